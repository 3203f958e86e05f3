"""From one shape of a strip that rests on itself to the next one, and which gaps it keeps.

Two ways. Where the gaps stay the same, Newton's method along the branch's tangent gets there. Where they
change, they are opened by a least move, and a barrier with collision detection on every step leads down to a
minimum; the pairs within its last reach, which are on the sides on which they are to stay, are the gaps
that may be kept, and sequential quadratic programming finds those that push. Either way the end and the
motion to it are audited over all pairs, independently of all lists.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..model.band import Array, Band, State
from ..model.problem import Problem
from ..model.touching import Shape
from ..model.touching_audit import Audit, Motion, audit
from ..model.touching_barrier import Neighbourhood, candidates, merged, nearest
from ..model.touching_gaps import Pairs, arguments, gaps, places, vectors
from ..parts import HALF_WIDTH
from .kkt import FactorisationError
from .linear import Factor
from .newton import Options, Stepper, change, iterate_at, solve
from .prolongation import divided
from .resting import RestingProblem, resting_rates
from .resting_barrier import BarrierProblem
from .resting_certificate import PULLS, certified, on_rim
from .resting_kkt import RestingDerivatives, kkt_matrix
from .status import STATIONARY, Result, Status

OFF = 1e-6
"""How far off its features, in their coordinates, a place of contact may be."""
DEPTH = 1e-10
"""Depth, as part of l, from which a crossing counts: a tenth of what a certificate allows."""
SLIP = 1e-4
"""Depth, as part of l, that sheets which slide on each other may have half-way between two shapes: their
straight way cuts a curve short. What passes deeper has passed through."""
MOST_STEPS, MOST_STUCK, MOST_SADDLES = 40, 8, 3
REACHES = (5e-4, 5e-5, 5e-6)
"""Reaches of the barrier, as parts of l, one after the other."""
POLISH_FROM = 1
MOST_TRACKED = 20
LIFTED = 1e-6
"""Force at which a contact is about to lift."""
MOST_OPENINGS, MOST_MOVES, MOST_SHARINGS = 6, 12, 5
APART = 1e-3
MOST_DESCENTS = 80
NEAR = 1e-4
"""Distance beyond a gap, as part of l, up to which pairs are candidates in the last steps."""
MOST_FACETS = 6400
"""Facets of a grid on which a way between two grids is looked at."""
BARRIER_GOAL = 1e-6
PROXIMAL = 1e-2
DEPENDENT = 1e-9
"""Eigenvalue of the gaps' compliance, relative to the largest, below which gaps depend on each other."""
SMALL = 1e-4
"""Force, as part of the largest, below which a pair within the last reach does not push at first."""
WANDERED = 0.05
"""Change from the shape that a barrier holds beyond which a polish goes somewhere else."""
SERVES = 1e-9
"""Depth, as part of l, up to which gaps without force leave those with it as they are."""
MARGIN = 0.05
"""How far off its features a place may be while the gap is still a candidate."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A stationary shape with the gaps that it keeps; `result` has the forces after the multipliers."""

    problem: RestingProblem
    result: Result
    audit: Audit
    steps: int = 0
    changes: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """The shape."""
        return self.result.state

    @property
    def band(self) -> Band:
        """What is fixed."""
        return self.problem.band

    @property
    def pairs(self) -> Pairs:
        """The gaps that are kept."""
        return self.problem.pairs

    @property
    def multipliers(self) -> Array:
        """Those of constraints (5N+3,)."""
        return self.problem.split(self.result.multipliers)[0]

    @property
    def forces(self) -> Array:
        """The gaps' forces (k,)."""
        return self.problem.split(self.result.multipliers)[1]

    @property
    def gap(self) -> float:
        """The gap that is kept."""
        return self.problem.gap


class NoRestError(Exception):
    """No active set was found; the message says why."""


