"""Spectra and their convergence as text, Markdown and CSV: plain documents in, text out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ribbon_cli.report.tables import csv_text

Document = Mapping[str, Any]
"""What `--json` prints, of which the other formats show the most of."""

MISSING = "-"


def spectrum_text(document: Document) -> str:
    """A state's modes in columns, its symmetry, and the verdict as the last line."""
    return (
        "\n".join([*_heading(document), "", _aligned(_spectrum_rows(document)), "", document["verdict"]])
        + "\n"
    )


def spectrum_markdown(document: Document) -> str:
    """The same with a pipe table."""
    heading = [f"{line}  " for line in _heading(document)]
    return (
        "\n".join([*heading, "", _pipes(_spectrum_rows(document)), "", f"**{document['verdict']}**"]) + "\n"
    )


def spectrum_csv(document: Document) -> str:
    """One line a mode, numbers to full precision; `position` spreads the modes evenly on [0, 1]."""
    modes = document["modes"]
    last = max(len(modes) - 1, 1)
    names = document["symmetries"]
    rows = [
        {
            "number": k + 1,
            "position": k / last,
            **{
                key: mode[key] for key in ("value", "bound", "residual", "label", "sliding_overlap", "hidden")
            },
            **{name: mode["symmetry"].get(name, "") for name in names},
        }
        for k, mode in enumerate(modes)
    ]
    return csv_text(rows)


def convergence_text(document: Document) -> str:
    """Sequences of eigenvalues by half-width, a column for each N, with orders and limits."""
    blocks = []
    for half_width, rows in _by_width(document):
        blocks.append(
            f"b = {half_width:.10g}, {document['metric']} metric: {document['formula']}\n{_aligned(rows)}"
        )
        blocks += [_reasons(document, half_width)]
    if document["notes"]:
        blocks.append("\n".join(document["notes"]))
    return "\n\n".join(blocks) + "\n"


def convergence_markdown(document: Document) -> str:
    """The same with pipe tables."""
    blocks = []
    for half_width, rows in _by_width(document):
        blocks.append(f"b = {half_width:.10g}, {document['metric']} metric\n\n{_pipes(rows)}")
    blocks += [f"- {note}" for note in document["notes"]]
    return "\n\n".join(blocks) + "\n"


def convergence_csv(document: Document) -> str:
    """One line for each eigenvalue at each N, numbers to full precision."""
    rows = [
        {
            "half_width": item["half_width"],
            "label": item["label"],
            "number": item["number"],
            "parity": item["parity"],
            "segments": n,
            "value": item["values"][k],
            "bound": item["bounds"][k],
            "sliding_overlap": item["overlaps"][k],
            "order": "" if item["orders"][k] is None else item["orders"][k],
            "limit": "" if item["limit"] is None else item["limit"],
            "error": "" if item["error"] is None else item["error"],
            "settled": item["settled"],
        }
        for item in document["sequences"]
        for k, n in enumerate(item["segments"])
    ]
    return csv_text(rows)


def run_text(document: Document) -> str:
    """A line for each state: how its spectrum ends below, and how many modes are checkerboards."""
    rows = [["b", "N", "rule", "modes", "lowest", "lowest/h", "hidden modes", "under 1e-2 of the median"]]
    for state in document["states"]:
        values = sorted(mode["value"] for mode in state["modes"] if mode["label"] != "rotation")
        hidden = sum(mode["label"] == "checkerboard" for mode in state["modes"])
        small = sum(value < 1e-2 * values[len(values) // 2] for value in values)
        figures = [f"{values[0]:.6g}", f"{values[0] / state['h']:.6g}", str(hidden), str(small)]
        place = [f"{state['half_width']:.10g}", str(state["segments"]), state["discretisation"]]
        rows.append([*place, str(len(values)), *figures])
    return f"{document['metric']} metric, all eigenvalues besides rotations\n\n{_aligned(rows)}\n"


def run_markdown(document: Document) -> str:
    """The states one after the other, each with its table."""
    return "\n".join(spectrum_markdown(state) for state in document["states"])


def run_csv(document: Document) -> str:
    """One line a mode, with its state in front: the data of Koldaev (2022), Figure 3.14."""
    rows = []
    for state in document["states"]:
        modes = [mode for mode in state["modes"] if mode["label"] != "rotation"]
        place = {key: state[key] for key in ("half_width", "segments", "discretisation")}
        for k, mode in enumerate(modes):
            figures = {key: mode[key] for key in ("value", "bound", "label", "sliding_overlap", "hidden")}
            rows.append({**place, "position": k / max(len(modes) - 1, 1), **figures})
    return csv_text(rows)


def renderers(document: Document) -> dict[str, Callable[[Document], str]]:
    """Renderers by the name a user gives: of one state, of a run's convergence, of all of a run's states."""
    if "sequences" in document:
        return {"text": convergence_text, "markdown": convergence_markdown, "csv": convergence_csv}
    if "states" in document:
        return {"text": run_text, "markdown": run_markdown, "csv": run_csv}
    return {"text": spectrum_text, "markdown": spectrum_markdown, "csv": spectrum_csv}


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


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def _pipes(rows: Sequence[Sequence[str]]) -> str:
    lines = [rows[0], ["---:"] * len(rows[0]), *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
