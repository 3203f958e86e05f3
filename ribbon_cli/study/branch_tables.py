"""Branches as tables: what a run's store says of them, without solving anything."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..store import Run, summary
from ..store.events import REMOVED
from .outcome import Course, CoursePoint

ENDED = "branch-end"
"""The event of the log that says why a branch ends."""
GOES_ON = "unfinished"
_UNFINISHED = "It was interrupted, or points of it were removed: the same command goes on."


def course_point(state: Mapping[str, Any]) -> CoursePoint:
    """A point of a branch from its state's summary."""
    branch = state["branch"]
    own = ("type", "index_before", "index_after", "lowest_eigenvalue", "sliding_overlap", "arclength")
    whole = (
        "label",
        "half_width",
        "energy",
        "status",
        "negative_eigenvalues",
        "linking_number",
        "self_contact",
        "clearance",
    )
    return CoursePoint(**{key: branch[key] for key in own}, **{key: state[key] for key in whole})


def courses(run: Run) -> tuple[Course, ...]:
    """The branches that a run holds, in the order in which they were begun."""
    states: dict[str, list[dict[str, Any]]] = {}
    for entry in run.entries().values():
        state = summary(entry)
        if state.get("branch"):
            states.setdefault(state["branch"]["name"], []).append(state)
    ends: dict[str, dict[str, Any]] = {}
    for event in run.events():
        if event["event"] == ENDED:
            ends[event["branch"]] = event
        elif event["event"] == REMOVED:
            for name in event["branches"]:
                ends.pop(name, None)
    return tuple(
        _course(name, states.get(name, []), ends.get(name)) for name in dict.fromkeys((*states, *ends))
    )


def _course(name: str, states: list[dict[str, Any]], end: Mapping[str, Any] | None) -> Course:
    # A branch that was first stopped and later followed further has its earlier events in their places.
    points = sorted(
        (course_point(state) for state in states), key=lambda point: (point.arclength or 0.0, point.label)
    )
    start = int(end["start"]) if end else int(states[0]["parent"])
    if end is None:
        return Course(name, start, tuple(points), GOES_ON, points[-1].half_width, _UNFINISHED)
    return Course(name, start, tuple(points), end["reason"], end["half_width"], end["message"])
