"""Which part of a strip rests on which: contacts in the plane of two arclengths, and on the flat strip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgba
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from ribbon_cli.export.contacts import TOGETHER, counted, gathered, touching
from ribbon_cli.export.fields import even_window
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.curves import alpha_axis
from ribbon_cli.plot.style import INK, LIGHT_GREY, SIDES, Style
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

RULINGS = 72
"""Most rulings that are drawn."""

MOST_NUMBERS = 40
"""Most places of contact that have numbers."""
SHARE = 0.66
"""Width of the picture as a part of the page's."""
FORCES = LinearSegmentedColormap.from_list("forces", ["#F0C9A8", "#D55E00", "#5A1A00"])
"""Colours of forces, from none to the largest: light to dark, in grey as well."""


def contacts_figure(record: StateRecord, style: Style) -> Figure:
    """The map of a state's contacts.

    Above, each is a point (s, s') and its mirror image (s', s), coloured by its force; below, both of its
    places on the flat strip have the same number. s is counted as in curves along the midline, from where the
    inflections lie evenly. A strip's band about the diagonal, where pairs are too near on the strip to count,
    is grey. Neighbouring contacts share a number.
    """
    found = touching(record)
    flat = counted(record, found.flat, even_window(record))
    groups = sorted(gathered(record, found.flat), key=lambda group: float(flat[group, :, 0].min()))
    width = style.across(SHARE)
    room = 0.73 * width  # inside of what numbers and the colours' bar take
    high = room * 2.0 * record.half_width / record.length
    # Letters between and below, and room to spare: then both panels are as wide as can be, and alike.
    figure = Figure(figsize=(width, room + high + 8.0 * style.font / 72), layout="constrained")
    plane, strip = figure.subplots(2, 1, sharex=True, height_ratios=[room, high])
    scale = Normalize(0.0, float(found.forces.max(initial=0.0)) or 1.0)
    _plane(plane, record, flat, found.forces, scale, style)
    _strip(strip, record, flat, found.forces, scale, style, high)
    alpha_axis(strip, [record.length])
    plane.set_yticks(strip.get_xticks(), [label.get_text() for label in strip.get_xticklabels()])
    plane.tick_params(labelbottom=False)
    strip.set_xlabel(r"$\alpha$")
    if len(groups) <= MOST_NUMBERS:
        strongest = [flat[group[int(np.argmax(found.forces[group]))]] for group in groups]
        above = [places[way, 0] for places in strongest for way in ([0, 1], [1, 0])]
        _numbers(plane, above, 0.0, style)
        _numbers(strip, [place for places in strongest for place in places], TOGETHER * record.length, style)
    bar = figure.colorbar(ScalarMappable(scale, FORCES), ax=[plane, strip], aspect=40, pad=0.02)
    bar.set_label("force")
    bar.outline.set_linewidth(0.6 * style.line)
    return figure


def _plane(
    axes: Axes, record: StateRecord, flat: Array, forces: Array, scale: Normalize, style: Style
) -> None:
    """Contacts at (s, s') and (s', s), over the diagonal with the band of what does not count."""
    assert record.contacts is not None
    length, near = record.length, record.contacts.excluded
    for shift in (-length, 0.0, length) if record.sigma else (0.0,):
        line = np.array([0.0, length])
        axes.fill_between(line, line + shift - near, line + shift + near, color=LIGHT_GREY, linewidth=0.0)
    for one, other in ((0, 1), (1, 0)):
        _marks(axes, flat[:, one, 0], flat[:, other, 0], forces, scale, style)
    axes.set_ylim(0.0, length)
    axes.set_aspect("equal")
    axes.set_anchor("S")
    axes.set_ylabel(r"$\alpha'$")
    axes.grid(color=LIGHT_GREY, linewidth=0.3)


