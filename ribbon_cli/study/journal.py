"""The run as a sequence of finished stages: what is stored is not computed again.

Every stage is a function of stored states alone, so that a run that was interrupted and resumed ends with
the same bytes as one that was not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..config import SpectrumRequest
from ..errors import LockedError, StoreError
from ..model.band import State
from ..model.topology import Linking, linking_number
from ..recipes.eversion import not_everted
from ..solver.newton import Options
from ..solver.status import STATIONARY, Result, SaddleMet, Status
from ..store import Run, StateRecord
from ..store.provenance import config_facts
from .outcome import Outcome
from .progress import Progress, Recording
from .records import Clock, Origin, Reached, build_record, saddle_result


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
        self._saddles: dict[str, int] = {}
        for remark in run.remarks:
            self.note(remark)
        for label, entry in sorted(run.entries().items()):
            state = entry["state"]
            if state["kind"] == "saddle":
                self._saddles[state["stage"]] = self._saddles.get(state["stage"], 0) + 1
            else:
                self._ends.setdefault(state["stage"], label)

    def has(self, stage: str) -> bool:
        """Whether the state that ended a stage is stored."""
        return stage in self._ends

    def finished(self, stage: str) -> StateRecord | None:
        """The state that ended a stage, if it is stored."""
        label = self._ends.get(stage)
        return None if label is None else self.run.look_up(label)

    def stages(self, prefix: str) -> list[str]:
        """Names of the finished stages that begin with `prefix`, in the order stored."""
        found = [(label, name) for name, label in self._ends.items() if name.startswith(prefix)]
        return [name for _, name in sorted(found)]

    def note(self, text: str) -> None:
        """Tell whoever watches, and keep it for the outcome."""
        self.notes.append(text)
        self.progress.note(text)

    def end(self, outcome: Outcome) -> None:
        """Keep in the log which targets were missed, where that is news and the run is open for writing."""
        if not self.run.is_writing:
            return
        missed = [[target.half_width, target.segments] for target in outcome.targets if not target.reached]
        ended = [event for event in self.run.events() if event["event"] == "ended"]
        if self.new_states or not ended or ended[-1]["missed"] != missed:
            self.run.log_event("ended", exit_code=outcome.exit_code, missed=missed)

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
    ) -> StateRecord:
        """Commit the saddles that were met in a stage, then the state that ends it."""
        for met in saddles[self._saddles.get(reached.stage, 0) :]:
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
        record = self._commit(reached, clock, spectrum)
        self._ends[reached.stage] = record.label
        return record

    def store_made(self, reached: Reached, clock: Clock, changes: Mapping[str, Any]) -> StateRecord:
        """Commit a state that was made and not solved for, some of its record's fields changed."""
        record = self._commit(reached, clock, None, changes)
        self._ends[reached.stage] = record.label
        return record

    def _commit(
        self,
        reached: Reached,
        clock: Clock,
        spectrum: SpectrumRequest | None,
        changes: Mapping[str, Any] | None = None,
    ) -> StateRecord:
        record = replace(build_record(self.run.next_label, reached, clock, spectrum), **(changes or {}))
        self.run.commit(record)
        self.new_states += 1
        return record


def options_for(half_twists: int, progress: Progress) -> Options:
    """Options of a solve with a closed seam: it must keep its linking number."""
    return Options(guard=_linking_guard(half_twists), watch=progress.step)


def _linking_guard(half_twists: int) -> Callable[[State], str | None]:
    def check(state: State) -> str | None:
        try:
            found = _linking_of(state).linking_number
        except ValueError:
            return None  # sum u is not zero between iterates; the state that ends a stage is checked again
        if abs(found - 0.5 * half_twists) > 0.25:
            return f"(Lk = {found:.6g} in place of {half_twists / 2:g}.)"
        return None

    return check


def _linking_of(state: State) -> Linking:
    return _linking(state.u.tobytes(), state.g.tobytes(), state.band.sigma, state.band.h)


@lru_cache(maxsize=1)
def _linking(u: bytes, g: bytes, sigma: int, h: float) -> Linking:
    """The linking number; the state that the guard saw last is the one that is checked next."""
    return linking_number(np.frombuffer(u).reshape(-1, 3), np.frombuffer(g).reshape(-1, 3), sigma, h)


def checked(result: Result, half_twists: int, *, everted: bool = False) -> Result:
    """A converged result, or the same with its status changed if it is not the band asked for.

    Of an `everted` cylinder, which the linking number does not tell from a ring, the inflections count too.
    """
    if not converged(result):
        return result
    state = result.state
    try:
        found = _linking_of(state)
    except ValueError as error:
        return replace(result, status=Status.LEFT_TOPOLOGY, detail=f"(No linking number: {error}.)")
    if not found.exact or abs(found.linking_number - 0.5 * half_twists) > 1e-6:
        detail = f"(Lk = {found.linking_number:.9g} in place of {half_twists / 2:g}.)"
        return replace(result, status=Status.LEFT_TOPOLOGY, detail=detail)
    misfit = not_everted(state) if everted else None
    return replace(result, status=Status.OTHER_SHAPE, detail=misfit) if misfit else result


def converged(result: Result) -> bool:
    """Whether a result is a stationary band of the right topology, certified or not."""
    return result.status in STATIONARY
