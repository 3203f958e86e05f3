"""Strips with natural curvature k0 along the midline: the ring, arcs, and both with N facets.

Planar strips, so that Poisson's ratio does not matter: the linear term per unit length is
-(b k0 kappa)((1 - nu) + nu (1 + eta^2)) with eta = 0, the constant b k0^2/2, and in all
(b/2)(kappa - k0)^2. The derivation is in docs/strips.md. With facets, nodes i turn the tangent by angles d_i
and stand for lengths h_i: h between facets and h/2 at a clamp. The energy is

    sum_i b (1 - cos d_i)/h_i - b k0 sin d_i + b k0^2 h_i/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def ring_energy(half_width: float, natural_curvature: float, length: float = 2.0 * math.pi) -> float:
    """(b l/2)(2 pi/l - k0)^2."""
    return 0.5 * half_width * length * (2.0 * math.pi / length - natural_curvature) ** 2


def discrete_ring_energy(
    segments: int, half_width: float, natural_curvature: float, length: float = 2.0 * math.pi
) -> float:
    """The regular polygon of N facets: the sum above with d_i = 2 pi/N and h_i = l/N."""
    return segments * _fold(2.0 * math.pi / segments, length / segments, half_width, natural_curvature)


def _fold(turn: float, h: float, b: float, k0: float) -> float:
    return b * ((1.0 - math.cos(turn)) / h - k0 * math.sin(turn) + 0.5 * k0**2 * h)


@dataclass(frozen=True)
class Arc:
    """A circular arc between clamps that lie on it. The force vanishes; the moment is b (c - k0) along it."""

    curvature: float
    half_width: float
    natural_curvature: float = 0.0
    length: float = 1.0

    @property
    def tilt(self) -> float:
        """Angle from the start's to the end's tangent, c l."""
        return self.curvature * self.length

    @property
    def span(self) -> float:
        """sin(c l)/c."""
        return math.sin(self.tilt) / self.curvature

    @property
    def lift(self) -> float:
        """(1 - cos(c l))/c."""
        return (1.0 - math.cos(self.tilt)) / self.curvature

    @property
    def energy(self) -> float:
        """(b l/2)(c - k0)^2."""
        return 0.5 * self.half_width * self.length * (self.curvature - self.natural_curvature) ** 2

    @property
    def moment(self) -> tuple[float, float, float]:
        """(0, 0, b (c - k0))."""
        return 0.0, 0.0, self.half_width * (self.curvature - self.natural_curvature)


@dataclass(frozen=True)
class FoldedArc:
    """An arc of N facets that is an equilibrium of the discrete problem, to rounding.

    Without a force the moment M is the same in every fold. It is the derivative of the sum above in d_i,
    b (sin d_i/h_i - k0 cos d_i), so that the inner folds turn by one angle d and those at the clamps, where
    h_i = h/2, by one angle e with 2 sin e - k0 h cos e = M h/b.
    """

    segments: int
    turn: float
    half_width: float
    natural_curvature: float = 0.0
    length: float = 1.0

    @property
    def _h(self) -> float:
        return self.length / self.segments

    @property
    def moment(self) -> float:
        """M about z, of the end's clamp."""
        return self.half_width * (
            math.sin(self.turn) / self._h - self.natural_curvature * math.cos(self.turn)
        )

    @property
    def end_turn(self) -> float:
        """e, from 2 sin e - k0 h cos e = hypot(2, k0 h) sin(e - atan2(k0 h, 2))."""
        natural = self.natural_curvature * self._h
        ratio = self.moment * self._h / self.half_width / math.hypot(2.0, natural)
        return math.asin(ratio) + math.atan2(natural, 2.0)

    @property
    def angles(self) -> Array:
        """Angles (N,) of the facets' tangents."""
        return self.end_turn + self.turn * np.arange(self.segments)

    @property
    def tilt(self) -> float:
        """Angle from the start's to the end's tangent."""
        return 2.0 * self.end_turn + (self.segments - 1) * self.turn

    @property
    def span(self) -> float:
        """x of the end."""
        return self._h * float(np.cos(self.angles).sum())

    @property
    def lift(self) -> float:
        """y of the end."""
        return self._h * float(np.sin(self.angles).sum())

    @property
    def energy(self) -> float:
        """The sum of the module's docstring."""
        b, k0 = self.half_width, self.natural_curvature
        inner = (self.segments - 1) * _fold(self.turn, self._h, b, k0)
        return inner + 2.0 * _fold(self.end_turn, 0.5 * self._h, b, k0)
