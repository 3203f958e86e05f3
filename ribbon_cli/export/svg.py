"""The fold pattern as SVG and PDF at true scale, on one sheet or on pages to be joined."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ribbon_cli.errors import UsageError
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ribbon_cli.export.pattern import Pattern

PAPERS = {"A4": (297.0, 210.0), "Letter": (279.4, 215.9)}
"""Sheets lying on their long side, in millimetres."""
MARGIN = 10.0
OVERLAP = 10.0
"""How much neighbouring pages share, in millimetres: the strip that is glued."""
HEADER = 12.0
LABEL_ROOM = 4.5
"""Distance of two folds, in millimetres, from which on their angles are printed."""
NOTE_SIZE, LETTER_WIDTH = 2.8, 0.6
"""Size of the letters above a pattern, in millimetres, and about how wide they are relative to it."""
BY_HAND = 1.0
"""Distance of two folds, in millimetres, below which nobody folds them."""
FOLD_WIDTH = 0.2
MOUNTAIN, VALLEY, INK, GREY = "#D55E00", "#0072B2", "#1b1b1b", "#6b6b6b"
COLOURS = {"mountain": MOUNTAIN, "valley": VALLEY, "flat": GREY}
DASHES = {"mountain": "6 1.5 1 1.5", "valley": "3 1.5", "flat": "0.5 2"}
FLAT_DEGREES = 1e-6


@dataclass(frozen=True)
class Page:
    """A window on the pattern: what lies between `left` and `right`, and its number of how many."""

    left: float
    right: float
    number: int
    count: int


def pages(pattern: Pattern, paper: str | None) -> tuple[float, float, list[Page]]:
    """Sheet's width and height in millimetres, and the pages; one sheet as large as needed for no paper.

    Raises UsageError for an unknown paper, or a strip that is wider than the sheet is high.
    """
    left, low, right, high = pattern.box
    if paper is None:
        return (
            right - left + 2 * MARGIN,
            high - low + 2 * MARGIN + HEADER,
            [Page(left, right, 1, 1)],
        )
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
    return (
        wide,
        tall,
        [
            Page(left + k * step, min(right, left + k * step + step + OVERLAP), k + 1, count)
            for k in range(count)
        ],
    )


def fold_kind(angle: float) -> str:
    """Which way a fold goes, seen from the printed side: a valley's sides come towards the reader."""
    return "flat" if abs(angle) <= FLAT_DEGREES else "mountain" if angle > 0 else "valley"


def notes(pattern: Pattern, title: str) -> list[str]:
    """What is printed above the pattern."""
    folds = "Valley folds dashed blue, mountain folds dash-dotted red, angles in degrees."
    lines = [title, f"{folds} {_glue(pattern)}"]
    if _step(pattern) < BY_HAND:
        lines.append(f"Folds are {_step(pattern):.2g} mm apart: by hand, fold a state of fewer segments.")
    return lines


def _step(pattern: Pattern) -> float:
    """Distance of two folds along the midline, in millimetres."""
    return pattern.length / (len(pattern.angles) + 1)


def _fold_width(pattern: Pattern) -> float:
    """Width of a fold's line, in millimetres: less than the distance of two, so that they stay lines."""
    return min(FOLD_WIDTH, 0.4 * _step(pattern))


def _glue(pattern: Pattern) -> str:
    """How the ends come together."""
    twists, matched = pattern.half_twists, "A to A, B to B"
    if not twists:
        if pattern.sigma > 0:
            return "Glue the flap under the other end, printed sides alike."
        return f"Turn one end over by half a turn and glue it to the flap: {matched}."
    hand = "right" if twists > 0 else "left"
    turns = "half a turn" if abs(twists) == 1 else f"{abs(twists)} half-turns"
    return f"Turn one end over by {turns}, {hand}-handed, and glue it to the flap: {matched}."


