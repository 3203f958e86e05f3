"""A step from a state: to another width, halved where it fails, or to another number of segments."""

from __future__ import annotations

import math
from dataclasses import replace

from ..facts import Event, event
from ..model.band import Array, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..solver.continuation import Move, to_segments, to_width
from ..solver.kinship import another_minimum
from ..solver.status import Result, Status
from ..solver.tracking import PARTS
from ..store import Summary
from .acceptance import converged
from .failure import Failure
from .plan import MOST_HALVINGS, width_name, width_steps
from .records import multipliers_of, state_of
from .walk import Ended, Stage, Walk


def width_step(
    walk: Walk,
    state: State,
    multipliers: Array,
    half_width: float,
    parts: int = PARTS,
    before: tuple[Event, ...] = (),
) -> Ended | Failure:
    """The minimum at another width that a state's branch leads to; `parts` as in `to_width`."""
    move = to_width(state, multipliers, half_width, walk.options, parts)
    result = walk.checked(move.result)
    if result.status is Status.MINIMUM:
        return _moved(move, result, before)
    facts = {"start": state.band.half_width, "end": half_width}
    return Failure("step", result.status, result.detail, facts, attempt=_moved(move, result))


def refined(
    walk: Walk, start: Summary, segments: int, stage: str, *, splitting: bool = False
) -> Ended | Failure:
    """The equilibrium on another number of segments that a state's shape leads to."""
    state = state_of(walk.journal.load(start))
    try:
        move = to_segments(state, segments, walk.options, splitting=splitting)
    except ClosureError as error:
        return Failure("refinement", None, str(error), {"stage": stage})
    result = walk.checked(move.result)
    if not converged(result):
        return Failure("solve", result.status, result.detail, {"stage": stage}, "an N in between")
    if result.certified and start.certified:
        kin = another_minimum(state, result.state, walk.options)
        move = replace(move, events=(*move.events, kin)) if kin else move
    return _moved(move, result)


def _moved(move: Move, result: Result, before: tuple[Event, ...] = ()) -> Ended:
    """The end of a step along a branch with what was met on the way."""
    # A saddle that ends the step is the last that was met.
    saddles = move.saddles[:-1] if result.status is Status.SADDLE else move.saddles
    met = replace(result, saddles=saddles, steps=move.steps)
    return Ended(Problem(move.band), met, move.method, move.events, before)


def longest_step(
    walk: Walk, before: Summary | None, current: Summary, b: float, visit: int
) -> tuple[Summary | None, Failure | None]:
    """Compute and store the longest step towards width b that works; also why none does, if none does.

    `before` is the state from which a halved step towards b led to the current one, None if none did. A state
    at b that is reached without a certificate is stored, and returned with the failure.
    """
    record = walk.journal.load(current)
    state, multipliers = state_of(record), multipliers_of(record)
    names = width_steps(current.half_width, b, visit)
    stages = [
        Stage(name, width, current.segments, "equilibrium" if width == b else "intermediate", current.label)
        for name, width in names
    ]
    # Doubts are resolved down to one length, however often the step itself was halved.
    parts = {stage.name: max(0, PARTS - halvings) for halvings, stage in enumerate(stages)}
    needed = walk.needed(stages)
    reached, failures = walk.longest(
        stages[_first_candidate(before, current, b) :] if needed is stages else needed,
        lambda stage, events: width_step(
            walk, state, multipliers, stage.half_width, parts[stage.name], events
        ),
        lambda stage, why: event("width-halved", **why.values, why=why.message),
    )
    if reached is not None:
        return reached, None
    return _given_up(walk, current, b, visit, failures)


def _given_up(
    walk: Walk, current: Summary, b: float, visit: int, failures: tuple[Failure, ...]
) -> tuple[Summary | None, Failure]:
    """Why no step towards a width succeeds, with the state at that width if one was reached uncertified."""
    beyond = [why.values["end"] for why in failures if why.status is Status.LEFT_BRANCH]
    if beyond:
        facts = {
            "near": 0.5 * (current.half_width + beyond[-1]),
            "start": current.half_width,
            "end": b,
            "label": current.label,
            "state": f"{walk.journal.run.short_name}:{current.label}",
        }
        return None, Failure("fold", Status.LEFT_BRANCH, "", facts)
    whole = failures[0]
    why = replace(
        whole,
        kind="width",
        values={"start": current.half_width, "end": b},
        smaller="a schedule with more widths",
    )
    end = whole.attempt
    if end is None or not (converged(end.result) and end.problem.band.half_width == b):
        return None, why
    stage = Stage(width_name(b, visit), b, current.segments, "equilibrium", current.label)
    return walk.store(stage, end), why


def _first_candidate(before: Summary | None, current: Summary, b: float) -> int:
    """Where to begin halving: at twice the step that led here, if that was a halved one.

    Read off the stored states, so that a resumed run takes the same steps.
    """
    if before is None:
        return 0
    last, left = abs(current.half_width - before.half_width), abs(b - current.half_width)
    if last == 0.0 or left <= 2.0 * last * (1.0 + 1e-9):
        return 0
    return min(MOST_HALVINGS, math.ceil(math.log2(left / (2.0 * last)) - 1e-9))
