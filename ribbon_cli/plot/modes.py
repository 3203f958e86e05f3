"""Modes of the second variation as pictures: frames in a row, and an animation.

A mode is a move (du, dg, dxi) without a size. What is drawn is the shape with u + a du and g + a dg, the
linear motion without corrections of higher order, a such that the farthest point of the surface moves by
`LARGEST` of the length.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from numpy.typing import NDArray
from PIL import Image

from ribbon_cli.export.mesh import facet_corners
from ribbon_cli.export.view import chosen_view, strip_axes
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.figure import dressed
from ribbon_cli.plot.shape import RULINGS, draw_shape, shown_sides
from ribbon_cli.plot.style import LIGHT_GREY, Style
from ribbon_cli.plot.supports import middle_of, with_plates
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

LARGEST = 0.045
"""Farthest that a point of the surface moves in a picture, as a part of the length."""
PHASES = {"−1": -1.0, "−½": -0.5, "0": 0.0, "½": 0.5, "1": 1.0}
"""Frames of the strip: their titles, and how far each goes."""
FRAME = 8.0
"""Least width of a frame, in sizes of its title's letters."""
STEPS = 24
"""Frames of one period of the animation; a multiple of 4, so that it goes to both ends and through 0."""
MILLISECONDS = 70
ANIMATION_WIDTH = 640
"""Width of the animation in pixels."""


@dataclass(frozen=True, eq=False)
class ModeShape:
    """A mode of a state: `number` in the list of eigenvalues, from 1, `value` and its `bound`, `metric`.

    `label` is its name, `symmetries` its behaviour under each symmetry of the state in words, `verdict` what
    the spectrum says of the state, `move` (N, 7) the move in (u, g, xi).
    """

    number: int
    value: float
    bound: float
    metric: str
    label: str
    symmetries: tuple[str, ...]
    verdict: str
    move: Array

    @property
    def title(self) -> str:
        """One line on the mode: which it is, its eigenvalue, and its symmetry."""
        name = "unstable mode" if self.value < -self.bound and self.label == "mode" else self.label
        value = "0" if self.label == "rotation" else f"{self.value:.6g} +- {self.bound:.0e}"
        words = (f"Mode {self.number}", name, f"eigenvalue {value} ({self.metric})", *self.symmetries)
        return ", ".join(words)


def displaced(record: StateRecord, move: Array, size: float) -> StateRecord:
    """The shape of a state moved by `size` times (du, dg): for pictures only, its numbers stay.

    A strip with ends keeps its start; g_{N+1} has the place of g_1 in its moves.
    """
    h = record.length / record.segments
    du, dg = move[:, :3], move[:, 3:6]
    along = np.vstack((np.zeros(3), h * np.cumsum(du, axis=0)))
    if record.parts.ends is None:
        along -= along[:-1].mean(axis=0)
        last = record.sigma * dg[0]
    else:
        last, dg = dg[0], np.vstack((np.zeros(3), dg[1:]))
    return replace(
        record,
        u=record.u + size * du,
        g=record.g + size * dg,
        g_end=record.g_end + size * last,
        midline=record.midline + size * along,
    )


def amplitude(record: StateRecord, move: Array) -> float:
    """The a > 0 for which the farthest corner of a facet moves by `LARGEST` of the length."""
    moved = facet_corners(displaced(record, move, 1.0)) - facet_corners(record)
    farthest = float(np.linalg.norm(moved, axis=2).max())
    return LARGEST * record.length / farthest if farthest > 0 else 0.0


def mode_figure(
    record: StateRecord, mode: ModeShape, style: Style, angles: tuple[float, float] | None = None
) -> Figure:
    """Five frames in a row, three where five would be narrow, from one end of the motion to the other.

    The shape at rest is in the middle.
    """
    frames = _Frames(record, mode, angles)
    phases = PHASES if style.fitting(5, FRAME) == 5 else {title: PHASES[title] for title in ("−1", "0", "1")}
    count = len(phases)
    width = style.across() / count
    titles = 2.6 * style.font / 72
    height = width * min(1.5, frames.aspect) + titles + 0.06 * style.width
    figure = Figure(figsize=(style.across(), height), layout="constrained")
    rulings = max(24, round(1.5 * RULINGS / count))
    for axes, (title, phase) in zip(figure.subplots(1, count), phases.items(), strict=True):
        frames.draw(axes, phase, style, rulings)
        axes.set_title(title)
    return figure


