"""The continuous surface through a discrete state, Koldaev (2022), section 2.2.

    r(alpha, beta) = int_0^alpha d' + beta g(alpha)                               (2.31)

with d'(alpha_{i+1/2}) = u_i (2.32) and g(alpha_i) = g_i (2.33). Between, d', g and xi are cubic splines, also
across the seam, where a one-sided band is joined to its other side: d' and g have two continuous derivatives.
The surface fulfils the constraints of the continuum to second order in h, (2.38)-(2.41).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .band import Array, State
from .energy import coth_factor
from .splines import BandSpline

_HALF_CELL_POINTS = 4
"""Gauss points on half a facet: the splines are cubic there, and squares of them are integrated exactly."""
_RULING_POINTS = 24
"""Gauss points along a ruling, in the variable in which H^2 da of a developable surface is constant."""


@dataclass(frozen=True)
class ConstraintResiduals:
    """Left-hand sides of the constraints of (1.57) on the reconstructed band, (n,) each, dimensionless.

    `tangent` |d'|^2 - 1; `ruling` |g|^2 - (g.d')^2 - 1 (2.38); `fold` d''.g (2.39), in 1/length; `flat`
    (d' x g).g' (2.40), in 1/length; `slope` b d'.g' - tanh xi (2.41).
    """

    tangent: Array
    ruling: Array
    fold: Array
    flat: Array
    slope: Array


class Reconstruction:
    """The continuous fields d', g and xi through a state whose seam is closed."""

    def __init__(self, state: State) -> None:
        self.band = state.band
        sigma = self.band.sigma
        self.tangent = BandSpline(self.band, state.u, 0.5, 1)
        self.ruling = BandSpline(self.band, state.g, 0.0, sigma)
        self.xi = BandSpline(self.band, state.xi, 0.5, sigma)

    def constraints(self, alpha: Array) -> ConstraintResiduals:
        """Constraints at arclengths alpha (n,)."""
        u, du = self.tangent(alpha), self.tangent(alpha, 1)
        g, dg = self.ruling(alpha), self.ruling(alpha, 1)
        return ConstraintResiduals(
            tangent=_dot(u, u) - 1.0,
            ruling=_dot(g, g) - _dot(g, u) ** 2 - 1.0,
            fold=_dot(du, g),
            flat=_dot(np.cross(u, g), dg),
            slope=self.band.half_width * _dot(u, dg) - np.tanh(self.xi(alpha)),
        )

    def density(self, alpha: Array) -> Array:
        """Bending energy per length zeta (n,) of (1.60), in 1/length."""
        du, g = self.tangent(alpha, 1), self.ruling(alpha)
        out: Array = (
            0.5 * self.band.half_width * _dot(du, du) * _dot(g, g) ** 2 * coth_factor(self.xi(alpha))[0]
        )
        return out

    def energy(self) -> float:
        """Q of (1.57) by Gauss quadrature of its density between the splines' knots."""
        alpha, weight = self.quadrature()
        return float(weight @ self.density(alpha))

    def surface_density(self, alpha: Array) -> Array:
        """The integral of H^2 da along each ruling, per length of the midline, (n,), in 1/length.

        It is computed from the surface's fundamental forms (1.40), without xi and without assuming that the
        surface is developable. Not-a-number where rulings meet within the band, which is no surface there.
        """
        u, du = self.tangent(alpha), self.tangent(alpha, 1)
        g, dg, ddg = self.ruling(alpha), self.ruling(alpha, 1), self.ruling(alpha, 2)
        b = self.band.half_width
        slope = _dot(u, dg)
        meets = b * np.abs(slope) >= 1.0
        slope = np.where(meets, 0.0, slope)
        # With beta = (exp(slope w) - 1) / slope, d beta / (1 + slope beta) is d w, and (1.48)'s integrand is
        # constant in w: in beta it peaks at the edge of the band beside an inflection.
        low, high = _log_ratio(slope, -b), _log_ratio(slope, b)
        total = np.zeros_like(slope)
        for point, share in zip(*np.polynomial.legendre.leggauss(_RULING_POINTS), strict=True):
            w = 0.5 * (low + high) + 0.5 * (high - low) * point
            beta = _exp_ratio(slope, w)[:, None]
            bent = _bending(u + beta * dg, g, du + beta * ddg, dg)
            total += share * 0.5 * (high - low) * np.exp(slope * w) * bent
        return np.where(meets, np.nan, total)

    def closure(self) -> Array:
        """d(l) - d(0) (3,), the integral of d' over the length, by quadrature."""
        alpha, weight = self.quadrature()
        out: Array = weight @ self.tangent(alpha)
        return out

    def quadrature(self) -> tuple[Array, Array]:
        """Points and weights (n,) on [0, l], Gauss's on each half of every facet."""
        half = 0.5 * self.band.h
        points, weights = np.polynomial.legendre.leggauss(_HALF_CELL_POINTS)
        starts = half * np.arange(2 * self.band.segments)
        alpha = starts[:, None] + 0.5 * half * (points + 1.0)
        return alpha.ravel(), np.tile(0.5 * half * weights, starts.size)


def _dot(a: Array, c: Array) -> Array:
    out: Array = np.einsum("ij,ij->i", a, c)
    return out


def _log_ratio(slope: Array, beta: float) -> Array:
    """log(1 + slope beta) / slope, which is beta where slope is 0."""
    x = slope * beta
    safe = np.where(np.abs(x) > 1e-8, x, 1.0)
    out: Array = beta * np.where(np.abs(x) > 1e-8, np.log1p(safe) / safe, 1.0 - 0.5 * x)
    return out


def _exp_ratio(slope: Array, w: Array) -> Array:
    """(exp(slope w) - 1) / slope, which is w where slope is 0."""
    x = slope * w
    safe = np.where(np.abs(x) > 1e-8, x, 1.0)
    out: Array = w * np.where(np.abs(x) > 1e-8, np.expm1(safe) / safe, 1.0 + 0.5 * x)
    return out


def _bending(along: Array, across: Array, second: Array, mixed: Array) -> Array:
    """H^2 times the area element (n,) from r_alpha, r_beta, r_alpha_alpha and r_alpha_beta (n,3).

    (1.46) in full with r_beta_beta = 0: H = (I_bb II_aa - 2 I_ab II_ab) / (2 det I).
    """
    normal = np.cross(along, across)
    area2 = _dot(normal, normal)
    first = _dot(across, across) * _dot(second, normal) - 2.0 * _dot(along, across) * _dot(mixed, normal)
    out: Array = 0.25 * first**2 / area2**2.5
    return out
