"""The planar elastica under its weight and a dead end force, by SciPy's boundary-value solver.

Unknowns over the arclength: theta, kappa = theta', x, y and the potential's density summed up, with the force
n = (n_x, n_y) that the rest of the strip exerts on the part before s. A strip of weight w per area has
the weight 2 b w per length, along -y, so n_x is constant and n_y(s) = V - 2 b w (l - s) with the end's V.
Moments balance where b theta'' = n_x sin theta - n_y cos theta. Lengths are in units of l and forces in
units of b/l^2 inside: the weight is 2 w l^3 there, and the half-width scales all energies and reactions.

The total potential is U = b/2 int kappa^2 + 2 b w int y - end_force . r(l): gravity's part is zero at the
start's midpoint, and that of the end's force where the end is there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from .planar import buckled

Array = NDArray[np.float64]
TOLERANCE = 1e-8
"""Of the relative residual, that is of derivatives: energies and reactions are then right to 1e-10."""
_NODES = 201


@dataclass(frozen=True)
class Heavy:
    """An equilibrium: `bending`, `energy` (the total potential), `lifted` int y ds, the end's place and
    angle, and reactions; of a free end `force` is the load on it and `moment` is zero."""

    half_width: float
    length: float
    bending: float
    energy: float
    lifted: float
    end: tuple[float, float]
    tilt: float
    force: tuple[float, float, float]
    moment: tuple[float, float, float]
    start_force: tuple[float, float, float]
    start_moment: tuple[float, float, float]
    angle: Callable[[Array], Array]


def clamped_clamped(
    span: float,
    half_width: float,
    gravity: float,
    *,
    side: int = 1,
    lift: float = 0.0,
    tilt: float = 0.0,
    length: float = 1.0,
) -> Heavy:
    """Between clamps, near the weightless strip that is buckled to +y (`side` = 1) or -y (-1)."""
    start = buckled(span / length, 1.0)
    s = np.linspace(0.0, 1.0, _NODES)
    theta = side * start.angle(s)
    guess = _guess(s, theta, side * start.curvature(s))

    def ends(a: Array, b: Array, p: Array) -> Array:
        wanted = (span / length, lift / length)
        return np.array([*a[[0, 2, 3, 4, 5]], b[0] - tilt, b[2] - wanted[0], b[3] - wanted[1]])

    weight = 2.0 * gravity * length**3
    return _solve(s, guess, np.array([start.force[0], 0.0]), weight, ends, half_width, length, (0.0, 0.0))


def cantilever(
    half_width: float,
    gravity: float = 0.0,
    *,
    end_force: tuple[float, float] = (0.0, 0.0),
    length: float = 1.0,
    steps: int = 8,
) -> Heavy:
    """Clamped at the start, the end free but for a dead force; the loads grow in steps from zero."""
    s = np.linspace(0.0, 1.0, _NODES)
    guess = _guess(s, np.zeros_like(s), np.zeros_like(s))
    load = np.array(end_force) * length**2 / half_width
    weight = 2.0 * gravity * length**3

    for part in np.linspace(0.0, 1.0, steps + 1)[1:-1]:

        def between(a: Array, b: Array, p: Array, part: float = float(part)) -> Array:
            return np.array([*a[[0, 2, 3, 4, 5]], b[1], *(p - part * load)])

        found = _run(s, guess, part * load, part * weight, between, 1e-3)
        s, guess = found.x, found.y

    def ends(a: Array, b: Array, p: Array) -> Array:
        return np.array([*a[[0, 2, 3, 4, 5]], b[1], *(p - load)])

    return _solve(s, guess, load, weight, ends, half_width, length, end_force)


def _guess(s: Array, theta: Array, kappa: Array) -> Array:
    step = s[1] - s[0]

    def summed(values: Array) -> Array:
        return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1])) * step))

    x, y = summed(np.cos(theta)), summed(np.sin(theta))
    return np.array([theta, kappa, x, y, summed(0.5 * kappa**2), summed(y)])


def _run(
    s: Array, guess: Array, force: Array, weight: float, ends: Callable[..., Array], tolerance: float
) -> Any:
    def rates(s: Array, z: Array, p: Array) -> Array:
        theta, kappa = z[0], z[1]
        n_y = p[1] - weight * (1.0 - s)
        turning = p[0] * np.sin(theta) - n_y * np.cos(theta)
        return np.array([kappa, turning, np.cos(theta), np.sin(theta), 0.5 * kappa**2, z[3]])

    found = solve_bvp(rates, ends, s, guess, p=force, tol=tolerance, bc_tol=1e-10, max_nodes=20000)
    if not found.success:
        raise ValueError(f"no equilibrium found: {found.message}")
    return found


def _solve(
    s: Array,
    guess: Array,
    force: Array,
    weight: float,
    ends: Callable[..., Array],
    half_width: float,
    length: float,
    end_force: tuple[float, float],
) -> Heavy:
    found = _run(s, guess, force, weight, ends, TOLERANCE)
    first, last = found.y[:, 0], found.y[:, -1]
    unit = half_width / length**2
    moment = half_width / length
    bending = moment * float(last[4])
    end = (length * float(last[2]), length * float(last[3]))
    lifted = length**2 * float(last[5])
    free = end_force[0] * end[0] + end_force[1] * end[1]
    n = unit * found.p
    return Heavy(
        half_width,
        length,
        bending,
        bending + unit * weight / length * lifted - free,
        lifted,
        end,
        float(last[0]),
        (float(n[0]), float(n[1]), 0.0),
        (0.0, 0.0, moment * float(last[1])),
        (-float(n[0]), float(unit * weight - n[1]), 0.0),
        (0.0, 0.0, -moment * float(first[1])),
        lambda at: found.sol(at / length)[0],
    )