def pattern_svg(pattern: Pattern, title: str, paper: str | None = None, number: int = 1) -> bytes:
    """One page of the pattern as SVG in millimetres; on paper, page `number` of `pages`.

    Each fold is a `line` of class `fold` with `data-node` (2..N) and `data-angle` in degrees, positive for a
    mountain; the end rulings are lines of class `glue`. y runs downwards, as in any SVG.
    """
    from xml.sax.saxutils import escape

    title = visible(title)
    wide, tall, found = pages(pattern, paper)
    if paper is None:
        # A sheet of its own has room for what is said above a short strip.
        longest = max(map(len, notes(pattern, title)))
        wide = max(wide, 2 * MARGIN + LETTER_WIDTH * NOTE_SIZE * longest)
    page = found[number - 1]
    high = pattern.box[3]
    top = MARGIN + HEADER + high

    def place(point: tuple[float, float]) -> tuple[str, str]:
        return _number(point[0] - page.left + MARGIN), _number(top - point[1])

    out = io.StringIO()
    out.write(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.3f}mm" height="{tall:.3f}mm" '
        f'viewBox="0 0 {wide:.3f} {tall:.3f}" font-family="sans-serif">\n<title>{escape(title)}</title>\n'
        f'<metadata>{{"origin_x": {_number(MARGIN - page.left)}, "origin_y": {_number(top)}}}</metadata>\n'
    )
    clip = (page.left - 0.01, page.right + 0.01) if page.count > 1 else None
    out.write(
        f'<clipPath id="sheet"><rect x="{MARGIN - 0.5:.3f}" y="0" width="{page.right - page.left + 1:.3f}" '
        f'height="{tall:.3f}"/></clipPath>\n<g clip-path="url(#sheet)" fill="none" stroke-linecap="round">\n'
    )
    tab = " ".join(",".join(place(tuple(p))) for p in pattern.tab.tolist())
    out.write(f'<polygon class="tab" points="{tab}" fill="#eeeeee" stroke="{GREY}" stroke-width="0.25"/>\n')
    for k in range(2):
        (x1, y1), (x2, y2) = (place(tuple(p[k])) for p in (pattern.first.tolist(), pattern.last.tolist()))
        place_of = f'x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"'
        out.write(f'<line class="edge" {place_of} stroke="{INK}" stroke-width="0.35"/>\n')
    for name, ends in (("first", pattern.first), ("last", pattern.last)):
        (x1, y1), (x2, y2) = (place(tuple(p)) for p in ends.tolist())
        out.write(
            f'<line class="glue" data-end="{name}" data-angle="{pattern.seam!r}" '
            f'x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{INK}" stroke-width="0.5"/>\n'
        )
    width = _fold_width(pattern)
    for k, (ends, angle) in enumerate(zip(pattern.folds.tolist(), pattern.angles.tolist(), strict=True)):
        if clip and not _meets(ends, clip):
            continue
        kind = fold_kind(angle)
        (x1, y1), (x2, y2) = (place(tuple(p)) for p in ends)
        out.write(
            f'<line class="fold {kind}" data-node="{k + 2}" data-angle="{angle!r}" '
            f'x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{COLOURS[kind]}" stroke-width="{width:.3g}" '
            f'stroke-dasharray="{DASHES[kind]}"/>\n'
        )
    out.write("</g>\n")
    for x, y, text, size in labels(pattern, page):
        px, py = place((x, y))
        out.write(f'<text x="{px}" y="{py}" font-size="{size}" fill="{INK}">{escape(text)}</text>\n')
    for k, text in enumerate(notes(pattern, title)):
        suffix = f"  (page {page.number} of {page.count})" if k == 0 and page.count > 1 else ""
        out.write(
            f'<text x="{MARGIN}" y="{MARGIN + 3.5 * k:.3f}" font-size="{NOTE_SIZE}" fill="{INK}">'
            f"{escape(text + suffix)}</text>\n"
        )
    out.write(_marks(page, tall))
    out.write("</svg>\n")
    return out.getvalue().encode()


def labels(pattern: Pattern, page: Page) -> list[tuple[float, float, str, float]]:
    """Texts on a page: place, text, size in millimetres. Letters where ends meet; angles if there
    is room.
    """
    b = pattern.half_width
    swapped = pattern.sigma < 0
    size = min(4.0, 0.35 * b)
    out = [
        (pattern.first[0, 0] + 0.8 * size, b - 1.4 * size, "A", size),
        (pattern.first[1, 0] + 0.8 * size, -b + 0.7 * size, "B", size),
        (pattern.last[0, 0] + 0.4 * size, b - 1.6 * size, "B" if swapped else "A", size),
        (pattern.last[1, 0] + 0.4 * size, -b + 1.0 * size, "A" if swapped else "B", size),
    ]
    every = max(1, math.ceil(LABEL_ROOM / _step(pattern)))
    for k in range(every - 1, len(pattern.angles), every):
        (x1, _), (x2, _) = pattern.folds[k].tolist()
        out.append((0.5 * (x1 + x2) + 0.9, -0.7, f"{abs(pattern.angles[k]):.1f}", 1.6))
    if page.count > 1:
        out = [item for item in out if page.left - 1 <= item[0] <= page.right + 1]
    return out


