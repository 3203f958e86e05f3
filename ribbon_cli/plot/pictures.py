"""Figures of one shape, and of shapes in a row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ribbon_cli.export.align import turn_between, turned_alike
from ribbon_cli.export.arrows import LONGEST, per_force
from ribbon_cli.export.mesh import facet_corners
from ribbon_cli.export.view import View, chosen_view, strip_axes
from ribbon_cli.export.words import standing
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.forces import arrow_meaning, force_key, seen
from ribbon_cli.plot.labels import legend_above, lines, place_texts
from ribbon_cli.plot.shape import RULINGS, draw_shape, shown_sides
from ribbon_cli.plot.style import GREY, Style
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]


def shape_figure(record: StateRecord, style: Style, angles: tuple[float, float] | None = None) -> Figure:
    """One shape with a bar for its scale; `angles` are azimuth and elevation in degrees, automatic if
    None.
    """
    corners = facet_corners(record)
    view = chosen_view(corners, angles, strip_axes(record))
    each = per_force([record])
    extent = np.ptp(view.project(seen(record, each))[:, :2], axis=0)
    width = style.across(0.7)
    height = width * float(np.clip(extent[1] / extent[0], 0.3, 1.2))
    figure = Figure(figsize=(width, height + 0.06 * width / 0.7), layout="constrained")
    axes = figure.subplots()
    draw_shape(axes, record, style, view, each=each)
    scale_bar(axes, style)
    if each > 0.0:
        force_key(axes, each, LONGEST * record.length, style)
    return figure


def scale_bar(axes: Axes, style: Style) -> None:
    """A bar of a round length, in the unit of the length l, below the picture at the right."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    wanted = 0.2 * (right - left)
    power = 10.0 ** math.floor(math.log10(wanted))
    size = max(m * power for m in (1.0, 2.0, 5.0) if m * power <= wanted)
    drop = 0.05 * (right - left)
    axes.plot(
        [right - size, right], [low - drop] * 2, color=GREY, linewidth=1.5 * style.line, solid_capstyle="butt"
    )
    axes.text(
        right - size - 0.012 * (right - left), low - drop, f"{size:g}", ha="right", va="center", color=GREY
    )
    axes.set_xlim(left, right)
    axes.set_ylim(low - 1.7 * drop, high)


PAD = 0.05
"""Room about a panel, in inches: matplotlib leaves 3 points and a little between panels."""
SHAPE = 9.0
"""Least width of a shape in a row, in sizes of its title's letters."""
LETTER = 0.6
"""Width of a letter of a title, relative to its size, on the long side."""


@dataclass(frozen=True)
class Panel:
    """A shape in a row: its title, and numbers from 1 of the nodes whose rulings are marked."""

    record: StateRecord
    title: str
    marked: tuple[int, ...] = ()


def family_figure(
    records: Sequence[StateRecord], style: Style, angles: tuple[float, float] | None = None
) -> Figure:
    """Shapes in rows at one scale and from one side, what they differ in, and which have no certificate."""
    letters = letters_across(len(records), style)
    titles = [
        lines([*text.split(", "), standing(record)], letters)
        for text, record in zip(place_texts(records), records, strict=True)
    ]
    panels = [Panel(record, title) for record, title in zip(records, titles, strict=True)]
    return shapes_figure(panels, style, aligned=True, angles=angles)


