"""A step from a state: to other parameters, halved where it fails, or to another number of segments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ..facts import Event, event
from ..model.band import Array, Band, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..parts import HALF_WIDTH
from ..solver.continuation import Move, to_band, to_segments
from ..solver.kinship import another_minimum
from ..solver.resting_exchange import NoRestError
from ..solver.status import Result, Status
from ..solver.tracking import PARTS
from ..store import StateRecord, Summary
from . import resting
from .acceptance import converged
from .failure import Failure, fold_facts, halved_kind, way_facts
from .plan import MOST_HALVINGS, Goal
from .records import multipliers_of, state_of
from .turning import soft_in_checkerboards, turns_back
from .walk import Ended, Stage, Walk


def step_from(
    walk: Walk,
    start: StateRecord,
    target: Mapping[str, float],
    parts: int = PARTS,
    before: tuple[Event, ...] = (),
) -> Ended | Failure:
    """The state at other parameters that a stored one leads to, with contact forces where the walk has
    them.

    With forces a band that touches nothing takes the same steps as without them. Where the end, or the way
    to it, would pass through itself, and from where contacts push, it comes to rest on itself.
    """
    if walk.gap is None:
        return step_to(walk, state_of(start), multipliers_of(start), target, parts, before)
    if start.contacts is None or not len(start.contacts):
        free = step_to(walk, state_of(start), multipliers_of(start), target, parts, before)
        passed = resting.passes(free, state_of(start), walk.gap)
        if not passed:
            return free if isinstance(free, Failure) else resting.at_rest(free, walk.gap)
    return resting.step(walk, start, moved(state_of(start).band, target), target, before)


def step_to(
    walk: Walk,
    state: State,
    multipliers: Array,
    target: Mapping[str, float],
    parts: int = PARTS,
    before: tuple[Event, ...] = (),
) -> Ended | Failure:
    """The minimum at other parameters that a state's branch leads to; `parts` as in `to_band`."""
    move = to_band(state, multipliers, moved(state.band, target), walk.options_from(state), parts)
    result = walk.checked(move.result)
    if result.status is Status.MINIMUM:
        return _moved(move, result, before)
    facts = way_facts(state.band.parameters, target)
    return Failure("step", result.status, result.detail, facts, attempt=_moved(move, result))


def moved(band: Band, target: Mapping[str, float]) -> Band:
    """The band with parameters at other values."""
    for name, value in target.items():
        band = band.with_parameter(name, value)
    return band


def refined(
    walk: Walk, start: Summary, segments: int, stage: str, *, splitting: bool = False
) -> Ended | Failure:
    """The equilibrium on another number of segments that a state's shape leads to."""
    record = walk.journal.load(start)
    state = state_of(record)
    if start.contacts:
        return resting.refined(walk, record, segments, stage)
    try:
        move = to_segments(state, segments, walk.options_from(state), splitting=splitting)
    except ClosureError as error:
        return Failure("refinement", None, str(error), {"stage": stage})
    result = walk.checked(move.result)
    if not converged(result):
        return Failure("solve", result.status, result.detail, {"stage": stage}, "an N in between")
    if result.certified and start.certified:
        kin = another_minimum(state, result.state, walk.options)
        move = replace(move, events=(*move.events, kin)) if kin else move
    end = _moved(move, result)
    if walk.gap is None:
        return end
    try:
        passed = resting.passes(end, state, walk.gap)
    except NoRestError as error:
        return resting.failed(error, stage)
    if passed:
        return resting.refined(walk, record, segments, stage)
    return resting.at_rest(end, walk.gap)


def _moved(move: Move, result: Result, before: tuple[Event, ...] = ()) -> Ended:
    """The end of a step along a branch with what was met on the way."""
    # A saddle that ends the step is the last that was met.
    saddles = move.saddles[:-1] if result.status is Status.SADDLE else move.saddles
    met = replace(result, saddles=saddles, steps=move.steps)
    return Ended(Problem(move.band), met, move.method, move.events, before)


