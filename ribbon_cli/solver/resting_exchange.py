"""Which gaps push: sequential quadratic programming with gaps as inequalities.

From a place near a shape at rest, that may cross itself a little, each step takes the gaps that are nearly
closed, with the sides on which features are to stay (`model.touching_sides`), finds the forces of the
quadratic problem by non-negative least squares, and makes one Newton step with the rows of gaps that push. So
a vertex that slides off a facet is exchanged for one on the next facet without more ado. Stationary points
that are saddles are left to the lower side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..model.band import Array, Band, State
from ..model.touching import Shape
from ..model.touching_distances import Distances
from ..model.touching_gaps import Pairs, places
from ..model.touching_sides import Sides
from .kkt import FactorisationError, KKTMatrix
from .linear import Factor
from .newton import Options, Stepper, iterate_at, solve
from .resting import RestingProblem
from .resting_kkt import RestingDerivatives, kkt_matrix
from .status import STATIONARY, Iterate, Result, Status
from .steps import turned

OFF = 1e-6
"""How far off its features, in their coordinates, a place of contact may be."""
NEARLY_CLOSED = 1e-3
"""Gap, as part of l, up to which it is taken into the quadratic problem."""
CROSSED = 5e-3
"""Depth, as part of l, from which a shape crosses itself too deeply to go on."""
MOST_STEPS, MOST_STUCK, MOST_SADDLES = 60, 12, 4
PROXIMAL, MOST_PROXIMAL = 1e-2, 1e6
DEPENDENT = 1e-9
"""Eigenvalue of the gaps' compliance, relative to the largest, below which gaps depend on each other."""
SMALL = 1e-4
"""Force, as part of the largest, below which a pair does not push at first."""
RUNS_AWAY = 100.0
"""Force, as a multiple of the energy over the unit of length, from which a search leads nowhere."""
SERVES = 1e-9
"""Depth, as part of l, up to which gaps without force leave those with it as they are."""


class NoRestError(Exception):
    """No active set was found; the message says why."""


class GapLostError(NoRestError):
    """A shape, or the way to it, passes through itself, or has features nearer than they are to be."""


class AstrayError(NoRestError):
    """A search went far from where it began: no other one from there will do."""


class Exchange:
    """The search for the stationary point near x (7N,) whose gaps push or are open.

    `farthest` is the change from the start beyond which it goes somewhere else.
    """

    def __init__(
        self,
        band: Band,
        sides: Sides | Distances,
        farthest: float,
        gap: float = 0.0,
        near_saddle: float = Options.near_saddle,
    ) -> None:
        self.band, self.sides, self.farthest, self.gap = band, sides, farthest, gap
        self.options = Options(leave_saddles=0, near_saddle=near_saddle)
        self.saddle: tuple[RestingProblem, Result] | None = None
        self.saddles = 0
        self.steps = 0

    def rest(self, x: Array, own: Array, pairs: Pairs, forces: Array) -> tuple[RestingProblem, Result]:
        """The stationary point, from multipliers and the forces of some pairs. Raises NoRestError."""
        forces = np.where(forces > SMALL * forces.max(initial=0.0), forces, 0.0)
        known = dict(zip(pairs.names(), forces.tolist(), strict=True))
        start, working, best, stuck = x, Pairs.none(), np.inf, 0
        for self.steps in range(MOST_STEPS):
            before = set(working.names())
            working, pushing_forces = self._working(x, own, known, working)
            if set(working.names()) != before:
                best, stuck = np.inf, 0
            problem = RestingProblem(self.band, working, self.gap)
            point = iterate_at(problem, x, np.concatenate((own, pushing_forces)))
            if not pushing_forces.max(initial=0.0) <= RUNS_AWAY * point.energy:
                raise AstrayError(f"forces grow beyond {RUNS_AWAY * point.energy:.1e}")
            beside: Array | None = None
            if point.worst <= self.options.goal or (point.worst <= self.options.tolerance and stuck > 1):
                result, beside = self._ended(problem, point)
                if result is not None:
                    return problem, result
                best, stuck = np.inf, 0
            else:
                stuck, best = (0, point.worst) if point.worst < 0.5 * best else (stuck + 1, best)
                following = None if stuck > MOST_STUCK else Stepper(problem, self.options).step(point)
                if following is None:
                    raise NoRestError(f"no step makes progress ({point.worst:.1e}, {len(working)} gaps)")
                x, (own, pushing_forces) = following.x, problem.split(following.multipliers)
            if beside is not None:
                x = beside
            if turned(start, x - start) > self.farthest:
                raise AstrayError("the search goes somewhere else")
            known = dict(zip(working.names(), pushing_forces.tolist(), strict=True))
        raise NoRestError(f"too many steps ({best:.1e}, {len(working)} gaps)")

    def _ended(self, problem: RestingProblem, point: Iterate) -> tuple[Result | None, Array | None]:
        """The result of a stationary point, or where to go on from if it is a saddle."""
        result = solve(problem, point.x, point.multipliers, replace(self.options, max_steps=4))
        if result.status not in STATIONARY:
            raise NoRestError(f"{result.status.value} at the end")
        if result.status is Status.SADDLE:
            self.saddle = problem, result
        if result.status is Status.SADDLE and self.saddles < MOST_SADDLES:
            self.saddles += 1
            beside = Stepper(problem, self.options).left(iterate_at(problem, result.x, result.multipliers))
            if beside is not None:
                return None, beside
        return result, None

    def _working(
        self, x: Array, own: Array, known: dict[tuple[int, int, int, int], float], working: Pairs
    ) -> tuple[Pairs, Array]:
        """The gaps that push at x, and their forces; those before while they serve."""
        length, shape = self.band.length, Shape.of(State.from_vector(self.band, x), self.gap)
        near, value = self.sides.near(shape, self.gap + CROSSED * length)
        value = value - self.gap
        keep = value <= NEARLY_CLOSED * length
        possible, value = near.take(keep), value[keep]
        forces = np.array([known.get(name, 0.0) for name in possible.names()])
        # Where gaps depend on each other forces can be shared out in many ways: one that serves is kept.
        pushes = forces > 0.0
        if len(working) == pushes.sum() and (value[~pushes] >= -SERVES * length).all():
            return possible.take(pushes), forces[pushes]
        return pushing_at(RestingProblem(self.band, possible, self.gap), x, own, forces)


