"""Spectra and their convergence as text, Markdown and CSV: plain documents in, text out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ribbon_cli.report.tables import csv_text
from ribbon_cli.text import aligned, pipes

Document = Mapping[str, Any]
"""What `--json` prints, of which the other formats show the most of."""

MISSING = "-"
_MODE = ("value", "bound", "label", "sliding_overlap", "hidden")
"""Numbers of a mode that CSV has, of one state and of all of a run."""


def render(document: Document, style: str) -> str:
    """A state's modes, a run's convergence or all of a run's states, as text, markdown or csv."""
    if "sequences" in document:
        return _convergence_csv(document) if style == "csv" else _convergence(document, style)
    if "states" in document:
        return _run_csv(document) if style == "csv" else _run(document, style)
    return _spectrum_csv(document) if style == "csv" else _spectrum(document, style)


def _spectrum(document: Document, style: str) -> str:
    """A state's modes in columns, its symmetry, and the verdict as the last line."""
    heading, rows, verdict = _heading(document), _spectrum_rows(document), document["verdict"]
    if style == "text":
        return "\n".join([*heading, "", aligned(rows), "", verdict, ""])
    return "\n".join([*(f"{line}  " for line in heading), "", pipes(rows), "", f"**{verdict}**", ""])


def _spectrum_csv(document: Document) -> str:
    """One line a mode, numbers to full precision; `position` spreads the modes evenly on [0, 1]."""
    modes, names = document["modes"], document["symmetries"]
    last = max(len(modes) - 1, 1)
    rows = [
        {"number": k + 1, "position": k / last}
        | {key: mode[key] for key in ("value", "bound", "residual", *_MODE[2:])}
        | {name: mode["symmetry"].get(name, "") for name in names}
        for k, mode in enumerate(modes)
    ]
    return csv_text(rows)


def _convergence(document: Document, style: str) -> str:
    """Sequences of eigenvalues by half-width, a column for each N, with orders and limits.

    Text says why limits are settled or not.
    """
    blocks, notes = [], document["notes"]
    for half_width, rows in _by_width(document):
        head = f"b = {half_width:.10g}, {document['metric']} metric"
        if style == "text":
            blocks += [f"{head}: {document['formula']}\n{aligned(rows)}", _reasons(document, half_width)]
        else:
            blocks.append(f"{head}\n\n{pipes(rows)}")
    if style == "text":
        blocks += ["\n".join(notes)] if notes else []
    else:
        blocks += [f"- {note}" for note in notes]
    return "\n\n".join(blocks) + "\n"


def _convergence_csv(document: Document) -> str:
    """One line for each eigenvalue at each N, numbers to full precision, missing ones empty."""
    named, result = ("half_width", "label", "number", "parity"), ("limit", "error", "settled")
    rows = [
        {key: item[key] for key in named}
        | {"segments": n, "value": item["values"][k], "bound": item["bounds"][k]}
        | {"sliding_overlap": item["overlaps"][k], "order": item["orders"][k]}
        | {key: item[key] for key in result}
        for item in document["sequences"]
        for k, n in enumerate(item["segments"])
    ]
    return csv_text(rows)


