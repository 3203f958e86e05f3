"""What holds the ends of a strip, in pictures: a clamp is a short plate, a hinge two pins, free nothing."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ribbon_cli.export.mesh import facet_corners
from ribbon_cli.parts import CLAMPED, HINGED
from ribbon_cli.plot.painter import hidden
from ribbon_cli.plot.style import INK, Style
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

PLATE = "#B9B9B9"
"""Colour of clamps."""
WIDER = 1.25
"""Half the width of a plate, in half-widths of the strip."""
DEPTH, DEEPEST = 0.9, 0.06
"""How far a plate goes beyond the strip, in half-widths, and at most of the length."""


def _ends(record: StateRecord) -> list[tuple[str, Array, Array, Array]]:
    """Of both ends how they are held, their midpoints, rulings, and the direction that leads away."""
    ends = record.parts.ends
    if ends is None:
        return []
    cosine = math.cos(ends.tilt)
    onward = np.array([cosine, *(math.sin(ends.tilt) * f(ends.twist) for f in (math.cos, math.sin))])
    return [
        (ends.start, record.midline[0], record.g[0], np.array([-1.0, 0.0, 0.0])),
        (ends.end, record.midline[-1], record.g_end, onward),
    ]


def plates(record: StateRecord) -> Array:
    """Corners (k, 4, 3) of the clamps' plates."""
    depth = min(DEPTH * record.half_width, DEEPEST * record.length)
    found = [
        [place - across, place + across, place + across + depth * way, place - across + depth * way]
        for held, place, ruling, way in _ends(record)
        if held == CLAMPED
        for across in (WIDER * record.half_width * ruling,)
    ]
    return np.array(found).reshape(-1, 4, 3)


def middle_of(record: StateRecord, corners: Array) -> Array:
    """What lies in the middle of a picture (3,): of a strip that may move its start, which does not."""
    middle: Array = corners.reshape(-1, 3).mean(axis=0) if record.parts.ends is None else record.midline[0]
    return middle


def with_plates(record: StateRecord) -> Array:
    """Corners (N + k, 4, 3) of the facets, then of the plates."""
    corners: Array = np.concatenate((facet_corners(record), plates(record)))
    return corners


def draw_pins(axes: Axes, record: StateRecord, flat: Array, style: Style) -> None:
    """Small circles at the ends of hinged rulings, where no facet (N, 4, 3) hides them."""
    for held, facet, sides in zip([end[0] for end in _ends(record)], (0, -1), ((0, 1), (3, 2)), strict=False):
        if held != HINGED:
            continue
        pins = flat[facet, list(sides)]
        owners = np.full((2, 1), facet % len(flat))
        seen = pins[~hidden(pins, owners, flat)]
        axes.plot(
            *seen[:, :2].T,
            linestyle="",
            marker="o",
            markersize=1.2 * style.marker,
            markerfacecolor="white",
            markeredgecolor=INK,
            markeredgewidth=0.75 * style.line,
            zorder=3,
            clip_on=False,
        )
