"""One step along a branch: to another width, or to another grid.

Both know the grid phase: sliding is a mode of the continuum but not of a grid, on which a band with its
inflection on a facet's middle and its twin with the inflection on a node are a minimum and a saddle of
index 1, or the other way round. Where a step ends on the saddle, its twin is tried before anything else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..model.band import Array, Band, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from .newton import Options, solve
from .prolongation import Phase, phase_of, smooth, split
from .status import Result, SaddleMet, Status

TRACKING_STEPS = 60
"""Newton steps after which a step along a branch is given up and halved; good ones take 4 to 20."""


@dataclass(frozen=True)
class Move:
    """Where a step along a branch ended: the last solve, the saddles met on the way, and in words how.

    `steps` counts the Newton steps of all attempts; `surplus_seen` the most negative eigenvalues met in the
    last.
    """

    result: Result
    band: Band
    saddles: tuple[SaddleMet, ...]
    method: str
    events: tuple[str, ...]
    steps: int


def _met(result: Result) -> tuple[SaddleMet, ...]:
    """The saddles of a result, the one it ended on included."""
    if result.status is not Status.SADDLE:
        return result.saddles
    last = SaddleMet(
        result.x,
        result.multipliers,
        result.energy,
        result.negative or 0,
        result.kkt_residual,
        result.constraint_residual,
    )
    return (*result.saddles, last)


def to_width(state: State, multipliers: Array, half_width: float, options: Options) -> Move:
    """Natural continuation from a state (with its multipliers (5N+3,)) to another half-width."""
    band = state.band.with_half_width(half_width)
    problem = Problem(band)
    tracking = replace(options, leave_saddles=0, max_steps=min(options.max_steps, TRACKING_STEPS))
    first = solve(problem, state.vector(), multipliers, tracking)
    move = Move(first, band, _met(first), "continuation in width", (), first.steps)
    return _settle(move, options) if first.status is Status.SADDLE else move


def _settle(move: Move, options: Options) -> Move:
    """From a saddle to a minimum: to the twin of the other grid phase, else along the negative direction."""
    saddle = move.result
    words = f"met a saddle of index {saddle.negative} at E = {saddle.energy:.12g}"
    here = phase_of(saddle.state)
    other = Phase.FACET if here is Phase.NODE else Phase.NODE
    twin = None
    if saddle.negative == 1:
        twin = _attempt(lambda: smooth(saddle.state, move.band.segments, other).state, options)
    if twin is not None:
        steps = move.steps + twin.steps
        if twin.certified and twin.energy < saddle.energy:
            event = f"grid phase: {words}, its twin with the inflection on a {other.value} is the minimum"
            return replace(move, result=twin, events=(*move.events, event), steps=steps)
        move = replace(move, steps=steps)
    left = solve(Problem(move.band), saddle.x, saddle.multipliers, options)
    events = (*move.events, f"{words}, left along its negative direction")
    known = (*move.saddles, *_met(left)[1:])
    return replace(move, result=left, saddles=known, events=events, steps=move.steps + left.steps)


def _attempt(start: object, options: Options) -> Result | None:
    """Solve from a start that may fail to exist; saddles are not left."""
    assert callable(start)
    try:
        state: State = start()
    except ClosureError:
        return None
    tracking = replace(options, leave_saddles=0, max_steps=min(options.max_steps, TRACKING_STEPS))
    return solve(Problem(state.band), state.vector(), None, tracking)


def to_segments(state: State, segments: int, options: Options, *, splitting: bool = False) -> Move:
    """Refine (or coarsen) a state to another number of segments.

    Smooth prolongation in the coarse state's grid phase comes first, then the other phase; a saddle met in
    both is left along its negative direction. `splitting` halves facets as in the thesis instead.
    Raises ValueError if `splitting` is asked for anything but twice the segments.
    """
    band = state.band.with_segments(segments)
    if splitting:
        if segments != 2 * state.band.segments:
            raise ValueError("splitting facets doubles the number of segments")
        start = split(state)
        only = solve(Problem(band), start.state.vector(), None, options)
        return Move(only, band, _met(only), start.method, (), only.steps)
    first_phase = phase_of(state)
    phases = (first_phase, Phase.FACET if first_phase is Phase.NODE else Phase.NODE)
    best: Move | None = None
    steps = 0
    events: tuple[str, ...] = ()
    saddles: tuple[SaddleMet, ...] = ()
    for phase in phases:
        method = f"smooth prolongation, inflection on a {phase.value}"
        result = _attempt(lambda phase=phase: smooth(state, segments, phase).state, options)
        if result is None:
            events = (*events, f"{method}: rulings would cross")
            continue
        steps += result.steps
        if result.certified:
            return Move(result, band, saddles, method, events, steps)
        if result.status is Status.SADDLE:
            saddles = (*saddles, *_met(result))
            events = (
                *events,
                f"{method}: met a saddle of index {result.negative} at E = {result.energy:.12g}",
            )
        else:
            events = (*events, f"{method}: {result.status.value} after {result.steps} steps")
        move = Move(result, band, saddles, method, events, steps)
        if best is None or result.status is Status.SADDLE:
            best = move
    if best is not None and best.result.status is Status.SADDLE:
        return _settle(replace(best, saddles=saddles, events=events, steps=steps), options)
    return _last_resort(state, best, events, steps, options)


def _last_resort(
    state: State, best: Move | None, events: tuple[str, ...], steps: int, options: Options
) -> Move:
    """Where smooth prolongation has no start: split facets until the grid is at least as fine."""
    wanted = best.band.segments if best is not None else 2 * state.band.segments
    if best is not None and wanted != 2 * state.band.segments:
        return replace(best, events=events, steps=steps)
    start = split(state)
    result = solve(Problem(start.state.band), start.state.vector(), None, options)
    return Move(result, start.state.band, _met(result), start.method, events, steps + result.steps)
