"""The fold pattern as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from ribbon_cli.export.pattern import Pattern, fold_pattern
from ribbon_cli.export.sheet import FLAT_DEGREES
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import legend_above
from ribbon_cli.plot.style import GREY, INK, PALETTE, Style
from ribbon_cli.store import StateRecord

MOUNTAIN, VALLEY = PALETTE[1], PALETTE[0]
FEW_FOLDS = 60
"""Most folds whose dashes can be told apart."""
LETTERS = 3.5
"""Height of the letters below the strip, in their size."""
LETTER_ROOM = 0.02
"""Share of the folds that a stretch has to have for a letter of its own."""


def pattern_figure(record: StateRecord, style: Style) -> Figure:
    """The flat strip with its folds; for true scale see `ribbon export --to svg` and `--to pdf`."""
    pattern = fold_pattern(record, 250.0)
    left, low, right, high = pattern.box
    height = style.width * (high - low) / (right - left)
    figure = Figure(figsize=(style.across(), height + LETTERS * style.font / 72), layout="constrained")
    axes = figure.subplots()
    draw_pattern(axes, pattern, style)
    legend_above(figure, axes.get_legend_handles_labels()[0], rows=0)
    return figure


def draw_pattern(axes: Axes, pattern: Pattern, style: Style) -> None:
    """Draw outline, folds and tab, lines the darker the sharper the fold."""
    # The seam to the flap is a fold too, seen from the other side on a one-sided band.
    folds = np.concatenate((pattern.folds, pattern.last[None]))
    angles = np.append(pattern.angles, pattern.sigma * pattern.seam)
    if pattern.held is not None:
        folds, angles = _with_clamps(pattern)
    sharpest = float(np.abs(angles).max()) or 1.0
    # Dashes that are shorter than a line is wide run together: of many folds, letters tell which they are.
    dense = len(pattern.angles) > FEW_FOLDS
    # Lines that are wider than their distance would hide each other.
    width = min(0.7 * style.line, 0.8 * style.width * 72 / (len(pattern.angles) + 1))
    for name, colour, dashes, chosen in (
        ("mountain", MOUNTAIN, (0, (6, 2, 1, 2)), angles > FLAT_DEGREES),
        ("valley", VALLEY, (0, (4, 2)), angles < -FLAT_DEGREES),
    ):
        if not chosen.any():
            continue
        strength = 0.25 + 0.75 * np.abs(angles[chosen]) / sharpest
        lines = LineCollection(
            list(folds[chosen]),
            colors=colour,
            alpha=strength,
            linewidths=width,
            linestyles="-" if dense else [dashes],
        )
        axes.add_collection(lines)
        label = f"{name} fold" + (f" ({name[0].upper()})" if dense else "")
        axes.plot([], [], color=colour, linestyle="-" if dense else dashes, label=label)
        if dense:
            _letters(axes, pattern, chosen[: len(pattern.angles)], name[0].upper(), colour)
    flat = np.abs(angles) <= FLAT_DEGREES
    if flat.any():
        axes.add_collection(LineCollection(list(folds[flat]), colors=GREY, linewidths=style.thin))
    # The flap is cut with the strip, and folded against it.
    start = pattern.start_tab if len(pattern.start_tab) else pattern.first
    end = pattern.tab if len(pattern.tab) else pattern.last
    outline = np.vstack((start[0], end, start[::-1]))
    axes.plot(*outline.T, color=INK, label="cut")
    label = "flap for glue" if pattern.held is None else "flap in a clamp"
    for flap in (pattern.tab, pattern.start_tab):
        if len(flap):
            axes.fill(*flap.T, facecolor="#dddddd", zorder=0, label=label)
            label = "_"
    axes.set_aspect("equal")
    axes.margins(0.01)
    axes.axis("off")


def _with_clamps(pattern: Pattern) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The folds (k, 2, 2) of a strip and their angles (k,), those at its clamps last."""
    flaps = ((pattern.start_tab, pattern.first, pattern.seam), (pattern.tab, pattern.last, pattern.end))
    clamps = [(ruling, angle) for flap, ruling, angle in flaps if len(flap)]
    folds = np.concatenate((pattern.folds, *(ruling[None] for ruling, _ in clamps)))
    return folds, np.append(pattern.angles, [angle for _, angle in clamps])


def _letters(axes: Axes, pattern: Pattern, chosen: NDArray[np.bool_], letter: str, colour: str) -> None:
    """A letter below each stretch of folds of one kind that has room for it."""
    ends = np.flatnonzero(np.diff(np.concatenate(([0], chosen.astype(int), [0]))))
    for first, after in zip(ends[::2], ends[1::2], strict=True):
        places = pattern.folds[first:after, 1, 0]
        if after - first > LETTER_ROOM * len(chosen):
            place = (float(places.mean()), -pattern.half_width)
            axes.annotate(
                letter,
                place,
                xytext=(0, -2),
                textcoords="offset points",
                ha="center",
                va="top",
                color=colour,
            )
