"""The convergence table as text, Markdown, LaTeX, CSV and JSON.

Every format shows the rows, the extrapolations and which energies have no certificate. Text and LaTeX accept
further columns, such as published numbers.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields

from ribbon_cli.digits import energy, powers, with_error
from ribbon_cli.report.convergence import Extrapolation, Row, Table
from ribbon_cli.text import aligned, pipes

MISSING = "-"
_LIMIT = ("extrapolated_energy", "extrapolation_error", "settled")
"""Columns of a CSV beside the rows' own."""
_FOR_PICTURES = "doubtful"
_OTHERS = "others"
"""The field of parameters other than b, which has columns of its own."""

_LATEX = {"_": r"\_", "|": "$|$", "<": "$<$", ">": "$>$", "%": r"\%", "&": r"\&", "#": r"\#", "^": r"\^{}"}


@dataclass(frozen=True)
class Beside:
    """Further columns of a table: their heads, their cells for each row, and the footnotes [1], [2] and so on
    that cells refer to.
    """

    heads: tuple[str, ...] = ()
    cells: tuple[tuple[str, ...], ...] = ()
    footnotes: tuple[str, ...] = ()

    def row(self, number: int) -> tuple[str, ...]:
        """The cells of a row, counted from 0."""
        return self.cells[number] if self.heads else ()


NOTHING = Beside()


def as_text(table: Table, beside: Beside = NOTHING) -> str:
    """Aligned plain text."""
    lines = [["b", "N", "E_N", "Delta_N", "ratio", "order", *beside.heads, "note"]]
    lines += [[*_cells(row), *beside.row(k), row.note] for k, row in enumerate(table.rows)]
    blocks = [aligned(lines, left={len(lines[0]) - 1})]
    if table.extrapolations:
        blocks.append("\n".join(["N -> infinity:", *map(_sentence, table.extrapolations)]))
    if beside.footnotes:
        blocks.append("\n".join(_footnotes(beside)))
    return "\n\n".join(blocks) + "\n"


def _footnotes(beside: Beside) -> list[str]:
    return [f"[{k}] {note}" for k, note in enumerate(beside.footnotes, 1)]


def as_markdown(table: Table) -> str:
    """A pipe table; rows without certificate carry a note in bold."""
    lines = [["b", "N", "E_N", "Δ_N", "ratio", "order", "note"]]
    lines += [[*_cells(row), f"**{row.note}**" if row.note else ""] for row in table.rows]
    blocks = [pipes(lines, left={len(lines[0]) - 1})]
    blocks.append("N → ∞:\n\n" + "\n".join(f"- {_sentence(item)}" for item in table.extrapolations))
    return "\n\n".join(blocks) + "\n"


def as_latex(table: Table, beside: Beside = NOTHING) -> str:
    """A `tabular` that needs no package, followed by the extrapolations and footnotes as paragraphs.

    Parameters in which rows differ have columns of their own, as in CSV.
    """
    others = [name for name, _ in table.rows[0].others] if table.rows else []
    heads = ["$b$", *map(_latex, others), "$N$", "$E_N$", r"$\Delta_N$", r"$\Delta_N/\Delta_{2N}$"]
    heads += [r"$\log_2(\Delta_N/\Delta_{2N})$", *map(_latex, beside.heads), "note"]
    lines = [
        rf"\begin{{tabular}}{{{'r' * (len(heads) - 1)}l}}",
        r"\hline",
        " & ".join(heads) + r" \\",
        r"\hline",
    ]
    for k, row in enumerate(table.rows):
        mark = rf"\textbf{{{_latex(row.note)}}}" if row.note else ""
        place = [_number(value, ".10g") for value in (row.half_width, *dict(row.others).values())]
        cells = [*place, *_cells(row)[1:], *beside.row(k)]
        lines.append(" & ".join([*map(_latex_number, cells), mark]) + r" \\")
    lines += [r"\hline", r"\end{tabular}"]
    paragraphs = [_latex(_sentence(item)).replace("+-", r"$\pm$") for item in table.extrapolations]
    paragraphs += map(_latex, _footnotes(beside))
    return "\n\n".join(["\n".join(lines), *paragraphs]) + "\n"