def mode_animation(
    record: StateRecord,
    mode: ModeShape,
    style: Style,
    caption: str | None,
    angles: tuple[float, float] | None = None,
    title: str | None = None,
) -> bytes:
    """The motion as an animated GIF that repeats, one period in `STEPS` frames.

    The same mode gives the same bytes.
    """
    frames = _Frames(record, mode, angles)
    # One way only is drawn: the other shows the same frames.
    quarter = STEPS // 4
    phases = np.sin(2 * np.pi * np.arange(-quarter, quarter + 1) / STEPS)
    drawn = [_pixels(_frame(frames, float(phase), style, caption, title)) for phase in phases]
    # One palette for all, or colours would flicker: that of the ends and of the middle together.
    both = np.concatenate((drawn[0], drawn[quarter], drawn[-1]))
    palette = Image.fromarray(both).quantize(colors=255, method=Image.Quantize.MEDIANCUT)
    images = [Image.fromarray(p).quantize(palette=palette, dither=Image.Dither.NONE) for p in drawn]
    order = (*range(quarter, 2 * quarter), *range(2 * quarter, 0, -1), *range(quarter))
    period = [images[k] for k in order]
    buffer = io.BytesIO()
    period[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=period[1:],
        duration=MILLISECONDS,
        loop=0,
        comment=(caption or mode.title).encode("ascii", "replace"),
    )
    return buffer.getvalue()


class _Frames:
    """The frames of a motion, from one side and at one scale."""

    def __init__(self, record: StateRecord, mode: ModeShape, angles: tuple[float, float] | None) -> None:
        self.record, self.mode = record, mode
        self.size = amplitude(record, mode.move)
        rest = facet_corners(record)
        self.view = chosen_view(rest, angles, strip_axes(record))
        flat = [self._flat(displaced(record, mode.move, s * self.size)) for s in (-1.0, 0.0, 1.0)]
        self.rest = flat[1][: record.segments]
        self.sides = shown_sides(record, self.view)
        low, high = np.min(flat, axis=(0, 1, 2)), np.max(flat, axis=(0, 1, 2))
        room = 0.015 * float(np.max(high - low))
        self.low, self.high = low - room, high + room

    @property
    def aspect(self) -> float:
        """Height of a frame over its width."""
        width, height = self.high - self.low
        return float(height / width)

    def _flat(self, moved: StateRecord) -> Array:
        """Corners (N + k, 4, 2) in the picture, those of clamps last, as `draw_shape` has them."""
        middle = middle_of(moved, facet_corners(moved))
        flat: Array = self.view.project(with_plates(moved) - middle)[..., :2]
        return flat

    def draw(self, axes: Axes, phase: float, style: Style, rulings: int) -> None:
        """Draw one frame, the edges of the shape at rest behind it."""
        moved = displaced(self.record, self.mode.move, phase * self.size)
        # Colours are fitted to the shape at rest, or those of a one-sided band would jump.
        draw_shape(axes, moved, style, self.view, (), rulings, self.sides)
        if phase:
            self._ghost(axes, style)
        axes.set_xlim(self.low[0], self.high[0])
        axes.set_ylim(self.low[1], self.high[1])

    def _ghost(self, axes: Axes, style: Style) -> None:

        edges = [*self.rest[:, 1:3], *self.rest[:, [3, 0]]]
        lines = LineCollection(edges, colors=LIGHT_GREY, linewidths=0.75 * style.line, zorder=0)
        axes.add_collection(lines)


def _frame(
    frames: _Frames, phase: float, style: Style, caption: str | None, title: str | None = None
) -> Figure:
    """One frame of the animation with the caption below it and the title above."""
    width = 0.7 * style.width
    height = width * min(1.2, frames.aspect) + 0.04 * style.width
    figure = Figure(figsize=(width, height), dpi=ANIMATION_WIDTH / width, layout="constrained")
    frames.draw(figure.subplots(), phase, style, RULINGS)
    return dressed(figure, style, caption, title)


def _pixels(figure: Figure) -> NDArray[np.uint8]:
    """The picture (height, width, 3) of a figure."""
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
