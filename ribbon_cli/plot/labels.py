"""What tells states from each other in a legend or above a panel, and which of them have no certificate."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from textwrap import wrap
from typing import Protocol

import matplotlib
from matplotlib.artist import Artist

from ribbon_cli.export.words import standing
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.store import Run, StateRecord
from ribbon_cli.text import visible


class Placed(Protocol):
    """A state as far as its place goes."""

    @property
    def half_width(self) -> float:
        """b."""

    @property
    def parameters(self) -> Mapping[str, float | None]:
        """All parameters by name."""


FEWEST_DIGITS, MOST_DIGITS = 4, 12
"""Digits of half-widths: as few as tell them apart."""
LEGEND_LETTER = 0.56
"""Width of a letter, relative to its size, on the long side."""
LEGEND_ROOM = 5.6
"""What an entry takes besides its letters, in their size: its line and the gaps."""
LEGEND_LINE = 1.5
"""Height of a legend's line, in the size of its letters."""
LISTED = 8
"""Most items that a title lists."""


def width_texts(half_widths: Sequence[float]) -> list[str]:
    """Half-widths as short as they can be told apart."""
    for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1):
        texts = {b: f"{b:.{digits}g}" for b in half_widths}
        if len(set(texts.values())) == len(texts):
            break
    return [texts[b] for b in half_widths]


def parameter_text(name: str) -> str:
    """A parameter as pictures call it."""
    return "$b$" if name == HALF_WIDTH else name.replace("_", " ")


def place_texts(states: Sequence[Placed]) -> list[str]:
    """States by the parameters that tell them from each other, by the half-width where none does."""
    rows = [{**state.parameters, HALF_WIDTH: state.half_width} for state in states]
    every = {name for row in rows for name in row}
    names = [name for name in PARAMETERS if name in every and len({row.get(name) for row in rows}) > 1]
    columns = [parameter_column(rows, name) for name in names or [HALF_WIDTH]]
    return [", ".join(filter(None, parts)) for parts in zip(*columns, strict=True)]


def parameter_column(rows: Sequence[Mapping[str, float | None]], name: str) -> list[str]:
    """`name = value` of each row, empty where it has none."""
    values = [math.nan if (value := row.get(name)) is None else value for row in rows]
    texts = width_texts(values)
    return [
        f"{parameter_text(name)} = {text}" if v == v else "" for text, v in zip(texts, values, strict=True)
    ]


def band_text(half_twists: int, sigma: int = 1) -> str:
    """A band by its twist, as the thesis calls it: a 3π band has three half-twists; `sigma` 0 is a strip."""
    if sigma == 0:
        return "strip"
    if half_twists == 0:
        return "untwisted"
    sign, count = "−" if half_twists < 0 else "", abs(half_twists)
    return f"{sign}{count if count > 1 else ''}π band"


def run_texts(runs: Sequence[Run | None]) -> list[str]:
    """Names of runs for a legend: as their configs have them, whole where that is another's too."""
    paths = {run.path: run.short_name for run in runs if run}
    count = Counter(paths.values())
    names = [(run.short_name if count[run.short_name] == 1 else run.name) if run else "" for run in runs]
    return [plain(name) for name in names]


def plain(text: str) -> str:
    """Text that others wrote: what a terminal would obey is escaped, and a dollar sign begins no formula."""
    return visible(text).replace("$", r"\$")


def curve_labels(records: Sequence[StateRecord], runs: Sequence[str] = ()) -> list[str]:
    """What each state differs in, and its standing; `runs` name the states' runs where there are several."""
    return [", ".join((*parts, *filter(None, [standing(record)]))) for parts, record in _told(records, runs)]


def panel_titles(records: Sequence[StateRecord], runs: Sequence[str], letters: int) -> list[str]:
    """Titles above shapes in a row, in lines of so many letters: what they differ in, and their standing.

    A stage says by itself that its state is auxiliary.
    """
    titles = []
    for parts, record in _told(records, runs):
        known = record.kind == "auxiliary" and plain(record.stage) in parts
        titles.append(lines([*parts, "" if known else standing(record)], letters))
    return titles


def _told(records: Sequence[StateRecord], runs: Sequence[str]) -> list[tuple[list[str], StateRecord]]:
    """What tells each state from the others, part by part: band or run, b, N, and more where they need it.

    Of states alike in these, auxiliary ones are told by their stages.
    """
    count = len(records)
    bands = [band_text(record.half_twists, record.sigma) for record in records]
    rows = [record.parameters for record in records]
    others = [name for name in PARAMETERS if name != HALF_WIDTH and any(name in row for row in rows)]
    columns = [
        bands if len(set(bands)) > 1 else list(runs),
        parameter_column(rows, HALF_WIDTH),
        *(column for name in others if len(set(column := parameter_column(rows, name))) > 1),
        [f"$N$ = {record.segments}" for record in records],
    ]
    shown = [c for c in columns if len(set(c)) > 1 or (count == 1 and c is not columns[0])]
    parts = [[text for column in shown if (text := column[k])] for k in range(count)]
    more: tuple[Callable[[int], str], ...] = (
        lambda k: runs[k] if runs else "",
        lambda k: records[k].discretisation,
        lambda k: plain(records[k].stage) if records[k].kind == "auxiliary" else records[k].kind,
        lambda k: f"state {records[k].label}",
        lambda k: f"no. {k + 1}",
    )
    for tell in more:
        _tell(parts, tell)
    return list(zip(parts, records, strict=True))


def _tell(parts: Sequence[list[str]], tell: Callable[[int], str]) -> None:
    """Add a part to those rows that are alike and that it tells apart."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, row in enumerate(parts):
        alike.setdefault(tuple(row), []).append(k)
    for members in alike.values():
        texts = [tell(k) for k in members]
        if len(set(texts)) > 1:
            for k, text in zip(members, texts, strict=True):
                parts[k] += [text] if text else []


def lines(parts: Iterable[str], letters: int) -> str:
    """Parts in lines of so many letters; one that is longer is broken by itself."""
    found: list[str] = []
    for part in filter(None, parts):
        if found and _length(found[-1]) + 2 + _length(part) <= letters:
            found[-1] += f", {part}"
        elif _length(part) <= letters:
            found.append(part)
        else:
            found += wrap(part, max(letters, 1))
    return "\n".join(found)


def _length(text: str) -> int:
    """Letters of a text without what marks its formulas."""
    return len(text.replace("$", ""))


def legend_above(figure: Figure, handles: Sequence[Artist], rows: int = 1) -> None:
    """A legend above all panels; the figure grows by its lines beyond so many, which it has room for."""
    size = 0.9 * float(matplotlib.rcParams["font.size"])
    letters = int((figure.get_figwidth() * 72 / size - LEGEND_ROOM) / LEGEND_LETTER)
    labels = [lines(str(handle.get_label()).split(", "), letters) for handle in handles]
    longest = max(_length(line) for label in labels for line in label.split("\n"))
    entry = (LEGEND_LETTER * longest + LEGEND_ROOM) * size / 72
    columns = max(1, min(len(labels), int(figure.get_figwidth() / entry)))
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, handlelength=2.6)
    high = [max(label.count("\n") + 1 for label in labels[k::columns]) for k in range(columns)]
    more = math.ceil(len(labels) / columns) * max(high) - rows
    figure.set_figheight(figure.get_figheight() + max(0, more) * LEGEND_LINE * size / 72)
