"""Panels in rows, as many side by side as have room."""

from __future__ import annotations

from matplotlib.axes import Axes

from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.style import PANEL, Style


def panels(
    style: Style, count: int, wanted: int, share: float, letters: float = PANEL
) -> tuple[Figure, list[Axes]]:
    """A figure of panels in full rows, `wanted` side by side or as many as are `letters` wide.

    `share` is a row's height as a part of the width.
    """
    columns = style.fitting(wanted, letters)
    while count % columns:
        columns -= 1
    rows = count // columns
    figure = Figure(figsize=(style.across(), rows * style.row(share)), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())
