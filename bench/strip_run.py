"""Strips between clamps, by both contestants: the cost of a Newton step, and a path in the shear.

Seconds are of the processor: both run on one thread, and other programs then take no part in them.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ribbon_cli.model.band import Array, Band, Discretisation, State
from ribbon_cli.model.entries import PER_NODE
from ribbon_cli.model.problem import END_ROW, Problem
from ribbon_cli.parts import Ends, Parts
from ribbon_cli.recipes.strip import CARD
from ribbon_cli.solver.continuation import to_band, to_segments
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, estimate_multipliers, iterate_at, solve
from ribbon_cli.solver.saddle_free import newton_step
from ribbon_cli.solver.status import Result
from ribbon_cli.study.acceptance import strip_guard

from .ours import SAME_ENERGY, certified
from .strips import Clamps, StripPeer, StripResult, StripStart, build

HALF_WIDTH, LENGTH, SPAN = 0.05, 1.0, 0.75
SHEAR, STEPS = 0.15, 20
"""Short of a shear of 0.2, where the branch loses its stability: beyond, the two end on different states."""
COARSEST = 50


@dataclass(frozen=True)
class StepCost:
    """Median seconds of one Newton step: derivatives, matrix, factors and solution."""

    segments: int
    band: float
    strips: dict[str, float]

    def ratio(self, rule: str) -> float:
        """A strip's step over the band's."""
        return self.strips[rule] / self.band


@dataclass(frozen=True)
class Way:
    """One contestant's solve in one step of the path: median seconds, iterations, and whether it ended on the
    equilibrium that ours did."""

    seconds: float
    iterations: int
    same: bool


@dataclass(frozen=True)
class ShearStep:
    """A step of the path by ours and by the peer, without multipliers and with ours."""

    shear: float
    ours: Way
    peers: dict[str, Way]


@dataclass
class ShearPath:
    """The path under one rule."""

    rule: str
    segments: int
    steps: list[ShearStep] = field(default_factory=list)

    def common(self, peer: str) -> list[ShearStep]:
        """The steps that end on the same equilibrium."""
        return [step for step in self.steps if step.peers[peer].same]

    def seconds(self, peer: str) -> tuple[float, float]:
        """Ours and the peer's over the steps in common."""
        common = self.common(peer)
        return sum(step.ours.seconds for step in common), sum(step.peers[peer].seconds for step in common)

    def ratio(self, peer: str) -> float:
        """How many times slower the peer is."""
        ours, theirs = self.seconds(peer)
        return theirs / ours

    @property
    def least(self) -> float:
        """The same of the peer at its best."""
        return min(self.ratio(peer) for peer in PEERS)


@dataclass(frozen=True)
class Strips:
    """All that is measured of strips."""

    cost: StepCost
    paths: list[ShearPath]
    repeats: int


WITHOUT, WITH = "without multipliers", "with our multipliers"
PEERS = (WITHOUT, WITH)


def measure_strips(
    band: State, segments: int, steps: int, repeats: int, say: Callable[[str], None]
) -> Strips:
    """The cost of steps beside that of a closed band's state; the path at `segments`; under both rules."""
    say(f"Newton steps of strips at N = {band.band.segments}")
    cost = _step_cost(band, 20 * repeats)
    paths = []
    for rule in Discretisation:
        say(f"strips sheared at N = {segments}, {rule.value}")
        paths.append(_path(rule, segments, steps, repeats))
    return Strips(cost, paths, repeats)


def buckled(rule: Discretisation, segments: int) -> Result:
    """The planar strip, refined to a number of segments."""
    band = Band(min(segments, COARSEST), HALF_WIDTH, LENGTH, 0, rule, Parts(Ends(span=SPAN)))
    guess = CARD.way(band, 0, {}).ready
    assert guess is not None
    found = certified_strip(solve(Problem(band), guess.vector(), None, Options()))
    while found.state.band.segments < segments:
        finer = min(2 * found.state.band.segments, segments)
        found = certified_strip(to_segments(found.state, finer, Options()).result)
    return found


