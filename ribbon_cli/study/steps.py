"""The steps that configs and `ribbon refine` share: a stage's end stored, a state refined.

As in the journal, model and solver are imported when there is something to compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from ..store import BranchRecord, Run, Summary
from .clock import Clock, Origin
from .journal import Journal
from .progress import Progress

if TYPE_CHECKING:
    from ..config import SpectrumRequest
    from ..model.problem import Problem
    from ..solver.continuation import Move
    from ..solver.newton import Options
    from ..solver.status import Result


class Steps:
    """Solves a stage, stores its end and tells who watches; one for each pass over a run."""

    def __init__(
        self,
        run: Run,
        half_twists: int,
        spectrum: SpectrumRequest,
        progress: Progress,
        argv: Sequence[str],
        origin: Origin,
        total: int,
        everted: bool = False,
    ) -> None:
        self.journal = Journal(run, progress, argv, origin)
        self.half_twists = half_twists
        self.everted = everted
        self.spectrum = spectrum
        self.progress = progress
        self._total, self._index = total, 0

    @cached_property
    def options(self) -> Options:
        """Options of a solve with a closed seam."""
        from .acceptance import options_for

        return options_for(self.half_twists, self.progress)

    def begin(self, stage: str, half_width: float, segments: int) -> None:
        """Announce a stage."""
        self._index += 1
        self.progress.stage(stage, self._index, max(self._total, self._index), half_width, segments)

    def tell(self, stage: str, events: Sequence[str]) -> None:
        """Note what happened in a stage."""
        for event in events:
            self.journal.note(f"{stage}: {event}")

    def checked(self, result: Result) -> Result:
        """The result with its status changed if it is not the band that this pass is about."""
        from .acceptance import checked

        return checked(result, self.half_twists, everted=self.everted)

    def store(
        self,
        problem: Problem,
        result: Result,
        clock: Clock,
        *,
        kind: str,
        stage: str,
        method: str,
        parent: int | None,
        parent_ref: str | None = None,
        events: tuple[str, ...] = (),
        branch: BranchRecord | None = None,
    ) -> Summary:
        """Store a solve's end and the saddles it left; equilibria get their spectra."""
        from .records import Reached

        reached = Reached(
            problem,
            result,
            kind,
            stage,
            method,
            self.half_twists,
            parent,
            parent_ref,
            events,
            result.steps,
            branch,
        )
        spectrum = self.spectrum if kind == "equilibrium" else None
        return self.journal.store(reached, result.saddles, clock, spectrum)

    def store_move(
        self,
        move: Move,
        result: Result,
        clock: Clock,
        *,
        kind: str,
        stage: str,
        parent: int | None,
        failures: Sequence[str] = (),
    ) -> Summary:
        """Store the end of a step along a branch with what was met on the way."""
        from ..model.problem import Problem
        from ..solver.status import Status

        self.tell(stage, move.events)
        met = replace(result, saddles=move.saddles, steps=move.steps)
        if result.status is Status.SADDLE:
            met = replace(met, saddles=move.saddles[:-1])  # the last is the end itself
        return self.store(
            Problem(move.band),
            met,
            clock,
            kind=kind,
            stage=stage,
            method=move.method,
            parent=parent,
            events=(*failures, *move.events),
        )

    def refine(
        self, start: Summary, segments: int, stage: str, kind: str, *, splitting: bool = False
    ) -> Summary | str:
        """The state refined to another number of segments, or a sentence why it was not reached."""
        self.begin(stage, start.half_width, segments)
        known = self.journal.finished(stage)
        if known is not None:
            return known
        clock = self.journal.clock()
        from ..model.folding import ClosureError
        from ..solver.continuation import to_segments
        from ..solver.kinship import another_minimum
        from .acceptance import converged
        from .records import state_of
        from .remedies import remedied

        state = state_of(self.journal.load(start))
        try:
            move = to_segments(state, segments, self.options, splitting=splitting)
        except ClosureError as error:
            return f"{stage}: {error}: take more or fewer segments"
        result = self.checked(move.result)
        if not converged(result):
            return remedied(f"{stage}: {result.message}", result.status, "an N in between")
        if result.certified and start.certified:
            kin = another_minimum(state, result.state, self.options)
            move = replace(move, events=(*move.events, kin)) if kin else move
        return self.store_move(move, result, clock, kind=kind, stage=stage, parent=start.label)