def _run(document: Document, style: str) -> str:
    """A line for each state: how its spectrum ends below, how many modes are checkerboards.

    Markdown has the states one after the other, each with its table.
    """
    if style == "markdown":
        return "\n".join(_spectrum(state, style) for state in document["states"])
    rows = [["b", "N", "rule", "modes", "lowest", "lowest/h", "hidden modes", "under 1e-2 of the median"]]
    for state in document["states"]:
        values = sorted(mode["value"] for mode in state["modes"] if mode["label"] != "rotation")
        hidden = sum(mode["label"] == "checkerboard" for mode in state["modes"])
        small = sum(value < 1e-2 * values[len(values) // 2] for value in values)
        figures = [f"{values[0]:.6g}", f"{values[0] / state['h']:.6g}", str(hidden), str(small)]
        place = [f"{state['half_width']:.10g}", str(state["segments"]), state["discretisation"]]
        rows.append([*place, str(len(values)), *figures])
    return f"{document['metric']} metric, all eigenvalues besides rotations\n\n{aligned(rows)}\n"


def _run_csv(document: Document) -> str:
    """One line a mode, with its state in front: the data of Koldaev (2022), Figure 3.14."""
    rows = []
    for state in document["states"]:
        modes = [mode for mode in state["modes"] if mode["label"] != "rotation"]
        place = {key: state[key] for key in ("half_width", "segments", "discretisation")}
        for k, mode in enumerate(modes):
            figures = {key: mode[key] for key in _MODE}
            rows.append({**place, "position": k / max(len(modes) - 1, 1), **figures})
    return csv_text(rows)


def _heading(document: Document) -> list[str]:
    symmetry = document["symmetry"]
    place = f"b = {document['half_width']:.10g}, N = {document['segments']}, {document['discretisation']}"
    lines = [
        f"{place}; {document['metric']} metric: {document['formula']}",
        f"symmetry {symmetry['group']}, order {symmetry['order']}, residual {symmetry['residual']:.0e}",
    ]
    if symmetry["nearly"] != symmetry["group"]:
        lines[-1] += f"; {symmetry['nearly']} but for {symmetry['near_residual']:.1e}"
    return lines


def _spectrum_rows(document: Document) -> list[list[str]]:
    names = document["symmetries"]
    rows = [["", "value", "+-", "label", "sliding", "hidden", *names]]
    for k, mode in enumerate(document["modes"], 1):
        figures = [f"{mode['value']:.8g}", f"{mode['bound']:.0e}", mode["label"]]
        shares = [f"{mode['sliding_overlap']:.4f}", f"{mode['hidden']:.3f}"]
        rows.append([str(k), *figures, *shares, *(_sign(mode["symmetry"].get(name)) for name in names)])
    return rows


def _sign(character: float | None) -> str:
    """+ for symmetric, - for antisymmetric, else the number; nothing where there is none."""
    if character is None or math.isnan(character):
        return ""
    return "+" if character > 0.999 else "-" if character < -0.999 else f"{character:.3f}"


def _by_width(document: Document) -> Iterable[tuple[float, list[list[str]]]]:
    """For each half-width the rows of its table, heads first."""
    widths = dict.fromkeys(item["half_width"] for item in document["sequences"])
    for half_width in widths:
        items = [item for item in document["sequences"] if item["half_width"] == half_width]
        grid = sorted({n for item in items for n in item["segments"]})
        rows = [["mode", "parity", *(f"N = {n}" for n in grid), "orders", "limit"]]
        for item in items:
            known = dict(zip(item["segments"], item["values"], strict=True))
            orders = [MISSING if o is None else f"{o:.2f}" for o in item["orders"]]
            name = item["label"] if item["label"] == "sliding" else f"{item['label']} {item['number']}"
            values = [f"{known[n]:.7g}" if n in known else MISSING for n in grid]
            rows.append([name, item["parity"] or MISSING, *values, " ".join(orders), _limit(item)])
        yield half_width, rows


def _limit(item: Document) -> str:
    if item["label"] == "sliding":
        return "0"
    if item["limit"] is None:
        return MISSING
    bar = "" if item["error"] is None else f" +- {item['error']:.0e}"
    return f"{item['limit']:.7g}{bar}" + ("" if item["settled"] else " ?")


def _reasons(document: Document, half_width: float) -> str:
    """Why limits are taken as settled or not, each reason once."""
    reasons: dict[str, list[str]] = {}
    for item in document["sequences"]:
        if item["half_width"] == half_width and item["label"] != "checkerboard" and not item["settled"]:
            name = item["label"] if item["label"] == "sliding" else f"mode {item['number']}"
            reasons.setdefault(item["reason"], []).append(name)
    return "\n".join(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())
