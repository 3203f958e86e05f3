"""States of a run that belong together: a branch in the width, and levels of refinement."""

from __future__ import annotations

import math
from typing import Any

from ribbon_cli.errors import UsageError
from ribbon_cli.store import Run
from ribbon_cli.store.refs import WIDTH_TOLERANCE, no_equilibria


def latest(states: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of states with the same half-width and N the latest certified, else the latest; by b, then N."""
    chosen: list[dict[str, Any]] = []
    for state in states:
        for k, other in enumerate(chosen):
            if same_width(state, other) and state["segments"] == other["segments"]:
                if state["certified"] or not other["certified"]:
                    chosen[k] = state
                break
        else:
            chosen.append(state)
    return sorted(chosen, key=lambda state: (state["half_width"], state["segments"]))


def left_out(run: Run, chosen: list[dict[str, Any]]) -> str:
    """Words on the equilibria at the widths and N of chosen ones that these stand for; empty where none.

    They may be solved again, or lie on other branches.
    """
    every = run.states()
    count = sum(
        same_width(state, one) and state["segments"] == one["segments"] and state["label"] != one["label"]
        for one in chosen
        for state in every
    )
    return f"; without {count} more at the same b and N" if count else ""


def same_width(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two states have the same half-width, as references understand it."""
    return math.isclose(one["half_width"], other["half_width"], rel_tol=WIDTH_TOLERANCE)


def branch(run: Run, segments: int | None = None) -> list[dict[str, Any]]:
    """Equilibria of a run at one N by width: the N asked for, else that of most widths, else the finest.

    Raises UsageError where there is none.
    """
    states = latest(run.states())
    if not states:
        raise UsageError(no_equilibria(run))
    counts: dict[int, int] = {}
    for state in states:
        counts[state["segments"]] = counts.get(state["segments"], 0) + 1
    if segments is None:
        segments = max(counts, key=lambda n: (counts[n], n))
    if segments not in counts:
        known = ", ".join(map(str, sorted(counts)))
        raise UsageError(f"{run.name} has no equilibrium with N = {segments}: it has N = {known}")
    return [state for state in states if state["segments"] == segments]


def finest(run: Run) -> list[dict[str, Any]]:
    """The finest equilibrium of each half-width, by width. Raises UsageError where there is none."""
    branch(run)
    found: dict[float, dict[str, Any]] = {}
    for state in latest(run.states()):
        key = next((b for b in found if math.isclose(b, state["half_width"], rel_tol=WIDTH_TOLERANCE)), None)
        found[state["half_width"] if key is None else key] = state
    return list(found.values())


def levels(run: Run, half_width: float) -> list[dict[str, Any]]:
    """The equilibria of one half-width by N."""
    at = {"half_width": half_width}
    return [state for state in latest(run.states()) if same_width(state, at)]


def courses(run: Run, segments: int | None = None) -> dict[str, list[dict[str, Any]]]:
    """Branches of a run that were followed by arclength: by name, the states in their order from the start.

    The state that a branch begins at comes first. With `segments`, those on that N alone. Empty where a run
    has none.
    """
    states = {state["label"]: state for state in run.states(all=True)}
    found: dict[str, list[dict[str, Any]]] = {}
    for state in states.values():
        if state.get("branch") and segments in (None, state["segments"]):
            found.setdefault(state["branch"]["name"], []).append(state)
    for points in found.values():
        start = states.get(points[0]["parent"])
        points.sort(key=lambda state: (state["branch"]["arclength"], state["label"]))
        if start is not None and start["kind"] != "auxiliary":
            points.insert(0, start)
    return found
