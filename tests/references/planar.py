"""The planar elastica between clamps with parallel tangents, in elliptic functions.

With the angle theta of the tangent, the end's force (-P, 0) and stiffness b, moments balance where
b theta'' + P sin theta = 0. From theta(0) = 0 this is a pendulum that starts at its lowest point:
sin(theta/2) = k sn(q s, m), q = sqrt(P/b), m = k^2 (Love, A Treatise on the Mathematical Theory of
Elasticity, section 262). The strip that buckles to one side makes one period, q l = 4 K. Over a period
the means of sn^2 and cn^2 are (K - E)/(m K) and (E - (1 - m) K)/(m K), with K and E complete integrals at m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ellipe, ellipj, ellipk

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Buckled:
    """A strip buckled to +y: its energy and reactions, and what its shape follows from."""

    half_width: float
    length: float
    parameter: float

    @property
    def _rate(self) -> float:
        return 4.0 * float(ellipk(self.parameter)) / self.length

    @property
    def span(self) -> float:
        """int cos theta = l (1 - 2 m mean sn^2) = l (2 E/K - 1)."""
        return self.length * (2.0 * float(ellipe(self.parameter) / ellipk(self.parameter)) - 1.0)

    @property
    def energy(self) -> float:
        """b/2 int theta'^2 with theta' = 2 k q cn, that is 2 b l q^2 (E/K - 1 + m)."""
        m = self.parameter
        ratio = float(ellipe(m) / ellipk(m))
        return 2.0 * self.half_width * self.length * self._rate**2 * (ratio - 1.0 + m)

    @property
    def force(self) -> tuple[float, float, float]:
        """The end pushes back: (-P, 0, 0) with P = b q^2."""
        return -self.half_width * self._rate**2, 0.0, 0.0

    @property
    def moment(self) -> tuple[float, float, float]:
        """b theta'(l) = 2 b k q about z; at the start it is the opposite."""
        return 0.0, 0.0, 2.0 * self.half_width * math.sqrt(self.parameter) * self._rate

    @property
    def height(self) -> float:
        """y in the middle, int sin theta over half the length, 4 k/q."""
        return 4.0 * math.sqrt(self.parameter) / self._rate

    def angle(self, s: Array) -> Array:
        """theta at arclengths s."""
        sn = ellipj(self._rate * s, self.parameter)[0]
        found: Array = 2.0 * np.arcsin(math.sqrt(self.parameter) * sn)
        return found

    def curvature(self, s: Array) -> Array:
        """theta' at arclengths s."""
        cn = ellipj(self._rate * s, self.parameter)[1]
        found: Array = 2.0 * math.sqrt(self.parameter) * self._rate * cn
        return found


def buckled(span: float, half_width: float, length: float = 1.0) -> Buckled:
    """The strip of some span, -length < span < length, buckled to +y."""

    def excess(m: float) -> float:
        return Buckled(half_width, length, m).span - span

    return Buckled(half_width, length, float(brentq(excess, 1e-15, 1.0 - 1e-15, xtol=1e-16, rtol=1e-15)))


def euler_load(half_width: float, length: float = 1.0) -> float:
    """The axial reaction as the span tends to the length: -4 pi^2 b / l^2."""
    return -4.0 * math.pi**2 * half_width / length**2
