"""How far discrete bands are from the continuum, and at which order they approach it: values, tables, text.

`ribbon_cli.analysis.continuum` computes the values. This module reads no state and computes orders alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ribbon_cli.digits import fixed
from ribbon_cli.facts import same_width
from ribbon_cli.text import aligned

MISSING = "-"


@dataclass(frozen=True)
class Quantity:
    """One number that says how far a state is from the continuum.

    `section` and `name` say what it is, and `equation` names an equation of Koldaev (2022). `value` is the
    largest size in `zone`, a part of the band ("" for the whole band); a vector's size is its length. It
    tends to zero with h, or to a limit if `limit` is set. Values below `floor` come from the solver's
    tolerance or from rounding. Not-a-number: undefined.
    """

    section: str
    name: str
    equation: str
    zone: str
    value: float
    floor: float = 0.0
    limit: bool = False


@dataclass(frozen=True)
class Continuum:
    """All quantities of one state; `inflections` are arclengths, in the unit of the length."""

    label: int
    half_width: float
    length: float
    sigma: int
    segments: int
    discretisation: str
    certified: bool
    inflections: tuple[float, ...]
    quantities: tuple[Quantity, ...]


@dataclass(frozen=True)
class OrderRow:
    """A quantity over N: `values` (n,), and the observed `orders` between neighbours, (n - 1,).

    Of a quantity with a `limit`, orders are those of its differences, (n - 2,). None: a value is
    unknown or below its floor, or the sign changes.
    """

    section: str
    name: str
    equation: str
    zone: str
    values: tuple[float | None, ...]
    orders: tuple[float | None, ...]
    limit: bool = False


@dataclass(frozen=True)
class OrderTable:
    """The rows of one half-width, N ascending."""

    half_width: float
    length: float
    sigma: int
    discretisation: str
    segments: tuple[int, ...]
    labels: tuple[int, ...]
    rows: tuple[OrderRow, ...]


def order_tables(states: Iterable[Continuum]) -> tuple[OrderTable, ...]:
    """A table for each half-width, in the order of first appearance; one state for each N."""
    groups: list[list[Continuum]] = []
    for state in states:
        group = next((g for g in groups if same_width(g[0].half_width, state.half_width)), None)
        if group is None:
            groups.append([state])
        else:
            group.append(state)
    return tuple(_table(sorted(group, key=lambda state: state.segments)) for group in groups)


def _table(states: Sequence[Continuum]) -> OrderTable:
    first = states[0]
    segments = tuple(state.segments for state in states)
    found = [{_key(q): q for q in state.quantities} for state in states]
    # Zones depend on whether a state has inflections, which a coarse grid may get wrong.
    keys = dict.fromkeys(key for quantities in found for key in quantities)
    rows = [_row(segments, [quantities.get(key) for quantities in found]) for key in keys]
    labels = tuple(state.label for state in states)
    return OrderTable(
        first.half_width, first.length, first.sigma, first.discretisation, segments, labels, tuple(rows)
    )


def _key(quantity: Quantity) -> tuple[str, str, str]:
    return quantity.section, quantity.name, quantity.zone


def _row(segments: Sequence[int], found: Sequence[Quantity | None]) -> OrderRow:
    some = next(quantity for quantity in found if quantity is not None)
    values = [None if q is None or not math.isfinite(q.value) else q.value for q in found]
    floors = [0.0 if q is None else q.floor for q in found]
    sizes, places = list(values), list(segments)
    if some.limit:
        sizes = [None if a is None or c is None else c - a for a, c in itertools.pairwise(values)]
        floors, places = floors[1:], places[:-1]
    shown = [s if s is not None and abs(s) > floor else None for s, floor in zip(sizes, floors, strict=True)]
    pairs = zip(itertools.pairwise(shown), itertools.pairwise(places), strict=True)
    orders = [_order(a, c, m, n) for (a, c), (m, n) in pairs]
    return OrderRow(
        some.section, some.name, some.equation, some.zone, tuple(values), tuple(orders), some.limit
    )


def _order(coarse: float | None, fine: float | None, m: int, n: int) -> float | None:
    """Observed order of two sizes at N = m and n; None where the sign changes."""
    if coarse is None or fine is None or coarse * fine <= 0.0:
        return None
    return math.log(coarse / fine) / math.log(n / m)


def state_text(state: Continuum) -> str:
    """One state, section by section: a column for each zone, the last for what has no zone."""
    blocks = [f"{_headline(state)}, N = {state.segments}\n{_places(state.inflections)}"]
    for section, group in _sections(state.quantities):
        zones = list(dict.fromkeys(q.zone for q in group if q.zone)) or [""]
        lines: dict[str, list[str]] = {}
        for q in group:
            cells = lines.setdefault(q.name, [q.name, q.equation, *[""] * len(zones)])
            cells[2 + (zones.index(q.zone) if q.zone else len(zones) - 1)] = _size(q.value, q.limit)
        blocks.append(aligned([[section, "equation", *zones], *lines.values()], left=(0, 1)))
    return "\n\n".join(blocks) + "\n"


def tables_text(tables: Sequence[OrderTable]) -> str:
    """Values over N and the observed orders, by half-width."""
    return "\n".join(_table_text(table) for table in tables)


def _table_text(table: OrderTable) -> str:
    blocks = [_headline(table)]
    columns = ["equation", "where", *map(str, table.segments)]
    columns += ["order", *[""] * (len(table.segments) - 2)][: len(table.segments) - 1]
    for section, group in _sections(table.rows):
        lines = [[section, *columns]]
        name = ""
        for row in group:
            orders = [MISSING if order is None else f"{round(order, 2) + 0.0:.2f}" for order in row.orders]
            values = [_size(value, row.limit) for value in row.values]
            gap = [""] * (len(columns) - 2 - len(values) - len(orders))
            # What a row repeats is left out, so that the zones of one quantity are seen together.
            head = ["", ""] if row.name == name else [row.name, row.equation]
            name = row.name
            lines.append([*head, row.zone, *values, *gap, *orders])
        blocks.append(aligned(lines, left=(0, 1, 2)))
    return "\n\n".join(blocks) + "\n"


def _sections(items: Sequence[Any]) -> list[tuple[str, list[Any]]]:
    names = dict.fromkeys(item.section for item in items)
    return [(name, [item for item in items if item.section == name]) for name in names]


def _headline(of: Continuum | OrderTable) -> str:
    seam = "one-sided" if of.sigma < 0 else "orientable"
    return f"b = {of.half_width:.10g}, length {of.length:.6g}, {seam}, {of.discretisation}"


def _places(inflections: Sequence[float]) -> str:
    if not inflections:
        return "no inflections"
    return "inflections at " + ", ".join(f"{place:.4f}" for place in inflections)


def _size(value: float | None, limit: bool) -> str:
    if value is None or math.isnan(value):
        return MISSING
    return fixed(value, 6) if limit else f"{value:.1e}"
