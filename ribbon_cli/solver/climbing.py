"""Climbing to saddles: up along the lowest modes of the projected Hessian, down along all others.

Cerjan & Miller (1981), J. Chem. Phys. 75, 2800: the Newton step with the sign of each component chosen, so
that what is stationary at its end has mostly the index asked for. Each step is drawn back to the constraints.
Dense algebra, O(N^3) a step: for coarse meshes, N up to 60 or so. Newton's method settles what was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from ..model.band import Array
from ..model.problem import Problem
from .arclength import nearest
from .kkt import FactorisationError, KKTMatrix
from .linear import Factor
from .newton import Guard, iterate_at
from .newton import estimate_multipliers as estimated
from .saddle_free import null_space
from .status import STATIONARY, Result, Status
from .steps import change, inverted_facets

STEP_LIMIT = 0.15
"""Change of one step, as in `steps.change`; halved where a step cannot be drawn back to the constraints."""
SHORTEST_LIMIT = 1e-3
MOST_STEPS = 120
CLOSE = 1e-5
"""Residual from which Newton's method is tried; climbing goes on where that does not settle there."""
RESIDUAL = 1e-9
FLATTEST = 1e-8
"""Size of an eigenvalue up to which a mode counts as flat."""
DRAWN_BACK = 1e-12
MOST_CORRECTIONS = 8


def climb(
    problem: Problem, x: Array, modes: int, guard: Guard | None = None, most_steps: int = MOST_STEPS
) -> Result:
    """The stationary point met from x (7N,) by climbing so many of the lowest modes, mostly of that index.

    `guard` says what is wrong with a state on the way. Nothing is raised: the result says how it ended.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _climb(problem, x, modes, guard, most_steps)


def _climb(problem: Problem, x: Array, modes: int, guard: Guard | None, most_steps: int) -> Result:
    limit, tried, steps = STEP_LIMIT, np.inf, 0
    try:
        while steps < most_steps:
            here = iterate_at(problem, x, estimated(problem, x))
            if here.worst < min(CLOSE, 0.1 * tried):
                found = replace(nearest(here.state, guard), steps=steps)
                if found.status in STATIONARY or here.worst < RESIDUAL:
                    return found
                tried = here.worst
            basis = null_space(problem, here.local, problem.rotations(x))
            hessian = problem.hessian_matrix(here.local)
            values, vectors = scipy.linalg.eigh(basis.T @ (hessian @ basis))
            gradient = problem.lagrangian_gradient(here.local, here.multipliers)
            step = -(vectors.T @ (basis.T @ gradient)) / np.maximum(np.abs(values), FLATTEST)
            step[:modes] *= -1.0
            trial = _drawn_back(problem, x, basis @ (vectors @ step), limit)
            if trial is None:
                limit *= 0.5
                if limit < SHORTEST_LIMIT:
                    return here.ended(Status.STALLED, None, steps=steps)
                continue
            x, steps = trial, steps + 1
            complaint = None if guard is None else guard(problem.state(x))
            if complaint:
                last = iterate_at(problem, x, None)
                return last.ended(Status.LEFT_TOPOLOGY, None, steps=steps, detail=complaint)
    except FactorisationError as error:
        return iterate_at(problem, x, None).ended(Status.STALLED, None, steps=steps, detail=f"({error}.)")
    return iterate_at(problem, x, None).ended(Status.ITERATION_LIMIT, None, steps=steps)


def _drawn_back(problem: Problem, x: Array, move: Array, limit: float) -> Array | None:
    """A move no longer than the limit, drawn back to the constraints; None where that fails.

    Raises FactorisationError where the constraints are linearly dependent.
    """
    y = x + move * min(1.0, limit / max(change(x, move), 1e-300))
    local = problem.local_derivatives(x, None)
    normal = Factor(KKTMatrix(problem, local, np.zeros((problem.size, 0))).with_unit_metric())
    for _ in range(MOST_CORRECTIONS):
        back = np.concatenate((np.zeros(problem.size), -problem.weighted_constraints(y)))
        y = y + normal.solve(back)[: problem.size]
        if not np.isfinite(y).all():
            return None
        if np.abs(problem.constraints(y)).max() < DRAWN_BACK:
            break
    if (inverted_facets(problem, y) <= 0).any() or change(x, y - x) > 3.0 * limit:
        return None
    return y
