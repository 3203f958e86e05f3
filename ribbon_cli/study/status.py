"""How far a run has come: what its config names, against what is stored. Opens no state file."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

from ..config import Arclength, Config
from ..errors import RibbonError, StoreError
from ..store import Run, Summary
from ..store.events import Ended, Event, SurveyFollowed, SurveyStart
from ..store.lock import Holder
from .plan import by_command, meeting, stages_of, start_name
from .run_config import resolved_config

MOST_NAMED = 12
"""Most targets that are named in a line."""

Place = tuple[float | None, int]
"""Half-width and N of an equilibrium that a config names, by which the log tells which were missed."""


@dataclass(frozen=True)
class Counts:
    """Of the equilibria that a config names, `done` have a certificate, `failed` were not reached or have
    none, `running` is in hand and `waiting` is left; None where the config does not tell, and of
    surveys, which do not follow their config.
    """

    complete: bool | None = None
    done: int | None = None
    running: int | None = None
    waiting: int | None = None
    failed: int | None = None


@dataclass(frozen=True)
class Standing:
    """A run in a few words; `damage` is empty or says why the rest is unknown.

    `targets` are the stages of the equilibria that its config names, in order, with what came of each.
    """

    run: Run
    status: str
    equilibria: int | None = None
    states: int | None = None
    last_change: str | None = None
    counts: Counts = Counts()
    holder: Holder | None = None
    damage: str = ""
    targets: Mapping[str, str] = field(default_factory=dict)

    @property
    def failures(self) -> tuple[str, ...]:
        """The targets that were not reached, and those without certificate, a line each."""
        told = {"missed": "not reached", "uncertified": "without certificate"}
        lines = []
        for word, said in told.items():
            names = [name for name, status in self.targets.items() if status == word]
            if names:
                more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
                listed = "; ".join(names[:MOST_NAMED])
                lines.append(f"{len(names)} of {len(self.targets)} targets {said}: {listed}{more}")
        return tuple(lines)

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
            "not_reached": [name for name, word in self.targets.items() if word == "missed"],
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
    held = holder is not None
    targets = None
    if any(isinstance(event, SurveyStart) for event in events):
        counts = Counts(_whole_survey(events))
    else:
        targets = _targets(run, events, states, held)
        counts = Counts() if targets is None else _counts(targets, held)
    changed = events[-1].time if events else None
    facts = (len(states), len(run.entries()), changed, counts, holder)
    return Standing(run, _status(counts, held), *facts, targets=targets or {})


def _targets(run: Run, events: list[Event], states: list[Summary], held: bool) -> dict[str, str] | None:
    """What came of each planned equilibrium, by its stage; None where they cannot be told.

    `done`, `uncertified`, `missed`, `beyond` the event at which the config stops, or `waiting`. A stage is
    found by its name, as resuming finds it: what `ribbon continue` or `ribbon refine` added at the same
    place reaches no target of the config.
    """
    config = _config(run)
    planned = None if config is None else _planned(run, config)
    if config is None or planned is None:
        return None
    ends = _ends(run, states, config.arclength)
    kept = start_name(config) if config.guess.keep_saddle else None
    found = dict.fromkeys(planned, "waiting")
    for name in planned.keys() & ends.keys():
        # A point of a branch is what was asked for, stable or not, and so is the saddle that it begins at.
        good = (s.certified or s.branch or (name == kept and s.status == "saddle") for s in ends[name])
        found[name] = "done" if any(good) else "uncertified"
    ended = [event for event in events if isinstance(event, Ended)]
    if ended:
        told = (("beyond", Counter(ended[-1].beyond)), ("missed", Counter(() if held else ended[-1].missed)))
        # The log has half-width and N alone: of several stages there the last are those not reached.
        for (word, left), name in product(told, reversed(planned)):
            if found[name] == "waiting" and left[planned[name]] > 0:
                found[name] = word
                left[planned[name]] -= 1
    return found


def _counts(found: dict[str, str], held: bool) -> Counts:
    """How many of the planned equilibria are in which state."""
    many = Counter(found.values())
    running = int(held and many["waiting"] > 0)
    failed, waiting = many["missed"] + many["uncertified"], many["waiting"] - running
    return Counts(not many["missed"] + many["waiting"], many["done"], running, waiting, failed)


def _whole_survey(events: list[Event]) -> bool | None:
    """Whether a survey came to its end. None where its log does not tell, as how many starts were asked for
    is not kept: it was interrupted, or an older version made it."""
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
        stages = stages_of(config, _given(run, config))
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
