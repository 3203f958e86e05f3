"""`ribbon plot`: pictures of states and runs."""

from __future__ import annotations

from typing import Any

import click

from ribbon_cli import api, export, store
from ribbon_cli import plot as pictures
from ribbon_cli.api.names import PLOT_KINDS
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import Word, complete_any, complete_file, complete_words
from ribbon_cli.cli.output import emit, emit_json, say, teller, warn
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError


@click.command()
@click.argument("ref", shell_complete=complete_any)
@click.argument("kind", type=Word(PLOT_KINDS))
@click.option(
    "-o",
    "--output",
    metavar="PATH",
    shell_complete=complete_file,
    help="PDF, SVG or PNG, for a mode also GIF. Default: RUN-LABEL-KIND.pdf.",
)
@click.option(
    "--style",
    "look",
    metavar="STYLE",
    default="paper",
    shell_complete=complete_words(("paper", "talk")),
    help="paper (default) or talk.",
)
@click.option(
    "--with",
    "others",
    metavar="STATE|RUN",
    multiple=True,
    shell_complete=complete_any,
    help="Another state; another run for a further row of its spectrum, or a further curve of its branch.",
)
@click.option(
    "--index",
    metavar="K",
    type=click.IntRange(min=1),
    help="Number of the mode in ribbon spectrum STATE. Default: the lowest but the rotations.",
)
@click.option(
    "--view",
    metavar="AZIMUTH,ELEVATION",
    help="Direction of view, in degrees and the band's own axes. Default: chosen.",
)
@click.option(
    "--segments", metavar="N", type=click.IntRange(min=3), help="For a run: its states with this N."
)
@click.option(
    "--width",
    metavar="MM",
    help="Width of the picture in mm, as for a journal's column. Default: the style's.",
)
@click.option("--title", metavar="TEXT", help="Title above the picture and in the file's metadata.")
@click.option("--no-caption", is_flag=True, help="Leave out the caption.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def plot(
    settings: Settings,
    ref: str,
    kind: str,
    output: str | None,
    look: str,
    others: tuple[str, ...],
    index: int | None,
    view: str | None,
    segments: int | None,
    width: str | None,
    title: str | None,
    no_caption: bool,
    overwrite: bool,
) -> None:
    """Draw a state or a run, from what is stored.

    A mode is computed from the stored state, as by ribbon spectrum. With -o x.gif it is animated.

    \b
    KIND of a state:           mode, pattern
    KIND of states:            shape
    KIND of states or a run:   geometry, multipliers, spectrum
    KIND of a run:             convergence, family
    KIND of a run or runs:     branch
    """
    api.drawing.check_kind(kind, index, view, segments, others)
    style = pictures.figure.find_style(look)
    form = pictures.figure.figure_format(output, moving=kind == "mode") if output else "pdf"
    if width is not None:
        if form == pictures.figure.ANIMATED:
            raise UsageError("--width does nothing for a film, which is made of pixels")
        style = pictures.style.of_width(style, _millimetres(width))
    api.drawing.check_title(title)
    first = named(settings, ref)
    more = [named(settings, other) for other in others]
    source = api.drawing.source_of(kind, first, more, _angles(view), segments, index)
    path = output or f"{first.stem}-{kind}.pdf"
    check_target(path, overwrite)
    picture = pictures.kinds.draw(kind, source, style)
    if form == pictures.figure.ANIMATED:
        data = pictures.kinds.animate(picture, source, style, None if no_caption else picture.words, title)
    else:
        figure = picture.dressed(style, not no_caption, title)
        data = pictures.figure.image(figure, form, style, title or picture.title, picture.caption)
    store.write_atomic(path, data, overwrite=overwrite)
    warn(settings, export.words.contact_warning(picture.states))
    if settings.json:
        run = source.run.name if source.run else None
        labels = [record.label for record in picture.states]
        document = {"path": path, "kind": kind, "run": run, "labels": labels, "caption": picture.caption}
        emit_json(document | _mode_document(picture.mode))
    else:
        emit(path)
        say(settings, picture.words)


def _mode_document(mode: pictures.modes.ModeShape | None) -> dict[str, Any]:
    """What JSON says of the mode that a picture shows."""
    if mode is None:
        return {}
    names = ("number", "value", "bound", "label", "symmetries", "verdict")
    return {"mode": {name: getattr(mode, name) for name in names}}


def named(settings: Settings, ref: str) -> api.drawing.Named:
    """What a reference names, with a word to standard error where it leaves a choice. Raises UsageError."""
    if not store.names_state(ref):
        return api.drawing.Named(ref, store.find_run(settings.root, ref))
    run, record, _ = api.open_state(ref, settings.runs, teller(settings))
    return api.drawing.Named(ref, run, (record,))


def _angles(text: str | None) -> tuple[float, float] | None:
    """A view as typed. Raises UsageError."""
    if text is None:
        return None
    try:
        azimuth, elevation = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--view {text}: expected two numbers of degrees, as in --view 30,20") from None
    if not (abs(azimuth) < 1e6 and abs(elevation) <= 90):
        raise UsageError(f"--view {text}: the elevation lies between -90 and 90")
    return azimuth, elevation


def _millimetres(text: str) -> float:
    """A width as typed. Raises UsageError."""
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"--width {text}: expected a number of millimetres, as in --width 86") from None
