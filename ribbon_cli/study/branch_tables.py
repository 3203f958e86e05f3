"""Branches as tables: what a run's store says of them, without solving anything."""

from __future__ import annotations

from dataclasses import fields

from ..parts import HALF_WIDTH
from ..store import Run, Summary
from ..store.events import BranchEnd, Removed
from .outcome import Course, CoursePoint

GOES_ON = "unfinished"
_UNFINISHED = "It was interrupted, or points of it were removed: the same command goes on."


def course_point(state: Summary, kind: str = "") -> CoursePoint:
    """A point of a branch from its state's summary; `kind` is its type without arclength continuation."""
    known = vars(state) | (vars(state.branch) if state.branch else {"type": kind})
    known["parameters"] = state.parameters
    names = [field.name for field in fields(CoursePoint)]
    return CoursePoint(**{name: known[name] for name in names if name in known})


def courses(run: Run) -> tuple[Course, ...]:
    """The branches that a run holds, in the order in which they were begun."""
    states: dict[str, list[Summary]] = {}
    for state in run.states(all=True):
        if state.branch is not None:
            states.setdefault(state.branch.name, []).append(state)
    ends: dict[str, BranchEnd] = {}
    for event in run.events():
        if isinstance(event, BranchEnd):
            ends[event.branch] = event
        elif isinstance(event, Removed):
            for name in event.branches:
                ends.pop(name, None)
    return tuple(
        _course(name, states.get(name, []), ends.get(name)) for name in dict.fromkeys((*states, *ends))
    )


def _course(name: str, states: list[Summary], end: BranchEnd | None) -> Course:
    # A branch that was first stopped and later followed further has its earlier events in their places.
    points = sorted(
        (course_point(state) for state in states), key=lambda point: (point.arclength or 0.0, point.label)
    )
    if end is None:
        start, last = states[0].parent or 0, points[-1]
        on = states[0].branch
        moved = HALF_WIDTH if on is None or on.parameter is None else on.parameter
        where = (last.half_width, _UNFINISHED, moved, last.parameters.get(moved))
        return Course(name, start, tuple(points), GOES_ON, *where)
    where = (end.half_width, end.message, end.parameter, end.value)
    return Course(name, end.start, tuple(points), end.reason, *where)