def rest_at(
    state: State,
    multipliers: Array,
    pairs: Pairs | None = None,
    forces: Array | None = None,
    gap: float = 0.0,
) -> Rest:
    """A stationary state as it is, with its gaps; its index is counted anew."""
    pairs = Pairs.none() if pairs is None else pairs
    forces = np.zeros(len(pairs)) if forces is None else forces
    problem = RestingProblem(state.band, pairs, gap)
    options = Options(max_steps=3, leave_saddles=0)
    result = solve(problem, state.vector(), np.concatenate((multipliers, forces)), options)
    return Rest(problem, result, audit(Shape.of(result.state, gap), gap + DEPTH * state.band.length))


@dataclass(frozen=True)
class Slopes:
    """Derivatives by a parameter along the branch with the same gaps: of x and of multipliers with forces,
    and dE/dp."""

    x: Array
    multipliers: Array
    rise: float


def slopes(rest: Rest, name: str = HALF_WIDTH) -> Slopes:
    """The slopes at a stationary shape. Raises FactorisationError at a fold."""
    problem, x, multipliers = rest.problem, rest.result.x, rest.result.multipliers
    along = resting_rates(problem, x, multipliers, name)
    matrix = kkt_matrix(problem, problem.local_derivatives(x, multipliers), problem.rotations(x))
    z = Factor(matrix).solve(np.concatenate((-along.gradient, -along.constraints, np.zeros(matrix.tail))))
    n = problem.size
    return Slopes(z[:n], -z[n : n + problem.rows], along.lagrangian)


def moved(rest: Rest, band: Band, by: float, along: Slopes, gap: float | None = None) -> Rest:
    """The next shape with the same pairs, with a band of other parameters or at another gap. Raises
    NoRestError."""
    x, multipliers = rest.result.x + by * along.x, rest.result.multipliers + by * along.multipliers
    problem = RestingProblem(band, rest.pairs, rest.gap if gap is None else gap)
    result = solve(problem, x, multipliers, Options(leave_saddles=0, max_steps=MOST_TRACKED))
    if result.status not in STATIONARY:
        raise NoRestError(f"{result.status.value} with the same gaps")
    return _accepted(rest.state, problem, result, SLIP, result.steps, ())


def _shortened(rest: Rest, name: str, full: float, along: Slopes) -> Rest:
    """A step towards a force of zero, a little shorter than Newton's, or shorter still where it pulls."""
    for part in (1.0 - LIFTED, 0.9, 0.5):
        try:
            value = rest.band.parameter(name) + part * full
            return moved(rest, rest.band.with_parameter(name, value), part * full, along)
        except NoRestError as failure:
            why = failure
    raise why


def touch_down(rest: Rest, name: str = HALF_WIDTH) -> Rest:
    """The shape of the same gaps at the value of a parameter at which the least of their forces is zero.

    There a contact begins, seen from where it pushes, or lifts. Newton's method in the parameter, which stays
    where forces push. Raises NoRestError.
    """
    for _ in range(MOST_TRACKED):
        if not len(rest.forces):
            raise NoRestError("nothing touches")
        if rest.forces.min() <= LIFTED:
            return rest
        along = slopes(rest, name)
        rates = along.multipliers[rest.problem.base.rows :]
        k = int(np.argmin(rest.forces))
        full = -float(rest.forces[k] / rates[k])
        rest = _shortened(rest, name, full, along)
    raise NoRestError("no force falls to zero")


def _accepted(
    before: State, problem: RestingProblem, result: Result, slip: float, steps: int, changes: tuple[str, ...]
) -> Rest:
    """The shape with its audit. Raises NoRestError if it, or the way to it from `before`, is none to be
    accepted."""
    shape, length = Shape.of(result.state, problem.gap), problem.band.length
    forces = problem.split(result.multipliers)[1]
    if len(forces):
        off = float(_off(shape, problem.pairs).max())
        if off > OFF:
            raise NoRestError(f"a place of contact is off its features by {off:.1e}")
        if forces.min() < -PULLS * max(1.0, float(forces.max())):
            raise NoRestError(f"a force pulls, {forces.min():.1e}")
    found = audit(shape, problem.gap + DEPTH * length)
    if found.lacks(problem.gap) > DEPTH * length:
        raise NoRestError(f"features cross, or are nearer than the gap, by {found.lacks(problem.gap):.1e}")
    motion = way_between(before, result.state, problem.gap)
    met = motion.passages()
    if len(met):
        depth = motion.depth(met)
        if depth > slip * length:
            raise NoRestError(f"the way passes through itself, {depth:.1e} deep")
    return Rest(problem, certified(problem, result, found), found, steps, changes)


