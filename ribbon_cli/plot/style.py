"""One look for every picture: sizes, fonts, lines and colours that also tell apart in grey and to the
colour-blind.

Hues are Okabe and Ito's (jfly.uni-koeln.de/color); lines differ by dash and marker as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.6)),
    (0, (1.2, 1.2)),
    (0, (6, 1.6, 1.2, 1.6)),
    (0, (3, 1)),
    "-.",
    "--",
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

SIDES = ("#8FB4D6", "#E8C38A")
"""Colours of a surface's two sides: blue and sand, of nearly the same lightness under full light."""
INK = "#1b1b1b"
GREY = "#6b6b6b"
LIGHT_GREY = "#c8c8c8"


@dataclass(frozen=True)
class Style:
    """Sizes of a style: `width` of a whole figure in inches, `font` in points, `line` widths in points."""

    name: str
    width: float
    font: float
    line: float
    thin: float
    marker: float
    dpi: int


STYLES = {
    "paper": Style("paper", 6.3, 8.0, 1.0, 0.35, 3.0, 300),
    "talk": Style("talk", 10.0, 15.0, 2.2, 0.6, 6.0, 150),
}
"""`paper` fills a page of A4 with usual margins; `talk` is read from the back of a room."""


@contextmanager
def styled(style: Style) -> Iterator[None]:
    """Let matplotlib draw in a style, whatever the user's own settings are."""
    import matplotlib
    from matplotlib import style as mpl_style

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


def line_look(index: int) -> dict[str, Any]:
    """Colour and dashes of the curve with this index."""
    return {"color": PALETTE[index % len(PALETTE)], "linestyle": DASHES[index % len(DASHES)]}
