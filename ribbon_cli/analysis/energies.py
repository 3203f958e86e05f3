"""The energies of a run, ready for a convergence table."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ribbon_cli import analysis

from ..facts import OTHER_MINIMA
from ..report.convergence import Entry, Table, convergence_rows
from ..store import Run, Summary
from ..store.refs import Place, by_place, meant, regridded
from ..store.summaries import varying


def table_entries(run: Run) -> list[Entry]:
    """One entry for each width and number of segments: the latest certified equilibrium, else the latest.

    Where there is none, a certified level that one was refined through, which is kept as intermediate.

    Half-widths that are one are written alike, as the smallest of them. An entry that is not on the branch of
    the one with half its segments says so in `breaks`. That is read off parents and their events; where they
    do not lead there, the two states are compared.
    """
    named = varying(run.states())
    states = {state.label: state for state in run.states(all=True)}
    passed = {level.label: level for state in run.states() for level in _passed(states, state)}
    found = by_place(sorted([*run.states(), *passed.values()], key=lambda state: state.label))
    for place, group in found.items():
        found[place] = [state for state in group if state.label not in passed] or group
    places = sorted(found.items(), key=lambda item: item[1][0].label)
    chosen = {place: meant(group) for place, group in places}
    at = {state.label: place for place, group in places for state in group}
    return [
        Entry(
            place.half_width,
            fine.segments,
            fine.energy,
            fine.certified,
            fine.label,
            _break(run, states, at, _coarser(chosen, place), fine),
            tuple(pair for pair in place.others if pair[0] in named),
        )
        for place, fine in chosen.items()
    ]


def _passed(states: Mapping[int, Summary], fine: Summary) -> list[Summary]:
    """The levels on the way from which a state was refined, grid by grid, without meeting another minimum."""
    levels: list[Summary] = []
    child = fine
    while OTHER_MINIMA.isdisjoint(child.event_kinds):
        parent = None if child.parent is None else states.get(child.parent)
        if parent is None or parent.kind != "intermediate" or not parent.certified:
            break
        if not regridded(parent, child):
            break
        levels.append(parent)
        child = parent
    return levels


def run_table(run: Run) -> Table:
    """The convergence table of a run, without rows where it has no equilibria."""
    return convergence_rows(table_entries(run), *(state.length for state in run.states()[:1]))


def _coarser(chosen: Mapping[Place, Summary], place: Place) -> Summary | None:
    """The state with half the segments."""
    half, rest = divmod(place.segments, 2)
    return None if rest else chosen.get(place._replace(segments=half))


def _break(
    run: Run, states: Mapping[int, Summary], at: Mapping[int, Place], coarse: Summary | None, fine: Summary
) -> str:
    """Why a state does not continue the one with half its segments; empty if it does or there is none.

    `at` has the place of each equilibrium.
    """
    if coarse is None or not (coarse.certified and fine.certified):
        return ""
    state = fine
    while True:
        told = zip(state.event_kinds, state.events, strict=True)
        found = next((sentence for kind, sentence in told if kind in OTHER_MINIMA), "")
        if found:
            return found
        if state.parent is None or state.parent not in states:
            # Only now is SciPy waited for.
            return analysis.kinship.another_minimum(run, coarse.label, fine.label)
        state = states[state.parent]
        if state.label == coarse.label:
            return ""
        if at.get(state.label) == at[coarse.label]:
            one, other = (math.nan if s.energy is None else s.energy for s in (state, coarse))
            if math.isclose(one, other, rel_tol=1e-9):
                return ""
            return f"another minimum: refined from state {state.label} with E = {one:.9g}"
