"""The convergence table as text, Markdown, LaTeX, CSV and JSON.

Every format shows the rows, the extrapolations, which energies have no certificate and, if a comparison is
given, the published numbers beside ours with their footnotes.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields

from ribbon_cli.digits import energy, powers, with_error
from ribbon_cli.report.convergence import ComparisonRow, Extrapolation, Row, Table, is_at

MISSING = "-"
_COMPARED = ("thesis_delta", "relative_difference", "agrees", "footnote")
_LIMIT = ("extrapolated_energy", "extrapolation_error", "settled")
"""Columns of a CSV beside the rows' own."""

_LATEX = {"_": r"\_", "|": "$|$", "<": "$<$", ">": "$>$", "%": r"\%", "&": r"\&", "#": r"\#", "^": r"\^{}"}


def as_text(table: Table, comparison: Sequence[ComparisonRow] = ()) -> str:
    """Aligned plain text; a footnote's number follows the published figure in brackets."""
    heads = ["b", "N", "E_N", "Delta_N", "ratio", "order", *_comparison_heads(comparison), "note"]
    notes = _footnotes(comparison)
    cells = [heads]
    for row in table.rows:
        cells.append([*_cells(row), *_comparison_cells(row, comparison, notes), row.note])
    widths = [max(len(line[k]) for line in cells) for k in range(len(heads) - 1)]
    lines = []
    for *figures, note in cells:
        aligned = [cell.rjust(width) for cell, width in zip(figures, widths, strict=True)]
        lines.append("  ".join([*aligned, note]).rstrip())
    blocks = ["\n".join(lines)]
    if table.extrapolations:
        blocks.append("\n".join(["N -> infinity:", *map(_sentence, table.extrapolations)]))
    if notes:
        blocks.append("\n".join(f"[{k}] {note}" for k, note in enumerate(notes, 1)))
    return "\n\n".join(blocks) + "\n"


def as_markdown(table: Table, comparison: Sequence[ComparisonRow] = ()) -> str:
    """A pipe table; rows without certificate carry a note in bold."""
    heads = ["b", "N", "E_N", "Δ_N", "ratio", "order", *_comparison_heads(comparison), "note"]
    notes = _footnotes(comparison)
    lines = [heads, ["---:"] * (len(heads) - 1) + [":---"]]
    for row in table.rows:
        mark = f"**{row.note}**" if row.note else ""
        lines.append([*_cells(row), *_comparison_cells(row, comparison, notes), mark])
    blocks = ["\n".join(f"| {' | '.join(line)} |" for line in lines)]
    blocks.append("N → ∞:\n\n" + "\n".join(f"- {_sentence(item)}" for item in table.extrapolations))
    if notes:
        # A bar would end a cell in some readers even here, where no table stands.
        blocks.append("\n".join(f"{k}. {note}" for k, note in enumerate(notes, 1)).replace("|", r"\|"))
    return "\n\n".join(blocks) + "\n"


def as_latex(table: Table, comparison: Sequence[ComparisonRow] = ()) -> str:
    """A `tabular` that needs no package, followed by the extrapolations and footnotes as paragraphs."""
    heads = [
        "$b$",
        "$N$",
        "$E_N$",
        r"$\Delta_N$",
        r"$\Delta_N/\Delta_{2N}$",
        r"$\log_2(\Delta_N/\Delta_{2N})$",
    ]
    heads += [*_comparison_heads(comparison), "note"]
    notes = _footnotes(comparison)
    lines = [
        rf"\begin{{tabular}}{{{'r' * (len(heads) - 1)}l}}",
        r"\hline",
        " & ".join(heads) + r" \\",
        r"\hline",
    ]
    for row in table.rows:
        mark = rf"\textbf{{{_latex(row.note)}}}" if row.note else ""
        cells = [*_cells(row), *_comparison_cells(row, comparison, notes)]
        lines.append(" & ".join([*map(_latex_number, cells), mark]) + r" \\")
    lines += [r"\hline", r"\end{tabular}"]
    paragraphs = [_latex(_sentence(item)).replace("+-", r"$\pm$") for item in table.extrapolations]
    paragraphs += [f"[{k}] {_latex(note)}" for k, note in enumerate(notes, 1)]
    return "\n\n".join(["\n".join(lines), *paragraphs]) + "\n"


