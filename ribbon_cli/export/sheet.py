"""Sheets of the fold pattern: every line and text of a page, placed, and trimmed where the page ends.

A laser or a plotter goes by colours and takes every line as it is: what is cut, folded, glued or read has one
colour each, and nothing is drawn that a window would have to hide.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from ribbon_cli.errors import UsageError
from ribbon_cli.export.pattern import Pattern
from ribbon_cli.parts import CLAMPED
from ribbon_cli.text import visible

Point = tuple[float, float]

PAPERS = {"A4": (297.0, 210.0), "Letter": (279.4, 215.9)}
"""Sheets lying on their long side, in millimetres."""
MARGIN = 10.0
OVERLAP = 10.0
"""How much neighbouring pages share, in millimetres: the strip that is glued."""
HEADER = 18.0
"""Height, in millimetres, of what is said above a pattern."""
LEGEND = MARGIN + 11.5
"""Where the legend stands, in millimetres from the upper edge."""
LABEL_ROOM = 4.5
"""Distance of two folds, in millimetres, from which on their angles are printed."""
NOTE_SIZE, LETTER_WIDTH = 2.8, 0.6
"""Size of the letters above a pattern, in millimetres, and about how wide they are relative to it."""
BY_HAND = 1.0
"""Distance of two folds, in millimetres, below which nobody folds them."""
FLAT_DEGREES = 1e-6
CUT_WIDTH, FOLD_WIDTH, GLUE_WIDTH, TEXT_WIDTH = 0.35, 0.2, 0.25, 0.25
SAMPLE = 8.0
"""Length of a line in the legend, in millimetres."""
SCALES = (("10 mm", 10.0), ("1 in", 25.4))
"""Bars to check a print against, in millimetres."""

COLOURS = {
    "cut": "#000000",
    "mountain": "#D55E00",
    "valley": "#0072B2",
    "flat": "#CC79A7",
    "glue": "#009E73",
    "text": "#6b6b6b",
}
"""What is done along a line, and its colour; no two are alike."""
DASHES = {"mountain": "6 1.5 1 1.5", "valley": "3 1.5", "flat": "0.5 2", "glue": "1 1"}
HOLDS = {
    "clamped": "its flap lies in a clamp up to the fold",
    "hinged": "a hinge holds its line",
    "free": "free",
}
"""What becomes of an end of a strip."""
WORDS = {
    "cut": "cut",
    "mountain": "mountain fold",
    "valley": "valley fold",
    "flat": "no fold",
    "glue": "glue",
}


@dataclass(frozen=True)
class Page:
    """A window on the pattern: what lies between `left` and `right`, and its number of how many."""

    left: float
    right: float
    number: int
    count: int


@dataclass(frozen=True)
class Line:
    """A line on a page, in millimetres from its upper left corner, y downwards.

    `kind` is what is done along it, a key of COLOURS; `data` are attributes that say what it stands for.
    """

    kind: str
    start: Point
    end: Point
    width: float
    data: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Text:
    """A text on a page that begins at `place`, on its base line; `size` in millimetres."""

    place: Point
    text: str
    size: float


@dataclass(frozen=True)
class Sheet:
    """A page as it is drawn. `origin` is where the start of the midline lies, maybe beyond the page."""

    wide: float
    tall: float
    origin: Point
    lines: list[Line]
    texts: list[Text]


def pages(pattern: Pattern, paper: str | None) -> tuple[float, float, list[Page]]:
    """Sheet's width and height in millimetres, and the pages; one sheet as large as needed for no paper.

    Raises UsageError for an unknown paper, or a strip that is wider than the sheet is high.
    """
    left, low, right, high = pattern.box
    if paper is None:
        wide = max(right - left, _legend(pattern, Page(left, right, 1, 1))[2] - MARGIN)
        return wide + 2 * MARGIN, high - low + 2 * MARGIN + HEADER, [Page(left, right, 1, 1)]
    if paper not in PAPERS:
        raise UsageError(f"no paper {paper!r} (known: {', '.join(PAPERS)})")
    wide, tall = PAPERS[paper]
    room = tall - 2 * MARGIN - HEADER
    if high - low > room:
        raise UsageError(
            f"the strip is {high - low:.0f} mm wide, and {paper} has room for {room:.0f} mm: "
            "take a smaller --size"
        )
    step = wide - 2 * MARGIN - OVERLAP
    count = max(1, math.ceil((right - left - OVERLAP) / step))
    lefts = [left + k * step for k in range(count)]
    found = [Page(x, min(right, x + step + OVERLAP), k + 1, count) for k, x in enumerate(lefts)]
    return wide, tall, found


def sheet(pattern: Pattern, title: str, paper: str | None, number: int) -> Sheet:
    """Page `number` of `pages`, with all that is drawn on it. Raises UsageError as `pages` does."""
    wide, tall, found = pages(pattern, paper)
    page = found[number - 1]
    said = notes(pattern, visible(title))
    if page.count > 1:
        said[0] += f"  (page {page.number} of {page.count})"
    if paper is None:
        # A sheet of its own has room for what is said above a short strip.
        wide = max(wide, 2 * MARGIN + LETTER_WIDTH * NOTE_SIZE * max(map(len, said)))
    origin = (MARGIN - page.left, MARGIN + HEADER + pattern.box[3])

    def place(point: Point) -> Point:
        return point[0] + origin[0], origin[1] - point[1]

    lines = []
    for line in strip_lines(pattern):
        ends = (
            _trimmed(line.start, line.end, page.left, page.right)
            if page.count > 1
            else (line.start, line.end)
        )
        if ends:
            lines.append(Line(line.kind, place(ends[0]), place(ends[1]), line.width, line.data))
    texts = [Text(place(text.place), text.text, text.size) for text in labels(pattern, page)]
    texts += [Text((MARGIN, MARGIN + 3.5 * k), text, NOTE_SIZE) for k, text in enumerate(said)]
    samples, names, _ = _legend(pattern, page)
    return Sheet(wide, tall, origin, [*lines, *samples, *_joins(page, tall)], texts + names)


def strip_lines(pattern: Pattern) -> Iterator[Line]:
    """The lines of the strip in the pattern's own place, y upwards.

    The outline goes around strip and flap. Between them runs a fold: the flap follows the facet that it is
    glued to, and on a one-sided band, whose end is seen from the other side, it is the opposite one.
    """
    first, last, tab = pattern.first.tolist(), pattern.last.tolist(), pattern.tab.tolist()
    width = min(FOLD_WIDTH, 0.4 * _step(pattern))
    if pattern.held is not None:
        yield from _held_lines(pattern, width)
        return
    ends = {"data-angle": repr(pattern.seam)}
    yield Line("cut", first[0], first[1], CUT_WIDTH, {"data-end": "first"} | ends)
    for k in range(2):
        yield Line("cut", first[k], last[k], CUT_WIDTH)
    for k in range(3):
        yield Line("cut", tab[k], tab[k + 1], CUT_WIDTH)
    yield Line(fold_kind(pattern.sigma * pattern.seam), last[0], last[1], width, {"data-end": "last"} | ends)
    yield from _fold_lines(pattern, width)
    for part in (0.25, 0.5, 0.75):
        upper, lower = (_between(tab[k], tab[m], part) for k, m in ((0, 1), (3, 2)))
        yield Line("glue", _between(upper, lower, 0.1), _between(upper, lower, 0.9), GLUE_WIDTH)


def _fold_lines(pattern: Pattern, width: float) -> Iterator[Line]:
    """The folds at nodes 2 to N."""
    for k, (fold, angle) in enumerate(zip(pattern.folds.tolist(), pattern.angles.tolist(), strict=True)):
        data = {"data-node": str(k + 2), "data-angle": repr(angle)}
        yield Line(fold_kind(angle), fold[0], fold[1], width, data)


def _held_lines(pattern: Pattern, width: float) -> Iterator[Line]:
    """The lines of a strip with ends: at a clamp a fold, and a flap that the clamp takes; else it is cut."""
    assert pattern.held is not None
    first, last = pattern.first.tolist(), pattern.last.tolist()
    for k in range(2):
        yield Line("cut", first[k], last[k], CUT_WIDTH)
    for name, held, ruling, flap, angle in (
        ("first", pattern.held[0], first, pattern.start_tab.tolist(), pattern.seam),
        ("last", pattern.held[1], last, pattern.tab.tolist(), pattern.end),
    ):
        data = {"data-end": name, "data-held": held}
        if held == CLAMPED:
            for k in range(3):
                yield Line("cut", flap[k], flap[k + 1], CUT_WIDTH)
            yield Line(fold_kind(angle), ruling[0], ruling[1], width, data | {"data-angle": repr(angle)})
        else:
            yield Line("cut", ruling[0], ruling[1], CUT_WIDTH, data)
    yield from _fold_lines(pattern, width)


def _between(a: Point, b: Point, part: float) -> Point:
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])


def _trimmed(a: Point, b: Point, left: float, right: float) -> tuple[Point, Point] | None:
    """The part of a line between two abscissae."""
    if a[0] > b[0]:
        turned = _trimmed(b, a, left, right)
        return (turned[1], turned[0]) if turned else None
    if b[0] < left or a[0] > right:
        return None
    start = (left, _height(a, b, left)) if a[0] < left else a
    end = (right, _height(a, b, right)) if b[0] > right else b
    return start, end


def _height(a: Point, b: Point, x: float) -> float:
    return a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0])


def fold_kind(angle: float) -> str:
    """Which way a fold goes, seen from the printed side: a valley's sides come towards the reader."""
    return "flat" if abs(angle) <= FLAT_DEGREES else "mountain" if angle > 0 else "valley"


