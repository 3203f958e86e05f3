"""Captions and files: what a picture says of its data, and how it is written."""

from __future__ import annotations

import io
import logging
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ribbon_cli.digits import significant
from ribbon_cli.errors import UsageError
from ribbon_cli.export.words import meets_unheld, verdict
from ribbon_cli.parts import PARAMETERS
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.style import GREY, STYLES, Style, styled
from ribbon_cli.store import StateRecord, content_sha256
from ribbon_cli.store.refs import suggest

FORMATS = ("pdf", "svg", "png")
ANIMATED = "gif"
TITLE = 1.25
"""Size of a picture's title, as a multiple of its letters'."""
LEADING = 1.4
"""From line to line of a caption, as a multiple of its letters' size, with the room above and below."""


def find_style(name: str) -> Style:
    """The style of that name. Raises UsageError."""
    if name not in STYLES:
        raise UsageError(f"no style {name!r} (known: {', '.join(STYLES)}){suggest(name, STYLES)}")
    return STYLES[name]


def figure_format(path: str | Path, moving: bool = False) -> str:
    """Format by a file's suffix, GIF for what is `moving` alone. Raises UsageError for one that is not
    written.
    """
    suffix = Path(path).suffix.removeprefix(".").lower()
    if suffix == ANIMATED and not moving:
        raise UsageError(f"{path}: only modes move; a picture's file ends in {_endings(FORMATS)}")
    if suffix not in (*FORMATS, ANIMATED):
        known = (*FORMATS, ANIMATED) if moving else FORMATS
        raise UsageError(f"{path}: a picture's file ends in {_endings(known)}")
    return suffix


def _endings(forms: Sequence[str]) -> str:
    """Suffixes in words."""
    return f".{', .'.join(forms[:-1])} or .{forms[-1]}"


def reference(record: StateRecord, run: str | None) -> str:
    """What a state is called in captions: RUN:LABEL, or its label alone outside of a run."""
    return f"{run}:{record.label}" if run else f"state {record.label}"


def state_caption(records: Sequence[StateRecord], run: str | None, names: Sequence[str] = ()) -> str:
    """One line on the states that a picture shows: which they are, whether they are certified, and whether
    they meet themselves.

    `names` are their references where they are of several runs.
    """
    if len(records) > 1:
        labels = ", ".join(names or [str(record.label) for record in records])
        auxiliary = sum(record.kind == "auxiliary" for record in records)
        certified = sum(record.certified and record.kind != "auxiliary" for record in records)
        meeting = sum(meets_unheld(record) for record in records)
        resting = sum(record.self_contact and record.contacts is not None for record in records)
        beside = f", {auxiliary} auxiliary" if auxiliary else ""
        beside += f", {meeting} in self-contact without forces" if meeting else ""
        beside += f", {resting} at rest on themselves" if resting else ""
        where = "" if names else f"{run}:" if run else "states "
        return f"{where}{labels} ({certified} of {len(records)} certified{beside})"
    (record,) = records
    linking = record.linking_number
    # Of an open seam or strip no curves are linked: what is stored is Tw + Wr.
    name = "Tw + Wr" if record.seam_open or record.parts.ends is not None else "Lk"
    links = f"{name} = {round(linking, 6) + 0.0:g}, " if math.isfinite(linking) else ""
    places = [
        f"{PARAMETERS[name].symbol} = {value:.10g}" for name, value in record.parameters.items() if value
    ]
    return (
        f"{reference(record, run)}, {', '.join(places)}, N = {record.segments}, "
        f"{links}E = {significant(record.energy)}, {verdict(record)}, "
        f"sha256 {content_sha256(record)[:12]}"
    )


def dressed(figure: Figure, style: Style, caption: str | None, title: str | None) -> Figure:
    """A figure with its caption and its title, where it has them."""
    with styled(style):
        if caption:
            add_caption(figure, caption, style)
        if title:
            add_title(figure, title, style)
    return figure


def add_caption(figure: Figure, caption: str, style: Style) -> None:
    """Put a caption below a figure in small grey letters, in as many lines as its width asks for.

    The figure grows by their height: taken from the panels, whose scales are fixed, it would push titles out.
    """
    lines = _wrapped(figure, caption, style.note)
    figure.set_figheight(figure.get_figheight() + LEADING * style.note * len(lines) / 72)
    text = "\n".join(lines)
    figure.supxlabel(text, x=0.005, ha="left", fontsize=style.note, color=GREY, parse_math=False)


def add_title(figure: Figure, title: str, style: Style) -> None:
    """Put a title above everything, in as many lines as its width asks for; the figure grows by their height.

    To come last: what is there keeps its place and size, since a layout has no room above legends.
    """
    size = TITLE * style.font
    lines = _wrapped(figure, title, size)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    before = figure.get_figheight()
    figure.set_figheight(before + LEADING * size * (len(lines) + 0.4) / 72)
    share = before / figure.get_figheight()
    for axes in figure.axes:
        box = axes.get_position(original=True)
        axes.set_position((box.x0, share * box.y0, box.width, share * box.height))
    for text in figure.texts:
        text.set_y(share * text.get_position()[1])
    for legend in figure.legends:
        legend.set_bbox_to_anchor((0.0, 0.0, 1.0, share), transform=figure.transFigure)
    top = 1.0 - 0.2 * LEADING * size / 72 / figure.get_figheight()
    figure.text(0.5, top, "\n".join(lines), ha="center", va="top", fontsize=size, parse_math=False)


def _wrapped(figure: Figure, text: str, size: float) -> list[str]:
    """A text in lines as long as a figure is wide, in letters of this size in points."""
    # A letter of this font is about 0.53 of its size wide.
    return textwrap.wrap(text, max(20, int(figure.get_figwidth() * 72 / (0.55 * size))))


def image(figure: Figure, form: str, style: Style, title: str, caption: str) -> bytes:
    """A figure as the bytes of a PDF, SVG or PNG file, without times, so that the same figure gives the
    same.
    """
    every: dict[str, dict[str, Any]] = {
        "pdf": {"Title": title, "Subject": caption, "CreationDate": None, "ModDate": None},
        "svg": {"Title": title, "Description": caption, "Date": None},
        "png": {"Title": title, "Description": caption},
    }
    # It complains of fonts without dates, which are left out for the same figure to give the same bytes.
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    buffer = io.BytesIO()
    with styled(style):
        figure.savefig(buffer, format=form, metadata=every[form], dpi=style.dpi)
    return buffer.getvalue()
