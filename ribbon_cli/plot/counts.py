"""Number of equilibria that a survey has met against its hits."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.ticker import MaxNLocator

from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.style import GREY, PALETTE, Style


def accumulation_figure(curve: Sequence[tuple[float, float]], estimate: float | None, style: Style) -> Figure:
    """The expected number of equilibria in so many hits, and a dashed line at an estimate of all of them."""
    figure = Figure(figsize=(style.across(0.6), style.row(0.36)), layout="constrained")
    axes = figure.subplots()
    axes.plot(*zip(*curve, strict=True), color=PALETTE[0])
    if estimate is not None:
        axes.axhline(estimate, color=GREY, linestyle="--")
        axes.annotate(
            f"Chao1: {estimate:.1f}",
            (0.02, estimate),
            xycoords=("axes fraction", "data"),
            xytext=(0, -2),
            textcoords="offset points",
            va="top",
            color=GREY,
        )
    axes.set_xlabel("hits")
    axes.set_ylabel("equilibria met")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0, curve[-1][0])
    axes.set_ylim(0, None)
    return figure
