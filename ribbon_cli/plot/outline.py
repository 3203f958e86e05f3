"""The lines of a shape that stand out: edges, outlines, free ends and marked rulings, where they are seen.

Each is cut into short pieces, and a piece is drawn if no facet lies in front of its middle. They come last
and whole: in the painter's order neighbours would cover half of a line's width.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from ribbon_cli.export.mesh import Strip
from ribbon_cli.plot.painter import hidden
from ribbon_cli.plot.style import INK, Style

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

GREEN = "#00A651"
"""Colour of marked rulings."""
PIECES = 1600
"""About how many pieces an edge that goes once round is cut into."""
SPECK = 0.01
"""Length, relative to the picture's size, below which what is seen of a line is left out: layers that lie
nearly on each other let such bits through.
"""
RULING_PIECES = 48
"""Pieces of a ruling."""


def draw_lines(axes: Axes, flat: Array, strip: Strip, outline: Flags, marked: Flags, style: Style) -> None:
    """Draw the edges of facets (N, 4, 3) and some rulings in ink, and the marked ones in green.

    `outline` (N,) and `marked` (N,) tell of the rulings at which facets begin. Free ends are drawn as well,
    in green where the ruling of that number is marked.
    """
    n = len(flat)
    ink: list[Array] = []
    for side in ((1, 2), (0, 3)):
        ink += _edge(flat, side, strip)
    green: list[Array] = []
    for k in np.flatnonzero(outline | marked).tolist():
        (green if marked[k] else ink).extend(_ruling(flat, flat[k, :2], (k, (k - 1) % n)))
    for i in strip.last:
        (green if marked[(i + 1) % n] else ink).extend(_ruling(flat, flat[i, 2:], (i, i)))
    _stroke(axes, ink, INK, 0.75 * style.line)
    _stroke(axes, green, GREEN, 2.4 * style.line)


def _edge(flat: Array, side: tuple[int, int], strip: Strip) -> list[Array]:
    """What is seen of the edge that runs along one side of all facets, as lines (k, 2)."""
    n = len(flat)
    count = max(2, -(-PIECES // n))
    points = _cut(flat[:, side[0]], flat[:, side[1]], count)
    middle = 0.5 * (points[:, 1:] + points[:, :-1])
    owners = np.repeat(np.arange(n), count)[:, None]
    seen = ~hidden(middle.reshape(-1, 3), owners, flat).reshape(n, count)
    # From a facet to the next the edge goes on, but for the seam and where the band is cut.
    ends = sorted({*strip.last, n - 1})
    lines: list[Array] = []
    for first, last in zip([0, *(i + 1 for i in ends[:-1])], ends, strict=True):
        piece = points[first : last + 1]
        line = np.concatenate((piece[:, :-1].reshape(-1, 3), piece[-1:, -1]))
        lines += _runs(line[:, :2], seen[first : last + 1].ravel(), _size(flat))
    return lines


def _ruling(flat: Array, ends: Array, owners: tuple[int, int]) -> list[Array]:
    """What is seen of a ruling with these ends (2, 3), as lines (k, 2)."""
    points = _cut(ends[:1], ends[1:], RULING_PIECES)[0]
    middle = 0.5 * (points[1:] + points[:-1])
    return _runs(points[:, :2], ~hidden(middle, np.tile(owners, (len(middle), 1)), flat), _size(flat))


def _cut(start: Array, end: Array, count: int) -> Array:
    """Points (n, count + 1, 3) that divide the way from `start` to `end` (n, 3) evenly."""
    share = np.linspace(0.0, 1.0, count + 1)[None, :, None]
    points: Array = start[:, None] * (1.0 - share) + end[:, None] * share
    return points


def _runs(line: Array, seen: Flags, size: float) -> list[Array]:
    """The parts of a line (k + 1, 2) whose pieces (k,) are seen; none shorter than `SPECK` of the size."""
    steps = np.flatnonzero(np.diff(np.concatenate(([0], seen.astype(int), [0]))))
    runs = [line[a : b + 1] for a, b in zip(steps[::2], steps[1::2], strict=True)]
    return [run for run in runs if np.linalg.norm(np.diff(run, axis=0), axis=1).sum() >= SPECK * size]


def _size(flat: Array) -> float:
    """The picture's larger extent."""
    return float(np.ptp(flat[:, :, :2], axis=(0, 1)).max())


def _stroke(axes: Axes, lines: Sequence[Array], colour: str, width: float) -> None:
    """Add lines to a picture, above everything that is there."""
    if lines:
        axes.add_collection(
            LineCollection(
                lines, colors=colour, linewidths=width, capstyle="round", joinstyle="round", zorder=2
            )
        )