def notes(pattern: Pattern, title: str) -> list[str]:
    """What is printed above the pattern."""
    lines = [title, f"Angles of folds in degrees. {_glue(pattern)}"]
    if _step(pattern) < BY_HAND:
        lines.append(f"Folds are {_step(pattern):.2g} mm apart: by hand, fold a state of fewer segments.")
    return lines


def _step(pattern: Pattern) -> float:
    """Distance of two folds along the midline, in millimetres."""
    return pattern.length / (len(pattern.angles) + 1)


def _glue(pattern: Pattern) -> str:
    """How the ends come together, or are held."""
    if pattern.held is not None:
        start, end = (HOLDS[kind] for kind in pattern.held)
        return f"Start, left: {start}. End: {end}."
    twists, matched = pattern.half_twists, "A to A, B to B"
    if not twists:
        if pattern.sigma > 0:
            return "Glue the flap under the other end, printed sides alike."
        return f"Turn one end over by half a turn and glue it to the flap: {matched}."
    hand = "right" if twists > 0 else "left"
    turns = "half a turn" if abs(twists) == 1 else f"{abs(twists)} half-turns"
    return f"Turn one end over by {turns}, {hand}-handed, and glue it to the flap: {matched}."


def labels(pattern: Pattern, page: Page) -> list[Text]:
    """Texts on the strip, in the pattern's place. Letters where ends meet; angles if there is room."""
    b = pattern.half_width
    swapped = pattern.sigma < 0
    size = min(4.0, 0.35 * b)
    out = (
        _held_words(pattern, size)
        if pattern.held
        else [
            Text((pattern.first[0, 0] + 0.8 * size, b - 1.4 * size), "A", size),
            Text((pattern.first[1, 0] + 0.8 * size, -b + 0.7 * size), "B", size),
            Text((pattern.last[0, 0] + 0.4 * size, b - 1.6 * size), "B" if swapped else "A", size),
            Text((pattern.last[1, 0] + 0.4 * size, -b + 1.6 * size), "A" if swapped else "B", size),
        ]
    )
    every = max(1, math.ceil(LABEL_ROOM / _step(pattern)))
    for k in range(every - 1, len(pattern.angles), every):
        (x1, _), (x2, _) = pattern.folds[k].tolist()
        out.append(Text((0.5 * (x1 + x2) + 0.9, -0.7), f"{abs(pattern.angles[k]):.1f}", 1.6))
    if page.count > 1:
        out = [item for item in out if page.left - 1 <= item.place[0] <= page.right + 1]
    return out


