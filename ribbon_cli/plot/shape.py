"""The shape: a shaded developable surface with its rulings, as vector graphics in exact depth order."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb, to_rgba
from numpy.typing import NDArray

from ribbon_cli.export.arrows import LONGEST
from ribbon_cli.export.mesh import facet_corners, facet_normals, strip
from ribbon_cli.export.view import View, chosen_view, strip_axes
from ribbon_cli.plot.forces import arrow_ends, draw_forces
from ribbon_cli.plot.outline import draw_lines
from ribbon_cli.plot.painter import depth_order
from ribbon_cli.plot.style import INK, SIDES, Style
from ribbon_cli.plot.supports import PLATE, draw_pins, middle_of, plates
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

RULINGS = 72
"""Most rulings that are drawn: more would be a grey haze in print."""
AMBIENT = 0.52
"""Brightness of what the light does not reach, as a share of full light."""


def draw_shape(
    axes: Axes,
    record: StateRecord,
    style: Style,
    view: View | None = None,
    marked: tuple[int, ...] = (),
    rulings: int = RULINGS,
    like: NDArray[np.bool_] | None = None,
    each: float = 0.0,
) -> View:
    """Draw a state's surface into `axes` and return the view, `chosen_view` unless given.

    The two sides have two colours. Light falls by |n.l|, which does not know a normal from its opposite, so
    that nothing shows where the seam lies. Clamps are plates, hinges have pins. `marked` are node numbers,
    from 1, of rulings drawn in green, and `rulings` is the most that are drawn of the others. The colours
    of a one-sided band are fitted to `like`, the `shown_sides` of a similar shape from the same side, if
    that is given. Forces at contacts are arrows with the length `each` a unit, none where that is 0.
    """
    corners, pieces = facet_corners(record), strip(record)
    view = view or chosen_view(corners, None, strip_axes(record))
    middle, held = middle_of(record, corners), plates(record)
    flat = view.project(corners - middle)
    every = np.concatenate((flat, view.project(held - middle))) if len(held) else flat
    order, covered = depth_order(every)
    normals = facet_normals(record)
    facing = normals @ view.eye
    side = _sides(facing, covered, record.sigma if pieces.closed else 1, flat, like)
    colours = _shaded(side, np.abs(normals @ view.light))
    n = len(flat)
    outline = _turning(facing > 0, record.sigma)
    outline[list(pieces.first)] = True
    green = np.isin(np.arange(1, n + 1), marked)
    drawn = _spread(n, rulings) & ~outline & ~green
    if len(held):
        plate = np.tile(to_rgb(PLATE), (len(held), 1))
        colours, drawn = np.concatenate((colours, plate)), np.append(drawn, [False] * len(held))
    _paint(axes, every, order, colours, style, drawn, n)
    draw_lines(axes, flat, pieces, outline, green, style)
    draw_pins(axes, record, flat, style)
    points = every.reshape(-1, 3)
    if each > 0.0:
        start, end = (view.project(points - middle) for points in arrow_ends(record, each))
        draw_forces(axes, start, end, every, LONGEST * record.length, style)
        points = np.concatenate((points, end))
    _frame(axes, points)
    return view


def _spread(n: int, most: int) -> NDArray[np.bool_]:
    """At most so many of n rulings, as evenly as can be once round: at the seam as well."""
    count = -(-n // max(1, -(-n // most)))
    chosen = np.zeros(n, dtype=bool)
    chosen[np.arange(count) * n // count] = True
    return chosen


def shown_sides(record: StateRecord, view: View, like: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Which facets (N,) of a state have the first of the two colours, seen from `view`; `like` as above."""
    corners = facet_corners(record)
    flat = view.project(corners - corners.reshape(-1, 3).mean(axis=0))
    facing = facet_normals(record) @ view.eye
    # What covers what takes by far the longest to find, and is not asked where `like` decides.
    covered = depth_order(flat)[1] if like is None else np.zeros(len(flat), dtype=np.int64)
    return _sides(facing, covered, record.sigma if strip(record).closed else 1, flat, like)


