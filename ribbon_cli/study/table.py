"""The energies of a run, ready for a convergence table."""

from __future__ import annotations

from ..report.convergence import Entry
from ..store import Run


def table_entries(run: Run) -> list[Entry]:
    """One entry for each width and number of segments: the latest certified equilibrium, else the latest."""
    chosen: dict[tuple[str, int], Entry] = {}
    for state in run.states():
        key = (f"{state['half_width']:.9e}", int(state["segments"]))
        old = chosen.get(key)
        if old is not None and old.certified and not state["certified"]:
            continue
        chosen[key] = Entry(
            half_width=state["half_width"],
            segments=int(state["segments"]),
            energy=state["energy"],
            certified=bool(state["certified"]),
            label=state["label"],
        )
    return list(chosen.values())
