"""The weight of a strip, zero where it lies at the start's midpoint.

With a weight w per area in the unit direction e, facet i (a quadrilateral with its midline h u_i and the
rulings g_i, g_{i+1} at its ends) has the first moment

    int r da = 2 b h r_i + (b^2 h / 3) tanh(xi_i) (g_i + g_{i+1}),      r_i = h (u_1 + ... + u_{i-1} + u_i /
    2),

exactly: its area element is (h + beta deta_i) dbeta dt with deta_i = u_i.(g_{i+1} - g_i) = (h/b) tanh xi_i,
(2.10).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..parts import HALF_WIDTH
from .band import Array, Band
from .constraints import sech_squared
from .stencil import G1, SIZE, G, U, X
from .term import Couplings, Term


class Gravity(Term):
    """The potential of dead weight; columns (M,) beyond the facets have none."""

    parameters = ("gravity",)
    load = True
    couplings: ClassVar[Couplings] = (("G1", "X"),)

    def __init__(self, band: Band) -> None:
        super().__init__(band)
        loads, n = band.parts.loads, band.segments
        direction = np.asarray(loads.gravity_direction, dtype=np.float64)
        size = float(np.linalg.norm(direction))
        self.direction = direction / size if size else direction
        self.weight = loads.gravity
        # 2 b h r_i summed over facets, as a sum over u_j; by b.
        self.arms = np.zeros(n if band.closed else n + 1)
        self.arms[:n] = 2.0 * band.h**2 * (n - 0.5 - np.arange(n))
        self.facets = (np.arange(self.arms.size) < n).astype(np.float64) * band.h / 3.0

    @property
    def active(self) -> bool:
        """Whether there is a weight."""
        return self.weight != 0.0

    def _down(self, vectors: Array) -> Array:
        return self.direction @ vectors

    def values(self, local: Array) -> Array:
        """Energies (M,) by facet."""
        b = self.band.half_width
        offset = self.facets * np.tanh(local[X]) * self._down(local[G] + local[G1])
        out: Array = -self.weight * (b * self.arms * self._down(local[U]) + b * b * offset)
        return out

    def gradient(self, local: Array) -> Array:
        """Their gradients (14, M)."""
        b = self.band.half_width
        return -self.weight * (b * self._straight(local) + b * b * self._offset(local))

    def _straight(self, local: Array) -> Array:
        """Gradient of the part that is linear in b, by -w b."""
        out = np.zeros((SIZE, local.shape[1]))
        out[U] = self.direction[:, None] * self.arms
        return out

    def _offset(self, local: Array) -> Array:
        """Gradient of the part that is quadratic in b, by -w b^2."""
        out = np.zeros((SIZE, local.shape[1]))
        out[G] = out[G1] = self.direction[:, None] * (self.facets * np.tanh(local[X]))
        out[X] = self.facets * sech_squared(local[X]) * self._down(local[G] + local[G1])
        return out

    def add_hessian(self, local: Array, hessian: Array) -> None:
        """Add their Hessians."""
        steep = (-self.weight * self.band.half_width**2) * self.facets * sech_squared(local[X])
        hessian[G, X] += self.direction[:, None] * steep
        hessian[G1, X] += self.direction[:, None] * steep
        hessian[X, X] -= 2.0 * np.tanh(local[X]) * steep * self._down(local[G] + local[G1])

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """By the half-width and by the weight."""
        b, w = self.band.half_width, self.weight
        straight = float((self.arms * self._down(local[U])).sum())
        offset = float((self.facets * np.tanh(local[X]) * self._down(local[G] + local[G1])).sum())
        if parameter == HALF_WIDTH:
            gradient = -w * (self._straight(local) + 2.0 * b * self._offset(local))
            return -w * (straight + 2.0 * b * offset), gradient
        if parameter in self.parameters:
            gradient = -b * self._straight(local) - b * b * self._offset(local)
            return -b * straight - b * b * offset, gradient
        return super().rate(parameter, local)

    def second_rate(self, parameter: str, local: Array) -> float:
        """By the half-width."""
        if parameter != HALF_WIDTH:
            return 0.0
        return (
            -2.0
            * self.weight
            * float((self.facets * np.tanh(local[X]) * self._down(local[G] + local[G1])).sum())
        )

    def resultant(self) -> Array:
        """The whole weight (3,)."""
        band = self.band
        return self.weight * 2.0 * band.half_width * band.length * self.direction
