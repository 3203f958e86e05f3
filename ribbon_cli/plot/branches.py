"""Branches that were followed by arclength: where they fold, cross, touch, and when they are stable."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.markers import CARETDOWN, CARETUP

from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import legend_above, plain
from ribbon_cli.plot.panels import branch_panels, energies, energy_unit, panels, wide_scale
from ribbon_cli.plot.style import INK, LIGHT_GREY, PALETTE, Style, branch_look, spread
from ribbon_cli.store import Summary

LINES: dict[int | None, tuple[str, Any]] = {
    0: ("stable", "-"),
    1: ("index 1", (0, (4, 1.8))),
    2: ("index 2 or more", (0, (1.2, 1.4))),
    None: ("index unknown", (0, (6, 1.6, 1.2, 1.6))),
}
"""Name and dashes of a stretch by its number of negative eigenvalues."""


class Mark(NamedTuple):
    """What a kind of point is called, and its marker."""

    name: str
    marker: Any


MARKS = {
    "fold": Mark("fold", "D"),
    "branch-point": Mark("branch point", "s"),
    "contact": Mark("contact", "X"),
    "touch": Mark("touch", CARETDOWN),
    "lift": Mark("lift", CARETUP),
}
"""Name and marker of a point by its type."""
DWARFED = 100.0
"""Ratio of the largest eigenvalue to the median beyond which a linear scale shows most as zero."""
ROW_SHARE = 0.4
"""Height of a row of panels as a part of the width."""
HELD_SHARE = 0.34
"""The same of four panels in two rows."""
FORCE = "end's force along $y$"
"""Title of a strip's fourth panel."""
AT_REST = "contact force"
"""Title of a panel of the sum of all forces with which a band rests on itself."""


def arclength_figure(
    courses: Mapping[str, Sequence[Summary]],
    starts: Mapping[int, float | None],
    style: Style,
    parameter: str = HALF_WIDTH,
) -> Figure:
    """Energy, lowest eigenvalue and clearance over a parameter along branches, and a force: of bands computed
    with contact forces their sum, else that across of a strip's end: of two sides of a branch point that are
    each other's image, which have one energy, it has opposite signs.

    `courses` are summaries of states by the name of the branch, from its start on; `starts` the lowest
    eigenvalue by label of a start that is no point of a branch. Dashes tell how many directions lead down,
    colours and small marks the branches, open marks folds, branch points and contact.
    """
    every = [point for points in courses.values() for point in points]
    resting, held = any(p.with_forces for p in every), all(p.reaction_force for p in every)
    force = AT_REST if resting else FORCE if held else None
    figure, places = panels(style, 4, 2, HELD_SHARE) if force else panels(style, 3, 3, ROW_SHARE)
    used: set[int | None] = set()
    for k, points in enumerate(courses.values()):
        b, energy, clearance = energies(points, parameter)
        title, ring = energy_unit(points)
        lowest = np.array([_eigenvalue(p, starts) for p in points])
        look = branch_look(k) if len(courses) > 1 else {"color": PALETTE[0]}
        drawn = [energy / ring, lowest, clearance]
        if force:
            drawn.append(contact_forces(points) if resting else _across(points))
        for axes, values in zip(places, drawn, strict=True):
            used |= draw_course(axes, points, b, values, look["color"], style)
            if len(courses) > 1:
                first, step = spread(k, len(points))
                axes.plot(b[first::step], values[first::step], linestyle="", zorder=3, **look)
            mark_points(axes, points, b, values, look["color"], style)
    titles = (title, "lowest eigenvalue", "clearance", *([force] if force else []))
    branch_panels(places, titles, parameter)
    for axes in places if force else ():
        axes.locator_params(axis="x", nbins=6)
    _tame(places[1])
    for axes in places[1::2]:
        axes.axhline(0.0, color=LIGHT_GREY, linewidth=0.6, zorder=0)
    places[2].set_ylim(bottom=0.0)
    handles = _names(courses, style) + meanings(used, every)
    legend_above(figure, handles, rows=0)
    return figure


def _across(points: Sequence[Summary]) -> np.ndarray:
    """The force (n,) that what holds the end exerts along y, across the start's tangent and ruling."""
    forces = [(point.reaction_force or (None, None, None))[1] for point in points]
    return np.array([np.nan if force is None else force for force in forces])


def contact_forces(points: Sequence[Summary]) -> np.ndarray:
    """The sum (n,) of the forces at a band's contacts, not-a-number without contact forces."""
    return np.array([np.nan if p.contact_force is None else p.contact_force for p in points], dtype=float)


