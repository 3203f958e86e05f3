"""Table 3.1 of Koldaev (2022): the published numbers, ours beside them, and both in text, LaTeX and CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ribbon_cli import digits
from ribbon_cli.facts import same_width
from ribbon_cli.report.convergence import Entry, Row, Table
from ribbon_cli.report.tables import MISSING, Beside, as_latex, as_text, csv_text, records

PUBLISHED = Path(__file__).parent / "data" / "table-3.1.csv"


@dataclass(frozen=True)
class ReferenceDelta:
    """Delta_N of a published table; `delta` is the number as printed, whose digits say how exact it is."""

    half_width: float
    segments: int
    delta: str


@dataclass(frozen=True)
class ComparisonRow:
    """Our Delta_N beside a published one.

    `relative_difference` is (ours - published)/published; `agrees`: both are the same number at the published
    number of digits. Both are None where we have no difference. `footnote` is empty or an explanation.
    """

    half_width: float
    segments: int
    delta: float | None
    thesis: str
    relative_difference: float | None
    agrees: bool | None
    footnote: str


def thesis_table() -> tuple[ReferenceDelta, ...]:
    """Table 3.1 of Koldaev (2022) as printed."""
    text = PUBLISHED.read_text(encoding="utf-8")
    lines = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
    return tuple(ReferenceDelta(float(b), int(n), delta) for b, n, delta in lines[1:])


def compare_with_thesis(
    table: Table, reference: Sequence[ReferenceDelta], second_minimum: Entry | None = None
) -> tuple[ComparisonRow, ...]:
    """Each number of `reference` beside ours, in the order of `reference`.

    `second_minimum` is a state of another discrete minimum than the table's, at one of its (b, N). Where the
    published number is not ours, |E'_N - E_2N| from it is shown in a footnote, with whether that is the
    published number.
    """
    return tuple(_compare(table, published, second_minimum) for published in reference)


def _compare(table: Table, published: ReferenceDelta, second: Entry | None) -> ComparisonRow:
    b, n, printed = published.half_width, published.segments, float(published.delta)
    row, finer = _find(table, b, n), _find(table, b, 2 * n)
    delta = None if row is None else row.delta
    agrees = None if delta is None else agrees_as_printed(delta, published.delta)
    footnote = ""
    if second is not None and second.energy is not None and not agrees and _is_at(second, b, n):
        footnote = _second_minimum_note(second, second.energy, row, finer, published.delta)
    return ComparisonRow(
        half_width=b,
        segments=n,
        delta=delta,
        thesis=published.delta,
        relative_difference=None if delta is None else (delta - printed) / printed,
        agrees=agrees,
        footnote=footnote,
    )


def _second_minimum_note(
    second: Entry, energy: float, row: Row | None, finer: Row | None, printed: str
) -> str:
    """What |E'_N - E_2N| from another minimum's `energy` says about the number `printed`."""
    n = second.segments
    if finer is None or finer.energy is None:
        return f"another discrete minimum has E'_{n} = {digits.energy(energy)}, but E_{2 * n} is not known"
    other = abs(energy - finer.energy)
    verdict = "the printed number" if agrees_as_printed(other, printed) else "not the printed number either"
    minimum = "minimum" if second.certified else "state (without certificate)"
    branch = (
        ""
        if row is None or row.energy is None
        else f"; the continued branch has E_{n} = {digits.energy(row.energy)}"
    )
    return (
        f"another discrete {minimum} has E'_{n} = {digits.energy(energy)}, "
        f"and |E'_{n} - E_{2 * n}| = {other:.6g} is {verdict}{branch}"
    )


def _is_at(place: Entry | Row | ComparisonRow, half_width: float, segments: int) -> bool:
    """Whether `place` speaks of this half-width (to a relative 1e-9) and this N."""
    return place.segments == segments and same_width(place.half_width, half_width)


def _find(table: Table, half_width: float, segments: int) -> Row | None:
    return next((row for row in table.rows if _is_at(row, half_width, segments)), None)


def agrees_as_printed(value: float, printed: str) -> bool:
    """Whether `value`, rounded to as many significant digits as `printed` shows, is that number."""
    mantissa = printed.lower().partition("e")[0].lstrip("+-").replace(".", "").lstrip("0")
    return float(f"{value:.{max(len(mantissa), 1) - 1}e}") == float(printed)


def texts(table: Table, comparison: Sequence[ComparisonRow]) -> dict[str, str]:
    """The table with the published numbers beside ours, by suffix of file."""
    beside = _beside(table, comparison)
    return {"txt": as_text(table, beside), "tex": as_latex(table, beside), "csv": _csv(table, comparison)}


def _beside(table: Table, comparison: Sequence[ComparisonRow]) -> Beside:
    """Columns of the published numbers; a footnote's number follows its figure in brackets."""
    notes = [item.footnote for item in comparison if item.footnote]
    cells = []
    for row in table.rows:
        item = _published(row, comparison)
        if item is None:
            cells.append((MISSING, MISSING, MISSING))
            continue
        mark = f" [{notes.index(item.footnote) + 1}]" if item.footnote else ""
        relative = MISSING if item.relative_difference is None else f"{item.relative_difference:.1e}"
        agrees = {None: MISSING, True: "yes", False: "no"}[item.agrees]
        cells.append((item.thesis + mark, relative, agrees))
    return Beside(("thesis", "difference", "agrees"), tuple(cells), tuple(notes))


def _published(row: Row, comparison: Sequence[ComparisonRow]) -> ComparisonRow | None:
    return next((item for item in comparison if _is_at(item, row.half_width, row.segments)), None)


def _csv(table: Table, comparison: Sequence[ComparisonRow]) -> str:
    """The table's records, to full precision, each with its published number; missing ones are empty."""
    rows = []
    for row, record in zip(table.rows, records(table), strict=True):
        item = _published(row, comparison)
        rows.append(
            record
            | {
                "thesis_delta": None if item is None else float(item.thesis),
                "relative_difference": None if item is None else item.relative_difference,
                "agrees": None if item is None else item.agrees,
                "footnote": "" if item is None else item.footnote,
            }
        )
    return csv_text(rows)