def _strip(
    axes: Axes,
    record: StateRecord,
    flat: Array,
    forces: Array,
    scale: Normalize,
    style: Style,
    high: float,
) -> None:
    """The flat strip with its rulings, and both places of each contact; it is `high` inches high."""
    b, length = record.half_width, record.length
    rulings = LineCollection(_rulings(record), colors=LIGHT_GREY, linewidths=style.thin, zorder=0)
    axes.add_collection(rulings, autolim=False)
    if record.sigma:
        outline = np.array([[0.0, -b], [length, -b], [length, b], [0.0, b]])
    else:
        first, last = record.eta[0], float(record.u[-1] @ record.g_end)
        outline = b * np.array([[-first, -1.0], [-last, -1.0], [last, 1.0], [first, 1.0]])
        outline[1:3, 0] += length
    paper = Polygon(
        outline, facecolor=to_rgba(SIDES[0], 0.25), edgecolor=INK, linewidth=0.75 * style.line, zorder=0.5
    )
    axes.add_patch(paper)
    rulings.set_clip_path(paper)
    for side in (0, 1):
        _marks(axes, flat[:, side, 0], flat[:, side, 1], forces, scale, style)
    axes.set_ylim(-1.02 * b, 1.02 * b)
    axes.set_aspect("equal")
    axes.set_anchor("N")
    lines = high * 72 / style.font  # high enough for three, two or no labels
    ticks = {-b: "−$b$", 0.0: "0", b: "$b$"} if lines > 4.0 else {-b: "−$b$", b: "$b$"} if lines > 2.0 else {}
    axes.set_yticks(list(ticks), list(ticks.values()))
    for spine in ("left", "bottom"):
        axes.spines[spine].set_visible(False)


def _rulings(record: StateRecord) -> list[Array]:
    """Rulings (k, 2, 2) of the flat strip, at most `RULINGS` and those beyond its ends that lean into it."""
    n, b = record.segments, record.half_width
    chosen = np.arange(0, n, max(1, -(-n // RULINGS)))
    s = record.length / n * chosen
    lean = b * record.eta[chosen]
    window = even_window(record)
    # The middle of a ruling is counted; its ends lean the other way where it came round upside down.
    middle = counted(record, np.column_stack((s, np.full(len(s), b))), window)
    lean = np.where(middle[:, 1] < 0.0, -lean, lean)
    lines = np.stack(
        (middle[:, 0] - lean, np.full(len(s), -b), middle[:, 0] + lean, np.full(len(s), b)), axis=1
    )
    found = [lines.reshape(-1, 2, 2)]
    if record.sigma:
        for shift in (-record.length, record.length):
            beyond = lines.reshape(-1, 2, 2).copy()
            beyond[..., 1] *= record.sigma
            beyond[..., 0] += shift
            found.append(beyond)
    return list(np.concatenate(found))


def _marks(axes: Axes, x: Array, y: Array, forces: Array, scale: Normalize, style: Style) -> None:
    """Places of contact in the colours of their forces, the largest on top."""
    order = np.argsort(forces, kind="stable")
    axes.scatter(
        x[order],
        y[order],
        c=forces[order],
        norm=scale,
        cmap=FORCES,
        s=(1.7 * style.marker) ** 2,
        edgecolors=INK,
        linewidths=0.4 * style.line,
        zorder=3,
        clip_on=False,
    )


def _numbers(axes: Axes, places: Sequence[Array], near: float, style: Style) -> None:
    """Numbers beside places (2,), two in turn the same; those that lie nearer to each other have one text."""
    texts: list[tuple[Array, list[str]]] = []
    for k, place in enumerate(places):
        number = str(k // 2 + 1)
        for known, numbers in texts:
            if np.hypot(*(known - place)) <= near:
                numbers.append(number)
                break
        else:
            texts.append((place, [number]))
    for place, numbers in texts:
        text = axes.annotate(
            ", ".join(numbers),
            (float(place[0]), float(place[1])),
            xytext=(1.6 * style.marker, 1.2 * style.marker),
            textcoords="offset points",
            zorder=4,
        )
        text.set_path_effects([Stroke(linewidth=2.0, foreground="white"), Normal()])
