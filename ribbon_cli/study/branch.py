"""Branches of a run: arclength continuation step by step, each step a function of stored states.

A step is stored as its events (folds, branch points, contacts, widths asked for) and, last, its end point
with the branch's tangent there and the length to try next. What is stored is not computed again; a step
that was interrupted is, and gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..config import Arclength
from ..facts import Event as Happening
from ..facts import event as happening
from ..facts import same_value
from ..model.touching_gaps import Pairs
from ..parts import HALF_WIDTH
from ..solver.arclength import Point, Tangent, initial_tangent, point_at, point_of, tangent_from
from ..solver.branch import Advance, BranchOptions, End, Reason, advance, reason_to_end
from ..solver.branch_events import VALUE, WIDTH, Event
from ..solver.branch_switch import switch
from ..solver.newton import Guard
from ..solver.resting import RestingProblem
from ..solver.singular import lowest_mode, with_multipliers
from ..store import BranchRecord, StateRecord, Summary
from ..store.events import BRANCH_END
from .acceptance import checked, converged
from .branch_tables import course_point, courses
from .clock import Clock
from .closed_branches import TURNING, repeated, turns
from .failure import Failure
from .outcome import Course, Target
from .plan import place_name
from .progress import Step
from .records import all_multipliers_of, pairs_of, state_of
from .walk import Ended, Stage, Walk

SIDES = ((1, "+"), (-1, "-"))
MOST_ENDS = 4
"""Branches whose ends are told of a value that none of them met."""
_RAN_OUT = (Reason.RANGE.value, Reason.STEP_TOO_SMALL.value)
"""Ends that are no events, after which a value that was asked for is missed."""


@dataclass(frozen=True)
class _Place:
    """Where a branch stands: a stored state, with the length to try next and that travelled.

    `sign` is the direction in the `parameter` at a branch's start, 0 at a stored step, whose tangent is
    stored. `gap` is what contact forces keep, None without them.
    """

    record: StateRecord
    next_step: float
    arclength: float
    parameter: str
    gap: float | None
    sign: int = 0

    @cached_property
    def point(self) -> Point:
        """The state with its derivatives."""
        return _point(self.record, self.parameter, self.gap)

    @cached_property
    def tangent(self) -> Tangent:
        """The unit tangent there; its multipliers are computed again. Raises FactorisationError."""
        branch = self.record.branch
        if self.sign or branch is None:
            return initial_tangent(self.point, self.sign)
        near = _direction(branch.tangent, branch.half_width_rate, self.record)
        return tangent_from(self.point, near)


class Branches:
    """Follows the branches that a request names from a stored state; `courses` are those followed so far."""

    def __init__(self, walk: Walk, request: Arclength, start: StateRecord) -> None:
        self.walk, self.journal = walk, walk.journal
        self.request, self.start = request, start
        self.name = request.parameter
        self.value = start.parameters[self.name]
        ends = [self.value, request.to, *([] if request.back_to is None else [request.back_to])]
        self.options = BranchOptions(
            low=min(ends),
            high=max(ends),
            values=request.at,
            stop_at=frozenset(Reason(word) for word in request.stop_at),
            first_step=min(BranchOptions.first_step, request.max_step),
            largest_step=request.max_step,
            guard=walk.options.guard,
        )
        self.courses: list[Course] = []

    def follow(self, name: str) -> None:
        """Follow the branch towards `to`, then, if asked, the other way, then those that cross it."""
        up = self.request.to > self.value
        for sign in (1, -1) if self.request.both else (1,):
            towards = "up" if up == (sign > 0) else "down"
            begun = (self.start, self.options.first_step, 0.0, self.name, self.walk.gap)
            place = _Place(*begun, 1 if towards == "up" else -1)
            self._follow(f"{name} {towards}", self.start, place, [], 1, self.request.switch)

    def _follow(
        self, name: str, start: StateRecord, place: _Place, met: list[StateRecord], step: int, depth: int
    ) -> None:
        """Follow a branch from a place on it, then those that cross it, `depth` times over."""
        end: End | None = None
        turned = [start] if place.record is not start else []  # off a branch point it begins as off a turn
        while end is None and step <= self.request.steps:
            following, found, end = self._step(name, step, place)
            met += found
            end = end or _closed(turned, found)
            if following is not None:
                place = following
                met.append(place.record)
            step += 1
        self._finish(name, start, met, end or End(Reason.STEPS, self._at(place.record)))
        if depth > 0:
            for record in met:
                if _can_be_left(record):
                    for side, word in SIDES:
                        self._switch(record, side, f"branch from {record.label} side {word}", depth - 1)

    @property
    def left(self) -> tuple[Target, ...]:
        """The values `at` that none of the branches met; beyond where an event ended one of them."""
        met = {self.value}
        for course in self.courses:
            met |= {p.parameters[self.name] or 0.0 for p in course.points if p.type in (WIDTH, VALUE)}
        beyond = any(course.reason not in _RAN_OUT for course in self.courses)
        ends = "; ".join(f"{c.name} ends at {c.place} ({c.reason})" for c in self.courses[:MOST_ENDS])
        more = "; ..." if len(self.courses) > MOST_ENDS else ""
        targets = []
        for value in self.request.at:
            if any(same_value(self.name, value, known, self.start.length) for known in met):
                continue
            half_width, words = self.start.half_width, place_name({self.name: value})
            if self.name == HALF_WIDTH:
                half_width, words = value, ""
            message = f"not met by any branch: {ends}{more}"
            where = (half_width, self.start.segments)
            targets.append(
                Target(*where, None, False, False, message, beyond=beyond, place=words, of_branch=True)
            )
            if beyond:
                self.journal.note(f"{targets[-1].where}: {message}")
        return tuple(targets)

    # --- one step ---

    def _step(self, name: str, k: int, place: _Place) -> tuple[_Place | None, list[StateRecord], End | None]:
        """Step k of a branch: the place it leads to, the events on the way, and the end if it is one."""
        stage = f"{name}, step {k}"
        base = place.record
        known = sorted(map(self._stored, self.journal.stages(f"{stage}, ")), key=_travelled)
        whole = not self.journal.lacks(f"{stage}, ")  # else it is taken again for the event that was lost
        for j, event in enumerate(known if whole else ()):
            end = self._end_at(event, base)
            if end is not None:
                return None, known[: j + 1], end
        stored = self._finished(stage)
        if whole and stored is not None and self.options.low <= self._at(stored) <= self.options.high:
            return _place(stored, self.name, self.walk.gap), known, None
        self.walk.begin(stage, base.half_width, base.segments)
        clock = self.journal.clock()
        try:
            taken = advance(place.point, place.tangent, place.next_step, self._options_from(place))
        except ArithmeticError as error:
            return None, known, End(Reason.STEP_TOO_SMALL, self._at(base), f"no tangent here: {error}")
        if taken.point is not None:
            found = taken.point
            where = "" if self.name == HALF_WIDTH else f"{found.symbol} = {found.value:g}"
            half_width = found.problem.band.half_width
            self.walk.progress(Step(found.steps, found.energy, found.worst, half_width, where))
        self.walk.tell(stage, (*taken.refused, *taken.changes))
        events: list[StateRecord] = []
        for found_on_it in _numbered(taken.events):
            met = self._store_event(stage, found_on_it, place, taken, clock)
            if isinstance(met, Failure):
                return None, events, self._broken(base, met)
            events.append(met)
        if taken.point is None or taken.tangent is None:
            return None, events, taken.end
        point, tangent, length = taken.point, taken.tangent, place.arclength + taken.length

        def ended() -> Ended | Failure:
            branch = self._branch_record(name, "step", point, tangent, length, taken.following)
            return self._ended(stage, point, branch, (*taken.refused, *taken.changes))

        record = self.walk.end_of(_stage(stage, point, "step", base), ended, clock)
        if isinstance(record, Failure):
            return None, events, self._broken(base, record)
        return _place(self.journal.load(record), self.name, self.walk.gap), events, None

    def _stored(self, stage: str) -> StateRecord:
        record = self._finished(stage)
        assert record is not None
        return record

    def _finished(self, stage: str) -> StateRecord | None:
        """All of the state that ended a stage, if it is stored: a branch goes on from its tangent."""
        state = self.journal.finished(stage)
        return None if state is None else self.journal.load(state)

    def _store_event(
        self, stage: str, found: tuple[str, Event], place: _Place, taken: Advance, clock: Clock
    ) -> StateRecord | Failure:
        """What was met within a step, stored."""
        word, event = found
        name, branch = f"{stage}, {word}", stage.rpartition(",")[0]

        def ended() -> Ended | Failure:
            point = self._branch_record(
                branch,
                event.type,
                event.point,
                event.tangent,
                place.arclength + event.position,
                taken.following,
                event,
            )
            what = _happening(event)
            end = self._ended(name, event.point, point, (what,), _SINGULAR.get(event.type, ""))
            if isinstance(end, Ended):
                self.walk.tell(branch, (what,))
            return end

        met = self.walk.end_of(_stage(name, event.point, event.type, place.record), ended, clock)
        return met if isinstance(met, Failure) else self.journal.load(met)

    def _ended(
        self,
        stage: str,
        point: Point,
        branch: BranchRecord,
        events: tuple[Happening, ...],
        singular: str = "",
        method: str = "arclength continuation",
    ) -> Ended | Failure:
        """A point of a branch as a stage's end; a failure if it is not the band that the run is about."""
        result = checked(point.result(singular), self.walk.half_twists)
        if not converged(result):
            return Failure("solve", result.status, result.detail, {"stage": stage})
        return Ended(point.problem, result, method, before=events, branch=branch)

    def _branch_record(
        self,
        name: str,
        type: str,
        point: Point,
        tangent: Tangent,
        arclength: float,
        next_step: float,
        event: Event | None = None,
    ) -> BranchRecord:
        """What a point is on its branch."""
        segments = point.problem.band.segments
        mode = None if event is None else event.mode
        before = None if event is None else event.before
        after = None if event is None else event.after
        lowest = lowest_mode(point)
        overlap = mode.overlap if mode is not None else None if lowest is None else lowest[1]
        return BranchRecord(
            name=name,
            type=type,
            arclength=arclength,
            half_width_rate=tangent.value,
            parameter=None if self.name == HALF_WIDTH else self.name,
            next_step=next_step,
            tangent=tangent.x.reshape(segments, 7),
            index_before=before,
            index_after=after,
            lowest_eigenvalue=None if lowest is None else lowest[0],
            sliding_overlap=overlap,
            soft_mode=None if mode is None else mode.tangent.x.reshape(segments, 7),
        )

    # --- ends ---

    def _end_at(self, record: StateRecord, base: StateRecord) -> End | None:
        """The end of the branch at a stored event, if it is one."""
        branch = record.branch
        assert branch is not None
        reason = reason_to_end(
            self.options,
            branch.type,
            self._at(record),
            loses=branch.index_before == 0 and (branch.index_after or 0) > 0,
            begins=not base.self_contact,
        )
        return None if reason is None else End(reason, self._at(record))

    def _finish(self, name: str, start: StateRecord, met: Sequence[StateRecord], end: End) -> None:
        """Keep the branch's course, and its end in the run's log."""
        points = tuple(course_point(Summary.of(record)) for record in met)
        last = met[-1] if met else start
        course = Course(
            name,
            start.label,
            points,
            end.reason.value,
            end.value if self.name == HALF_WIDTH else last.half_width,
            end.message(self.name),
            self.name,
            None if self.name == HALF_WIDTH else end.value,
        )
        self.courses.append(course)
        noted = {
            "branch": name,
            "start": start.label,
            "reason": course.reason,
            "half_width": course.half_width,
            "message": course.message,
            **({} if self.name == HALF_WIDTH else {"parameter": self.name, "value": end.value}),
        }
        self.journal.note(f"{name} ends at {course.place}: {course.message}")
        known = {each.name: each for each in courses(self.journal.run)}.get(name)
        if known is not None and known.arclength > course.arclength:
            return  # it was followed further before, and that end stands
        if known is None or any(
            getattr(known, key) != noted[key] for key in ("reason", "half_width", "message")
        ):
            self.journal.log(BRANCH_END, **noted)

    # --- other branches ---

    def _switch(self, record: StateRecord, side: int, name: str, depth: int) -> None:
        """Follow the branch that crosses at a stored branch point, to one side."""
        words = f"{name}, step 1"
        stage = Stage(words, record.half_width, record.segments, "intermediate", record.label)

        def ended() -> Ended | Failure:
            assert record.branch is not None
            assert record.branch.soft_mode is not None
            tangent = _direction(record.branch.tangent, record.branch.half_width_rate, record)
            try:
                point = _point(record, self.name, self.walk.gap)
                mode = with_multipliers(point, record.branch.soft_mode.ravel())
                found = switch(point, tangent, mode, side, self._guard_from(record))
            except ArithmeticError as error:
                return Failure("solve", None, str(error), {"stage": stage.name})
            branch = self._branch_record(
                name, "step", found.point, found.tangent, found.distance, self.options.first_step
            )
            method = f"branch switching, side {side:+d}"
            return self._ended(stage.name, found.point, branch, (), method=method)

        if not self.journal.has(stage.name):
            self.walk.begin(stage.name, stage.half_width, stage.segments)
        first = self.walk.end_of(stage, ended)
        if isinstance(first, Failure):
            self._finish(name, record, [], self._broken(record, first))
        else:
            begun = self.journal.load(first)
            self._follow(name, record, _place(begun, self.name, self.walk.gap), [begun], 2, depth)

    # --- small things ---

    def _at(self, record: StateRecord) -> float:
        """The value of the parameter at a state."""
        return record.parameters[self.name]

    def _broken(self, base: StateRecord, why: Failure) -> End:
        """The end of a branch on which nothing follows a state."""
        return End(Reason.STEP_TOO_SMALL, self._at(base), why.message)

    def _guard_from(self, base: StateRecord) -> Guard | None:
        """What refuses a point that is reached from a state."""
        return self.walk.options_from(state_of(base)).guard

    def _options_from(self, place: _Place) -> BranchOptions:
        return replace(self.options, guard=self._guard_from(place.record))


