"""Auxiliary problems one after another: rulings turned step by step, steps that fail halved."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ..model.band import State
from ..model.problem import Problem
from ..recipes.eversion import EversionStage
from ..recipes.twist import TwistStage
from ..solver.newton import Options, solve
from ..solver.status import Result, Status
from ..store import Summary
from .plan import MOST_HALVINGS
from .records import multipliers_of, state_of
from .remedies import remedied
from .steps import Steps

Stage = TwistStage | EversionStage
STEPS = "`steps` of the recipe"


@dataclass(frozen=True)
class Turning:
    """Runs the stages of a twist or an eversion from a cylinder.

    `between` makes the stage after so many steps, whole or not; `word` begins the stages' names.
    """

    steps: Steps
    ring: State
    word: str
    between: Callable[[float], Stage]

    def run(self, stages: Iterable[Stage]) -> Summary | str:
        """Solve or load all of them; the last one's state, or a sentence why it was not reached."""
        record: Summary | None = None
        # The eversion's first stage turns nothing, and has no step to halve.
        reached: float | None = None if self.word == "eversion" else 0.0
        for goal in stages:
            while reached is None or reached < goal.index:
                step = self._towards(goal, record, reached)
                if isinstance(step, str):
                    return step
                record, reached = step
        assert record is not None
        return record

    def _towards(
        self, goal: Stage, record: Summary | None, reached: float | None
    ) -> tuple[Summary, float] | str:
        """Turn to a stage, or as far as halving leads; what was reached, or a sentence why nothing was."""
        stages = [goal]
        if reached is not None:
            parts = (reached + (goal.index - reached) / 2**j for j in range(1, MOST_HALVINGS + 1))
            stages += [self.between(part) for part in parts]
        for stage in stages:
            stored = self.steps.journal.finished(stage.name)
            if stored is not None:
                self._begin(stage)
                return stored, stage.index
        failures: list[str] = []
        for stage in stages:
            self._begin(stage)
            kept = self._solved(stage, record, failures)
            if isinstance(kept, Summary):
                return kept, stage.index
            if reached is None:
                return remedied(f"{stage.name}: {kept.message}", kept.status, STEPS)
            failures.append(
                f"a step from {self.word} {reached:.10g}/{goal.count} to {stage.index:.10g} failed, halved: "
                f"{kept.message}"
            )
            self.steps.journal.note(failures[-1])
        why = f"no step from {self.word} {reached:.10g}/{goal.count} succeeds: {kept.message}"
        return remedied(why, kept.status, STEPS)

    def _begin(self, stage: Stage) -> None:
        self.steps.begin(stage.name, self.ring.band.half_width, self.ring.band.segments)

    def _solved(self, stage: Stage, stored: Summary | None, failures: list[str]) -> Summary | Result:
        """Solve a stage from the one before and store it; the result alone where it is no minimum."""
        record = None if stored is None else self.steps.journal.load(stored)
        state = self.ring if record is None else state_of(record)
        multipliers = None if record is None else multipliers_of(record)
        clock = self.steps.journal.clock()
        problem = Problem(self.ring.band, stage.prescription)
        options = Options(guard=stage.guard(), watch=self.steps.progress.step)
        result = solve(problem, state.vector(), multipliers, options)
        if result.status is not Status.MINIMUM:
            return result
        rulings = "two prescribed rulings" if self.word == "eversion" else "prescribed rulings"
        return self.steps.store(
            problem,
            result,
            clock,
            kind="auxiliary",
            stage=stage.name,
            method=f"{self.word}, {rulings}",
            parent=None if record is None else record.label,
            events=tuple(failures),
        )
