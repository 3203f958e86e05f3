"""Auxiliary problems one after another: rulings turned step by step, steps that fail halved."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from ..facts import Event, event
from ..model.band import State
from ..model.problem import Problem
from ..recipes.eversion import EversionStage
from ..recipes.twist import TwistStage
from ..solver.newton import Options, solve
from ..solver.status import Status
from ..store import Summary
from .failure import Failure
from .plan import MOST_HALVINGS
from .records import multipliers_of, state_of
from .walk import Ended, Stage, Walk

Turn = TwistStage | EversionStage
STEPS = "`steps` of the recipe"


@dataclass(frozen=True)
class Turning:
    """Runs the stages of a twist or an eversion from a cylinder.

    `between` makes the stage after so many steps, whole or not; `word` begins the stages' names.
    """

    walk: Walk
    ring: State
    word: str
    between: Callable[[float], Turn]

    def run(self, turns: Iterable[Turn]) -> Summary | Failure:
        """Solve or load all of them; the last one's state, or why it was not reached."""
        record: Summary | None = None
        # The eversion's first stage turns nothing, and has no step to halve.
        reached: float | None = None if self.word == "eversion" else 0.0
        for goal in turns:
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
            turns |= {turn.name: turn for turn in map(self.between, parts)}
        band, parent = self.ring.band, None if record is None else record.label
        stages = [Stage(name, band.half_width, band.segments, "auxiliary", parent) for name in turns]
        if reached is None:
            end = self.walk.reach(stages[0], lambda: self._solved(goal, record, ()))
            return end if isinstance(end, Failure) else (end, goal.index)
        facts = {"turn": self.word, "start": reached, "count": goal.count}
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
        state = self.ring if record is None else state_of(record)
        multipliers = None if record is None else multipliers_of(record)
        problem = Problem(self.ring.band, turn.prescription)
        options = Options(guard=turn.guard(), watch=self.walk.progress.step)
        result = solve(problem, state.vector(), multipliers, options)
        if result.status is not Status.MINIMUM:
            return Failure("solve", result.status, result.detail, {"stage": turn.name}, STEPS)
        rulings = "two prescribed rulings" if self.word == "eversion" else "prescribed rulings"
        return Ended(problem, result, f"{self.word}, {rulings}", before=before)
