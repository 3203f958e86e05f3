"""The walk through a run's stages: each is loaded if it is stored, else solved for, checked and committed.

As in the journal, model and solver are imported, and arrays are read, when there is something to compute.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Protocol, TypeVar

from ..facts import Event
from ..store import BranchRecord, Run, Summary
from ..store.events import GIVEN_UP
from .clock import Clock, Origin
from .failure import Failure, way_facts
from .journal import Journal
from .memory import leave_grid
from .progress import Progress
from .progress import Stage as Begun

if TYPE_CHECKING:
    from ..config import SpectrumRequest
    from ..model.band import State
    from ..model.problem import Problem
    from ..solver.newton import Options
    from ..solver.status import Result
    from .records import Reached


@dataclass(frozen=True)
class Stage:
    """One stage: its name, which is its key in the run, the place it aims at, the state it begins at.

    Where `start` is given, the parameters that a step to `target` begins at, the log keeps that the step
    failed, and another pass does not try it again.
    """

    name: str
    half_width: float
    segments: int
    kind: str
    parent: int | None = None
    parent_ref: str | None = None
    start: Mapping[str, float | None] | None = None
    target: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Ended:
    """Where a stage's solve ended, and how it came there.

    `events` are told when the end is stored, those `before` have been told. `changes` is a
    dataclass with fields of the record that do not follow from the result. `clock` is set by the walk.
    """

    problem: Problem
    result: Result
    method: str
    events: tuple[Event, ...] = ()
    before: tuple[Event, ...] = ()
    branch: BranchRecord | None = None
    changes: object = None
    clock: Clock | None = None


Solve = Callable[[], Ended | Failure]


class Walk:
    """Walks through stages, and tells who watches; one for each pass over a run.

    `gap` is the least distance that contact forces keep, None where contact has no forces.
    """

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
        gap: float | None = None,
    ) -> None:
        self.journal = Journal(run, progress, argv, origin)
        self.half_twists = half_twists
        self.everted = everted
        self.gap = gap
        self.spectrum = spectrum
        self.progress = progress
        self._total, self._index = total, 0

    @cached_property
    def options(self) -> Options:
        """Options of a solve with a closed seam."""
        from .acceptance import options_for

        return options_for(self.half_twists, self.progress)

    def options_from(self, start: State) -> Options:
        """Options of a solve that begins at a state: a strip with ends must not pass through itself."""
        if start.band.closed:
            return self.options
        from .acceptance import strip_guard

        return replace(self.options, guard=strip_guard(start))

    def begin(self, stage: str, half_width: float, segments: int) -> None:
        """Announce a stage."""
        self._index += 1
        total = max(self._total, self._index) if self._total else 0
        self.progress(Begun(stage, self._index, total, half_width, segments))

    def tell(self, stage: str, events: Iterable[object]) -> None:
        """Note what happened in a stage."""
        for event in events:
            self.journal.note(f"{stage}: {event}")

    def checked(self, result: Result) -> Result:
        """The result with its status changed if it is not the band that this pass is about."""
        from .acceptance import checked

        return checked(result, self.half_twists, everted=self.everted)

    # --- one stage ---

    def reach(self, stage: Stage, solve: Solve) -> Summary | Failure:
        """Announce a stage and come to its end."""
        self.begin(stage.name, stage.half_width, stage.segments)
        return self.end_of(stage, solve)

    def end_of(self, stage: Stage, solve: Solve, clock: Clock | None = None) -> Summary | Failure:
        """The end of a stage, which is stored or is solved for and committed; the failure where it has none.

        Saddles that were met on the way to a stored end, and were lost since, are met again and stored.
        """
        failed = self._failed_before(stage)
        if failed is not None:  # though it is stored: it was reached from elsewhere, by halves
            return failed
        known = self.journal.finished(stage.name)
        if known is not None and not self.journal.lacks_saddle(stage.name):
            return known
        clock = clock or self.journal.clock()
        end = solve()
        attempt = end.attempt if isinstance(end, Failure) else end
        attempt = None if attempt is None else replace(attempt, clock=clock)
        if known is not None:
            if attempt is not None:
                self.journal.store_saddles(self._reached(stage, attempt), attempt.result.saddles, clock)
            return known
        if isinstance(end, Failure):
            if stage.start is not None and end.status is not None:
                facts = {"stage": stage.name, "parent": stage.parent, "detail": end.detail}
                self.journal.log(GIVEN_UP, status=end.status.value, **facts)
            return replace(end, attempt=attempt)
        assert attempt is not None
        return self.store(stage, attempt)

    def _failed_before(self, stage: Stage) -> Failure | None:
        """The failure of a step that an earlier pass took in vain, None where none is kept."""
        if stage.start is None:
            return None
        kept = self.journal.given_up(stage.name, stage.parent)
        return None if kept is None else Failure("step", *kept, way_facts(stage.start, stage.target))

    def store(self, stage: Stage, end: Ended) -> Summary:
        """Store a stage's end and the saddles that it left; equilibria get their spectra."""
        self.tell(stage.name, end.events)
        spectrum = self.spectrum if stage.kind == "equilibrium" else None
        clock = end.clock or self.journal.clock()
        reached = self._reached(stage, end)
        return self.journal.store(reached, end.result.saddles, clock, spectrum, end.changes)

    def _reached(self, stage: Stage, end: Ended) -> Reached:
        from .records import Reached

        return Reached(
            end.problem,
            end.result,
            stage.kind,
            stage.name,
            end.method,
            self.half_twists,
            stage.parent,
            stage.parent_ref,
            (*end.before, *end.events),
            end.result.steps,
            end.branch,
        )

    def goes_on(self, state: Summary) -> bool:
        """Whether a schedule goes on from a state: a certified one, or one at rest on itself that may be
        a minimum, but was left undecided.
        """
        return state.certified or (bool(state.contacts) and state.status == "undecided")

    # --- several ---

    def needed(self, stages: Sequence[Stage]) -> Sequence[Stage]:
        """Of stages that stand for each other the first that is stored, else all of them."""
        stored = (stage for stage in stages if self.journal.has(stage.name))
        return next(([stage] for stage in stored), stages)

    def longest(
        self,
        stages: Iterable[Stage],
        solve: Callable[[Stage, tuple[Event, ...]], Ended | Failure],
        halved: Callable[[Stage, Failure], Event | str],
    ) -> tuple[Summary | None, tuple[Failure, ...]]:
        """The end of the first stage that has one, each being half as far as the one before, and the failures
        of those before it.

        `solve` is called with the events of the failures so far, which `halved` makes of them.
        """
        failures: list[Failure] = []
        events: list[Event] = []
        for stage in stages:
            end = self.reach(stage, partial(solve, stage, tuple(events)))
            if isinstance(end, Summary):
                return end, tuple(failures)
            failures.append(end)
            what = halved(stage, end)
            self.journal.note(str(what))
            events += [what] if isinstance(what, Event) else []
        return None, tuple(failures)

    def refine(
        self, start: Summary, segments: int, stage: str, kind: str, *, splitting: bool = False
    ) -> Summary | Failure:
        """The state refined to another number of segments."""

        def solve() -> Ended | Failure:
            from .stepping import refined

            return refined(self, start, segments, stage, splitting=splitting)

        before = self.journal.new_states
        found = self.reach(Stage(stage, start.half_width, segments, kind, start.label), solve)
        if self.journal.new_states > before and kind != "intermediate":  # which has no spectra
            leave_grid(segments)
        return found


class Touching(Protocol):
    """A state on a branch, of which it is known whether it touches itself."""

    @property
    def self_contact(self) -> bool:
        """Whether facets meet."""


S = TypeVar("S", bound=Touching)


def bracketed(
    free: S, touching: S, within: float, place: Callable[[S], float], step: Callable[[S, float], S | Failure]
) -> tuple[S, S, Failure | None]:
    """Halve the step between two states to `within` in their `place`, each half taken from the free end.

    Also why it could not be halved further, where a step fails.
    """
    while abs(place(touching) - place(free)) > within:
        middle = step(free, 0.5 * (place(free) + place(touching)))
        if isinstance(middle, Failure):
            return free, touching, middle
        free, touching = (free, middle) if middle.self_contact else (middle, touching)
    return free, touching, None
