"""Panels in rows, as many side by side as have room, and what several kinds of picture do with theirs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ribbon_cli.export.series import value_at
from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import parameter_text
from ribbon_cli.plot.style import Style
from ribbon_cli.store import Summary

Array = NDArray[np.float64]


def panels(style: Style, count: int, wanted: int, share: float) -> tuple[Figure, list[Axes]]:
    """A figure of panels in full rows, `wanted` side by side or as many as are `PANEL` letters wide.

    `share` is a row's height as a part of the width.
    """
    columns = style.fitting(wanted)
    while count % columns:
        columns -= 1
    rows = count // columns
    figure = Figure(figsize=(style.across(), rows * style.row(share)), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def branch_panels(axes: Sequence[Axes], titles: Sequence[str], parameter: str = HALF_WIDTH) -> None:
    """Panels over a parameter, with their titles."""
    for place, title in zip(axes, titles, strict=True):
        place.set_title(title, loc="left")
        place.set_xlabel(parameter_text(parameter))
        place.margins(0.06)


def energies(states: Sequence[Summary], parameter: str = HALF_WIDTH) -> tuple[Array, Array, Array]:
    """Values of a parameter, energies and clearances (n,) of states."""
    b = np.array([value_at(state, parameter) for state in states])
    energy = np.array([state.energy for state in states], dtype=float)
    return b, energy, np.array([state.clearance for state in states], dtype=float)


def energy_unit(states: Sequence[Summary]) -> tuple[str, Array | float]:
    """What energies are shown by, a ring's of a closed band (n,), and their title."""
    if states[0].sigma == 0:
        return "$E$", 1.0
    return "$E / E_{ring}$", np.array([2 * np.pi**2 * state.half_width / state.length for state in states])


def wide_scale(axes: Axes, low: int, high: int) -> None:
    """A smooth scale, linear below 10^`low` and logarithmic beyond, with ticks at the powers up to `high`."""
    axes.set_yscale("asinh", linear_width=0.5 * 10.0**low)
    bottom, top = axes.get_ylim()
    powers = [10.0**k for k in range(low, high + 1)]
    axes.set_yticks([t for t in (*(-p for p in powers), 0.0, *powers) if bottom <= t <= top])
    axes.minorticks_off()