def as_csv(table: Table) -> str:
    """One line for each row: numbers to full precision, missing ones empty, the group's extrapolation.

    A table without rows has the header, too.
    """
    columns = [field.name for field in fields(Row) if field.name not in (_FOR_PICTURES, _OTHERS)]
    return csv_text(records(table), [*columns, *(dict(table.rows[0].others) if table.rows else ()), *_LIMIT])


def records(table: Table) -> list[dict[str, object]]:
    """The rows as flat records, with the parameters in which rows differ and the group's extrapolation."""
    limits = {
        (item.half_width, item.others): dict(
            zip(_LIMIT, (item.energy, item.error, item.settled), strict=True)
        )
        for item in table.extrapolations
    }
    return [_record(row) | dict(row.others) | limits[row.half_width, row.others] for row in table.rows]


def _record(row: Row) -> dict[str, object]:
    record = asdict(row)
    del record[_FOR_PICTURES], record[_OTHERS]
    return record


def _nested(row: Row | Extrapolation) -> dict[str, object]:
    """A row for JSON, with `parameters` besides b if rows differ in them."""
    record = _record(row) if isinstance(row, Row) else asdict(row)
    record.pop(_OTHERS, None)
    return record | ({"parameters": dict(row.others)} if row.others else {})


def _place(row: Row | Extrapolation) -> str:
    """The half-width, with the parameters in which rows differ: `0.1, shear = 0.3`."""
    return f"{row.half_width:.10g}" + "".join(f", {name} = {value:.10g}" for name, value in row.others)


def csv_text(records: Sequence[Mapping[str, object]], columns: Sequence[str] = ()) -> str:
    """Records with the same keys as CSV, the keys in the first line; without records, `columns`."""
    out = io.StringIO()
    columns = columns or list(records[0] if records else ())
    if columns:
        writer = csv.DictWriter(out, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    return out.getvalue()


def as_json(table: Table) -> str:
    """One document: `rows`, `extrapolation` and `length`; missing is null."""
    document = {
        "length": table.length,
        "rows": [_nested(row) for row in table.rows],
        "extrapolation": [_nested(item) for item in table.extrapolations],
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


RENDERERS: dict[str, Callable[[Table], str]] = {
    "text": as_text,
    "markdown": as_markdown,
    "latex": as_latex,
    "csv": as_csv,
    "json": as_json,
}
"""Renderer by the name a user gives."""


def _sentence(item: Extrapolation) -> str:
    start = f"b = {_place(item)}: "
    if item.energy is None:
        return f"{start}no value ({item.reason})"
    state = "" if item.settled else f"order not settled, E_{item.segments} shown: "
    return f"{start}E = {with_error(item.energy, item.error)} ({state}{item.reason})"


def _number(value: float | None, spec: str) -> str:
    return MISSING if value is None else format(value, spec)


def _cells(row: Row) -> list[str]:
    return [
        _place(row),
        str(row.segments),
        MISSING if row.energy is None else energy(row.energy),
        _number(row.delta, ".6g"),
        _number(row.ratio, ".6g"),
        _number(row.order, ".4f"),
    ]


def _latex(text: str) -> str:
    """A text with LaTeX's special characters escaped, and powers of ten written out."""
    return powers("".join(_LATEX.get(character, character) for character in text))


def _latex_number(cell: str) -> str:
    """A cell in mathematics mode, 1e-05 as a power of ten; a footnote's mark follows outside of it."""
    number, _, mark = cell.partition(" ")
    if number == MISSING or number in ("yes", "no"):
        return "--" if number == MISSING else number
    written = powers(number)
    return (written if written != number else f"${number}$") + (f" {mark}" if mark else "")