def longest_step(
    walk: Walk, before: Summary | None, current: Summary, goal: Goal
) -> tuple[Summary | None, Failure | None]:
    """Compute and store the longest step towards a goal that works; also why none does, if none does.

    `before` is the state from which a halved step towards it led to the current one, None if none did. A
    state at the goal that is reached without a certificate is stored, and returned with the failure.
    """
    record = walk.journal.load(current)
    ways = goal.ways(record.parameters)
    targets = dict(ways)
    stages = [
        _stage(name, target, current, goal.kind if k == 0 else "intermediate")
        for k, (name, target) in enumerate(ways)
    ]
    # Doubts are resolved down to one length, however often the step itself was halved.
    parts = {stage.name: max(0, PARTS - halvings) for halvings, stage in enumerate(stages)}
    needed = walk.needed(stages)
    reached, failures = walk.longest(
        stages[_first_candidate(before, current, goal) :] if needed is stages else needed,
        lambda stage, events: step_from(walk, record, targets[stage.name], parts[stage.name], events),
        lambda stage, why: event(f"{halved_kind(targets[stage.name])}-halved", **why.values, why=why.message),
    )
    if reached is not None:
        return reached, None
    return _given_up(walk, current, goal, failures)


def all_the_way(walk: Walk, current: Summary, goal: Goal) -> Summary | Failure:
    """The state at a goal, from one state to the next; why it is not reached."""
    before: Summary | None = None
    while not goal.reached(current.parameters, current.length):
        following, why = longest_step(walk, before, current, goal)
        if why is not None:
            return why
        assert following is not None
        before, current = current, following
    return current


def _stage(name: str, target: Mapping[str, float], start: Summary, kind: str) -> Stage:
    return Stage(name, target.get(HALF_WIDTH, start.half_width), start.segments, kind, start.label)


def _given_up(
    walk: Walk, current: Summary, goal: Goal, failures: tuple[Failure, ...]
) -> tuple[Summary | None, Failure]:
    """Why no step towards a goal succeeds, with the state there if one was reached uncertified."""
    beyond = [why.values["end"] for why in failures if why.status is Status.LEFT_BRANCH]
    if beyond and goal.one is not None:
        here, end = current.parameters[goal.one] or 0.0, goal.to[goal.one]
        kind = "fold" if turns_back(walk.journal, current, goal.one, beyond[-1]) else "other-branch"
        soft = kind != "fold" and soft_in_checkerboards(walk.journal, current)
        facts = fold_facts(walk.journal.run.short_name, current, goal.one, here, end, beyond[-1], soft)
        return None, Failure(kind, Status.LEFT_BRANCH, "", facts)
    facts = way_facts(current.parameters, goal.to)
    # Where contacts push the shortest step says what is in the way.
    said = failures[-1 if current.contacts else 0]
    why = replace(said, kind="way", values=facts, smaller="a schedule with more steps")
    if goal.one == HALF_WIDTH:
        why = replace(why, smaller="a schedule with more widths")
    end_of = failures[0].attempt
    if end_of is None or not (converged(end_of.result) and goal.holds(end_of.problem.band.parameters)):
        return None, why
    return walk.store(_stage(goal.name, goal.to, current, goal.kind), end_of), why


def _first_candidate(before: Summary | None, current: Summary, goal: Goal) -> int:
    """Where to begin halving: at twice the step that led here, if that was a halved one.

    Read off the stored states, so that a resumed run takes the same steps.
    """
    if before is None:
        return 0
    last, left = goal.distance(before.parameters, current.parameters), goal.distance(current.parameters)
    if last == 0.0 or left <= 2.0 * last * (1.0 + 1e-9):
        return 0
    return min(MOST_HALVINGS, math.ceil(math.log2(left / (2.0 * last)) - 1e-9))
