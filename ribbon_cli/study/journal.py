"""The run as a sequence of finished stages: what is stored is not computed again.

Every stage is a function of stored states alone, so that a run that was interrupted and resumed ends with
the same bytes as one that was not. What it takes to compute a stage is imported when there is one to compute.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..errors import LockedError, StoreError
from ..store import Run, StateRecord, Summary
from ..store.events import Ended, Lost, removed
from ..store.provenance import config_facts
from .clock import Clock, Origin
from .outcome import Outcome
from .progress import Progress, Recording

if TYPE_CHECKING:
    from ..config import SpectrumRequest
    from ..solver.status import SaddleMet
    from .records import Reached

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
    told = Recording()
    try:
        outcome = study(told)
    except NotStoredError:
        with run.writing():
            run.remarks[:0] = cleared
            return study(progress)
    told.replay(progress)
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
        self._saddles = Counter[str]()
        self._recent = deque[StateRecord](maxlen=_RECENT)
        self._lost = _lost_stages(run)
        for remark in run.remarks:
            self.note(remark)
        for label, entry in run.entries().items():
            if entry.state.kind == "saddle":
                self._saddles[entry.state.stage] += 1
            else:
                self._ends.setdefault(entry.state.stage, label)

    def has(self, stage: str) -> bool:
        """Whether the state that ended a stage is stored."""
        return stage in self._ends

    def finished(self, stage: str) -> Summary | None:
        """The state that ended a stage, if it is stored: `load` reads what a stage is computed from."""
        label = self._ends.get(stage)
        return None if label is None else self.run.look_up(label)

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
        self.progress.note(text)

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
    ) -> Summary:
        """Commit the saddles that were met in a stage, then the state that ends it."""
        from .records import saddle_result

        for met in saddles[self._saddles[reached.stage] :]:
            self._commit(
                replace(
                    reached,
                    result=saddle_result(reached.problem, met),
                    kind="saddle",
                    events=(),
                    steps=0,
                ),
                clock,
                None,
            )
        return self._end_of_stage(reached, clock, spectrum)

    def store_made(self, reached: Reached, clock: Clock, changes: Mapping[str, Any]) -> Summary:
        """Commit a state that was made and not solved for, some of its record's fields changed."""
        return self._end_of_stage(reached, clock, None, changes)

    def _end_of_stage(self, reached: Reached, *how: Any) -> Summary:
        state = self._commit(reached, *how)
        self._ends[reached.stage] = state.label
        return state

    def _commit(
        self,
        reached: Reached,
        clock: Clock,
        spectrum: SpectrumRequest | None,
        changes: Mapping[str, Any] | None = None,
    ) -> Summary:
        from .records import build_record

        record = replace(build_record(self.run.next_label, reached, clock, spectrum), **(changes or {}))
        state = self.run.commit(record)
        self._recent.append(record)
        self.new_states += 1
        return state


def _lost_stages(run: Run) -> set[str]:
    """Stages of the states that were removed, or that `ribbon repair` marked as lost."""
    events = run.events()
    lost = {event.stage for event in events if isinstance(event, Lost) and event.stage is not None}
    return lost | {entry.state.stage for entry in removed(events).values()}