def found(rest: Rest, band: Band, by: float, along: Slopes | None, gap: float | None = None) -> Rest:
    """The next shape by a barrier, then without it. Raises NoRestError.

    From the shape its gaps are opened to half of the reach, by the least move, and nothing meets on the way;
    nor does it on any step of the descents, which end a thirtieth of the first reach apart.
    """
    gap = rest.gap if gap is None else gap
    x, own = rest.result.x, rest.multipliers
    if along is not None:
        x, own = x + by * along.x, own + by * along.multipliers[: rest.problem.base.rows]
    return let_down(rest.state, band, x, own, rest.pairs, gap)


def let_down(
    before: State,
    band: Band,
    x: Array,
    own: Array | None,
    pairs: Pairs,
    gap: float = 0.0,
    slip: float = 10.0 * DEPTH,
) -> Rest:
    """The shape at rest next to a place x (7N,), which need not be one that keeps its gaps, by a barrier.

    `own` are multipliers of constraints, estimated where there are none. Pairs are those known to be near, on
    the sides on which they are to stay. The way from the shape `before`, which may be on a coarser grid, to
    where the descent begins may pass through itself no deeper than `slip`, as part of l. Raises NoRestError.
    """
    length = band.length
    start = _opened(before, band, x, pairs, gap, 0.5 * REACHES[0] * length, slip)
    steps, x, why = 0, start.vector(), NoRestError("no reach")
    for k, reach in enumerate(REACHES):
        problem = BarrierProblem(band, reach * length, gap)
        options = Options(
            way=problem.allows,
            leave_saddles=MOST_SADDLES,
            max_steps=MOST_DESCENTS,
            goal=BARRIER_GOAL,
            tolerance=BARRIER_GOAL,
        )
        result = solve(problem, x, own, options)
        steps += result.steps
        if result.status not in (*STATIONARY, Status.STALLED, Status.ITERATION_LIMIT):
            raise NoRestError(f"{result.status.value} at reach {reach:g}")
        x, own = result.x, result.multipliers
        if k < POLISH_FROM:
            continue
        near = problem.near(x)
        listed, forces = near, problem.forces(x, near)
        listed, forces = merged(near, forces) if gap else candidates(problem.shape(x), near, forces)
        try:
            return _at_rest(result, band, gap, listed, forces, steps)
        except NoRestError as failure:
            why = failure
    raise why


def _at_rest(result: Result, band: Band, gap: float, listed: Pairs, forces: Array, steps: int) -> Rest:
    """The shape at rest beside one that a barrier holds; with gaps that bound it, if some suffice. Raises
    NoRestError.

    Where gaps depend on each other some may be bounds and others not: those on a rim are left out then.
    """
    end: Rest | None = None
    for _ in range(MOST_SHARINGS):
        try:
            polished, found, more = _polished(band, gap, result.x, result.multipliers, listed, forces)
            other = _accepted(result.state, polished, found, 10.0 * DEPTH, steps + more, ("barrier",))
        except NoRestError:
            if end is None:
                raise
            break
        lost = on_rim(Shape.of(other.state, gap), other.pairs, gap)
        if end is None or lost is None:
            end = other
        if lost is None or gap:
            break
        keep = np.array([key != lost for key in listed.names()])
        listed, forces = listed.take(keep), forces[keep]
    assert end is not None
    return end


