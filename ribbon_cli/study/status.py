"""How far a run has come: what its config names, against what is stored. Opens no state file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from ..config import Config
from ..errors import RibbonError, StoreError
from ..solver.status import Status
from ..store import Run, Summary
from ..store.events import Ended, Event
from ..store.lock import Holder
from .plan import plan_of, start_name
from .run_config import resolved_config

RUN_STATUSES = ("complete", "running", "waiting", "failed", "damaged", "unknown")
"""Words for a run as a whole: all targets certified; being written to; targets left; targets missed; ..."""
STATE_STATUSES = (*(status.value for status in Status), "missing", "unreadable", "damaged")
"""Words for a state: outcomes of a solve, or what has become of its file."""

Place = tuple[float | None, int]


@dataclass(frozen=True)
class Counts:
    """Of the equilibria that a config names, `done` have a certificate, `failed` were not reached or have
    none, `running` is in hand and `waiting` is left; None where the config does not tell.
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
    """How many of the planned equilibria are in which state; a schedule may come to a place several times."""
    config = _config(run)
    planned = None if config is None else _planned(run, config)
    if config is None or planned is None:
        return Counts()
    kept = start_name(config) if config.guess.keep_saddle else None
    # A point of a branch is what was asked for, stable or not, and so is the saddle that it begins at.
    good = (
        state
        for state in states
        if state.certified or state.branch or (state.stage == kept and state.status == "saddle")
    )
    reached = _stages(states)
    done = planned & _stages(good)
    ended = [event for event in events if isinstance(event, Ended)]
    missed = Counter(ended[-1].missed) if ended and not held else Counter()
    planned = planned - Counter(ended[-1].beyond) if ended else planned
    failed = (planned - done) & (reached - done + missed)
    left = (planned - done - failed).total()
    running = int(held and left > 0)
    return Counts(planned <= reached, done.total(), running, left - running, failed.total())


def _stages(states: Iterable[Summary]) -> Counter[Place]:
    """How many stages end at each place; one whose state was computed again counts once."""
    return Counter(
        (b, n) for b, n, _ in {(state.half_width, state.segments, state.stage) for state in states}
    )


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


def _planned(run: Run, config: Config) -> Counter[Place] | None:
    """How often a run's config names each equilibrium by width and N, None where that cannot be told."""
    try:
        stages = plan_of(config, _given(run, config)).stages
    except RibbonError:
        return None
    places: Counter[Place] = Counter()
    for stage in stages:
        if stage.kind == "equilibrium":
            if stage.half_width is None or stage.segments is None:
                return None
            places[stage.half_width, stage.segments] += 1
    return places


def _status(counts: Counts, held: bool) -> str:
    """The run in one word."""
    if held:
        return "running"
    if counts.done is None:
        return "unknown"
    if counts.waiting:
        return "waiting"
    return "failed" if counts.failed else "complete"