def shapes_figure(
    panels: Sequence[Panel], style: Style, *, aligned: bool, angles: tuple[float, float] | None = None
) -> Figure:
    """Shapes in rows of up to five, fewer where these would be narrow, at one scale; `aligned` from one side,
    else each from its own best.
    """
    corners = [facet_corners(panel.record) for panel in panels]
    own = [strip_axes(panel.record) for panel in panels]
    if aligned and any(axes is None for axes in own):
        views = _common_views(corners, angles)
    else:
        views = [chosen_view(item, angles, axes) for item, axes in zip(corners, own, strict=True)]
    each = per_force([panel.record for panel in panels])
    boxes = [
        np.ptp(view.project(seen(panel.record, each))[:, :2], axis=0)
        for view, panel in zip(views, panels, strict=True)
    ]
    columns = _columns(len(panels), style)
    rows = math.ceil(len(panels) / columns)
    width = style.across(1.0 if columns > 1 else 0.6)
    parts = [slice(k * columns, (k + 1) * columns) for k in range(rows)]
    titles = [max(_title_height(panel.title, style) for panel in panels[part]) for part in parts]
    high = [max(float(box[1]) for box in boxes[part]) for part in parts]
    # One scale everywhere; each row is as high as its highest shape, and none far higher than wide.
    wide = max(*(float(box[0]) for box in boxes), max(high) / 1.3, 0.0)
    inner = width / columns - 2 * PAD
    height = sum(inner * h / wide + title + 2 * PAD for h, title in zip(high, titles, strict=True))
    figure = Figure(figsize=(width, height), layout="constrained")
    places = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"height_ratios": high}).ravel()
    for axes in places[len(panels) :]:
        axes.axis("off")
    # In a smaller picture fewer rulings are told apart.
    rulings = RULINGS if columns == 1 else max(24, round(1.5 * RULINGS / columns))
    sides = _common_sides(panels, views) if aligned else [None] * len(panels)
    for k, (axes, panel, view) in enumerate(zip(places, panels, views, strict=False)):
        draw_shape(axes, panel.record, style, view, panel.marked, rulings, sides[k], each)
        _same_scale(axes, 1.03 * wide, 1.03 * high[k // columns])
        axes.set_title(panel.title)
        axes.set_anchor("S")  # what equal scales leave over belongs to the titles
    if each > 0.0:
        legend_above(figure, [arrow_meaning([panel.record for panel in panels], style)], rows=0)
    return figure


def _columns(count: int, style: Style) -> int:
    """How many of some shapes stand side by side."""
    most = style.fitting(5, SHAPE)
    if count <= most:
        return count
    return math.ceil(count / math.ceil(count / min(most, 4)))


def letters_across(count: int, style: Style) -> int:
    """How many letters a line of a title has room for above one of some shapes."""
    room = style.width / _columns(count, style) - 2 * PAD
    return int(room * 72 / (LETTER * style.font))


def _title_height(title: str, style: Style) -> float:
    """Inches that a panel's title takes, with the room about it."""
    return (1.1 + 1.3 * (title.count("\n") + 1)) * style.font / 72 if title else 0.0


def _common_views(shapes: Sequence[Array], angles: tuple[float, float] | None) -> list[View]:
    """Views of shapes turned onto each other, from one side: the one that suits the middle shape."""
    placed = turned_alike(shapes)
    view = chosen_view(placed[len(placed) // 2], angles)
    return [View(view.axes @ turn_between(c, p)) for c, p in zip(shapes, placed, strict=True)]


def _common_sides(panels: Sequence[Panel], views: Sequence[View]) -> list[NDArray[np.bool_] | None]:
    """What each shape's colours are to be like: from the middle shape outwards, its neighbour's.

    A one-sided band's two colours are names; without this they would change from picture to picture.
    """
    middle = len(panels) // 2
    out: list[NDArray[np.bool_] | None] = [None] * len(panels)
    for way in (range(middle + 1, len(panels)), range(middle - 1, -1, -1)):
        sides = shown_sides(panels[middle].record, views[middle]) if way else None
        for k in way:
            out[k] = sides
            sides = shown_sides(panels[k].record, views[k], sides)
    return out


def _same_scale(axes: Axes, wide: float, high: float) -> None:
    """Widen a picture's limits about its middle to a common size."""
    x, y = float(np.mean(axes.get_xlim())), float(np.mean(axes.get_ylim()))
    axes.set_xlim(x - wide / 2, x + wide / 2)
    axes.set_ylim(y - high / 2, y + high / 2)