def _held_words(pattern: Pattern, size: float) -> list[Text]:
    """How each end is held, written beside it on the strip."""
    assert pattern.held is not None
    start, end = pattern.held
    high = pattern.half_width - 1.4 * size
    back = LETTER_WIDTH * size * len(end) + 0.8 * size
    return [
        Text((pattern.first[0, 0] + 0.8 * size, high), start, size),
        Text((pattern.last[0, 0] - back, high), end, size),
    ]


def _legend(pattern: Pattern, page: Page) -> tuple[list[Line], list[Text], float]:
    """Samples of lines with their names and bars of known length, on the page, and where they end."""
    used = {line.kind for line in strip_lines(pattern)}
    x, lines, texts = MARGIN, [], []

    def name(text: str) -> None:
        nonlocal x
        texts.append(Text((x + 1.2, LEGEND + 0.9), text, NOTE_SIZE))
        x += LETTER_WIDTH * NOTE_SIZE * len(text) + 4.5

    for kind, words in WORDS.items():
        if kind in used:
            width = CUT_WIDTH if kind == "cut" else FOLD_WIDTH
            lines.append(Line(kind, (x, LEGEND), (x + SAMPLE, LEGEND), width, {"data-legend": words}))
            x += SAMPLE
            name(words)
    for words, length in SCALES:
        bar = Line("text", (x, LEGEND), (x + length, LEGEND), TEXT_WIDTH, {"data-scale": words})
        ticks = [
            Line("text", (end, LEGEND - 1.0), (end, LEGEND + 1.0), TEXT_WIDTH) for end in (x, x + length)
        ]
        lines += [bar, *ticks]
        x += length
        name(words)
    return lines, texts, x


def _joins(page: Page, tall: float) -> Iterator[Line]:
    """Where the neighbouring page begins or ends: short ticks above and below."""
    for edge, there in (
        (page.left + OVERLAP, page.number > 1),
        (page.right - OVERLAP, page.number < page.count),
    ):
        if there:
            x = edge - page.left + MARGIN
            for y1, y2 in ((MARGIN + HEADER - 4.0, MARGIN + HEADER - 1.0), (tall - 6.0, tall - 3.0)):
                yield Line("text", (x, y1), (x, y2), TEXT_WIDTH, {"data-join": "page"})
