"""States of a run that belong together: a branch in the width, and levels of refinement."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from ribbon_cli.errors import UsageError
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.store import Run, Summary
from ribbon_cli.store.refs import by_place, meant, no_equilibria


def latest(states: list[Summary]) -> list[Summary]:
    """Of states with the same half-width and N the latest certified, else the latest; by b, then N."""
    return [meant(group) for group in by_place(states).values()]


def left_out(run: Run, chosen: list[Summary]) -> str:
    """Words on the equilibria at the widths and N of chosen ones that these stand for; empty where none.

    They may be solved again, or lie on other branches.
    """
    labels = {state.label for state in chosen}
    groups = [{state.label for state in group} for group in by_place(run.states()).values()]
    count = sum(len(group) - 1 for group in groups if group & labels)
    return f"; without {count} more at the same b and N" if count else ""


def branch(run: Run, segments: int | None = None) -> list[Summary]:
    """Equilibria of a run at one N by width: the N asked for, else that of most widths, else the finest.

    Raises UsageError where there is none.
    """
    states = latest(run.states())
    if not states:
        raise UsageError(no_equilibria(run))
    counts = Counter(state.segments for state in states)
    if segments is None:
        segments = max(counts, key=lambda n: (counts[n], n))
    if segments not in counts:
        known = ", ".join(map(str, sorted(counts)))
        raise UsageError(f"{run.name} has no equilibrium with N = {segments}: it has N = {known}")
    return [state for state in states if state.segments == segments]


def along(states: Sequence[Summary]) -> tuple[str, list[Summary]]:
    """Of states on one N the most that differ in one parameter alone, in its order, and that parameter.

    States of closed bands, which mostly have the half-width alone, are all of them.
    """
    every = [state.parameters or {HALF_WIDTH: state.half_width} for state in states]
    moving = [name for name in PARAMETERS if len({row.get(name) for row in every}) > 1] or [HALF_WIDTH]
    best: tuple[str, list[Summary]] = (moving[0], [])
    for name in moving:
        groups: dict[tuple[float | None, ...], list[Summary]] = {}
        for state, row in zip(states, every, strict=True):
            groups.setdefault(tuple(row.get(other) for other in moving if other != name), []).append(state)
        longest = max(groups.values(), key=len)
        if len(longest) > len(best[1]):
            best = name, longest
    return best[0], sorted(best[1], key=lambda state: value_at(state, best[0]))


def value_at(state: Summary, name: str) -> float:
    """The value of a parameter at a state, not-a-number where it has none."""
    value = state.half_width if name == HALF_WIDTH else state.parameters.get(name)
    return math.nan if value is None else value


def followed_in(points: Sequence[Summary]) -> str:
    """The parameter of a branch that was followed."""
    return next(
        (point.branch.parameter for point in points if point.branch and point.branch.parameter), HALF_WIDTH
    )


def finest(run: Run) -> list[Summary]:
    """The finest equilibrium of each half-width and other parameters. Raises UsageError if there is none."""
    branch(run)
    return list(
        {(b, others): meant(group) for (b, _, others), group in by_place(run.states()).items()}.values()
    )


def levels(run: Run) -> list[list[Summary]]:
    """The equilibria of each half-width and other parameters by N."""
    found: dict[tuple[object, ...], list[Summary]] = {}
    for (b, _, others), group in by_place(run.states()).items():
        found.setdefault((b, others), []).append(meant(group))
    return list(found.values())


def courses(run: Run, segments: int | None = None) -> dict[str, list[Summary]]:
    """Branches of a run that were followed by arclength: by name, the states in their order from the start.

    The state that a branch begins at comes first. With `segments`, those on that N alone. Empty where a run
    has none.
    """
    states = {state.label: state for state in run.states(all=True)}
    found: dict[str, list[Summary]] = {}
    for state in states.values():
        if state.branch is not None and segments in (None, state.segments):
            found.setdefault(state.branch.name, []).append(state)
    for points in found.values():
        start = states.get(points[0].parent or 0)
        points.sort(key=travelled)
        if start is not None and start.kind != "auxiliary":
            points.insert(0, start)
    return found


def travelled(state: Summary) -> tuple[float, int]:
    """The order of the points of a branch: by the length from its start, then by label."""
    length = None if state.branch is None else state.branch.arclength
    return length or 0.0, state.label
