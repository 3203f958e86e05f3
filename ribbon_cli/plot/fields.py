"""Fields of a table of states over another, one curve for each value of a third."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from ribbon_cli.errors import UsageError
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import legend_above, parameter_text, plain
from ribbon_cli.plot.style import INK, MOST_LOOKS, Style, marked_look
from ribbon_cli.report.rows import LEADING, Column, Rows
from ribbon_cli.report.where import near

OPEN = "no certificate"
ENERGY = "$E$"
LENGTH_OF_NUMBER = ".6g"
MOST_MARKED = 60
"""States of a curve beyond which their marks are as small as a line is wide."""


@dataclass(frozen=True)
class Choice:
    """What is drawn: the column `of`, over the column `over`, a curve for each value of those in `by`; None
    where the table's keys decide.
    """

    of: str | None = None
    over: str | None = None
    by: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Chosen:
    """Columns that are drawn."""

    of: Column
    over: Column
    by: tuple[Column, ...]

    @property
    def title(self) -> str:
        """What the picture shows."""
        told = f", a curve for each {' and '.join(column.name for column in self.by)}" if self.by else ""
        first = self.of.name[:1].upper() + self.of.name[1:]
        return f"{first} over {self.over.name}{told}"


def chosen(table: Rows, choice: Choice) -> Chosen:
    """The columns of a choice; what is left open follows from what varies. Raises UsageError."""
    known = {column.name: column for column in table.columns}
    varied = [known[name] for name in table.keys if len(set(table.values(known[name]))) > 1]
    numbers = [column for column in varied if column.kind == "number"]
    of = _column(known, "--of", choice.of or "energy")
    if of.kind != "number":
        raise UsageError(f"--of {of.name}: not a number: it cannot be drawn")
    if choice.over is not None:
        over = _column(known, "--over", choice.over)
    elif numbers:
        over = max(numbers, key=lambda c: (c.dtype == "float64", len(set(table.values(c)))))
    else:
        raise UsageError("table: nothing that is a number varies: say --over COLUMN")
    if over.kind != "number":
        raise UsageError(f"--over {over.name}: not a number: curves go along numbers; --by takes it")
    if choice.by is not None:
        return Chosen(of, over, tuple(_column(known, "--by", name) for name in choice.by))
    return Chosen(of, over, tuple(_apart(table, varied, [over])))


def _apart(table: Rows, varied: Sequence[Column], known: list[Column]) -> list[Column]:
    """The columns that do not follow from some, nor from each other, the first first."""
    found: list[Column] = []
    for column in varied:
        if not any(_goes_with(table, column, other) for other in [*known, *found]):
            found.append(column)
    return found


def keys_apart(table: Rows) -> tuple[str, ...]:
    """The keys that tell the states of a table apart."""
    known = {column.name: column for column in table.columns}
    varied = [known[name] for name in table.keys if len(set(table.values(known[name]))) > 1]
    return tuple(column.name for column in _apart(table, varied, []))


def _column(known: dict[str, Column], option: str, name: str) -> Column:
    if name not in known:
        raise UsageError(f"{option}: no column {name!r}{near(name, known)}")
    return known[name]


def _goes_with(table: Rows, column: Column, other: Column) -> bool:
    """Whether one column's value follows from another's."""
    seen: dict[Any, Any] = {}
    pairs = zip(table.values(other), table.values(column), strict=True)
    return all(seen.setdefault(key, value) == value for key, value in pairs)


def curves(table: Rows, columns: Chosen) -> list[tuple[tuple[Any, ...], list[Mapping[str, Any]]]]:
    """The rows of each curve, along it, by the values that name it.

    Of several states at one place it is the finest one, and of these a certified one. A state that is not
    where its schedule leads is on no curve along a key that says where. Raises UsageError.
    """
    leading = [column.name for column in columns.by if column.name in table.leading]
    axis, meshed = columns.over, "segments" in {columns.over.name, *(c.name for c in columns.by)}
    best: dict[tuple[Any, ...], dict[float, Mapping[str, Any]]] = {}
    for row in table.rows:
        x, y = row.get(axis.name), row.get(columns.of.name)
        if x is None or y is None or y != y or any(name in row and row[name] is None for name in leading):
            continue
        curve = best.setdefault(tuple(row.get(column.name) for column in columns.by), {})
        before = curve.get(float(x))
        if before is None or _rank(row, meshed) >= _rank(before, meshed):
            curve[float(x)] = row
    if not best:
        raise UsageError(f"table: no state has both {columns.of.name} and {axis.name}")
    if len(best) > MOST_LOOKS:
        raise UsageError(
            f"table tells {MOST_LOOKS} curves apart, and there are {len(best)}: choose with --by or --where"
        )
    return [(name, [curve[x] for x in sorted(curve)]) for name, curve in best.items()]


def _rank(row: Mapping[str, Any], meshed: bool) -> tuple[int, bool]:
    """Which of two states at one place is shown."""
    return (0 if meshed else int(row.get("segments") or 0)), bool(row.get("certified"))


def fields_figure(table: Rows, columns: Chosen, style: Style) -> Figure:
    """A field over another: marks are states, open ones without certificate."""
    figure = Figure(figsize=(style.across(0.72), style.row(0.5)), layout="constrained")
    axes = figure.subplots()
    drawn = curves(table, columns)
    handles = []
    for k, (name, rows) in enumerate(drawn):
        look = marked_look(k) | ({"markersize": style.line} if len(rows) > MOST_MARKED else {})
        x = np.array([row[columns.over.name] for row in rows], dtype=np.float64)
        y = np.array([row[columns.of.name] for row in rows], dtype=np.float64)
        certified = np.array([bool(row.get("certified")) for row in rows])
        axes.plot(x, y, **{**look, "marker": ""})
        for mask, fill in ((certified, look["color"]), (~certified, "white")):
            axes.plot(x[mask], y[mask], **{**look, "linestyle": "", "markerfacecolor": fill})
        handles.append(Line2D([], [], label=_label(columns.by, name), **look))
    if any(not row.get("certified") for _, rows in drawn for row in rows):
        handles.append(
            Line2D([], [], marker="o", markerfacecolor="white", label=OPEN, color=INK, linestyle="")
        )
    axes.set_xlabel(axis_text(columns.over.name))
    axes.set_ylabel(axis_text(columns.of.name))
    axes.margins(0.06)
    if len(handles) > 1:
        legend_above(figure, handles, rows=0)
    return figure


def _label(by: Sequence[Column], name: Sequence[Any]) -> str:
    return ", ".join(
        f"{axis_text(column.name)} = {value_text(value)}" for column, value in zip(by, name, strict=True)
    )


def value_text(value: Any) -> str:
    """A value as pictures show it."""
    if isinstance(value, float):
        return format(value, LENGTH_OF_NUMBER)
    return "none" if value is None else plain(str(value))


def axis_text(name: str) -> str:
    """A column as pictures call it: by its last word, and a key of a schedule as in the config."""
    if name.partition(".")[0] in LEADING:
        return plain(name)
    last = name.rpartition(".")[2].removeprefix("parameter_")
    if last == "energy":
        return ENERGY
    if last == "segments":
        return "$N$"
    return parameter_text(last) if last == HALF_WIDTH or last in PARAMETERS else plain(last.replace("_", " "))