def _tame(axes: Axes) -> None:
    """Where one eigenvalue dwarfs the rest, a scale that is linear near zero and logarithmic beyond."""
    values = np.concatenate([np.abs(np.asarray(line.get_ydata(), dtype=float)) for line in axes.get_lines()])
    values = values[np.isfinite(values) & (values > 0.0)]
    if not values.size or values.max() <= DWARFED * np.median(values):
        return
    low, high = math.floor(math.log10(np.median(values))), math.floor(math.log10(values.max()))
    wide_scale(axes, low, high)


def _eigenvalue(point: Summary, starts: Mapping[int, float | None]) -> float:
    """The lowest eigenvalue at a point, not-a-number where it is unknown.

    Where the index changes between 0 and 1, the lowest is the one that vanishes.
    """
    branch = point.branch
    if branch and {branch.index_before, branch.index_after} == {0, 1}:
        return 0.0
    value = branch.lowest_eigenvalue if branch else starts.get(point.label)
    return float("nan") if value is None else float(value)


def _stretches(points: Sequence[Summary]) -> list[int | None]:
    """Number of negative eigenvalues between each point and the next, 2 for more; None: unknown."""
    found: list[int | None] = []
    for k, (one, other) in enumerate(pairwise(points)):
        ends = [_index(other, other.branch.index_before if other.branch else None)]
        # A branch that begins at a point of another has that one's index nowhere.
        if k or one.branch is None:
            ends.append(_index(one, one.branch.index_after if one.branch else None))
        known = {index for index in ends if index is not None}
        found.append(min(known.pop(), 2) if len(known) == 1 else None)
    return found


def _index(point: Summary, side: int | None) -> int | None:
    """Negative eigenvalues at a point, or on the given side of it where they change."""
    turns = point.branch is not None and point.branch.type in ("fold", "branch-point")
    return side if turns and side is not None else point.negative_eigenvalues


def _runs(stretches: Sequence[int | None]) -> Iterator[tuple[int | None, int, int]]:
    """Neighbouring stretches of one index: it, and the numbers of the first and of the last point."""
    place = 0
    for index, group in groupby(stretches):
        count = len(list(group))
        yield index, place, place + count
        place += count


def draw_course(
    axes: Axes, points: Sequence[Summary], b: np.ndarray, values: np.ndarray, colour: str, style: Style
) -> set[int | None]:
    """Draw a branch as lines, dashed by index; the indices that it has."""
    stretches = _stretches(points)
    for index, first, last in _runs(stretches):
        part = slice(first, last + 1)
        known = ~np.isnan(values[part])
        x, y = b[part][known], values[part][known]
        axes.plot(x, y, color=colour, linestyle=LINES[index][1], linewidth=style.line)
    return set(stretches)


def mark_points(
    axes: Axes, points: Sequence[Summary], b: np.ndarray, values: np.ndarray, colour: str, style: Style
) -> None:
    """Marks at points that are more than steps."""
    for k, point in enumerate(points):
        branch = point.branch
        if branch is None or branch.type not in MARKS or (k == 0 and len(points) > 1):
            continue
        axes.plot(
            b[k],
            values[k],
            linestyle="",
            marker=MARKS[branch.type][1],
            markersize=1.5 * style.marker,
            markerfacecolor="white",
            markeredgecolor=colour,
            zorder=4,
        )


def _names(courses: Mapping[str, Sequence[Summary]], style: Style) -> list[Line2D]:
    """A legend's lines for branches, numbered where there are several."""
    if len(courses) == 1:
        return [Line2D([], [], color=PALETTE[0], label=name, linewidth=2 * style.line) for name in courses]
    return [
        Line2D([], [], label=f"{k + 1} {plain(name)}", **branch_look(k)) for k, name in enumerate(courses)
    ]


def meanings(used: set[int | None], points: Sequence[Summary]) -> list[Line2D]:
    """A legend's lines for what dashes and open marks mean; of these only what is there."""
    types = {p.branch.type for p in points if p.branch}
    lines = [
        Line2D([], [], color=INK, linestyle=dashes, label=name)
        for index, (name, dashes) in LINES.items()
        if index in used
    ]
    lines += [
        Line2D([], [], color=INK, linestyle="", marker=marker, markerfacecolor="white", label=name)
        for kind, (name, marker) in MARKS.items()
        if kind in types
    ]
    return lines