def _opened(before: State, band: Band, x: Array, pairs: Pairs, gap: float, room: float, slip: float) -> State:
    """A shape that crosses nothing, nor does the way to it: x with gaps opened to `room` more than they are
    to be, those known and those of what passes through itself. Raises NoRestError."""
    why = "what passes through itself cannot be opened"
    problem = Problem(band)
    for _ in range(MOST_OPENINGS):
        try:
            x = _apart(band, x, pairs, gap + room, room)
        except FactorisationError:
            break
        state = problem.state(x)
        motion = way_between(before, state, gap)
        met, shape = motion.passages(), Shape.of(state, gap)
        close = _nearer(shape, gap + 0.25 * room) if gap else Pairs.none()
        if not len(close) and audit(shape, 0.0).penetration == 0.0:
            if not len(met) or motion.depth(met) <= slip * band.length:
                return state
            why = "the way to the start passes through itself"
        if motion.after.segments != shape.segments:
            break
        what = arguments(met.pairs)
        value = gaps(vectors(shape, what), what, met.pairs.sign, band.half_width).value
        more = united(united(pairs, met.pairs.take(value < gap + 0.5 * room).unique()), close)
        if len(more) == len(pairs):
            break
        pairs = more
    raise NoRestError(why)


def _nearer(shape: Shape, reach: float) -> Pairs:
    """The pairs nearer than a reach, over all pairs, each once and as it is nearest."""
    return nearest(shape, Neighbourhood.of(shape, reach, 0.0).features, reach).unique()


