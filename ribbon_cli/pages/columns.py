"""Columns of tables of states on pages and in notebooks: each says what stands in its cell."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ribbon_cli import digits
from ribbon_cli.export.words import MEETS_ITSELF, linking_name, meeting
from ribbon_cli.pages.html import Cell, table
from ribbon_cli.store import StateRecord, Summary
from ribbon_cli.store.summaries import varying

Column = Callable[[Any], Cell]


def number(value: float | None, spec: str) -> Cell:
    """A number, a dash where it is unknown; rounding errors of zero are zero."""
    return "–" if value is None else format(value + 0.0, spec), "n"


def energy(value: float | None) -> Cell:
    """An energy, a dash where it is unknown."""
    return "–" if value is None else digits.energy(value), "n"


def contact(state: Any) -> Cell:
    """Whether the band meets itself, and how."""
    if isinstance(state, Summary | StateRecord) and state.contacts is not None:
        return meeting(state) or "none"
    return (MEETS_ITSELF, "no") if state.self_contact else "none"


OF_STATES: Mapping[str, Column] = {
    "label": lambda state: (str(state.label), "n"),
    "b": lambda state: (f"{state.half_width:.10g}", "n"),
    "N": lambda state: (str(state.segments), "n"),
    "E": lambda state: energy(state.energy),
    "status": lambda state: state.status,
}
"""Columns of summaries; those of the points of branches as well, but for N."""


def named_for(columns: Mapping[str, Column], states: Sequence[Summary]) -> dict[str, Column]:
    """Columns for these states: after `b` the parameters that they differ in, and Tw + Wr where they are of
    strips with ends."""
    found: dict[str, Column] = {}
    for name, cell in columns.items():
        found[linking_name(states) if name == "Lk" else name] = cell
        if name == "b":
            found |= {other: _parameter(other) for other in varying(states)}
    return found


def _parameter(name: str) -> Column:
    """The column of a parameter."""
    return lambda state: number(state.parameters.get(name), ".10g")


def listing(columns: Mapping[str, Column], items: Iterable[Any]) -> str:
    """A table with a row for each item."""
    return table(tuple(columns), ([cell(item) for cell in columns.values()] for item in items))
