"""Folds and branch points of the planar elastica between clamps.

With stiffness 1 and length 1, theta'' = n_x sin theta - n_y cos theta is shot from the start, together with
its variational equations, with the unknowns p = (theta'(0), n_x, n_y). The end is at e(p) = (theta, x, y)(1),
and an equilibrium is critical where J = de/dp is singular. A fold in the tilt solves
e(p) = (tilt, span, lift) and det J = 0 for p and the tilt.

With tilt = 0 a half turn about the middle of the chord maps the clamps onto each other. Strips with this
symmetry, theta(s) = theta(1 - s), lose it at a branch point where theta'(0) = theta'(1) = 0: theta' then
solves the variational equation and vanishes at both ends, and moves the end by (cos theta, sin theta)(1)
- (cos theta, sin theta)(0) = 0, so that it is the critical mode; the strip slides along itself. Such a strip
is one period of the elastica from inflection to inflection, with the force along the chord. It leaves the
clamp at the angle alpha = 2 asin k to the chord, the chord is 2 E/K - 1 long, and the force is 16 K^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from .planar import Buckled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Critical:
    """A critical equilibrium for unit length and stiffness: multiply energy, force and moment by b/l, b/l^2
    and b/l, and the place by l."""

    span: float
    lift: float
    tilt: float
    energy: float
    force: tuple[float, float]
    moment: float


def shot(p: Array) -> tuple[Array, Array]:
    """(theta, theta', x, y, energy) (5,) at the end and its derivatives in p (5,3)."""

    def rates(s: float, packed: Array) -> Array:
        z, d = packed[:5], packed[5:].reshape(5, 3)
        sine, cosine = np.sin(z[0]), np.cos(z[0])
        value = [z[1], p[1] * sine - p[2] * cosine, cosine, sine, 0.5 * z[1] ** 2]
        bent = (p[1] * cosine + p[2] * sine) * d[0] + [0.0, sine, -cosine]
        slopes = np.array([d[1], bent, -sine * d[0], cosine * d[0], z[1] * d[1]])
        return np.concatenate((value, slopes.ravel()))

    first = np.zeros(20)
    first[1] = p[0]
    first[5 + 3] = 1.0
    last = solve_ivp(rates, (0.0, 1.0), first, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return last[:5], last[5:].reshape(5, 3)


def _determinant(d: Array) -> float:
    return float(np.linalg.det(d[[0, 2, 3]]))


def fold_in_tilt(span: float, lift: float, guess: tuple[float, float, float, float]) -> Critical:
    """The fold near `guess` = (theta'(0), n_x, n_y, tilt)."""

    def excess(q: Array) -> list[float]:
        z, d = shot(q[:3])
        return [z[0] - q[3], z[2] - span, z[3] - lift, _determinant(d)]

    return _critical(excess, guess)


def branch_point_in_span(lift: float) -> Critical:
    """Where strips with the half turn's symmetry lose it; 0 <= lift < 0.6."""

    def strip(angle: float) -> Buckled:
        return Buckled(1.0, 1.0, math.sin(angle / 2) ** 2)

    angle = float(brentq(lambda a: math.sin(a) * strip(a).span - lift, 0.0, 1.0, xtol=1e-15))
    found = strip(angle)
    size, chord = found.force[0], found.span
    direction = (math.cos(angle), math.sin(angle))
    force = (size * direction[0], size * direction[1])
    return Critical(chord * direction[0], chord * direction[1], 0.0, found.energy, force, 0.0)


def _critical(excess: Callable[[Array], list[float]], guess: tuple[float, ...]) -> Critical:
    found = root(excess, guess, tol=1e-11)
    if np.abs(excess(found.x)).max() > 1e-9:
        raise ValueError(f"no critical equilibrium found: {found.message}")
    z = shot(found.x[:3])[0]
    n = (float(found.x[1]), float(found.x[2]))
    return Critical(float(z[2]), float(z[3]), float(z[0]), float(z[4]), n, float(z[1]))
