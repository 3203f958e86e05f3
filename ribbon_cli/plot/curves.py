"""Fields along the midline: the geometry of Koldaev (2022), (3.1), and the multipliers of (1.58)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ribbon_cli.export.fields import even_window, field
from ribbon_cli.plot.style import LIGHT_GREY, Style, line_look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ribbon_cli.store import StateRecord

GEOMETRY = {"kappa_s": r"$\kappa_s$", "tau": r"$\tau$", "eta": r"$\eta$", "eta_prime": r"$\eta'$"}
DWARFED = 20.0
"""Ratio of two curves' largest values beyond which a linear scale shows the smaller as a flat line."""
MULTIPLIERS = {f"lambda_{k}": rf"$\lambda_{k}$" for k in range(1, 6)}


def curve_label(record: StateRecord, records: Sequence[StateRecord]) -> str:
    """What tells a state from the others in a legend: b, N or both."""
    parts = []
    if len({other.half_width for other in records}) > 1 or len(records) == 1:
        parts.append(f"$b$ = {record.half_width:.4g}")
    if len({other.segments for other in records}) > 1 or len(records) == 1:
        parts.append(f"$N$ = {record.segments}")
    return ", ".join(parts) or f"state {record.label}"


def draw_field(axes: Axes, records: Sequence[StateRecord], name: str, title: str) -> None:
    """Draw one field of several states over alpha, in the unit of l."""
    length = records[0].length
    axes.axhline(0.0, color=LIGHT_GREY, linewidth=0.6, zorder=0)
    for k, record in enumerate(records):
        alpha, values = field(record, name, even_window(record))
        axes.plot(alpha, values, label=curve_label(record, records), zorder=2 + 0.1 * k, **line_look(k))
    alpha_axis(axes, length)
    axes.set_title(title, loc="left", fontsize=plain_size(axes) * 1.15)
    axes.margins(y=0.08)


def plain_size(axes: Axes) -> float:
    """Size of ordinary text in points."""
    import matplotlib

    return float(matplotlib.rcParams["font.size"])


def alpha_axis(axes: Axes, length: float) -> None:
    """Alpha from 0 to l with ticks at quarters, in multiples of pi where l is 2 pi."""
    axes.set_xlim(0.0, length)
    axes.set_xticks(np.arange(5) * length / 4)
    if abs(length - 2 * np.pi) < 1e-9:
        axes.set_xticklabels(["0", "π/2", "π", "3π/2", "2π"])
    else:
        axes.set_xticklabels(["0", "ℓ/4", "ℓ/2", "3ℓ/4", "ℓ"])


def geometry_figure(records: Sequence[StateRecord], style: Style) -> Figure:
    """Signed curvature, torsion, eta and eta' of one or more states."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width, 0.62 * style.width), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for axes, (name, title) in zip(panels, GEOMETRY.items(), strict=True):
        draw_field(axes, records, name, title)
    for axes in panels[2:]:
        axes.set_xlabel(r"$\alpha$")
    _legend(figure, panels[0], records)
    return figure


def multipliers_figure(records: Sequence[StateRecord], style: Style) -> Figure:
    """The multipliers lambda_1 to lambda_5; the sixth panel has the closure force gamma of each state."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width, 0.62 * style.width), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    for axes, (name, title) in zip(panels, MULTIPLIERS.items(), strict=False):
        draw_field(axes, records, name, title)
        if name in ("lambda_3", "lambda_4", "lambda_5"):
            axes.set_xlabel(r"$\alpha$")
        else:
            axes.tick_params(labelbottom=False)
        _tame(axes)
    _forces(panels[5], records)
    _legend(figure, panels[0], records)
    return figure


def _tame(axes: Axes) -> None:
    """Where one curve dwarfs another by `DWARFED`, a smooth scale that is linear near zero and logarithmic
    beyond.
    """
    sizes = [float(np.abs(line.get_ydata()).max()) for line in axes.get_lines()[1:]]
    if len(sizes) > 1 and max(sizes) > DWARFED * min(sizes) > 0:
        low, high = math.ceil(math.log10(min(sizes))), math.ceil(math.log10(max(sizes)))
        axes.set_yscale("asinh", linear_width=0.5 * 10.0**low)
        bottom, top = axes.get_ylim()
        powers = [10.0**k for k in range(low, high + 1)]
        axes.set_yticks([t for t in (*(-p for p in powers), 0.0, *powers) if bottom <= t <= top])
        axes.minorticks_off()


def _forces(axes: Axes, records: Sequence[StateRecord]) -> None:
    """The closure forces as a small table of text, under the title of a panel."""
    axes.axis("off")
    axes.set_title(r"$|\gamma|$", loc="left", fontsize=plain_size(axes) * 1.15)
    for k, record in enumerate(records):
        text = f"{curve_label(record, records)}:  {np.linalg.norm(record.gamma):.3g}"
        axes.text(0.0, 0.92 - 0.13 * k, text, transform=axes.transAxes, va="top")


def _legend(figure: Figure, axes: Axes, records: Sequence[StateRecord]) -> None:
    """One line above the panels that says which curve is which state."""
    if len(records) > 1:
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper center", ncols=min(len(labels), 6), handlelength=2.6
        )
