"""The energies of a run, ready for a convergence table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ribbon_cli import analysis

from ..facts import OTHER_MINIMA, same_width
from ..report.convergence import Entry, Table, convergence_rows
from ..store import Run, Summary
from ..store.refs import by_place, meant
from ..store.summaries import varying


def table_entries(run: Run) -> list[Entry]:
    """One entry for each width and number of segments: the latest certified equilibrium, else the latest.

    An entry that is not on the branch of the one with half its segments says so in `breaks`. That is read
    off parents and their events; where they do not lead there, the two states are compared.
    """
    named = varying(run.states())
    places = sorted(by_place(run.states()).items(), key=lambda item: item[1][0].label)
    chosen = [
        replace(_entry(meant(group)), others=tuple(pair for pair in place.others if pair[0] in named))
        for place, group in places
    ]
    states = {state.label: state for state in run.states(all=True)}
    return [replace(entry, breaks=_break(run, states, chosen, entry)) for entry in chosen]


def run_table(run: Run) -> Table:
    """The convergence table of a run, without rows where it has no equilibria."""
    return convergence_rows(table_entries(run), *(state.length for state in run.states()[:1]))


def _same(a: Entry, b: Entry | Summary) -> bool:
    """Whether a state, or an entry, is at the place of an entry."""
    others = dict(b.others) if isinstance(b, Entry) else b.parameters
    return (
        a.segments == b.segments
        and same_width(a.half_width, b.half_width)
        and all(_close(value, others.get(name)) for name, value in a.others)
    )


def _close(a: float | None, b: float | None) -> bool:
    return a == b or (a is not None and b is not None and math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9))


def _break(run: Run, states: Mapping[int, Summary], chosen: list[Entry], fine: Entry) -> str:
    """Why an entry does not continue the one with half its segments; empty if it does or there is none."""
    half = replace(fine, segments=fine.segments // 2)
    coarse = next((entry for entry in chosen if fine.segments % 2 == 0 and _same(entry, half)), None)
    if coarse is None or not (coarse.certified and fine.certified):
        return ""
    state = states[int(fine.label or 0)]
    while True:
        told = zip(state.event_kinds, state.events, strict=True)
        found = next((sentence for kind, sentence in told if kind in OTHER_MINIMA), "")
        if found:
            return found
        if state.parent is None or state.parent not in states:
            # Only now is SciPy waited for.
            return analysis.kinship.another_minimum(run, int(coarse.label or 0), int(fine.label or 0))
        state = states[state.parent]
        if state.label == coarse.label:
            return ""
        if state.kind == "equilibrium" and _same(coarse, state):
            if _one_energy(state.energy, coarse.energy):
                return ""
            return f"another minimum: refined from state {state.label} with E = {state.energy:.9g}"


def _entry(state: Summary) -> Entry:
    return Entry(state.half_width, state.segments, state.energy, state.certified, state.label)


def _one_energy(a: float | None, b: float | None) -> bool:
    return a is not None and b is not None and math.isclose(a, b, rel_tol=1e-9)
