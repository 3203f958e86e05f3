"""The energies of a run, ready for a convergence table."""

from __future__ import annotations

import math

from ..report.convergence import Entry
from ..store import Run


def table_entries(run: Run) -> list[Entry]:
    """One entry for each width and number of segments: the latest certified equilibrium, else the latest."""
    chosen: list[Entry] = []
    for state in run.states():
        entry = Entry(
            half_width=state["half_width"],
            segments=int(state["segments"]),
            energy=state["energy"],
            certified=bool(state["certified"]),
            label=state["label"],
        )
        place = next((k for k, old in enumerate(chosen) if _same(old, entry)), None)
        if place is None:
            chosen.append(entry)
        elif entry.certified or not chosen[place].certified:
            chosen[place] = entry
    return chosen


def _same(a: Entry, b: Entry) -> bool:
    return a.segments == b.segments and math.isclose(a.half_width, b.half_width, rel_tol=1e-9)
