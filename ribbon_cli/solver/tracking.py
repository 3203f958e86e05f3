"""Whether a step in width stayed on its branch.

Newton's method converges to some stationary point at the new width; past a fold it can only be one of
another branch. On a branch x(b) the slopes dx/db and dE/db are known at both ends, and the step must agree
with them: to fourth order E_1 - E_0 is the corrected trapezoid db/2 (E'_0 + E'_1) + db^2/12 (E''_0 - E''_1),
and to second x_1 - x_0 is db/2 (x'_0 + x'_1). Where it does not agree, points in between decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..model.band import Array, State
from ..model.problem import Problem
from ..model.width import constraints_by_width, energy_by_width, gradient_by_width
from .kkt import FactorisationError, KKTMatrix
from .linear import Factor
from .newton import change
from .prolongation import Phase, clear_phase

ENERGY_MISFIT = 2e-3
"""Largest error of the corrected trapezoid, relative to the energy that the step covers: 5e-4 on pi bands
over b = 0.5 to 0.8, 6e-2 and more where a step of that length fell off its branch."""
STATE_MISFIT = 0.1
"""Largest change that is left when the step by the slopes is taken off: 0.09 on pi bands over b = 0.2 to
0.5, about 1 where a step fell off."""
PARTS = 5
"""How often a doubtful step is halved to see whether its parts agree."""


@dataclass(frozen=True)
class BranchPoint:
    """A stationary point with its slopes along the branch.

    `slope` (7N,) and `multiplier_slope` (5N+3,) are dx/db and dlambda/db without rigid rotation; `rise` is
    dE/db and `bend` d2E/db2.
    """

    state: State
    multipliers: Array
    energy: float
    slope: Array
    multiplier_slope: Array
    rise: float
    bend: float
    phase: Phase | None

    @classmethod
    def at(cls, state: State, multipliers: Array) -> BranchPoint:
        """The slopes at a stationary point with multipliers (5N+3,).

        They solve Newton's system (2.57) with the derivatives of its right-hand side with respect to b.
        Raises FactorisationError where it is singular: at a fold.
        """
        problem, x = Problem(state.band), state.vector()
        local = problem.local_derivatives(x, multipliers)
        matrix = KKTMatrix(problem, local, problem.rotations(x))
        force = gradient_by_width(problem, x, multipliers, local.gradient)
        opening = constraints_by_width(problem, x)
        z = Factor(matrix).solve(np.concatenate((-force, -opening, np.zeros(matrix.gauge))))
        slope, change_of_multipliers = z[: problem.size], -z[problem.size : problem.size + problem.rows]
        return cls(
            state,
            multipliers,
            local.energy,
            slope,
            change_of_multipliers,
            energy_by_width(problem, x, multipliers),
            float(force @ slope - opening @ change_of_multipliers),  # L is linear in b
            clear_phase(state),
        )

    @property
    def half_width(self) -> float:
        """The half-width b."""
        return self.state.band.half_width


def agree(a: BranchPoint, b: BranchPoint) -> bool:
    """Whether the slopes at two points account for the difference of their energies and of their states.

    Where the inflections went from nodes to facets' middles or back, the shape slid by half a facet, which
    costs next to nothing: then only energies are compared.
    """
    width = b.half_width - a.half_width
    expected = width * (0.5 * (a.rise + b.rise) + width / 12.0 * (a.bend - b.bend))
    scale = abs(width) * max(abs(a.rise), abs(b.rise))
    if not abs(b.energy - a.energy - expected) <= ENERGY_MISFIT * scale:
        return False
    if slid(a.phase, b.phase):
        return True
    x = a.state.vector()
    rest = b.state.vector() - x - 0.5 * width * (a.slope + b.slope)
    return change(x, rest) <= STATE_MISFIT


def slid(a: Phase | None, b: Phase | None) -> bool:
    """Whether two grid phases are known and differ."""
    return a is not None and b is not None and a is not b


Solver = Callable[[State, Array], tuple[State, Array] | None]
"""A stationary point near a state, from multipliers, or None."""


def follows(start: tuple[State, Array], end: tuple[State, Array], solve: Solver, parts: int) -> bool:
    """Whether a stationary point lies on the branch of another one, at another width.

    `start` and `end` are states with their multipliers (5N+3,). Where their slopes do not agree, the
    branch is followed from `start` by `solve` to the width in the middle, and both halves are looked at,
    `parts` times.
    """
    try:
        return _follows(BranchPoint.at(*start), BranchPoint.at(*end), solve, parts)
    except FactorisationError:
        return False


def _follows(a: BranchPoint, b: BranchPoint, solve: Solver, parts: int) -> bool:
    if agree(a, b):
        return True
    if parts == 0:
        return False
    middle = a.state.band.with_half_width(0.5 * (a.half_width + b.half_width))
    found = solve(State(middle, a.state.u, a.state.g, a.state.xi), a.multipliers)
    if found is None:
        return False
    point = BranchPoint.at(*found)
    return _follows(a, point, solve, parts - 1) and _follows(point, b, solve, parts - 1)