def _meets(ends: list[list[float]], clip: tuple[float, float]) -> bool:
    """Whether a line lies at least partly between two abscissae."""
    low, high = sorted((ends[0][0], ends[1][0]))
    return high >= clip[0] and low <= clip[1]


def _marks(page: Page, tall: float) -> str:
    """Where the neighbouring page begins or ends: short ticks above and below."""
    out = ""
    for edge, there in (
        (page.left + OVERLAP, page.number > 1),
        (page.right - OVERLAP, page.number < page.count),
    ):
        if there:
            x = edge - page.left + MARGIN
            for y1, y2 in ((MARGIN + HEADER - 4.0, MARGIN + HEADER - 1.0), (tall - 6.0, tall - 3.0)):
                ends = f'x1="{x:.3f}" y1="{y1}" x2="{x:.3f}" y2="{y2}"'
                out += f'<line class="join" {ends} stroke="{GREY}" stroke-width="0.3"/>\n'
    return out


def _number(value: float) -> str:
    """A coordinate in millimetres, exact to 1e-9."""
    return f"{value:.9f}".rstrip("0").rstrip(".")


def pattern_pdf(pattern: Pattern, title: str, paper: str | None = "A4") -> bytes:
    """The pattern as a PDF at true scale, one page a sheet. Raises UsageError as `pages` does."""
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    wide, tall, found = pages(pattern, paper)
    buffer = io.BytesIO()
    metadata = {"Title": title, "CreationDate": None, "ModDate": None}
    with PdfPages(buffer, metadata=metadata) as document:
        for page in found:
            figure = Figure(figsize=(wide / 25.4, tall / 25.4))
            _draw_page(figure, pattern, page, title, wide, tall)
            document.savefig(figure)
    return buffer.getvalue()


def _draw_page(figure: Figure, pattern: Pattern, page: Page, title: str, wide: float, tall: float) -> None:
    """One page: axes in millimetres that fill the sheet, with the pattern's origin shifted as on the SVG."""
    from matplotlib.patches import Rectangle

    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(page.left - MARGIN, page.left - MARGIN + wide)
    top = pattern.half_width + HEADER + MARGIN
    axes.set_ylim(top - tall, top)
    axes.axis("off")
    clip = Rectangle(
        (page.left - 0.5, top - tall), page.right - page.left + 1, tall, transform=axes.transData
    )
    point = 72 / 25.4

    def line(ends: Any, colour: str, width: float, dashes: str | None = None) -> None:
        pattern_of = (0, tuple(float(d) / width for d in dashes.split())) if dashes else "-"
        (x1, y1), (x2, y2) = ends
        (drawn,) = axes.plot([x1, x2], [y1, y2], color=colour, linewidth=width * point, linestyle=pattern_of)
        drawn.set_clip_path(clip)

    (tab,) = axes.fill(*pattern.tab.T, facecolor="#eeeeee", edgecolor=GREY, linewidth=0.25 * point)
    tab.set_clip_path(clip)
    for k in range(2):
        line((pattern.first[k], pattern.last[k]), INK, 0.35)
    line(pattern.first, INK, 0.5)
    line(pattern.last, INK, 0.5)
    for ends, angle in zip(pattern.folds, pattern.angles.tolist(), strict=True):
        if _meets(ends.tolist(), (page.left, page.right)):
            kind = fold_kind(angle)
            line(ends, COLOURS[kind], _fold_width(pattern), DASHES[kind])
    for x, y, text, size in labels(pattern, page):
        axes.text(x, y, text, fontsize=size * point, ha="left", va="baseline", color=INK)
    for k, text in enumerate(notes(pattern, title)):
        suffix = f"  (page {page.number} of {page.count})" if k == 0 and page.count > 1 else ""
        axes.text(
            page.left,
            top - MARGIN - 3.5 * k,
            text + suffix,
            fontsize=NOTE_SIZE * point,
            va="baseline",
            color=INK,
        )
    for edge, there in (
        (page.left + OVERLAP, page.number > 1),
        (page.right - OVERLAP, page.number < page.count),
    ):
        if there:
            line(((edge, top - MARGIN - HEADER + 4), (edge, top - MARGIN - HEADER + 1)), GREY, 0.3)
            line(((edge, top - tall + 6), (edge, top - tall + 3)), GREY, 0.3)
