"""Forces at contacts in a shape: a point where sheets touch, and two arrows, equal and opposite.

An arrow begins at the contact and lies along the force on the sheet on its side. What a facet hides is thin
and dashed, as in drawings of machines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ribbon_cli.digits import significant
from ribbon_cli.export.contacts import touching
from ribbon_cli.plot.painter import hidden
from ribbon_cli.plot.style import GREY, NEGATIVE, Style
from ribbon_cli.plot.supports import with_plates
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PIECES = 24
"""Pieces of an arrow, each of which is seen or hidden."""
HEAD, SLENDER = 0.22, 0.3
"""Length of a head as a part of the longest arrow, and half its width as a part of its length."""
KEY = 0.035
"""Height of the key above the lower edge, as a part of the picture's width: that of the scale's bar."""


def arrow_ends(record: StateRecord, each: float) -> tuple[Array, Array]:
    """Where the arrows (m, 3) of a state begin and end in space, with the length `each` a unit of force."""
    places, forces = touching(record).arrows
    return places, places + each * forces


def seen(record: StateRecord, each: float) -> Array:
    """All points (n, 3) that a picture of a shape has to have room for: facets, clamps and arrows."""
    points: Array = np.concatenate((with_plates(record).reshape(-1, 3), arrow_ends(record, each)[1]))
    return points


def draw_forces(axes: Axes, start: Array, end: Array, flat: Array, longest: float, style: Style) -> None:
    """Draw arrows (2k, 3), of a contact two in turn, and points of contact over facets (n, 4, 3), all in the
    picture's coordinates; `longest` is the length of the longest arrow in space."""
    if not len(start):
        return
    between = start[:, None] + ((np.arange(PIECES) + 0.5) / PIECES)[:, None] * (end - start)[:, None]
    behind = _behind(between.reshape(-1, 3), flat).reshape(-1, PIECES)
    for k in range(len(start)):
        _arrow(axes, start[k, :2], end[k, :2], behind[k], longest, style)
    at = 0.5 * (start[::2] + start[1::2])
    covered = _behind(at, flat)
    for chosen, face in ((covered, "white"), (~covered, NEGATIVE)):
        axes.plot(
            *at[chosen, :2].T,
            linestyle="",
            marker="o",
            markersize=0.8 * style.marker,
            markerfacecolor=face,
            markeredgecolor=NEGATIVE,
            markeredgewidth=0.6 * style.line,
            zorder=4,
        )


def _behind(points: Array, flat: Array) -> Flags:
    """Which points (n, 3) a facet hides."""
    return hidden(points, np.full((len(points), 1), -1), flat)


def _arrow(axes: Axes, start: Array, end: Array, behind: Flags, longest: float, style: Style) -> None:
    """An arrow in the picture's plane; its pieces `behind` (PIECES,) are drawn as hidden."""
    size = float(np.linalg.norm(end - start))
    if size <= 0.02 * longest:  # seen along its line: the point of contact stands for it
        return
    way = (end - start) / size
    head = min(HEAD * longest, 0.6 * size)
    aside = SLENDER * head * np.array([-way[1], way[0]])
    neck = end - head * way
    marks = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    changes = np.flatnonzero(np.diff(behind.astype(int))) + 1
    for run in np.split(np.arange(PIECES), changes):
        line = start + np.minimum(marks[[run[0], run[-1] + 1]], 1.0 - head / size) * (end - start)
        _line(axes, line, bool(behind[run[0]]), style)
    tip = PolyCollection(
        [np.array([end, neck + aside, neck - aside])],
        facecolors="white" if behind[-1] else NEGATIVE,
        edgecolors=NEGATIVE,
        linewidths=0.5 * style.line,
        joinstyle="miter",
        zorder=3.2,
    )
    axes.add_collection(tip, autolim=False)


def _line(axes: Axes, line: Array, behind: bool, style: Style) -> None:
    """A stretch of an arrow's line."""
    axes.add_collection(
        LineCollection(
            [line],
            colors=NEGATIVE,
            linewidths=(0.6 if behind else 1.3) * style.line,
            linestyles=[(0, (2.5, 1.8)) if behind else "-"],
            capstyle="butt",
            zorder=3.1,
        ),
        autolim=False,
    )


def force_key(axes: Axes, each: float, longest: float, style: Style) -> None:
    """An arrow of a round force with its number, in the line of the scale's bar at the left."""
    power = 10.0 ** math.floor(math.log10(longest / each))
    force = max(m * power for m in (1.0, 2.0, 5.0) if m * power * each <= longest * (1.0 + 1e-9))
    left, right = axes.get_xlim()
    low, _ = axes.get_ylim()
    place = np.array([left, low + KEY * (right - left)])
    shown = np.zeros(PIECES, dtype=bool)
    _arrow(axes, place, place + np.array([force * each, 0.0]), shown, longest, style)
    axes.text(
        place[0] + force * each + 0.012 * (right - left),
        place[1],
        f"force {force:g}",
        va="center",
        color=GREY,
    )


def arrow_meaning(records: Sequence[StateRecord], style: Style) -> Line2D:
    """A legend's entry for the arrows of several shapes, which have one scale."""
    most = max(float(touching(record).forces.max(initial=0.0)) for record in records)
    label = f"force on a sheet at a contact, longest {significant(most, 3)}"
    return Line2D([], [], color=NEGATIVE, marker=">", markevery=[1], linewidth=1.3 * style.line, label=label)