def pushing_at(problem: RestingProblem, x: Array, own: Array, forces: Array) -> tuple[Pairs, Array]:
    """The problem's gaps that push in the quadratic problem at x, and their forces there.

    With p = p_0 + V f for forces f, V = K^-1 G^T, linearised gaps are q + M f with M = G V, and f >= 0
    minimises f.M f / 2 + q.f: a problem of non-negative least squares, of which M may be singular. K has
    `PROXIMAL` or more added to W: at a stationary point that changes no force, and soft modes would drown all
    differences between gaps. Where gaps depend on each other, some that suffice get all the force.
    """
    if not len(forces):
        return problem.pairs, forces
    found = compliance(problem, x, own, forces)
    share = pushing(found.m, found.away)
    keep = share > 0.0
    return problem.pairs.take(keep), share[keep]


@dataclass(frozen=True)
class Compliance:
    """How gaps give way to forces, `m` (k,k), and what they are without any, `away` (k,), in the quadratic
    problem at a place."""

    m: Array
    away: Array


def compliance(problem: RestingProblem, x: Array, own: Array, forces: Array) -> Compliance:
    """That of the problem's gaps at x, with multipliers and forces. Raises NoRestError where the problem's
    matrix is too nearly singular."""
    local = problem.local_derivatives(x, np.concatenate((own, forces)))
    assert isinstance(local, RestingDerivatives)
    assert local.touched is not None
    rows = problem.rows_of(local.touched.jacobian)
    matrix = kkt_matrix(problem, local.keeping(0), problem.rotations(x))
    n, none, tail = problem.size, np.zeros(problem.base.rows), np.zeros(matrix.tail)
    gradient = problem.base.lagrangian_gradient(local.free, own) - forces @ rows
    try:
        factor = _convex(matrix)
        p = factor.solve(np.concatenate((-gradient, -local.free.constraints, tail)))[:n]
        v = np.array([factor.solve(np.concatenate((row, none, tail)))[:n] for row in rows])
    except FactorisationError as failure:
        raise NoRestError(str(failure)) from failure
    m = rows @ v.T
    return Compliance(m, problem.gaps(x).value - problem.gap + rows @ p - m @ forces)


def _convex(matrix: KKTMatrix) -> Factor:
    """Factors with as much added to W as makes it positive definite on the constraints' null space."""
    added = PROXIMAL
    while (factor := Factor(matrix, shift=-added)).surplus > 0 and added < MOST_PROXIMAL:
        added *= 10.0
    return factor


def off_features(shape: Shape, pairs: Pairs) -> Array:
    """How far off (k,) places of contact are from their features, in the features' coordinates."""
    at = places(shape, pairs)
    out: Array = np.maximum(-at, at - 1.0).max(axis=1, initial=0.0)
    return out


def pushing(m: Array, away: Array) -> Array:
    """Forces f >= 0 (k,) with m f + away >= 0 where f = 0 and = 0 where f > 0, m (k,k) symmetric, which
    may be singular: of gaps that depend on each other some that suffice get all the force. Raises
    NoRestError where no gap gives way to a force, as may be far from any minimum."""
    if not (np.isfinite(m).all() and np.isfinite(away).all()):
        raise NoRestError("gaps have no derivatives, as where edges that touch are parallel")
    values, axes = np.linalg.eigh(0.5 * (m + m.T))
    if values[-1] <= 0.0:
        raise NoRestError("no gap gives way to a force there")
    least = DEPENDENT * float(values[-1])
    root = np.sqrt(np.maximum(values, 0.0) + least)
    shared = scipy.optimize.nnls(root[:, None] * axes.T, -(axes.T @ away) / root)[0]
    # The same sum of forces by as few of these gaps as are independent.
    at = np.flatnonzero(shared > 0.0)
    values, axes = np.linalg.eigh(m[np.ix_(at, at)]) if at.size else (values, axes)
    clear = values > least
    if at.size and not clear.all():
        rows = np.sqrt(values[clear])[:, None] * axes[:, clear].T
        shared[at] = scipy.optimize.nnls(rows, rows @ shared[at])[0]
    out: Array = shared
    return out