def as_csv(table: Table, comparison: Sequence[ComparisonRow] = ()) -> str:
    """One line a row, numbers to full precision, missing ones empty; the extrapolation repeats in a group.

    The header is there for a table without rows, too.
    """
    extrapolated = {item.half_width: item for item in table.extrapolations}
    columns = [
        *(field.name for field in fields(Row) if field.name != "doubtful"),
        *(_COMPARED if comparison else ()),
        *_LIMIT,
    ]
    records = []
    for row in table.rows:
        limit = extrapolated[row.half_width]
        values = (limit.energy, limit.error, limit.settled)
        records.append(_record(row, comparison) | dict(zip(_LIMIT, values, strict=True)))
    return csv_text(records, columns)


def csv_text(records: Sequence[Mapping[str, object]], columns: Sequence[str] = ()) -> str:
    """Records of the same keys as CSV, the keys in the first line; of none the `columns`, if given."""
    out = io.StringIO()
    columns = columns or list(records[0] if records else ())
    if columns:
        writer = csv.DictWriter(out, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    return out.getvalue()


def as_json(table: Table, comparison: Sequence[ComparisonRow] = ()) -> str:
    """One document: `rows`, `extrapolation`, `length`, and `footnotes` if there are any; missing is null."""
    document = {
        "length": table.length,
        "rows": [_record(row, comparison) for row in table.rows],
        "extrapolation": [asdict(item) for item in table.extrapolations],
    }
    if notes := _footnotes(comparison):
        document["footnotes"] = notes
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


RENDERERS: dict[str, Callable[[Table, Sequence[ComparisonRow]], str]] = {
    "text": as_text,
    "markdown": as_markdown,
    "latex": as_latex,
    "csv": as_csv,
    "json": as_json,
}
"""Renderer by the name a user gives."""


def _sentence(item: Extrapolation) -> str:
    start = f"b = {item.half_width:.10g}: "
    if item.energy is None:
        return f"{start}no value ({item.reason})"
    state = "" if item.settled else f"order not settled, E_{item.segments} shown: "
    return f"{start}E = {with_error(item.energy, item.error)} ({state}{item.reason})"


def _number(value: float | None, spec: str) -> str:
    return MISSING if value is None else format(value, spec)


def _cells(row: Row) -> list[str]:
    return [
        f"{row.half_width:.10g}",
        str(row.segments),
        MISSING if row.energy is None else energy(row.energy),
        _number(row.delta, ".6g"),
        _number(row.ratio, ".6g"),
        _number(row.order, ".4f"),
    ]


def _comparison_heads(comparison: Sequence[ComparisonRow]) -> list[str]:
    return ["thesis", "difference", "agrees"] if comparison else []


def _footnotes(comparison: Sequence[ComparisonRow]) -> list[str]:
    return [item.footnote for item in comparison if item.footnote]


def _published(row: Row, comparison: Sequence[ComparisonRow]) -> ComparisonRow | None:
    return next((item for item in comparison if is_at(item, row.half_width, row.segments)), None)


def _comparison_cells(row: Row, comparison: Sequence[ComparisonRow], notes: Sequence[str]) -> list[str]:
    if not comparison:
        return []
    item = _published(row, comparison)
    if item is None:
        return [MISSING] * 3
    mark = f" [{notes.index(item.footnote) + 1}]" if item.footnote else ""
    agrees = {None: MISSING, True: "yes", False: "no"}[item.agrees]
    return [item.thesis + mark, _number(item.relative_difference, ".1e"), agrees]


def _record(row: Row, comparison: Sequence[ComparisonRow]) -> dict[str, object]:
    record = asdict(row)
    del record["doubtful"]  # what the note says to people
    if comparison:
        item = _published(row, comparison)
        record |= {
            "thesis_delta": None if item is None else float(item.thesis),
            "relative_difference": None if item is None else item.relative_difference,
            "agrees": None if item is None else item.agrees,
            "footnote": "" if item is None else item.footnote,
        }
    return record


def _latex(text: str) -> str:
    """A text with what LaTeX would obey escaped, and powers of ten written out."""
    return powers("".join(_LATEX.get(character, character) for character in text))


def _latex_number(cell: str) -> str:
    """A cell in mathematics mode, 1e-05 as a power of ten; a footnote's mark stays behind it."""
    number, _, mark = cell.partition(" ")
    if number == MISSING or number in ("yes", "no"):
        return "--" if number == MISSING else number
    written = powers(number)
    return (written if written != number else f"${number}$") + (f" {mark}" if mark else "")
