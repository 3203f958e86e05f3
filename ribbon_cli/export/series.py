"""States of a run that belong together: a branch in the width, and levels of refinement."""

from __future__ import annotations

from collections import Counter

from ribbon_cli.errors import UsageError
from ribbon_cli.facts import same_width
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


def finest(run: Run) -> list[Summary]:
    """The finest equilibrium of each half-width and other parameters. Raises UsageError if there is none."""
    branch(run)
    return list(
        {(b, others): meant(group) for (b, _, others), group in by_place(run.states()).items()}.values()
    )


def levels(run: Run, half_width: float) -> list[Summary]:
    """The equilibria of one half-width by N."""
    return [state for state in latest(run.states()) if same_width(state.half_width, half_width)]


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