_SINGULAR = {
    "fold": "It lies on a fold of its branch, where the projected Hessian is singular.",
    "branch-point": "It lies on a bifurcation, where the projected Hessian is singular.",
}


def _closed(turned: list[StateRecord], found: Sequence[StateRecord]) -> End | None:
    """Add a step's turns to those of its branch; the end if they repeat what came before."""
    for record in filter(turns, found):
        turned.append(record)
        before = repeated(turned)
        if before is not None:
            detail = (
                f"State {record.label} is state {before.label} over again, and so are the turns before them."
            )
            return End(Reason.CLOSED, record.half_width, detail)
    return None


def _can_be_left(record: StateRecord) -> bool:
    """Whether a point is a branch point at which the branch passes on in b.

    At a pitchfork's vertex reached along the branch that turns there, the other branch is the one in b, and
    its direction is not stored: it is followed from its own side.
    """
    branch = record.branch
    return branch is not None and branch.type == "branch-point" and abs(branch.half_width_rate) > TURNING


def _stage(name: str, point: Point, type: str, parent: StateRecord) -> Stage:
    """The stage of a point of a branch; widths that were asked for are equilibria."""
    kind, band = "equilibrium" if type in (WIDTH, VALUE) else "intermediate", point.problem.band
    return Stage(name, band.half_width, band.segments, kind, parent.label)


