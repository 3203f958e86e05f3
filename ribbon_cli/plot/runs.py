"""Runs beside each other: energies over the half-width in one panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ribbon_cli.export.words import meets_unheld
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.plot.branches import draw_course, mark_points, meanings
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import legend_above, parameter_column, parameter_text
from ribbon_cli.plot.panels import energies
from ribbon_cli.plot.style import BRANCH_MARKERS, INK, Style, branch_look, spread
from ribbon_cli.store import Summary

Course = Sequence["Summary"]

MOST_RUNS = len(BRANCH_MARKERS)
"""Most runs that are told apart: fill says whether a state is certified, dashes how stable it is."""
FEW_STATES = 24
"""Most states of a run that are marked one by one."""
OPEN = "no certificate"
CONTACT = "self-contact"


def runs_figure(
    names: Sequence[str],
    bands: Sequence[str],
    runs: Sequence[Sequence[Course]],
    style: Style,
    parameter: str = HALF_WIDTH,
) -> Figure:
    """Energy over a parameter, each run in a colour and with marks of its own.

    `runs` has for each run summaries of states along its branches, `bands` what each is of. Marks are
    states, open ones without certificate, crosses those with self-contact; dashes tell how many directions
    lead down.
    """
    figure = Figure(figsize=(style.across(0.72), style.row(0.5)), layout="constrained")
    axes = figure.subplots()
    used: set[int | None] = set()
    for k, courses in enumerate(runs):
        for points in courses:
            used |= _draw(axes, points, k, style, parameter)
    axes.set_xlabel(parameter_text(parameter))
    axes.set_ylabel("$E$")
    axes.margins(0.06)
    every = [point for courses in runs for points in courses for point in points]
    handles = [
        Line2D([], [], label=label, **branch_look(k))
        for k, label in enumerate(_labels(names, bands, runs, parameter))
    ]
    handles += meanings(used if used - {0} else set(), every)
    grey: dict[str, Any] = {"color": INK, "linestyle": ""}
    if any(not _certified(point) for point in every):
        handles.append(Line2D([], [], marker="o", markerfacecolor="white", label=OPEN, **grey))
    if any(_touches(point) for point in every):
        handles.append(Line2D([], [], marker="x", label=CONTACT, **grey))
    legend_above(figure, handles, rows=0)
    return figure


def _draw(axes: Axes, points: Course, k: int, style: Style, parameter: str) -> set[int | None]:
    """One branch of the run with this index; the indices that it has."""
    b, energy, _ = energies(points, parameter)
    look = branch_look(k)
    used = draw_course(axes, points, b, energy, look["color"], style)
    first, step = spread(k, len(points)) if len(points) > FEW_STATES else (0, 1)
    chosen = np.zeros(len(points), dtype=bool)
    chosen[first::step] = True
    certified = np.array([_certified(point) for point in points])
    for mask, fill in ((chosen & certified, look["color"]), (chosen & ~certified, "white")):
        axes.plot(b[mask], energy[mask], linestyle="", zorder=3, **(look | {"markerfacecolor": fill}))
    touching = np.array([_touches(point) for point in points])
    axes.plot(
        b[touching], energy[touching], "x", color=look["color"], markersize=2.2 * style.marker, zorder=4
    )
    mark_points(axes, points, b, energy, look["color"], style)
    return used


def _certified(point: Summary) -> bool:
    """Whether a state is certified; a point of a branch is told by its dashes."""
    return point.certified or point.branch is not None


def _touches(point: Summary) -> bool:
    """Whether a state touches itself; where a branch begins to has a mark of its own."""
    return meets_unheld(point) and point.branch is None


def _labels(
    names: Sequence[str], bands: Sequence[str], runs: Sequence[Sequence[Course]], parameter: str
) -> list[str]:
    """Runs by name, and by band, N and other parameters where they differ in these."""
    meshes = [sorted({point.segments for points in courses for point in points}) for courses in runs]
    numbers = [f"$N$ = {found[0]}" if len(found) == 1 else "several $N$" for found in meshes]
    columns: list[Sequence[str]] = [bands]
    if parameter != HALF_WIDTH:
        firsts = [{**courses[0][0].parameters, parameter: None} for courses in runs]
        columns += [parameter_column(firsts, name) for name in PARAMETERS]
    shown = [list(names), *(column for column in (*columns, numbers) if len(set(column)) > 1)]
    return [", ".join(filter(None, parts)) for parts in zip(*shown, strict=True)]