def _sides(
    facing: Array,
    covered: NDArray[np.int64],
    sigma: int,
    flat: Array,
    like: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Which of the two colours each facet (N,) has: it changes where the surface turns over in the picture.

    A one-sided band turns over an odd number of times, counted once round, so that at one place the
    colour has to stay: at the outline that most of the band covers, or else the shortest, never amid a
    surface. With `like`, it is the outline, and of the two namings the one, with which the most facets
    have the colour that `like` has at the same part of the length.
    """
    front = facing > 0
    if sigma > 0:
        return front
    # The seam, behind facet N, is no place where the band turns over: there the normal changes its name.
    turns = np.flatnonzero(front != np.append(front[1:], ~front[0]))
    if turns.size and like is not None:
        like = like[np.arange(front.size) * like.size // front.size]
        found = [_coloured(bool(front[0]), turns, int(kept), front.size) for kept in turns]
        found += [~side for side in found]
        return max(found, key=lambda side: int(np.count_nonzero(side == like)))
    kept = -1
    if turns.size:
        length = np.linalg.norm(flat[turns, 2, :2] - flat[turns, 3, :2], axis=1)
        cover = np.minimum(covered[turns], covered[(turns + 1) % front.size])
        kept = int(turns[np.lexsort((length, -cover))[0]])
    return _coloured(bool(front[0]), turns, kept, front.size)


def _coloured(first: bool, turns: NDArray[np.int64], kept: int, count: int) -> NDArray[np.bool_]:
    """Colours (count,) of facets: facet 1's own side's at the start; each turning-over but one changes it."""
    flips = np.zeros(count, dtype=int)
    flips[turns] = 1
    if kept >= 0:
        flips[kept] = 0
    before = np.concatenate(([0], np.cumsum(flips)[:-1]))
    side: NDArray[np.bool_] = first ^ (before % 2 == 1)
    return side


def _turning(front: NDArray[np.bool_], sigma: int) -> NDArray[np.bool_]:
    """At which rulings (N,) the surface turns over in the picture; at the seam a one-sided band changes
    names.
    """
    turning = np.append(False, front[1:] != front[:-1])
    turning[0] = (front[0] == front[-1]) == (sigma < 0)
    return turning


def _shaded(side: NDArray[np.bool_], light: Array) -> Array:
    """Colours (N, 3): Lambert's law with |n.l|, on top of even light."""
    base = np.where(side[:, None], to_rgb(SIDES[0]), to_rgb(SIDES[1]))
    level = AMBIENT + (1.0 - AMBIENT) * light
    return np.clip(base * (level * 1.08)[:, None], 0.0, 1.0)


def _paint(
    axes: Axes,
    flat: Array,
    order: NDArray[np.int64],
    colours: Array,
    style: Style,
    drawn: NDArray[np.bool_],
    facets: int,
) -> None:
    """One collection for facets and the rulings `drawn` (N,) on them, so that nearer facets cover both.

    What follows the `facets` are plates, which have a rim.
    """
    n = len(flat)
    thin, none = to_rgba(INK, 0.45), (0.0, 0.0, 0.0, 0.0)
    vertices: list[Array] = []
    faces: list[Any] = []
    lines: list[Any] = []
    widths: list[float] = []
    picture = flat[:, :, :2]
    for i in order.tolist():
        colour = (*colours[i], 1.0)
        vertices.append(picture[i][[0, 1, 2, 3, 0]])
        faces.append(colour)
        # A facet's own colour covers the hairline that viewers leave between neighbours.
        lines.append(colour if i < facets else to_rgba(INK))
        widths.append(0.3 if i < facets else 0.5 * style.line)
        for k, ends in ((i, picture[i, :2]), ((i + 1) % n, picture[i, 2:])):
            if drawn[k]:
                vertices.append(ends)
                faces.append(none)
                lines.append(thin)
                widths.append(style.thin)
    axes.add_collection(
        PolyCollection(
            vertices,
            closed=False,
            facecolors=faces,
            edgecolors=lines,
            linewidths=widths,
            capstyle="round",
            joinstyle="round",
        )
    )


def _frame(axes: Axes, points: Array) -> None:
    """Equal scales, no axes, and room for the lines' width all round points (n, 3)."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half = 1.03 * half
    axes.set_aspect("equal")
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.axis("off")
