"""From one shape of a strip that rests on itself to the next one, and which gaps it keeps.

Two ways. Where the gaps stay the same, Newton's method along the branch's tangent gets there. Where they
change, they are opened by a least move, and a barrier with collision detection on every step leads down to a
minimum; the pairs within its last reach, which are on the sides on which they are to stay, are the gaps
that may be kept, and sequential quadratic programming finds those that push. Either way the end and the
motion to it are audited over all pairs, independently of all lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..model.band import Array, Band, State
from ..model.problem import Problem
from ..model.touching import Shape
from ..model.touching_audit import Audit, Motion, audit
from ..model.touching_barrier import candidates
from ..model.touching_distances import Distances, nearer
from ..model.touching_gaps import Pairs, gap_values
from ..model.touching_sides import Sides
from ..parts import HALF_WIDTH
from .kkt import FactorisationError
from .linear import Factor
from .newton import Options, solve
from .prolongation import divided
from .resting import RestingProblem, resting_rates
from .resting_barrier import BarrierProblem
from .resting_certificate import PULLS, certified
from .resting_exchange import (
    CROSSED,
    OFF,
    AstrayError,
    Exchange,
    GapLostError,
    NoRestError,
    off_features,
    pushing,
)
from .resting_kkt import RestingDerivatives, kkt_matrix
from .resting_shares import shared_anew
from .status import STATIONARY, Result, Status
from .steps import change
from .tracking import Way

DEPTH = 1e-10
"""Depth, as part of l, from which a crossing counts: a tenth of what a certificate allows."""
SLIP = 1e-4
"""Depth, as part of l, that sheets which slide on each other may have half-way between two shapes: their
straight way cuts a curve short. What passes deeper has passed through."""
MOST_WAYPOINTS = 3
"""How often a way along which sheets slide is halved to see whether it passes through itself."""
NEARLY_ON = 1e-2
"""How far off its features a place of contact may be for its force to be shared out to others."""
SHY = 0.1
"""Gap of sheets in the middle of a way, as part of the depth that it may have."""
MOST_SADDLES = 3
REACHES = (5e-4, 5e-5, 5e-6)
"""Reaches of the barrier, as parts of l, one after the other."""
POLISH_FROM = 1
MOST_TRACKED = 20
LIFTED = 1e-6
"""Force at which a contact is about to lift."""
MOST_OPENINGS, MOST_MOVES = 6, 12
APART, OPEN = 1e-3, 1e-5
ASTRAY = 0.05
"""Value of a constraint from which all moves together led nowhere."""
AT_ONCE = 16
"""Gaps, the worst, that are opened first, and with these as many more."""
MOST_DESCENTS = 80
MOST_FACETS = 6400
"""Facets of a grid on which a way between two grids is looked at."""
BARRIER_GOAL = 1e-6
WANDERED, FARTHEST = 0.05, 0.5
"""Changes from the shape that a barrier holds, and from a predicted one, beyond which a search for the gaps
that push goes somewhere else."""


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


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def moved(rest: Rest, band: Band, by: float, along: Slopes, gap: float | None = None) -> Rest:
    """The next shape with the same pairs, with a band of other parameters or at another gap; with others that
    touch where forces can be shared out among these. Raises NoRestError."""
    x, multipliers = rest.result.x + by * along.x, rest.result.multipliers + by * along.multipliers
    gap = rest.gap if gap is None else gap
    options = Options(leave_saddles=0, max_steps=MOST_TRACKED)
    problem = RestingProblem(band, rest.pairs, gap)
    result = solve(problem, x, multipliers, options)
    steps = result.steps
    if result.status not in STATIONARY:
        why = f"{result.status.value} with the same gaps"
        try:
            other, anew = shared_anew(rest.problem, rest.result)
        except NoRestError as failure:
            raise NoRestError(why) from failure
        problem = RestingProblem(band, other.pairs, gap)
        result = solve(problem, x, anew.multipliers, options)
        steps += result.steps
    if result.status not in STATIONARY:
        raise NoRestError(why)
    return accepted(rest.state, problem, result, SLIP, steps, ())


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


def accepted(
    before: State, problem: RestingProblem, result: Result, slip: float, steps: int, changes: tuple[str, ...]
) -> Rest:
    """The shape with its audit. Raises NoRestError if it, or the way to it from `before`, which may be on a
    coarser grid, is none to be accepted."""
    shape, length = Shape.of(result.state, problem.gap), problem.band.length
    if _pulls(problem, result) and _off(shape, problem.pairs) <= NEARLY_ON:
        with suppress(NoRestError):
            problem, result = shared_anew(problem, result)
            shape = Shape.of(result.state, problem.gap)
    forces = problem.split(result.multipliers)[1]
    if len(forces):
        off = _off(shape, problem.pairs)
        if off > OFF:
            raise NoRestError(f"a place of contact is off its features by {off:.1e}")
        if _pulls(problem, result):
            raise NoRestError(f"a force pulls, {forces.min():.1e}")
    found = audit(shape, problem.gap + DEPTH * length)
    if found.lacks(problem.gap) > DEPTH * length:
        raise GapLostError(f"features cross, or are nearer than the gap, by {found.lacks(problem.gap):.1e}")
    depth = _passed(before, result.state, problem.gap, slip)
    if depth > slip * length:
        raise GapLostError(f"the way passes through itself, {depth:.1e} deep")
    return Rest(problem, certified(problem, result, found), found, steps, changes)


def _off(shape: Shape, pairs: Pairs) -> float:
    return float(off_features(shape, pairs).max(initial=0.0))


def _pulls(problem: RestingProblem, result: Result) -> bool:
    forces = problem.split(result.multipliers)[1]
    return bool(len(forces) and forces.min() < -PULLS * max(1.0, float(forces.max())))


def _passed(
    before: State,
    after: State,
    gap: float,
    slip: float,
    halvings: int = MOST_WAYPOINTS,
    sides: Sides | None = None,
) -> float:
    """How deep the way from one shape to another passes through itself.

    Sheets that slide far on each other cut a curve short: of such a way the middle is opened, and both halves
    are looked at. `sides` are those on which sheets are to stay, where they are known already.
    """
    motion = way_between(before, after, gap)
    met = motion.passages()
    depth, length = motion.depth(met) if len(met) else 0.0, after.band.length
    if depth <= slip * length or not halvings or before.band.segments != after.band.segments:
        return depth
    if sides is None and not gap:
        sides = Sides(Shape.of(before), Pairs.none())
    try:
        middle = _middle(before, after, gap, slip * length, sides or met.pairs.unique())
    except (NoRestError, FactorisationError):
        return depth
    first = _passed(before, middle, gap, slip, halvings - 1, sides)
    if first > slip * length:
        return first
    return max(first, _passed(middle, after, gap, slip, halvings - 1, sides))


def _middle(before: State, after: State, gap: float, slip: float, apart: Sides | Pairs) -> State:
    """A shape half-way between two, in which sheets are on their sides, or pairs that passed apart. Raises
    NoRestError, FactorisationError."""
    band = Way.between(before.band, after.band).middle(before.band, after.band)
    x = 0.5 * (before.vector() + after.vector())
    if isinstance(apart, Pairs):
        return opened(Guess(before, band, x, None, apart, np.empty(0), gap, math.inf), slip)

    def near(x: Array) -> Pairs:
        pairs, value = apart.near(Shape.of(State.from_vector(band, x)), CROSSED * band.length)
        return pairs.take(value <= slip)

    return State.from_vector(band, _apart(band, x, near, SHY * slip, SHY * slip))


def found(rest: Rest, band: Band, by: float, along: Slopes | None, gap: float | None = None) -> Rest:
    """The next shape, with other gaps, at another `gap` where one is given. Raises NoRestError."""
    gap = rest.gap if gap is None else gap
    x, multipliers = rest.result.x, rest.result.multipliers
    if along is not None:
        x, multipliers = x + by * along.x, multipliers + by * along.multipliers
    own, forces = rest.problem.split(multipliers)
    guess = Guess(rest.state, band, x, own, rest.pairs, forces, gap)
    ways = [partial(exchanged, guess), partial(let_down, guess)]
    if gap == rest.gap and along is not None:
        ways.insert(1, partial(_in_halves, rest, band, by, along))
    return _first_certified(ways)


def _first_certified(ways: Iterable[Callable[[], Rest]], astray: bool = False) -> Rest:
    """The first certified end of several ways, else the first end. Raises the last NoRestError where no way
    ends, or, with `astray`, where the first goes astray."""
    ends: list[Rest] = []
    why = NoRestError("")
    for way in ways:
        try:
            end = way()
        except NoRestError as failure:
            why = failure
            if astray and not ends and isinstance(failure, AstrayError):
                break
            continue
        if end.result.certified:
            return end
        ends.append(end)
    if not ends:
        raise why
    return ends[0]


def _in_halves(rest: Rest, band: Band, by: float, along: Slopes) -> Rest:
    """The next shape by way of one half-way to it, certified. Raises NoRestError."""
    way, half = Way.between(rest.band, band), 0.5 * by
    x, multipliers = rest.result.x + half * along.x, rest.result.multipliers + half * along.multipliers
    own, forces = rest.problem.split(multipliers)
    middle = exchanged(Guess(rest.state, way.middle(rest.band, band), x, own, rest.pairs, forces, rest.gap))
    if not middle.result.certified:
        raise NoRestError("no minimum half-way")
    try:
        each = [(rate, slopes(middle, name)) for name, rate in way.rates]
    except FactorisationError as failure:
        raise NoRestError("a fold half-way") from failure
    x = middle.result.x + half * np.sum([rate * slope.x for rate, slope in each], axis=0)
    more = np.sum([rate * slope.multipliers for rate, slope in each], axis=0)
    own, forces = middle.problem.split(middle.result.multipliers + half * more)
    end = exchanged(Guess(middle.state, band, x, own, middle.pairs, forces, rest.gap))
    return replace(end, steps=middle.steps + end.steps)


@dataclass(frozen=True)
class Guess:
    """A place near a shape at rest: x (7N,), multipliers of constraints, and pairs that may touch, on the
    sides on which they are to stay, with their forces (k,). The way to it begins at the shape `before`, which
    may be on a coarser grid, and passes through itself no deeper than `slip`, as part of l."""

    before: State
    band: Band
    x: Array
    multipliers: Array | None
    pairs: Pairs
    forces: Array
    gap: float = 0.0
    slip: float = 10.0 * DEPTH


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def exchanged(guess: Guess) -> Rest:
    """The shape at rest near a place, with gaps exchanged on the way: a certified minimum if there is one,
    first where sheets slip off each other, then held at corners. Raises NoRestError."""
    held = (False,) if guess.gap else (False, True)
    return _first_certified((partial(_exchanged, guess, corners) for corners in held), astray=True)


def _exchanged(guess: Guess, corners: bool) -> Rest:
    """The same, with corners held or not."""
    own = guess.multipliers
    assert own is not None
    sides = Distances() if guess.gap else Sides(Shape.of(guess.before), guess.pairs, corners)
    search = Exchange(guess.band, sides, FARTHEST, guess.gap)
    problem, result = search.rest(guess.x, own, guess.pairs, guess.forces)
    return accepted(guess.before, problem, result, SLIP, search.steps, ("exchange",))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def let_down(guess: Guess) -> Rest:
    """The shape at rest near a place, which need not be one that keeps gaps, by a barrier, then without it.
    Raises NoRestError.

    Gaps are opened to half of the reach, by the least move, and nothing meets on the way; nor does it on any
    step of the descents, which end a thirtieth of the first reach apart.
    """
    band, gap, own = guess.band, guess.gap, guess.multipliers
    length = band.length
    start = _start(guess, 0.5 * REACHES[0] * length)
    steps, x, why = 0, start.vector(), NoRestError("no reach")
    near_by = None
    for k, reach in enumerate(REACHES):
        problem = BarrierProblem(band, reach * length, gap, near_by)
        near_by = problem.near_by
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
        try:
            return _first_certified(
                partial(_polished, problem, result, corners, steps)
                for corners in (True, False)[: 1 if gap else 2]
            )
        except NoRestError as failure:
            why = failure
    raise why


def _polished(problem: BarrierProblem, result: Result, corners: bool, steps: int) -> Rest:
    """The shape at rest where a barrier has led, with corners held or not. Raises NoRestError."""
    x, gap = result.x, problem.gap
    near, shape = problem.near(x), problem.shape(x)
    listed, forces = candidates(shape, near, problem.forces(x, near), gap)
    sides = Distances() if gap else Sides(shape, Pairs.none(), corners)
    search = Exchange(problem.band, sides, WANDERED, gap)
    polished, found = search.rest(x, result.multipliers, listed, forces)
    return accepted(result.state, polished, found, 10.0 * DEPTH, steps + search.steps, ("barrier",))


def _start(guess: Guess, room: float, halvings: int = MOST_WAYPOINTS) -> State:
    """An opened shape, by way of others where the straight way to it passes through itself. Raises
    NoRestError."""
    try:
        return opened(guess, room)
    except GapLostError:
        if not halvings or guess.before.band.segments != guess.band.segments:
            raise
    before = guess.before
    band, x = Way.between(before.band, guess.band).middle(before.band, guess.band), before.vector()
    half = replace(guess, band=band, x=0.5 * (x + guess.x))
    return _start(replace(guess, before=_start(half, room, halvings - 1)), room, halvings - 1)


def opened(guess: Guess, room: float) -> State:
    """A shape that crosses nothing, nor does the way to it: the place of a guess with gaps opened to `room`
    more than they are to be, those known and those of what passes through itself. Raises NoRestError."""
    band, gap, x, pairs = guess.band, guess.gap, guess.x, guess.pairs
    why = "what passes through itself cannot be opened"
    problem = Problem(band)
    for _ in range(MOST_OPENINGS):
        try:
            x = _apart(band, x, pairs, gap + room, room)
        except FactorisationError:
            break
        state = problem.state(x)
        motion = way_between(guess.before, state, gap)
        met, shape = motion.passages(), Shape.of(state, gap)
        close = nearer(shape, gap + 0.25 * room) if gap else Pairs.none()
        if not len(close) and audit(shape, 0.0).penetration == 0.0:
            if not len(met) or motion.depth(met) <= guess.slip * band.length:
                return state
            why = "the way to the start passes through itself"
        if motion.after.segments != shape.segments:
            break
        value = gap_values(shape, met.pairs)
        more = united(united(pairs, met.pairs.take(value < gap + 0.5 * room).unique()), close)
        if len(more) == len(pairs):
            break
        pairs = more
    raise GapLostError(why)


def way_between(before: State, after: State, gap: float = 0.0) -> Motion:
    """The straight way from one shape to another, on a grid that divides facets of both. Raises NoRestError
    where that has too many facets."""
    one, other = before.band.segments, after.band.segments
    both = math.lcm(one, other)
    if one != other and both > MOST_FACETS:
        raise NoRestError(f"no way from N = {one} to {other} can be looked at: double N instead")
    first, last = (Shape.of(divided(state, both // state.band.segments), gap) for state in (before, after))
    return Motion(first, last)


def _apart(band: Band, x: Array, listed: Pairs | Callable[[Array], Pairs], gap: float, room: float) -> Array:
    """The place near x on the constraints at which gaps of pairs, which may be listed anew at each place, are
    at least `gap`, to a part of `room`, by least moves. Raises GapLostError where these lead off the
    constraints."""
    for _ in range(MOST_MOVES):
        problem = RestingProblem(band, listed if isinstance(listed, Pairs) else listed(x), gap)
        base, n = problem.base, problem.size
        away = problem.gaps(x).value - gap
        wrong = np.concatenate((base.constraints(x), np.minimum(away, 0.0)))
        if float(np.abs(wrong).max()) <= APART * room:
            break
        local = problem.local_derivatives(x, None)
        normal = Factor(
            kkt_matrix(base, base.local_derivatives(x, None), np.zeros((n, 0))).with_unit_metric()
        )
        p = normal.solve(np.concatenate((np.zeros(n), -base.weighted_constraints(x))))[:n]
        if len(problem.pairs):
            assert isinstance(local, RestingDerivatives)
            assert local.touched is not None
            rows = problem.rows_of(local.touched.jacobian)
            p = p + _least_move(rows, away + rows @ p, normal, OPEN * room)
        x = x + min(1.0, 0.25 / max(change(x, p), 1e-300)) * p
    if float(np.abs(Problem(band).constraints(x)).max()) > ASTRAY:
        raise GapLostError("what passes through itself cannot be opened by small moves")
    return x


def _least_move(rows: Array, away: Array, normal: Factor, lacks: float) -> Array:
    """The least move (n,) in the normal factors' metric that makes gaps of some rows (k,n) positive, up to
    `lacks`. Few of them are in the way: how it answers to a row is found for these alone, the worst first."""
    n, none = rows.shape[1], np.zeros(normal.matrix.size + normal.matrix.border - rows.shape[1])
    chosen, move = np.empty(0, dtype=np.int64), np.zeros(n)
    answers = np.empty((0, n))
    while True:
        left = away + rows @ move
        left[chosen] = np.inf
        worst = np.argsort(left, kind="stable")[:AT_ONCE]
        worst = worst[left[worst] < -lacks]
        if not worst.size:
            return move
        new = np.array([normal.solve(np.concatenate((rows[k], none)))[:n] for k in worst])
        chosen, answers = np.concatenate((chosen, worst)), np.vstack((answers, new))
        move = pushing(rows[chosen] @ answers.T, away[chosen]) @ answers


def united(pairs: Pairs, more: Pairs) -> Pairs:
    """Pairs and those of others that are not among them."""
    known = set(pairs.names())
    new = [k for k, key in enumerate(more.names()) if key not in known]
    return pairs.joined(more.take(np.array(new, dtype=np.int64))) if new else pairs
