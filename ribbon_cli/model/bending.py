"""The bending energy as a term, and what natural curvature adds to it.

With the natural curvature k0 along the midline and Poisson's ratio nu, the density
((1 - nu) |II - k0|^2 + nu (tr(II - k0))^2) / 4 of a developable surface is H^2 less a term linear in k0. Per
length of the midline that is -b k0 kappa ((1 - nu) + nu (1 + eta^2)), and the constant is b k0^2 / 2; see
docs/strips.md. Discretely kappa_i h = g_i.(u_{i-1} x u_i), (3.1), and 1 + eta^2 = |g_i|^2.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..parts import CLAMPED, HALF_WIDTH
from .band import Array, Band
from .constraints import NodeConstraints
from .energy import NodeEnergy, energy_derivatives, energy_terms
from .stencil import SIZE, U0, G, U, add_cross, add_diagonal, cross, dot
from .term import Couplings, Term


def folds(band: Band) -> Array | float:
    """Which nodes are folded (M,): all of a closed band, and of a strip those at clamps and between the
    ends."""
    ends = band.parts.ends
    if ends is None:
        return 1.0
    out = np.ones(band.segments + 1)
    out[[0, -1]] = float(ends.start == CLAMPED), float(ends.end == CLAMPED)
    return out


def cells(band: Band) -> Array | float:
    """Factors (M,) on the bending energies of the nodes: 2 at clamps, where a fold spans half a cell."""
    return folds(band) if band.closed else folds(band) * _halves(band, 2.0)


def _halves(band: Band, factor: float) -> Array:
    out = np.ones(band.segments + 1)
    out[[0, -1]] = factor
    return out


class Bending(Term):
    """Wunderlich's bending energy Q_h, Koldaev (2022), (2.14)."""

    def __init__(self, band: Band) -> None:
        super().__init__(band)
        self.cells = cells(band)

    @property
    def active(self) -> bool:
        """Always."""
        return True

    def values(self, local: Array) -> Array:
        """Energies (M,) by node."""
        return energy_terms(self.band, local, self.cells)

    def at(self, local: Array, shared: NodeConstraints) -> NodeEnergy:
        """The energies at local vectors, which share what constraints know of these."""
        return NodeEnergy(self.band, local, shared.fold, shared.fold_square, shared.ruling_square, self.cells)

    def gradient(self, local: Array) -> Array:
        """Gradients (14, M)."""
        return energy_derivatives(self.band, local, self.cells)[1]

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """By the half-width, to which the energy is proportional."""
        if parameter != HALF_WIDTH:
            return super().rate(parameter, local)
        terms, gradient = energy_derivatives(self.band, local, self.cells)
        b = self.band.half_width
        return float(terms.sum()) / b, gradient / b


class NaturalCurvature(Term):
    """What a natural curvature adds to the bending energy."""

    parameters = ("natural_curvature",)
    couplings: ClassVar[Couplings] = (("U0", "U"),)

    def __init__(self, band: Band) -> None:
        super().__init__(band)
        self.natural = band.parts.material.natural_curvature
        self.poisson = band.parts.material.poisson
        self.folds = folds(band)
        # A fold at a clamp spans half a cell; where there is none, nothing is counted.
        lengths = np.full(band.segments, 1.0) if band.closed else self.folds * _halves(band, 0.5)
        self.covered = band.h * float(np.sum(lengths))

    @property
    def active(self) -> bool:
        """Whether there is a natural curvature."""
        return self.natural != 0.0

    def _constant(self, local: Array) -> float:
        """The constant by k0^2, spread over the nodes."""
        return 0.5 * self.band.half_width * self.covered / float(local.shape[1])

    def _per_unit(self, local: Array) -> Array:
        """The linear term by b k0, (M,)."""
        out: Array = -self.folds * self._stretch(local) * dot(local[G], cross(local[U0], local[U]))
        return out

    def _stretch(self, local: Array) -> Array:
        """(1 - nu) + nu |g|^2, (M,)."""
        return (1.0 - self.poisson) + self.poisson * dot(local[G], local[G])

    def _gradient_per_unit(self, local: Array) -> Array:
        u0, u, g = local[U0], local[U], local[G]
        stretch, turn = self._stretch(local), cross(u0, u)
        out = np.zeros((SIZE, local.shape[1]))
        out[U0], out[U] = stretch * cross(u, g), stretch * cross(g, u0)
        out[G] = stretch * turn + (2.0 * self.poisson * dot(g, turn)) * g
        out *= -self.folds
        return out

    def values(self, local: Array) -> Array:
        """Energies (M,) by node, the constant spread evenly."""
        k = self.natural
        out: Array = self.band.half_width * k * self._per_unit(local) + k * k * self._constant(local)
        return out

    def gradient(self, local: Array) -> Array:
        """Their gradients (14, M)."""
        return self.band.half_width * self.natural * self._gradient_per_unit(local)

    def add_hessian(self, local: Array, hessian: Array) -> None:
        """Add their Hessians."""
        u0, u, g = local[U0], local[U], local[G]
        factor = -self.band.half_width * self.natural * self.folds
        stretch, turn, twice = factor * self._stretch(local), cross(u0, u), 2.0 * self.poisson * factor
        add_cross(hessian[U0, U], -stretch * g)
        add_cross(hessian[U0, G], stretch * u)
        add_cross(hessian[U, G], -stretch * u0)
        hessian[U0, G] += (twice * cross(u, g))[:, None] * g
        hessian[U, G] += (twice * cross(g, u0))[:, None] * g
        hessian[G, G] += (twice * turn)[:, None] * g + (twice * g)[:, None] * turn
        add_diagonal(hessian[G, G], twice * dot(g, turn))

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """By the half-width, to which it is proportional, and by the natural curvature."""
        b, k = self.band.half_width, self.natural
        if parameter == HALF_WIDTH:
            return float(self.values(local).sum()) / b, self.gradient(local) / b
        if parameter in self.parameters:
            value = b * self._per_unit(local) + 2.0 * k * self._constant(local)
            return float(value.sum()), b * self._gradient_per_unit(local)
        return super().rate(parameter, local)

    def second_rate(self, parameter: str, local: Array) -> float:
        """By the natural curvature."""
        return self.band.half_width * self.covered if parameter in self.parameters else 0.0
