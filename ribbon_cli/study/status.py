"""How far a run has come: what its config names, against what is stored. Opens no state file."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from typing import Any

from ..config import Arclength, Config
from ..errors import RibbonError, StoreError
from ..solver.status import Status
from ..store import Run, Summary
from ..store.events import Ended, Event, SurveyFollowed, SurveyStart
from ..store.lock import Holder
from .plan import meeting, plan_of, start_name
from .removal import by_command
from .run_config import resolved_config

RUN_STATUSES = ("complete", "running", "waiting", "failed", "damaged", "unknown")
"""Words for a run as a whole: all targets certified; being written to; targets left; targets missed; ..."""
STATE_STATUSES = (*(status.value for status in Status), "missing", "unreadable", "damaged")
"""Words for a state: outcomes of a solve, or what has become of its file."""

Place = tuple[float | None, int]
"""Half-width and N of an equilibrium that a config names, by which the log tells which were missed."""


@dataclass(frozen=True)
class Counts:
    """Of the equilibria that a config names, `done` have a certificate, `failed` were not reached or have
    none, `running` is in hand and `waiting` is left; None where the config does not tell, and of surveys, which
    do not follow their config.
    """

    complete: bool | None = None
    done: int | None = None
    running: int | None = None
    waiting: int | None = None
    failed: int | None = None


@dataclass(frozen=True)
class Standing:
    """A run in a few words; `damage` is empty or says why the rest is unknown."""

    run: Run
    status: str
    equilibria: int | None = None
    states: int | None = None
    last_change: str | None = None
    counts: Counts = Counts()
    holder: Holder | None = None
    damage: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The run for JSON, as `ribbon ls` gives it."""
        run = self.run
        return {
            "name": run.name,
            "short_name": run.short_name,
            "path": str(run.path),
            "aside": run.is_aside,
            "status": self.status,
            "equilibria": self.equilibria,
            "states": self.states,
            "last_change": self.last_change,
            **asdict(self.counts),
            "holder": None if self.holder is None else asdict(self.holder),
            "damage": self.damage,
        }


def standing(run: Run) -> Standing:
    """How far a run has come. A damaged log is told, and raises nothing."""
    try:
        events = run.events()
        states = run.states()
    except StoreError as error:
        return Standing(run, "damaged", damage=str(error))
    holder = run.holder()
    counts = _counts(run, events, states, holder is not None)
    changed = events[-1].time if events else None
    status = _status(counts, holder is not None)
    return Standing(run, status, len(states), len(run.entries()), changed, counts, holder)


def _counts(run: Run, events: list[Event], states: list[Summary], held: bool) -> Counts:
    """How many of the planned equilibria are in which state.

    A stage is found by its name, as resuming finds it: what `ribbon continue` or `ribbon refine` added at the
    same place reaches no target of the config.
    """
    if any(isinstance(event, SurveyStart) for event in events):
        return Counts(_whole_survey(events))
    config = _config(run)
    planned = None if config is None else _planned(run, config)
    if config is None or planned is None:
        return Counts()
    ends = _ends(run, states, config.arclength)
    kept = start_name(config) if config.guess.keep_saddle else None
    reached = planned.keys() & ends.keys()
    # A point of a branch is what was asked for, stable or not, and so is the saddle that it begins at.
    done = {
        name
        for name in reached
        if any(
            state.certified or state.branch or (name == kept and state.status == "saddle")
            for state in ends[name]
        )
    }
    ended = [event for event in events if isinstance(event, Ended)]
    missed = Counter(ended[-1].missed) if ended and not held else Counter()
    left = Counter(place for name, place in planned.items() if name not in done)
    left -= Counter(ended[-1].beyond) if ended else Counter()
    bad = Counter(planned[name] for name in reached - done)
    failed = (left & (bad + missed)).total()
    waiting = left.total() - failed
    running = int(held and waiting > 0)
    return Counts(left <= bad, len(done), running, waiting - running, failed)


def _whole_survey(events: list[Event]) -> bool | None:
    """Whether a survey came to its end. None where its log does not tell, as how many starts were asked for is
    not kept: it was interrupted, or an older version made it."""
    last = next(
        event for event in reversed(events) if isinstance(event, (SurveyStart, SurveyFollowed, Ended))
    )
    return True if isinstance(last, Ended) else None


def _ends(run: Run, states: list[Summary], branch: Arclength | None) -> dict[str, list[Summary]]:
    """The states by the planned stage that each ends; a point of the config's branch ends the stage that is
    planned for the value it meets."""
    ends: dict[str, list[Summary]] = defaultdict(list)
    stages = {state.label: state.stage for state in run.states(all=True)} if branch else {}
    for state in states:
        if branch is None or state.branch is None:
            ends[state.stage].append(state)
        elif not by_command(state.stage, stages):
            ends[meeting(branch, state.parameters[branch.parameter] or 0.0)].append(state)
    return ends


def _given(run: Run, config: Config) -> tuple[float, int] | None:
    """Half-width and N that a given state brought, by what was made of it; None before that."""
    if config.guess.recipe != "state":
        return None
    made = (state for state in run.states(all=True) if state.stage == start_name(config))
    return next(((state.half_width, state.segments) for state in made), None)


def _config(run: Run) -> Config | None:
    """The run's config; None where it cannot be read."""
    try:
        return resolved_config(run)
    except RibbonError:
        return None


def _planned(run: Run, config: Config) -> dict[str, Place] | None:
    """The equilibria that a run's config names by their stages, None where they cannot be told."""
    try:
        stages = plan_of(config, _given(run, config)).stages
    except RibbonError:
        return None
    places: dict[str, Place] = {}
    for stage in stages:
        if stage.kind == "equilibrium":
            if stage.half_width is None or stage.segments is None:
                return None
            places[stage.name] = (stage.half_width, stage.segments)
    return places


def _status(counts: Counts, held: bool) -> str:
    """The run in one word."""
    if held:
        return "running"
    if counts.done is None:
        return "complete" if counts.complete else "unknown"
    if counts.waiting:
        return "waiting"
    return "failed" if counts.failed else "complete"
