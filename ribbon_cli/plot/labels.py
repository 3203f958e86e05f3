"""What tells states from each other in a legend or above a panel, and which of them have no certificate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ribbon_cli.export.words import standing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ribbon_cli.store import StateRecord

FEWEST_DIGITS, MOST_DIGITS = 4, 12
"""Digits of half-widths: as few as tell them apart."""
LEGEND_LETTER = 0.56
"""Width of a letter, relative to its size, on the long side."""
LEGEND_ROOM = 5.6
"""What an entry takes besides its letters, in their size: its line and the gaps."""


def width_texts(half_widths: Sequence[float]) -> list[str]:
    """Half-widths as short as they can be told apart."""
    for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1):
        texts = {b: f"{b:.{digits}g}" for b in half_widths}
        if len(set(texts.values())) == len(texts):
            break
    return [texts[b] for b in half_widths]


def curve_labels(records: Sequence[StateRecord]) -> list[str]:
    """A name for each state: b, N or both, then what else is needed to tell them apart, then its standing."""
    widths = width_texts([record.half_width for record in records])
    columns: list[list[str]] = [
        [f"$b$ = {text}" for text in widths],
        [f"$N$ = {record.segments}" for record in records],
    ]
    names = _rows([c for c in columns if len(set(c)) > 1 or len(records) == 1], len(records))
    more: tuple[Callable[[StateRecord], str], ...] = (
        lambda record: record.discretisation,
        lambda record: f"state {record.label}",
    )
    for tell in more:
        if len(set(names)) == len(names):
            break
        column = [tell(record) for record in records]
        if len(set(column)) > 1:
            names = _rows([names, column], len(records))
    if len(set(names)) < len(names):  # states of several runs, alike in all of this
        names = _rows([names, [f"no. {k}" for k in range(1, len(records) + 1)]], len(records))
    return _rows([names, [standing(record) for record in records]], len(records))


def _rows(columns: Sequence[Sequence[str]], count: int) -> list[str]:
    """Row by row the texts of the columns, empty ones left out."""
    return [", ".join(text for column in columns if (text := column[k])) for k in range(count)]


def legend_columns(labels: Sequence[str], figure: Figure) -> int:
    """How many entries of a legend fit side by side above the panels of a figure."""
    import matplotlib

    letters = max(len(label.replace("$", "")) for label in labels)
    entry = (LEGEND_LETTER * letters + LEGEND_ROOM) * float(matplotlib.rcParams["font.size"]) * 0.9 / 72
    return max(1, min(len(labels), int(figure.get_figwidth() / entry)))
