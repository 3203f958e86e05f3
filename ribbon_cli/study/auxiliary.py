"""The way of a recipe: auxiliary problems, steps that fail halved, and states that are made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from ..facts import Event, event
from ..model.band import Band
from ..model.problem import Problem
from ..recipes.recipe import Making, NotMadeError, Turn, Turning
from ..solver.newton import solve
from ..solver.status import Status
from ..store import Summary
from .failure import Failure
from .plan import MOST_HALVINGS, STEPS
from .records import constructed, multipliers_of, state_of
from .walk import Ended, Stage, Walk


def make(walk: Walk, making: Making, band: Band, before: Summary | None) -> Summary | Failure:
    """Make or load states that need no solving, from what the way led to so far; the last of them."""
    start = None if before is None else state_of(walk.journal.load(before))
    record = before

    def made(k: int) -> Ended | Failure:
        try:
            new = making.make(k, start)
        except NotMadeError as error:
            return Failure("construction", None, str(error), {"stage": making.stages[k]})
        return Ended(Problem(new.state.band), constructed(new.state), new.method, changes=new.changes)

    for k, name in enumerate(making.stages):
        parent = None if record is None else record.label
        known = walk.reach(Stage(name, band.half_width, band.segments, "auxiliary", parent), partial(made, k))
        if isinstance(known, Failure):
            return known
        record = known
    assert record is not None
    return record


@dataclass(frozen=True)
class Turner:
    """Runs the auxiliary problems of a recipe."""

    walk: Walk
    turning: Turning

    def run(self) -> Summary | Failure:
        """Solve or load all of them; the last one's state, or why it was not reached."""
        first = self.turning.first
        record: Summary | None = None
        # A stage 0 turns nothing, and has no step to halve.
        reached: float | None = None if first == 0 else 0.0
        for goal in map(self.turning.turn, range(first, self.turning.count + 1)):
            while reached is None or reached < goal.index:
                step = self._towards(goal, record, reached)
                if isinstance(step, Failure):
                    return step
                record, reached = step
        assert record is not None
        return record

    def _towards(
        self, goal: Turn, record: Summary | None, reached: float | None
    ) -> tuple[Summary, float] | Failure:
        """Turn to a stage, or as far as halving leads; what was reached, or why nothing was."""
        turns = {goal.name: goal}
        if reached is not None:
            parts = (reached + (goal.index - reached) / 2**j for j in range(1, MOST_HALVINGS + 1))
            turns |= {turn.name: turn for turn in map(self.turning.turn, parts)}
        band, parent = self.turning.start.band, None if record is None else record.label
        stages = [Stage(name, band.half_width, band.segments, "auxiliary", parent) for name in turns]
        if reached is None:
            end = self.walk.reach(stages[0], lambda: self._solved(goal, record, ()))
            return end if isinstance(end, Failure) else (end, goal.index)
        facts = {"turn": goal.word, "start": reached, "count": goal.count}
        found, failures = self.walk.longest(
            self.walk.needed(stages),
            lambda stage, events: self._solved(turns[stage.name], record, events),
            lambda stage, why: event("turn-halved", **facts, end=turns[stage.name].index, why=why.message),
        )
        if found is None:
            return replace(failures[-1], kind="turn", values=facts)
        return found, turns[found.stage].index

    def _solved(self, turn: Turn, stored: Summary | None, before: tuple[Event, ...]) -> Ended | Failure:
        """Solve a stage from the one before; only minima are taken."""
        record = None if stored is None else self.walk.journal.load(stored)
        state = self.turning.start if record is None else state_of(record)
        multipliers = None if record is None else multipliers_of(record)
        problem = Problem(state.band, turn.prescription)
        options = replace(self.walk.options, guard=turn.guard)
        result = solve(problem, state.vector(), multipliers, options)
        if result.status is not Status.MINIMUM:
            return Failure("solve", result.status, result.detail, {"stage": turn.name}, STEPS)
        return Ended(problem, result, self.turning.method, before=before)
