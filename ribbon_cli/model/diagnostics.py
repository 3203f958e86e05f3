"""Derivative checks by Taylor remainders, for anyone who changes an energy, a constraint or a problem.

If the first k terms of a Taylor expansion are right, the remainder falls like t^(k+1) with the step t.
Large steps show higher orders and small ones roundoff, so the slope is read off the straightest window
of many step sizes, as in Boumal (2023), An Introduction to Optimization on Smooth Manifolds, 4.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .band import Array
from .problem import Problem

STEPS = np.logspace(-7.0, 0.0, 43)
WINDOW = 12  # two decades of STEPS
EXACT = 64.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class TaylorSlope:
    """Slope of the remainder in log-log scale, infinite where the expansion is exact.

    `steps` and `remainders` (n,) are all that were measured, `window` the steps of the straightest part.
    """

    slope: float
    window: tuple[float, float]
    steps: Array
    remainders: Array


def taylor_slopes(
    function: Callable[[Array], Array | float],
    x: Array,
    direction: Array,
    terms: Sequence[Array | float],
    steps: Array = STEPS,
) -> tuple[TaylorSlope, ...]:
    """Slopes of the remainders of function(x + t d) after 0, 1, ... of the given terms.

    `terms` are the directional derivatives Df[d], D2f[d, d], ...; right ones give slopes 1, 2, ...,
    len(terms) + 1. Values may be scalars or arrays of one shape; remainders are their largest entries.
    """
    start = np.asarray(function(x), dtype=np.float64)
    moved = [np.asarray(function(x + t * direction), dtype=np.float64) - start for t in steps]
    size = float(np.abs(start).max()) + max(float(np.abs(m).max()) for m in moved)
    out = []
    expansion = [np.zeros_like(start) for _ in steps]
    for order in range(len(terms) + 1):
        if order > 0:
            factors = [t**order / math.factorial(order) for t in steps]
            term = np.asarray(terms[order - 1])
            expansion = [e + f * term for e, f in zip(expansion, factors, strict=True)]
        remainders = np.array(
            [np.abs(m - e).max() for m, e in zip(moved, expansion, strict=True)], dtype=np.float64
        )
        out.append(_straightest(steps, remainders, EXACT * size))
    return tuple(out)


def _straightest(steps: Array, remainders: Array, roundoff: float) -> TaylorSlope:
    """Fit lines to all windows that stand clear of roundoff and keep the one of least deviation."""
    clear = remainders > roundoff
    best = TaylorSlope(math.inf, (float(steps[0]), float(steps[-1])), steps, remainders)
    least = math.inf
    width = min(WINDOW, steps.size)
    for first in range(steps.size - width + 1):
        part = slice(first, first + width)
        if not clear[part].all():
            continue
        t, r = np.log(steps[part]), np.log(remainders[part])
        t_mean, r_mean = t.mean(), r.mean()
        slope = float((t - t_mean) @ (r - r_mean) / ((t - t_mean) @ (t - t_mean)))
        deviation = float(np.abs(r - r_mean - slope * (t - t_mean)).max())
        if deviation < least:
            least = deviation
            best = TaylorSlope(
                slope, (float(steps[first]), float(steps[first + width - 1])), steps, remainders
            )
    return best


def problem_slopes(problem: Problem, x: Array, multipliers: Array, direction: Array) -> dict[str, float]:
    """Taylor slopes of a problem's derivatives at x (7N,) along a direction (7N,).

    Expected: `energy` 2, `constraints` 2, `lagrangian` 3 (value by gradient and Hessian), `gradient` 2
    (gradient of the Lagrangian by its Hessian). Components of the direction that are held are ignored.
    """
    d = np.where(problem.fixed, 0.0, direction)
    jacobian, hessian = problem.jacobian(x), problem.hessian(x, multipliers)

    def value(y: Array) -> float:
        return problem.energy(y) - float(multipliers @ problem.weighted_constraints(y))

    def gradient(y: Array) -> Array:
        out: Array = problem.gradient(y) - problem.jacobian(y).T @ multipliers
        return out

    tangent = problem.gradient(x)
    pushed = hessian @ d
    slopes = {
        "energy": taylor_slopes(problem.energy, x, d, [float(tangent @ d)]),
        "constraints": taylor_slopes(problem.weighted_constraints, x, d, [jacobian @ d]),
        "lagrangian": taylor_slopes(value, x, d, [float(gradient(x) @ d), float(d @ pushed)]),
        "gradient": taylor_slopes(gradient, x, d, [pushed]),
    }
    return {name: found[-1].slope for name, found in slopes.items()}