def way_between(before: State, after: State, gap: float = 0.0) -> Motion:
    """The straight way from one shape to another, on a grid that divides facets of both. Raises NoRestError
    where that has too many facets."""
    one, other = before.band.segments, after.band.segments
    both = math.lcm(one, other)
    if both > MOST_FACETS:
        raise NoRestError(
            f"no way from N = {one} to {other} is short enough to be looked at: double N instead"
        )
    ends = (Shape.of(divided(state, both // state.band.segments), gap) for state in (before, after))
    return Motion(*ends)


def _apart(band: Band, x: Array, pairs: Pairs, gap: float, room: float) -> Array:
    """The place near x on the constraints at which gaps are at least `gap`, to a part of `room`, by least
    moves."""
    problem = RestingProblem(band, pairs, gap)
    base, n = problem.base, problem.size
    for _ in range(MOST_MOVES):
        away = problem.gaps(x).value - gap
        wrong = np.concatenate((base.constraints(x), np.minimum(away, 0.0)))
        if float(np.abs(wrong).max()) <= APART * room:
            break
        local = problem.local_derivatives(x, None)
        normal = Factor(
            kkt_matrix(base, base.local_derivatives(x, None), np.zeros((n, 0))).with_unit_metric()
        )
        p = normal.solve(np.concatenate((np.zeros(n), -base.weighted_constraints(x))))[:n]
        if len(pairs):
            assert isinstance(local, RestingDerivatives)
            assert local.touched is not None
            rows = np.array([problem.pull(_only(k, local.touched.jacobian)) for k in range(len(pairs))])
            none = np.zeros(base.rows)
            v = np.array([normal.solve(np.concatenate((row, none)))[:n] for row in rows])
            p = p + pushing(rows @ v.T, away + rows @ p) @ v
        x = x + min(1.0, 0.25 / max(change(x, p), 1e-300)) * p
    return x


def _polished(
    band: Band, gap: float, x: Array, own: Array, listed: Pairs, forces: Array
) -> tuple[RestingProblem, Result, int]:
    """The stationary point near x whose gaps, of those listed, push or are open; and the steps to it.

    Sequential quadratic programming with gaps as inequalities. Raises NoRestError.
    """
    options, best, stuck, start = Options(leave_saddles=0), np.inf, 0, x
    working = Pairs.none()
    forces = np.where(forces > SMALL * forces.max(initial=0.0), forces, 0.0)
    known = dict(zip(listed.names(), forces.tolist(), strict=True))
    for steps in range(MOST_STEPS):
        if gap:
            # Which kind of distance is the least may change from step to step.
            listed = _nearer(Shape.of(State.from_vector(band, x), gap), gap + NEAR * band.length)
        possible = listed.take(_off(Shape.of(State.from_vector(band, x), gap), listed) <= MARGIN)
        here = np.array([known.get(key, 0.0) for key in possible.names()])
        # Where gaps depend on each other forces can be shared out in many ways: one that serves is kept.
        pushes, value = here > 0.0, RestingProblem(band, possible).gaps(x).value - gap
        serves = (value[~pushes] >= -SERVES * band.length).all()
        if not steps or (len(working) == pushes.sum() and serves):
            working, own_forces = possible.take(pushes), here[pushes]
        else:
            working, own_forces = _working(band, gap, x, own, possible, here)
        problem = RestingProblem(band, working, gap)
        point = iterate_at(problem, x, np.concatenate((own, own_forces)))
        if point.worst <= options.goal or (point.worst <= options.tolerance and stuck > 1):
            off = _off(Shape.of(point.state, gap), working)
            if not (off > OFF).any():
                result = solve(problem, x, point.multipliers, replace(options, max_steps=4))
                if result.status not in STATIONARY:
                    raise NoRestError(f"{result.status.value} at the end")
                return problem, result, steps
            gone = working.names()[int(np.argmax(off))]
            listed = listed.take(np.array([key != gone for key in listed.names()]))
            best = np.inf
            continue
        stuck, best = (0, point.worst) if point.worst < 0.5 * best else (stuck + 1, best)
        following = None if stuck > MOST_STUCK else Stepper(problem, options).step(point)
        if following is None or change(start, following.x - start) > WANDERED:
            raise NoRestError(f"no step makes progress ({point.worst:.1e}, {len(working)} gaps)")
        x, (own, own_forces) = following.x, problem.split(following.multipliers)
        known = dict(zip(working.names(), own_forces.tolist(), strict=True))
    raise NoRestError(f"too many steps ({best:.1e}, {len(working)} gaps)")


def _working(
    band: Band, gap: float, x: Array, own: Array, possible: Pairs, forces: Array
) -> tuple[Pairs, Array]:
    """The candidates that push in the quadratic problem at x, and their forces there.

    With p = p_0 + V f for forces f, V = K^-1 G^T, linearised gaps are q + M f with M = G V, and f >= 0
    minimises f.M f / 2 + q.f: a problem of non-negative least squares, of which M may be singular. K has
    `PROXIMAL` added to W: at a stationary point that changes no force, and soft modes would drown all
    differences between gaps. Where gaps depend on each other, some that suffice get all the force.
    """
    if not len(possible):
        return possible, forces
    problem = RestingProblem(band, possible, gap)
    local = problem.local_derivatives(x, np.concatenate((own, forces)))
    assert isinstance(local, RestingDerivatives)
    assert local.touched is not None
    rows = np.array([problem.pull(_only(k, local.touched.jacobian)) for k in range(len(possible))])
    matrix = kkt_matrix(problem, local.pushed(), problem.rotations(x))
    factor = Factor(matrix, shift=-PROXIMAL)
    n, tail = problem.size, np.zeros(matrix.tail)
    gradient = problem.base.lagrangian_gradient(local.free, own) - forces @ rows
    p = factor.solve(np.concatenate((-gradient, -local.free.constraints, tail)))[:n]
    none = np.zeros(problem.base.rows)
    v = np.array([factor.solve(np.concatenate((row, none, tail)))[:n] for row in rows])
    m = rows @ v.T
    found = pushing(m, problem.gaps(x).value - gap + rows @ p - m @ forces)
    keep = found > 0.0
    return possible.take(keep), found[keep]


def _off(shape: Shape, pairs: Pairs) -> Array:
    """How far (k,) places of contact are off their features, in the features' coordinates."""
    at = places(shape, pairs)
    out: Array = np.maximum(-at, at - 1.0).max(axis=1, initial=0.0)
    return out


def _only(k: int, jacobian: Array) -> Array:
    out = np.zeros_like(jacobian)
    out[k] = jacobian[k]
    return out


def pushing(m: Array, away: Array) -> Array:
    """Forces f >= 0 (k,) with m f + away >= 0 where f = 0 and = 0 where f > 0, m (k,k) symmetric, which
    may be singular: of gaps that depend on each other some that suffice get all the force."""
    values, axes = np.linalg.eigh(0.5 * (m + m.T))
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


def united(pairs: Pairs, more: Pairs) -> Pairs:
    """Pairs and those of others that are not among them."""
    known = set(pairs.names())
    new = [k for k, key in enumerate(more.names()) if key not in known]
    return pairs.joined(more.take(np.array(new, dtype=np.int64))) if new else pairs
