"""One step along a branch: to another width, or to another grid.

Both know the grid phase: sliding is a mode of the continuum but not of a grid, on which a band with its
inflection on a facet's middle and its twin with the inflection on a node are a minimum and a saddle of
index 1, or the other way round. Where a step ends on the saddle, its twin is tried before anything else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from ..facts import Event, event
from ..model.band import Array, Band, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..parts import HALF_WIDTH
from .newton import Options, solve
from .prolongation import Phase, Start, clear_phase, phase_of, smooth, split
from .status import STATIONARY, Result, SaddleMet, Status
from .tracking import PARTS, Way, follows, slid

TRACKING_STEPS = 60
"""Newton steps after which a step along a branch is given up and halved; good ones take 4 to 20."""

LONG_WAYS_UP_TO = 3200
"""Segments of the finest grid on which facets are split where prolongation fails, saddles are left along
their negative direction, and a start of undecided index is followed by one in the other grid phase. Kinked
starts take hundreds of steps, on finer grids minutes, and have not led on where prolongation did not."""


@dataclass(frozen=True)
class Move:
    """Where a step along a branch ended: the last solve, the saddles met on the way, and in words how.

    `band` is that of the result; where the result is itself a saddle, it is the last of `saddles`. `steps`
    counts the Newton steps of all attempts.
    """

    result: Result
    band: Band
    saddles: tuple[SaddleMet, ...]
    method: str
    events: tuple[Event, ...]
    steps: int


@dataclass
class _Trail:
    """What the attempts of one move leave behind."""

    options: Options
    saddles: list[SaddleMet] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    steps: int = 0

    @property
    def tracking(self) -> Options:
        """Options of a solve that stays where it is: it leaves no saddle and gives up early."""
        return replace(self.options, leave_saddles=0, max_steps=min(self.options.max_steps, TRACKING_STEPS))

    def solve(self, state: State, multipliers: Array | None, *, leaving: bool) -> Result:
        """Solve from a state; saddles are met and kept, and left only if `leaving`."""
        options = self.options if leaving else self.tracking
        result = solve(Problem(state.band), state.vector(), multipliers, options)
        self.steps += result.steps
        for met in (*result.saddles, *_ended_on(result)):
            if not any(_same(met, known) for known in self.saddles):
                self.saddles.append(met)
        return result

    def move(self, result: Result, method: str) -> Move:
        """The move that ends with a result."""
        ended = _ended_on(result)
        others = [s for s in self.saddles if not any(_same(s, end) for end in ended)]
        saddles = (*others, *ended)
        return Move(result, result.state.band, saddles, method, tuple(self.events), self.steps)

    def settle(self, saddle: Result, method: str) -> Move:
        """From a saddle to a minimum: to the twin of the other grid phase, else along the way down."""
        band, other = saddle.state.band, _other(phase_of(saddle.state))
        met = {"index": saddle.negative, "energy": saddle.energy}
        if saddle.negative == 1 and band.closed:
            try:
                twin = self.solve(smooth(saddle.state, band.segments, other).state, None, leaving=False)
            except ClosureError:
                twin = saddle
            if twin.certified and twin.energy < saddle.energy:
                self.events.append(event("phase-twin", **met, phase=other.value))
                return self.move(twin, method)
        self.events.append(event("saddle-left", **met))
        return self.move(self.solve(saddle.state, saddle.multipliers, leaving=True), method)


def _track(options: Options, state: State, multipliers: Array) -> tuple[State, Array] | None:
    """The stationary point next to a state, of any index, or None; nobody watches, nor asks for the index."""
    options = replace(options, judged=False, watch=None)
    result = solve(Problem(state.band), state.vector(), multipliers, options)
    return (result.state, result.multipliers) if result.status in STATIONARY else None


def _ended_on(result: Result) -> tuple[SaddleMet, ...]:
    """The saddle that a result is, if it is one."""
    if result.status is not Status.SADDLE:
        return ()
    negative = result.negative or 0
    residuals = (result.kkt_residual, result.constraint_residual)
    return (SaddleMet(result.x, result.multipliers, result.energy, negative, *residuals),)


def _same(a: SaddleMet, b: SaddleMet) -> bool:
    """Whether two saddles are one, met twice: same index, same energy to roundoff."""
    return a.index == b.index and abs(a.energy - b.energy) <= 1e-11 * abs(a.energy)


def _other(phase: Phase) -> Phase:
    return Phase.FACET if phase is Phase.NODE else Phase.NODE


def to_width(
    state: State, multipliers: Array, half_width: float, options: Options, parts: int = PARTS
) -> Move:
    """Natural continuation from a state to another half-width; see `to_band`."""
    return to_band(state, multipliers, state.band.with_half_width(half_width), options, parts)


def to_band(state: State, multipliers: Array, band: Band, options: Options, parts: int = PARTS) -> Move:
    """Natural continuation from a state (with its multipliers (5N+3,)) to other parameters, those of a band.

    A stationary point that the state's branch does not lead to, as there is behind a fold, has status
    `LEFT_BRANCH`; a step in doubt is halved `parts` times to find out.
    """
    trail = _Trail(options)
    names = (name for name, _ in Way.between(state.band, band).rates)
    method = "continuation in " + ", ".join("width" if name == HALF_WIDTH else name for name in names)
    result = trail.solve(state.on(band), multipliers, leaving=False)
    if result.status not in STATIONARY:
        return trail.move(result, method)
    ends = (state, multipliers), (result.state, result.multipliers)
    if not follows(*ends, partial(_track, trail.tracking), parts):
        return trail.move(replace(result, status=Status.LEFT_BRANCH), method)
    phases = clear_phase(state), clear_phase(result.state)
    if result.status is Status.MINIMUM and phases[1] is not None and slid(*phases):
        trail.events.append(event("phase-slid", phase=phases[1].value))
    return trail.settle(result, method) if result.status is Status.SADDLE else trail.move(result, method)


def to_segments(state: State, segments: int, options: Options, *, splitting: bool = False) -> Move:
    """Refine (or coarsen) a state to another number of segments.

    Smooth prolongation in the coarse state's grid phase comes first, then the other phase; if both meet a
    saddle it is left. Where prolongation has no start that works, and for `splitting`, facets are split as
    in the thesis, which doubles their number. On grids of more than `LONG_WAYS_UP_TO` segments what the
    starts led to is returned instead.
    Raises ClosureError if there is no start at all, ValueError if `splitting` is asked for anything but
    twice the segments.
    """
    doubled = segments == 2 * state.band.segments
    if splitting and not doubled:
        raise ValueError("splitting facets doubles the number of segments")
    trail = _Trail(options)
    fine = segments > LONG_WAYS_UP_TO
    ends: list[tuple[Result, str]] = []
    if not splitting:
        here = phase_of(state)
        # Between ends nothing slides, and there is one way to sample the shape.
        phases = (here, _other(here)) if state.band.closed else (here,)
        starts = (partial(smooth, state, segments, phase) for phase in phases)
        for start in starts:
            end = _attempt(trail, start)
            if end is not None and (end[0].certified or (fine and end[0].status is Status.UNDECIDED)):
                return trail.move(*end)
            ends += [] if end is None else [end]
        for result, method in ends:
            if result.status is Status.SADDLE:
                return trail.move(result, method) if fine else trail.settle(result, method)
    if doubled and (splitting or not fine):
        start_split = split(state)
        return trail.move(trail.solve(start_split.state, None, leaving=True), start_split.method)
    if not ends:
        raise ClosureError("; ".join(map(str, trail.events)))
    return trail.move(*ends[0])


def _attempt(trail: _Trail, make: Callable[[], Start]) -> tuple[Result, str] | None:
    """Solve from a start that may not exist; what comes of it is put down unless it is a minimum."""
    try:
        start = make()
    except ClosureError as error:
        trail.events.append(event("no-start", why=error))
        return None
    result = trail.solve(start.state, None, leaving=False)
    if result.status is Status.SADDLE:
        met = {"index": result.negative, "energy": result.energy}
        trail.events.append(event("start-saddle", method=start.method, **met))
    elif not result.certified:
        facts = {"method": start.method, "status": result.status.value, "steps": result.steps}
        trail.events.append(event("start-failed", **facts))
    return result, start.method
