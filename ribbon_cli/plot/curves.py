"""Fields along the midline: the geometry of Koldaev (2022), (3.1), and the multipliers of (1.58)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ribbon_cli.digits import powers, significant
from ribbon_cli.export.fields import even_window, field, placed
from ribbon_cli.export.mesh import check_shape, end_value
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import curve_labels, legend_above
from ribbon_cli.plot.panels import panels, wide_scale
from ribbon_cli.plot.style import INK, LIGHT_GREY, Style, line_look, shade
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

GEOMETRY = {"kappa_s": r"$\kappa_s$", "tau": r"$\tau$", "eta": r"$\eta$", "eta_prime": r"$\eta'$"}
NOTHING = 1e-12
"""Largest value of a field of a strip that is rounding."""
DWARFED = 20.0
"""Ratio of two curves' largest values beyond which a linear scale shows the smaller as a flat line."""
MULTIPLIERS = {f"lambda_{k}": rf"$\lambda_{k}$" for k in range(1, 6)}

CENTRED = MULTIPLIERS | {"lambda_3": r"$\lambda_3 - h \lambda_2 \eta$"}
"""Titles where multipliers are shown as what approximates their fields at second order."""


class Curve(Protocol):
    """A multiplier (N,) as computed, and as its explicit formula has it on the same shape."""

    @property
    def name(self) -> str:
        """lambda_1 to lambda_5."""

    @property
    def computed(self) -> Array:
        """The discrete multiplier as an approximation of its field."""

    @property
    def theory(self) -> Array:
        """The formula's values, not-a-number where it divides by zero."""


def draw_field(
    axes: Axes,
    records: Sequence[StateRecord],
    name: str,
    title: str,
    values: Sequence[Array] | None = None,
    runs: Sequence[str] = (),
) -> None:
    """Draw one field of several states over alpha, in the unit of l; `values` in place of what is stored.

    `runs` name the states' runs where they are of several. Raises UsageError for a state that went wrong.
    """
    labels = curve_labels(records, runs)
    axes.axhline(0.0, color=LIGHT_GREY, linewidth=0.6, zorder=0)
    for k, record in enumerate(records):
        check_shape(record)
        window = even_window(record)
        alpha, shown = placed(record, name, values[k], window) if values else field(record, name, window)
        if not values and not math.isnan(last := end_value(record, name)):
            alpha, shown = np.append(alpha, record.length), np.append(shown, last)
        if record.parts.ends is not None:  # of planar shapes rounding is no curve
            shown = np.where(np.abs(shown) < NOTHING, 0.0, shown)
        axes.plot(alpha, shown, label=labels[k], zorder=2 + 0.1 * k, **line_look(k, len(alpha)))
    alpha_axis(axes, [record.length for record in records])
    axes.set_title(title, loc="left", fontsize=plain_size() * 1.15)
    axes.margins(y=0.08)


def plain_size() -> float:
    """Size of ordinary text in points."""
    return float(matplotlib.rcParams["font.size"])


def alpha_axis(axes: Axes, lengths: Sequence[float]) -> None:
    """Alpha from 0 to l with ticks at quarters, in multiples of pi where l is 2 pi.

    Where lengths differ the axis has room for the longest, and its ticks are numbers.
    """
    length = max(lengths)
    axes.set_xlim(0.0, length)
    if max(lengths) - min(lengths) > 1e-9 * length:
        return
    axes.set_xticks(np.arange(5) * length / 4)
    if abs(length - 2 * np.pi) < 1e-9:
        axes.set_xticklabels(["0", "π/2", "π", "3π/2", "2π"])
    else:
        axes.set_xticklabels(["0", "ℓ/4", "ℓ/2", "3ℓ/4", "ℓ"])


def geometry_figure(records: Sequence[StateRecord], style: Style, runs: Sequence[str] = ()) -> Figure:
    """Signed curvature, torsion, eta and eta' of one or more states."""
    figure, places = panels(style, len(GEOMETRY), 2, 0.31)
    for axes, (name, title) in zip(places, GEOMETRY.items(), strict=True):
        draw_field(axes, records, name, title, None, runs)
    _label_lowest(places, len(places))
    _legend(figure, places[0])
    return figure


