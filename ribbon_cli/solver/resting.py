"""Newton's method for a strip that rests on itself: gaps that are kept are rows, their forces multipliers.

L = E - lambda.c - f.(g - t): forces f push features apart, f >= 0 where a gap g may not be less than t.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model.band import Array, State
from ..model.problem import LocalDerivatives, Problem
from ..model.touching import Shape
from ..model.touching_gaps import Gaps, Pairs, arguments, gaps, vectors
from .kkt import KKTMatrix
from .linear import RESIDUAL_LIMIT, Factor
from .newton import change, inverted_facets
from .resting_kkt import Copies, RestingMatrix, pulled_back


class Touching:
    """Gaps of fixed pairs on a problem's x (7N,)."""

    def __init__(self, problem: Problem, pairs: Pairs, gap: float = 0.0) -> None:
        self.problem, self.pairs, self.gap = problem, pairs, gap
        self.what = arguments(pairs)
        self.copies = Copies.of(self.what)

    def __len__(self) -> int:
        return len(self.pairs)

    def at(self, x: Array) -> Gaps:
        """Gaps and derivatives at x."""
        shape = Shape.of(self.problem.state(x), self.gap)
        six = vectors(shape, self.what)
        return gaps(six, self.what, self.pairs.sign, self.problem.band.half_width)

    def pull(self, local: Array) -> Array:
        """The sum (7N,) of gradients (k,6,3) in the six vectors, in x."""
        on_copies = np.zeros((len(self.copies.kind), 3))
        np.add.at(on_copies, self.copies.slot.ravel(), local.reshape(-1, 3))
        return pulled_back(self.problem, self.copies, on_copies)


@dataclass(frozen=True, eq=False)
class RestingPoint:
    """A place with multipliers (5N+3,) and forces (k,), its derivatives and residuals."""

    touching: Touching
    x: Array
    multipliers: Array
    forces: Array
    local: LocalDerivatives
    gaps: Gaps
    gradient: Array
    kkt_residual: float
    constraint_residual: float
    gap_residual: float

    @classmethod
    def at(cls, touching: Touching, x: Array, multipliers: Array, forces: Array) -> RestingPoint:
        """Evaluate a place."""
        problem = touching.problem
        local = problem.local_derivatives(x, multipliers)
        found = touching.at(x)
        gradient = problem.lagrangian_gradient(local, multipliers)
        gradient = gradient - touching.pull(forces[:, None, None] * found.gradient)
        away = found.value - touching.gap
        return cls(
            touching,
            x,
            multipliers,
            forces,
            local,
            found,
            gradient,
            float(np.abs(gradient).max()),
            float(np.abs(local.constraints / problem.weights).max()),
            float(np.abs(away).max()) if away.size else 0.0,
        )

    @property
    def problem(self) -> Problem:
        """The problem without gaps."""
        return self.touching.problem

    @property
    def energy(self) -> float:
        """Q_h, with loads."""
        return self.local.energy

    @property
    def worst(self) -> float:
        """The largest residual."""
        return max(self.kkt_residual, self.constraint_residual, self.gap_residual)

    @property
    def state(self) -> State:
        """The shape."""
        return self.problem.state(self.x)

    @cached_property
    def matrix(self) -> KKTMatrix:
        """The KKT matrix here, with copies and gaps where there are pairs."""
        base = KKTMatrix(self.problem, self.local, self.problem.rotations(self.x))
        if not len(self.touching):
            return base
        hessian = -self.forces[:, None, None] * self.gaps.hessian
        return RestingMatrix(self.problem, base, self.touching.copies, self.gaps.gradient, hessian)

    def solve(self, factor: Factor, x: Array, constraints: Array, gaps: Array, limit: float = RESIDUAL_LIMIT) -> tuple[Array, Array, Array]:
        """Solve with right-hand sides for x (7N,), constraints and gaps: changes of x, of -lambda, of -f."""
        matrix, n, rows = self.matrix, self.problem.size, self.problem.rows
        q = matrix.size - n
        rhs = np.concatenate((x, np.zeros(q), constraints, np.zeros(matrix.gauge + q), gaps))
        z = factor.solve(rhs, limit=limit)
        first = n + q
        return z[:n], z[first : first + rows], z[z.size - len(gaps) :]

    def step(self, factor: Factor, limit: float = RESIDUAL_LIMIT) -> tuple[Array, Array, Array]:
        """Newton's step (7N,) with new multipliers and forces."""
        away = self.touching.gap - self.gaps.value
        p, by_lambda, by_force = self.solve(factor, -self.gradient, -self.local.constraints, away, limit)
        return p, self.multipliers - by_lambda, self.forces - by_force


@dataclass(frozen=True, eq=False)
class Newton:
    """How Newton's method ended: its last point, whether it converged, and its steps."""

    point: RestingPoint
    converged: bool
    steps: int
    why: str = ""


TOLERANCE = 1e-9
GOAL = 1e-11
MOST_STEPS = 12
LONGEST = 0.25


def newton(point: RestingPoint, most_steps: int = MOST_STEPS) -> Newton:
    """Plain Newton steps to the stationary point near a place, whatever it is.

    Ends where steps are longer than `LONGEST`, a facet turns over, or residuals do not fall.
    """
    problem = point.problem
    best, stuck = point, 0
    for steps in range(most_steps + 1):
        if point.worst <= GOAL:
            return Newton(point, True, steps)
        limit = max(RESIDUAL_LIMIT, 1e-3 * min(point.worst, 1.0), 0.1 * GOAL / point.worst)
        p, multipliers, forces = point.step(Factor(point.matrix), limit)
        size = change(point.x, p)
        if not np.isfinite(size):
            return Newton(best, False, steps, "not finite")
        t = min(1.0, LONGEST / max(size, 1e-300))
        following = RestingPoint.at(
            point.touching,
            point.x + t * p,
            point.multipliers + t * (multipliers - point.multipliers),
            point.forces + t * (forces - point.forces),
        )
        if not np.isfinite(following.worst) or (inverted_facets(problem, following.x) <= 0).any():
            return Newton(best, False, steps, "a facet turns over")
        if following.worst < 0.5 * best.worst:
            stuck = 0
        else:
            stuck += 1
            if best.worst <= TOLERANCE:
                return Newton(best if best.worst < following.worst else following, True, steps)
            if stuck > 4:
                return Newton(best, False, steps, "residuals do not fall")
        if following.worst < best.worst:
            best = following
        point = following
    return Newton(best, best.worst <= TOLERANCE, most_steps, "too many steps")
