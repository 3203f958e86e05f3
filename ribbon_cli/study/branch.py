"""Branches of a run: arclength continuation step by step, each step a function of stored states.

A step is stored as its events (folds, branch points, contacts, widths asked for) and, last, its end point
with the branch's tangent there and the length to try next. What is stored is not computed again; a step
that was interrupted is, and gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..config import Arclength
from ..solver.arclength import Point, Tangent, initial_tangent, point_of, tangent_from
from ..solver.branch import Advance, BranchOptions, End, Reason, advance
from ..solver.branch_events import Event
from ..solver.branch_switch import switch
from ..solver.singular import lowest_mode, with_multipliers
from ..store import BranchRecord, StateRecord, Summary
from ..store.events import BRANCH_END
from .acceptance import checked, converged
from .branch_tables import course_point, courses
from .clock import Clock
from .closed_branches import TURNING, repeated, turns
from .outcome import Course
from .records import multipliers_of, state_of
from .steps import Steps

STATE_TYPES = {"width": "equilibrium"}
"""Kind of state for a type of point; all others are intermediate."""
SIDES = ((1, "+"), (-1, "-"))


@dataclass(frozen=True)
class _Place:
    """Where a branch stands: a stored state, with the length to try next and that travelled.

    `sign` is the direction in b at a branch's start, 0 at a stored step, whose tangent is stored.
    """

    record: StateRecord
    next_step: float
    arclength: float
    sign: int = 0

    @cached_property
    def point(self) -> Point:
        """The state with its derivatives."""
        return _point(self.record)

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

    def __init__(self, steps: Steps, request: Arclength, start: StateRecord) -> None:
        self.steps, self.journal = steps, steps.journal
        self.request, self.start = request, start
        ends = [start.half_width, request.to, *([] if request.back_to is None else [request.back_to])]
        self.options = BranchOptions(
            low=min(ends),
            high=max(ends),
            widths=request.at,
            stop_at=frozenset(Reason(word) for word in request.stop_at),
            first_step=min(BranchOptions.first_step, request.max_step),
            largest_step=request.max_step,
            guard=steps.options.guard,
        )
        self.courses: list[Course] = []

    def follow(self, name: str) -> None:
        """Follow the branch towards `to`, then, if asked, the other way, then those that cross it."""
        up = self.request.to > self.start.half_width
        for sign in (1, -1) if self.request.both else (1,):
            towards = "up" if up == (sign > 0) else "down"
            place = _Place(self.start, self.options.first_step, 0.0, 1 if towards == "up" else -1)
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
        self._finish(name, start, met, end or End(Reason.STEPS, place.record.half_width))
        if depth > 0:
            for record in met:
                if _can_be_left(record):
                    for side, word in SIDES:
                        self._switch(record, side, f"branch from {record.label} side {word}", depth - 1)

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
        if whole and stored is not None and self.options.low <= stored.half_width <= self.options.high:
            return _place(stored), known, None
        self.steps.begin(stage, base.half_width, base.segments)
        clock = self.journal.clock()
        try:
            taken = advance(place.point, place.tangent, place.next_step, self.options)
        except ArithmeticError as error:
            return None, known, End(Reason.STEP_TOO_SMALL, base.half_width, f"no tangent here: {error}")
        if taken.point is not None:
            found = taken.point
            self.steps.progress.step(found.steps, found.energy, found.worst, found.half_width)
        self.steps.tell(stage, taken.refused)
        events: list[StateRecord] = []
        for found_on_it in _numbered(taken.events):
            met, end = self._store_event(stage, found_on_it, place, taken, clock)
            if met is None:
                return None, events, end
            events.append(met)
        if taken.point is None or taken.tangent is None:
            return None, events, taken.end
        if stored is not None:
            return _place(stored), events, None
        length = place.arclength + taken.length
        branch = self._branch_record(name, "step", taken.point, taken.tangent, length, taken.following)
        record, end = self._store(taken.point, stage, branch, place.record, clock, taken.refused)
        return (None if record is None else _place(record)), events, end

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
    ) -> tuple[StateRecord | None, End | None]:
        """Store what was met within a step, unless it is stored; an end as in `_store`."""
        word, event = found
        name = f"{stage}, {word}"
        known = self._finished(name)
        if known is not None:
            return known, None
        branch = self._branch_record(
            stage.rpartition(",")[0],
            event.type,
            event.point,
            event.tangent,
            place.arclength + event.position,
            taken.following,
            event,
        )
        return self._store(event.point, name, branch, place.record, clock, (_sentence(event),), event)

    def _store(
        self,
        point: Point,
        stage: str,
        branch: BranchRecord,
        parent: StateRecord,
        clock: Clock,
        remarks: Sequence[str],
        event: Event | None = None,
        method: str = "arclength continuation",
    ) -> tuple[StateRecord | None, End | None]:
        """Store a point of a branch; an end if it is not the band that the run is about."""
        singular = "" if event is None else _SINGULAR.get(event.type, "")
        result = checked(point.result(singular), self.steps.half_twists)
        if not converged(result):
            return None, End(Reason.STEP_TOO_SMALL, parent.half_width, result.message)
        if event is not None:
            self.journal.note(f"{branch.name}: {_sentence(event)}")
        state = self.steps.store(
            point.problem,
            result,
            clock,
            kind=STATE_TYPES.get(branch.type, "intermediate"),
            stage=stage,
            method=method,
            parent=parent.label,
            events=tuple(remarks),
            branch=branch,
        )
        return self.journal.load(state), None

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
            half_width_rate=tangent.half_width,
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
        branch, stop = record.branch, self.options.stop_at
        assert branch is not None
        b = record.half_width
        if branch.type == "fold" and Reason.FOLD in stop:
            return End(Reason.FOLD, b)
        if branch.index_before == 0 and (branch.index_after or 0) > 0 and Reason.STABILITY_LOST in stop:
            return End(Reason.STABILITY_LOST, b)
        if branch.type == "contact" and not base.self_contact and Reason.CONTACT in stop:
            return End(Reason.CONTACT, b)
        if branch.type == "width" and b in (self.options.low, self.options.high):
            return End(Reason.RANGE, b)
        return None

    def _finish(self, name: str, start: StateRecord, met: Sequence[StateRecord], end: End) -> None:
        """Keep the branch's course, and its end in the run's log."""
        points = tuple(course_point(Summary.of(record)) for record in met)
        course = Course(
            name,
            start.label,
            points,
            end.reason.value,
            end.half_width,
            f"{end.reason.sentence} {end.detail}".strip(),
        )
        self.courses.append(course)
        noted = {
            "branch": name,
            "start": start.label,
            "reason": course.reason,
            "half_width": course.half_width,
            "message": course.message,
        }
        self.journal.note(f"{name} ends at b = {end.half_width:.12g}: {course.message}")
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
        stage = f"{name}, step 1"
        first = self._finished(stage)
        if first is None:
            self.steps.begin(stage, record.half_width, record.segments)
            clock = self.journal.clock()
            assert record.branch is not None
            assert record.branch.soft_mode is not None
            tangent = _direction(record.branch.tangent, record.branch.half_width_rate, record)
            try:
                point = _point(record)
                mode = with_multipliers(point, record.branch.soft_mode.ravel())
                found = switch(point, tangent, mode, side, self.options.guard)
            except ArithmeticError as error:
                self._finish(name, record, [], End(Reason.STEP_TOO_SMALL, record.half_width, str(error)))
                return
            branch = self._branch_record(
                name, "step", found.point, found.tangent, found.distance, self.options.first_step
            )
            stored, end = self._store(
                found.point, stage, branch, record, clock, (), method=f"branch switching, side {side:+d}"
            )
            if stored is None:
                assert end is not None
                self._finish(name, record, [], end)
                return
            first = stored
        self._follow(name, record, _place(first), [first], 2, depth)


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


def _point(record: StateRecord) -> Point:
    return point_of(state_of(record), multipliers_of(record))


def _direction(x: np.ndarray, rate: float, record: StateRecord) -> Tangent:
    """A stored direction; its multipliers, which have no weight in the metric, are not stored."""
    return Tangent(x.ravel(), np.zeros(5 * record.segments + 3), rate)


def _travelled(record: StateRecord) -> float:
    """The length of the branch up to a stored point."""
    assert record.branch is not None
    return record.branch.arclength


def _place(record: StateRecord) -> _Place:
    """Where a branch stands at a stored step."""
    assert record.branch is not None
    return _Place(record, record.branch.next_step, record.branch.arclength)


def _numbered(events: Sequence[Event]) -> Iterator[tuple[str, Event]]:
    """Events with the words that name their stages, different within a step."""
    seen: dict[str, int] = {}
    for event in events:
        word = f"b = {event.point.half_width:.12g}" if event.type == "width" else event.type
        seen[word] = seen.get(word, 0) + 1
        yield (word if seen[word] == 1 else f"{word} ({seen[word]})"), event


def _sentence(event: Event) -> str:
    """An event in words."""
    b = f"b = {event.point.half_width:.12g}"
    index = f"index {_index(event.before)} to {_index(event.after)}"
    if event.type == "fold":
        return f"fold at {b}, {index}"
    if event.type == "branch-point" and event.mode is not None:
        gained = (
            "stability lost"
            if event.loses_stability
            else "stability gained"
            if event.after == 0
            else "bifurcation"
        )
        overlap = f"overlap with sliding {event.mode.overlap:.3f}"
        if abs(event.tangent.half_width) <= TURNING:
            return f"another branch is met where this one turns, at {b}, {index} ({overlap})"
        return f"{gained} at {b}, {index}, by the {event.mode.word} mode ({overlap})"
    if event.type == "contact":
        what = "facets begin to touch" if event.begins else "facets cease to touch"
        return f"{what} at {b} (bracket {event.bracket:.1e})"
    return f"reached {b}"


def _index(value: int | None) -> str:
    return "?" if value is None else str(value)