def _point(record: StateRecord, parameter: str, gap: float | None) -> Point:
    state, multipliers = state_of(record), all_multipliers_of(record)
    if gap is None:
        return point_of(state, multipliers, parameter)
    pairs = Pairs.none() if record.contacts is None else pairs_of(record.contacts)
    return point_at(RestingProblem(state.band, pairs, gap), state.vector(), multipliers, parameter)


def _direction(x: np.ndarray, rate: float, record: StateRecord) -> Tangent:
    """A stored direction; its multipliers, which have no weight in the metric, are not stored."""
    return Tangent(x.ravel(), np.zeros_like(all_multipliers_of(record)), rate)


def _travelled(record: StateRecord) -> float:
    """The length of the branch up to a stored point."""
    assert record.branch is not None
    return record.branch.arclength


def _place(record: StateRecord, parameter: str, gap: float | None) -> _Place:
    """Where a branch stands at a stored step."""
    assert record.branch is not None
    return _Place(record, record.branch.next_step, record.branch.arclength, parameter, gap)


def _numbered(events: Sequence[Event]) -> Iterator[tuple[str, Event]]:
    """Events with the words that name their stages, different within a step."""
    seen: dict[str, int] = {}
    for event in events:
        asked = f"{event.point.symbol} = {event.point.value:.12g}"
        word = asked if event.type in (WIDTH, VALUE) else event.type
        seen[word] = seen.get(word, 0) + 1
        yield (word if seen[word] == 1 else f"{word} ({seen[word]})"), event


def _happening(event: Event) -> Happening:
    """An event of a branch as the fact that its state keeps."""
    where = {"symbol": event.point.symbol, "value": event.point.value}
    if event.type in ("touch", "lift"):
        place = f"{event.point.symbol} = {event.point.value:.12g}"
        return happening(event.type, place=place, bracket=event.bracket)
    if event.type == "contact":
        kind = "contact-begins" if event.begins else "contact-ceases"
        return happening(kind, **where, bracket=event.bracket)
    if event.type in (WIDTH, VALUE) or (event.type == "branch-point" and event.mode is None):
        return happening("width-reached" if event.type == WIDTH else "value-reached", **where)
    index = {**where, "before": _index(event.before), "after": _index(event.after)}
    if event.type == "fold" or event.mode is None:
        return happening("fold", **index)
    if abs(event.tangent.value) <= TURNING:
        return happening("branch-met", **index, overlap=event.mode.overlap)
    kind = "stability-gained" if event.after == 0 else "bifurcation"
    if event.loses_stability:
        kind = "stability-lost"
    return happening(kind, **index, mode=event.mode.word, overlap=event.mode.overlap)


def _index(value: int | None) -> str:
    return "?" if value is None else str(value)
