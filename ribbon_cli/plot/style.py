"""Sizes, fonts and lines of every picture, and the looks by which curves are told apart.

Hues are Okabe and Ito's (jfly.uni-koeln.de/color), which the colour-blind tell apart. No two looks of one
sequence share dashes, marker and fill, so that they differ in grey as well. Where marks stand for states all
looks are filled: an open mark has no certificate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import matplotlib
from matplotlib import style as mpl_style

from ribbon_cli.errors import UsageError

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.6)),
    (0, (1.2, 1.2)),
    (0, (6, 1.6, 1.2, 1.6)),
    (0, (9, 1.6, 1.2, 1.6, 1.2, 1.6)),
)
"""As many as the eye tells apart on a line of usual width."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
MOST_LOOKS = 28
"""Most curves of one panel: each marker in four kinds of dashes."""
BRANCH_MARKERS = ("o", "^", "v", "<", ">", "P", "*")
"""Marks of branches: none of those of folds, branch points and contact."""
SPARSE = 8
"""Marks along a curve of many points."""

SIDES = ("#8FB4D6", "#E8C38A")
"""Colours of a surface's two sides: blue and sand, of nearly the same lightness under full light."""
INK = "#1b1b1b"
GREY = "#6b6b6b"
LIGHT_GREY = "#c8c8c8"
NEGATIVE = "#B00020"
"""Colour of negative eigenvalues, of what is doubtful, and of forces."""

MILLIMETRES = 25.4
"""In an inch."""
NARROWEST, WIDEST = 18.0, 1000
"""Least width of a picture in sizes of its letters, and the largest in mm."""
PANEL = 14.0
"""Least width of a panel with axes, in sizes of its letters."""
ROW = 12.0
"""Least height of a row of panels, in sizes of its letters."""
SMALLEST = 6.0
"""Smallest letters that journals take, in points."""


@dataclass(frozen=True)
class Style:
    """Sizes of a style: `width` of a whole figure in inches, `font` in points, `line` widths in points.

    `exact` says that the width was asked for: then every figure is as wide, and panels stand below each
    other where they would be narrow.
    """

    name: str
    width: float
    font: float
    line: float
    thin: float
    marker: float
    dpi: int
    exact: bool = False

    def across(self, share: float = 1.0) -> float:
        """Inches of a figure that fills a share of the page, or of the width that was asked for."""
        return self.width if self.exact else share * self.width

    def fitting(self, wanted: int, letters: float = PANEL) -> int:
        """How many panels fit side by side, each at least so many letters wide."""
        return max(1, min(wanted, int(self.width * 72 / (letters * self.font))))

    def row(self, share: float) -> float:
        """Inches of a row of panels that takes a share of the width, and more where letters need it."""
        return max(share * self.width, ROW * self.font / 72)

    @property
    def note(self) -> float:
        """Size of captions in points."""
        return max(SMALLEST, 0.7 * self.font) if self.exact else 0.7 * self.font


STYLES = {
    "paper": Style("paper", 6.3, 8.0, 1.0, 0.35, 3.0, 300),
    "talk": Style("talk", 10.0, 15.0, 2.2, 0.6, 6.0, 150),
}
"""`paper` fills a page of A4 with usual margins; `talk` is read from the back of a room."""


def of_width(style: Style, millimetres: float) -> Style:
    """The style with figures of exactly this width and letters of the same size. Raises UsageError."""
    narrowest = math.ceil(NARROWEST * style.font / 72 * MILLIMETRES)
    if not narrowest <= millimetres <= WIDEST:
        raise UsageError(
            f"--width {millimetres:g}: a picture in the style {style.name} is {narrowest} to {WIDEST} mm wide"
        )
    return replace(style, width=millimetres / MILLIMETRES, exact=True)


@contextmanager
def styled(style: Style) -> Iterator[None]:
    """Let matplotlib draw in a style, whatever the user's own settings are."""
    settings: dict[Any, Any] = {
        "figure.dpi": 100,
        "savefig.dpi": style.dpi,
        "font.family": "DejaVu Sans",
        "mathtext.fontset": "dejavusans",
        "font.size": style.font,
        "axes.titlesize": style.font,
        "axes.labelsize": style.font,
        "xtick.labelsize": 0.9 * style.font,
        "ytick.labelsize": 0.9 * style.font,
        "legend.fontsize": 0.9 * style.font,
        "legend.frameon": False,
        "axes.linewidth": 0.6 * style.line,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.major.width": 0.6 * style.line,
        "ytick.major.width": 0.6 * style.line,
        "xtick.minor.width": 0.4 * style.line,
        "ytick.minor.width": 0.4 * style.line,
        "lines.linewidth": style.line,
        "lines.markersize": style.marker,
        "lines.solid_capstyle": "round",
        # Text stays text: searchable in PDF, editable in SVG.
        "pdf.fonttype": 42,
        "svg.fonttype": "none",
        # The same picture gives the same bytes.
        "svg.hashsalt": "ribbon",
    }
    with matplotlib.rc_context():
        mpl_style.use("default")
        matplotlib.rcParams.update(settings)
        yield


def marked_look(index: int) -> dict[str, Any]:
    """Look of the curve with this index where each of its points has a mark."""
    turn = index // len(MARKERS)
    return _look(index, PALETTE[(index + 3 * turn) % len(PALETTE)])


def line_look(index: int, points: int) -> dict[str, Any]:
    """Look of the curve with this index, of so many points.

    The first are told by dashes alone, the others by sparse marks as well.
    """
    colour = PALETTE[index % len(PALETTE)]
    if index < len(DASHES):
        return {"color": colour, "linestyle": DASHES[index]}
    return _look(index - len(DASHES), colour) | {"markevery": spread(index, points)}


def branch_look(index: int) -> dict[str, Any]:
    """Colour and marks of the branch with this index; dashes are left to say how stable it is."""
    turn = index // len(BRANCH_MARKERS)
    colour = PALETTE[(index + turn) % len(PALETTE)]
    fill = "white" if turn % 2 else colour
    return {
        "color": colour,
        "marker": BRANCH_MARKERS[index % len(BRANCH_MARKERS)],
        "markerfacecolor": fill,
    }


def spread(index: int, points: int) -> tuple[int, int]:
    """First point with a mark and the distance to the next, for `SPARSE` marks on a curve of so many points.

    Curves that lie on each other have them at different places.
    """
    step = max(1, points // SPARSE)
    return (3 * index * step // len(MARKERS)) % step, step


def _look(index: int, colour: str) -> dict[str, Any]:
    # Markers and dashes are 7 and 5, so that each pair comes once in 35.
    dashes = DASHES[index % len(DASHES)]
    return {"color": colour, "linestyle": dashes, "marker": MARKERS[index % len(MARKERS)]}


def shade(colour: str) -> str:
    """A dark shade of a colour, of black a grey one."""
    if colour == "#000000":
        return GREY
    return "#" + "".join(f"{round(0.5 * int(colour[k : k + 2], 16)):02x}" for k in (1, 3, 5))