def _label_lowest(places: Sequence[Axes], count: int) -> None:
    """Name alpha below the lowest panels; the others go without numbers. Panels are counted to `count`."""
    columns = len({axes.get_subplotspec().colspan.start for axes in places})  # type: ignore[union-attr]
    for k, axes in enumerate(places[:count]):
        if k + columns >= count:
            axes.set_xlabel(r"$\alpha$")
        else:
            axes.tick_params(labelbottom=False)


def multipliers_figure(
    records: Sequence[StateRecord],
    style: Style,
    curves: Sequence[Sequence[Curve] | None] = (),
    runs: Sequence[str] = (),
) -> Figure:
    """The multipliers lambda_1 to lambda_5; the sixth panel has the closure force gamma of each state.

    `curves` gives for each state the multipliers beside their formulas, None for a state without. If all
    have them, they are shown in place of what is stored, so that lambda_3 is less h lambda_2 eta, and the
    formulas as thin dashed lines. Near inflections these leave the panels, which are fitted to what was
    computed.
    """
    figure, places = panels(style, 6, 3, 0.31)
    given = [list(found) for found in curves if found]
    compared = len(given) == len(records)
    for axes, (name, title) in zip(places, (CENTRED if compared else MULTIPLIERS).items(), strict=False):
        found = [next(c for c in of_state if c.name == name) for of_state in given] if compared else []
        draw_field(axes, records, name, title, [c.computed for c in found] or None, runs)
        _tame(axes)
        if found:
            _formulas(axes, records, name, [c.theory for c in found])
    _label_lowest(places, len(MULTIPLIERS))
    _forces(places[5], records)
    _legend(figure, places[0])
    return figure


def _formulas(axes: Axes, records: Sequence[StateRecord], name: str, theory: Sequence[Array]) -> None:
    """The explicit formulas on top of the computed curves, in limits that these have set.

    Of several states each is in a dark shade of its curve's colour.
    """
    limits, alone = axes.get_ylim(), len(records) == 1
    look: dict[str, Any] = {"linewidth": 0.7, "linestyle": (0, (2.5, 2.5)), "zorder": 4}
    for k, (record, values) in enumerate(zip(records, theory, strict=True)):
        alpha, shown = placed(record, name, values, even_window(record))
        colour = INK if alone else shade(line_look(k, len(alpha))["color"])
        axes.plot(alpha, shown, color=colour, label="explicit formulas" if alone else "_", **look)
    if not alone:
        axes.plot([], [], color=INK, label="explicit formulas", **look)
    axes.set_ylim(limits)


def _tame(axes: Axes) -> None:
    """Where one curve dwarfs another by `DWARFED`, a smooth scale that is linear near zero and logarithmic
    beyond.
    """
    sizes = [float(np.nanmax(np.abs(line.get_ydata()))) for line in axes.get_lines()[1:]]
    if len(sizes) > 1 and max(sizes) > DWARFED * min(sizes) > 0:
        low, high = math.ceil(math.log10(min(sizes))), math.ceil(math.log10(max(sizes)))
        wide_scale(axes, low, high)


def _forces(axes: Axes, records: Sequence[StateRecord]) -> None:
    """The closure forces, each beside its state's line, under the title of a panel."""
    axes.axis("off")
    axes.set_title(r"$|\gamma|$", loc="left", fontsize=plain_size() * 1.15)
    lines = [
        Line2D(
            [],
            [],
            label=powers(significant(float(np.linalg.norm(record.gamma)), 3)),
            **line_look(k, record.segments),
        )
        for k, record in enumerate(records)
    ]
    axes.legend(handles=lines, loc="upper left", borderaxespad=0.0, handlelength=2.6, fontsize=plain_size())


def _legend(figure: Figure, axes: Axes) -> None:
    """Above the panels which curve is which state, where there are several."""
    handles, _ = axes.get_legend_handles_labels()
    if len(handles) > 1:
        legend_above(figure, handles)