def sheared(start: Result, shear: float) -> Result:
    """The next strip of the path, guarded and certified as in a study."""
    band = start.state.band.with_parameter("shear", shear)
    options = Options(guard=strip_guard(start.state))
    return certified_strip(to_band(start.state, start.multipliers, band, options).result)


def certified_strip(result: Result) -> Result:
    """A strip, if its whole certificate holds. Raises RuntimeError if it does not."""
    return certified(result, Problem(result.state.band))


def _step_cost(band: State, repeats: int) -> StepCost:
    closed = Problem(band.band)
    x = band.vector()
    given = {"band": (closed, x, estimate_multipliers(closed, x))}
    for rule in Discretisation:
        found = sheared(buckled(rule, band.band.segments), SHEAR / 2)
        given[rule.value] = (Problem(found.state.band), found.x, found.multipliers)
    seconds: dict[str, list[float]] = {name: [] for name in given}
    for _ in range(repeats):
        for name, (problem, place, multipliers) in given.items():
            began = time.process_time()
            _newton_step(problem, place, multipliers)
            seconds[name].append(time.process_time() - began)
    medians = {name: statistics.median(each) for name, each in seconds.items()}
    return StepCost(band.band.segments, medians.pop("band"), medians)


def _newton_step(problem: Problem, x: Array, multipliers: Array) -> None:
    point = iterate_at(problem, x, multipliers)
    matrix = KKTMatrix(problem, point.local, problem.rotations(x))
    newton_step(problem, point.local, point.multipliers, Factor(matrix))


def _path(rule: Discretisation, segments: int, steps: int, repeats: int) -> ShearPath:
    """Each step begins at our state of the step before, for both; medians over passes of the whole path."""
    peer, first = build(segments, rule.value, LENGTH), buckled(rule, segments)
    passes = [_pass(peer, first, steps) for _ in range(repeats)]
    return ShearPath(rule.value, segments, [_median(step) for step in zip(*passes, strict=True)])


def _pass(peer: StripPeer, state: Result, steps: int) -> list[ShearStep]:
    out = []
    for k in range(1, steps + 1):
        shear = SHEAR * k / STEPS
        began = time.process_time()
        reached = sheared(state, shear)
        ours = Way(time.process_time() - began, reached.steps, True)
        start, clamps = peer_start(state), Clamps(np.array([SPAN, 0.0, shear]))
        theirs = {}
        for name, multipliers in {WITHOUT: None, WITH: peer_multipliers(state)}.items():
            began = time.process_time()
            found = peer.solve(start, HALF_WIDTH, clamps, multipliers)
            theirs[name] = Way(time.process_time() - began, found.iterations, _same(found, reached))
        out.append(ShearStep(shear, ours, theirs))
        state = reached
    return out


def _median(steps: Sequence[ShearStep]) -> ShearStep:
    """One step with the median seconds of several passes."""

    def median(ways: list[Way]) -> Way:
        return replace(ways[-1], seconds=statistics.median(way.seconds for way in ways))

    theirs = {name: median([step.peers[name] for step in steps]) for name in PEERS}
    return ShearStep(steps[-1].shear, median([step.ours for step in steps]), theirs)


def _same(found: StripResult, ours: Result) -> bool:
    return found.success and abs(found.energy - ours.energy) <= SAME_ENERGY * ours.energy


def peer_start(state: Result) -> StripStart:
    """One of our strips as the peer takes it."""
    problem, band = Problem(state.state.band), state.state
    rulings = np.vstack((problem.rulings(state.x), problem.end_ruling(state.x)))
    return StripStart(band.u, rulings, band.xi)


def peer_multipliers(state: Result) -> Array:
    """Our multipliers in the order and with the signs of the peer's, whose constraints have no weights."""
    problem = Problem(state.state.band)
    weighted = -problem.weights * state.multipliers
    rows = weighted[: -problem.closing].reshape(-1, PER_NODE)
    facet = [0, 3, 4]
    first, last = (rows[0, 2], *rows[0, facet]), (-rows[0, END_ROW], *rows[-1, facet])
    return np.concatenate(
        (
            rows[1:, 1:3].ravel(),
            rows[1:-1, facet].ravel(),
            first,
            last,
            -state.multipliers[-problem.closing :],
        )
    )
