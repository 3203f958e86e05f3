"""The run as a sequence of finished stages: what is stored is not computed again.

Every stage is a function of stored states alone, so that a run that was interrupted and resumed ends with
the same bytes as one that was not. What it takes to compute a stage is imported when there is one to compute.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..errors import LockedError, StoreError
from ..store import Run, StateRecord, Summary
from ..store.events import Ended, GivenUp, Lost, removed
from ..store.provenance import config_facts
from .clock import Clock, Origin
from .outcome import Outcome
from .progress import Event, Note, Progress

if TYPE_CHECKING:
    from ..config import SpectrumRequest
    from ..solver.status import SaddleMet, Status
    from .records import Reached

SAME_SADDLE = 1e-9
"""Relative difference of energies up to which two saddles of one stage and index are one, computed twice."""
_RECENT = 8
"""States whose arrays are kept in memory after they were committed: the next stages begin at one of these."""


class NotStoredError(Exception):
    """A stage has to be computed, and the run is not open for writing; nothing that a user meets."""


def run_or_read(run: Run, progress: Progress, study: Callable[[Progress], Outcome]) -> Outcome:
    """Let a study pass over a run; where all its stages are stored, without a lock and without writing.

    So a finished run can be used that others may not write to, or that someone is refining; what an
    interrupted writer left in it is cleared if it can be. Raises as `Run.writing`.
    """
    cleared: list[str] = []
    if run.has_leftovers:
        with suppress(StoreError, LockedError), run.writing():
            cleared = list(run.remarks)
    told: list[Event] = []
    try:
        outcome = study(told.append)
    except NotStoredError:
        with run.writing():
            run.remarks[:0] = cleared
            return study(progress)
    for event in told:
        progress(event)
    return outcome


class Journal:
    """Finished stages of a run, by name; commits what is new if the run is open for writing."""

    def __init__(self, run: Run, progress: Progress, argv: Sequence[str], origin: Origin) -> None:
        self.run = run
        self.progress = progress
        self.notes: list[str] = []
        self.new_states = 0
        self._argv, self._origin = argv, origin
        self._config = config_facts(run.path)
        self._ends: dict[str, int] = {}
        self._saddles: dict[str, list[Summary]] = {}
        self._recent = deque[StateRecord](maxlen=_RECENT)
        for remark in run.remarks:
            self.note(remark)
        for label, entry in run.entries().items():
            if entry.state.kind == "saddle":
                self._saddles.setdefault(entry.state.stage, []).append(entry.state)
            else:
                self._ends.setdefault(entry.state.stage, label)
        self._lost = _lost_stages(run)
        self._lost_saddles = {
            state.stage
            for state in _lost_saddles(run)
            if not any(_met_again(state, known) for known in self._saddles.get(state.stage, ()))
        }

    def has(self, stage: str) -> bool:
        """Whether the state that ended a stage is stored."""
        return stage in self._ends

    def finished(self, stage: str) -> Summary | None:
        """The state that ended a stage, if it is stored: `load` reads what a stage is computed from."""
        label = self._ends.get(stage)
        return None if label is None else self.run.look_up(label)

    def lacks_saddle(self, stage: str) -> bool:
        """Whether a saddle that was met in a stage was lost, and is not stored again.

        Raises StoreError where the file of one that was not marked as lost is missing, or another.
        """
        for saddle in self._saddles.get(stage, ()):
            self.run.look_up(saddle.label)
        return stage in self._lost_saddles

    def given_up(self, stage: str, parent: int | None) -> tuple[Status, str] | None:
        """How an earlier pass failed at a stage from a state, if it did and kept it: status and detail."""
        for event in self.run.events():
            if isinstance(event, GivenUp) and (event.stage, event.parent) == (stage, parent):
                from ..solver.status import Status

                with suppress(ValueError):  # a status of another version's
                    return Status(event.status), event.detail
        return None

    def load(self, state: Summary) -> StateRecord:
        """All of a stored state; one that was committed of late is at hand. Raises StoreError."""
        at_hand = (record for record in self._recent if record.label == state.label)
        return next(at_hand, None) or self.run.load(state.label)

    def ancestry(self, stage: str) -> list[Summary]:
        """The states that led to a stage's end, the first of them first and that end last.

        Empty where one of them is not stored. A parent's label is smaller than its child's.
        """
        label, entries = self._ends.get(stage), self.run.entries()
        line: list[Summary] = []
        while label is not None:
            if label not in entries or (line and label >= line[-1].label):
                return []
            line.append(self.run.look_up(label))
            label = line[-1].parent
        return line[::-1]

    def stages(self, prefix: str) -> list[str]:
        """Names of the finished stages that begin with `prefix`, in the order stored."""
        found = [(label, name) for name, label in self._ends.items() if name.startswith(prefix)]
        return [name for _, name in sorted(found)]

    def lacks(self, prefix: str) -> bool:
        """Whether a state was lost or removed, and not stored again, whose stage's name begins so."""
        return any(stage.startswith(prefix) and stage not in self._ends for stage in self._lost)

    def note(self, text: str) -> None:
        """Tell whoever watches, and keep it for the outcome."""
        self.notes.append(text)
        self.progress(Note(text))

    def end(self, outcome: Outcome) -> None:
        """Keep in the log which targets were missed, where that is news and the run is open for writing."""
        if not self.run.is_writing:
            return
        left = [target for target in outcome.targets if not target.reached]
        missed = tuple((target.half_width, target.segments) for target in left if not target.beyond)
        beyond = tuple((target.half_width, target.segments) for target in left if target.beyond)
        ended = [event for event in self.run.events() if isinstance(event, Ended)]
        if self.new_states or not ended or (ended[-1].missed, ended[-1].beyond) != (missed, beyond):
            more = {"beyond": beyond} if beyond else {}
            self.run.log_event("ended", exit_code=outcome.exit_code, missed=missed, **more)

    def clock(self) -> Clock:
        """A clock for a stage that begins now. Raises NotStoredError if its end could not be committed."""
        if not self.run.is_writing:
            raise NotStoredError
        return Clock(self._argv, self._origin, self._config)

    def log(self, kind: str, **data: Any) -> None:
        """Append an event to the run's log. Raises NotStoredError if the run is not open for writing."""
        if not self.run.is_writing:
            raise NotStoredError
        self.run.log_event(kind, **data)

    def store(
        self,
        reached: Reached,
        saddles: Sequence[SaddleMet],
        clock: Clock,
        spectrum: SpectrumRequest | None,
        changes: object = None,
    ) -> Summary:
        """Commit the saddles that were met in a stage, then the state that ends it.

        `changes` is a dataclass with fields of its record that do not follow from the solve.
        """
        self.store_saddles(reached, saddles, clock)
        state = self._commit(reached, clock, spectrum, changes)
        self._ends[reached.stage] = state.label
        return state

    def store_saddles(self, reached: Reached, saddles: Sequence[SaddleMet], clock: Clock) -> None:
        """Commit those of a stage's saddles that are not stored; a stored one is the nearest in energy."""
        from .records import saddle_result

        left = list(saddles)
        for state in self._saddles.get(reached.stage, ())[: len(left)]:
            left.remove(min(left, key=lambda met: abs(met.energy - (state.energy or 0.0))))
        for met in left:
            saddle = saddle_result(reached.problem, met)
            self._commit(replace(reached, result=saddle, kind="saddle", events=(), steps=0), clock, None)
        self._lost_saddles.discard(reached.stage)

    def _commit(
        self,
        reached: Reached,
        clock: Clock,
        spectrum: SpectrumRequest | None,
        changes: object = None,
    ) -> Summary:
        from .records import build_record, completed, with_spectra

        record = replace(
            build_record(self.run.next_label, reached, clock), **({} if changes is None else vars(changes))
        )
        if spectrum is not None and self.run.behind:
            record, spectrum = with_spectra(record, spectrum), None
        self.run.commit_soon(record.label, partial(completed, record, spectrum))
        self._recent.append(record)
        self.new_states += 1
        return Summary.of(record, "")  # no stage asks for the hash, nor for the spectra that it covers


def _lost_stages(run: Run) -> set[str]:
    """Stages of the states that were removed, or that `ribbon repair` marked as lost."""
    events = run.events()
    lost = {event.stage for event in events if isinstance(event, Lost) and event.stage is not None}
    return lost | {entry.state.stage for entry in removed(events).values()}


def _lost_saddles(run: Run) -> list[Summary]:
    """The saddles among these states, as far as their lines tell."""
    events = run.events()
    lost = [event.state for event in events if isinstance(event, Lost)]
    lost += [entry.state for entry in removed(events).values()]
    return [state for state in lost if state is not None and state.kind == "saddle"]


def _met_again(lost: Summary, known: Summary) -> bool:
    """Whether a stored saddle is one that was lost, computed again."""
    if lost.energy is None or known.energy is None:
        return True  # nothing to tell them apart by
    same = lost.negative_eigenvalues == known.negative_eigenvalues
    return same and math.isclose(lost.energy, known.energy, rel_tol=SAME_SADDLE)
