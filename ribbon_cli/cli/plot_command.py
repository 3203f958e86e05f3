"""`ribbon plot`: pictures of states and runs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import click

from ribbon_cli.cli.completion import complete_any, complete_file, complete_words
from ribbon_cli.cli.output import check_target, emit, emit_json, say, teller, warn
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError

if TYPE_CHECKING:
    from ribbon_cli.plot.kinds import Source
    from ribbon_cli.plot.modes import ModeShape
    from ribbon_cli.store import Run, StateRecord

PLOT_KINDS = (
    "shape",
    "geometry",
    "multipliers",
    "spectrum",
    "convergence",
    "branch",
    "family",
    "mode",
    "pattern",
)
"""Kinds of picture, as in `plot.kinds.KINDS`, which is not loaded for a line of help."""
_SEEN = ("shape", "family", "mode")
_ON_ONE_GRID = ("geometry", "multipliers", "branch", "family")
_OF_A_RUN = ("convergence", "branch", "family")
_OF_RUNS = ("spectrum", "branch")
"""Kinds that have a view; that can show a run's states of one N; that show a run and no state; that show
several runs."""


@click.command()
@click.argument("ref", shell_complete=complete_any)
@click.argument("kind", shell_complete=complete_words(PLOT_KINDS))
@click.option(
    "-o",
    "--output",
    metavar="PATH",
    shell_complete=complete_file,
    help="PDF, SVG or PNG, of a mode also GIF; else RUN-LABEL-KIND.pdf.",
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
    help="Of a mode: its number in ribbon spectrum STATE; else the lowest that is no rotation.",
)
@click.option("--view", metavar="AZIMUTH,ELEVATION", help="Degrees, in the band's own axes; else chosen.")
@click.option("--segments", metavar="N", type=click.IntRange(min=3), help="Of a run, its states with this N.")
@click.option(
    "--width", metavar="MM", help="Of the picture in mm, as for a journal's column; else the style's."
)
@click.option("--title", metavar="TEXT", help="Above the picture, and in the file's own words.")
@click.option("--no-caption", is_flag=True, help="Leave the line out that says what is shown.")
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

    A mode is computed from the stored state, as by ribbon spectrum. With -o x.gif it moves.

    \b
    KIND of a state:           mode, pattern
    KIND of states:            shape
    KIND of states or a run:   geometry, multipliers, spectrum
    KIND of a run:             convergence, family
    KIND of a run or runs:     branch
    """
    from ribbon_cli.export.words import contact_warning
    from ribbon_cli.plot.figure import ANIMATED, dressed, figure_format, find_style, image, state_caption
    from ribbon_cli.plot.kinds import KINDS, animate, draw
    from ribbon_cli.plot.style import of_width
    from ribbon_cli.store import suggest, write_atomic

    if kind not in KINDS:
        raise UsageError(f"no kind of picture {kind!r} (known: {', '.join(KINDS)}){suggest(kind, KINDS)}")
    style = find_style(look)
    _check_options(kind, index, view, segments, others)
    form = figure_format(output, moving=kind == "mode") if output else "pdf"
    if width is not None:
        if form == ANIMATED:
            raise UsageError("--width does nothing for a film, which is made of pixels")
        style = of_width(style, _millimetres(width))
    if title is not None and not title.strip():
        raise UsageError("--title is empty: leave it out, or say what the picture shows")
    first, states = open_run_or_state(settings, ref)
    source = _source(settings, ref, first, states, kind, others, view, segments, index)
    if segments and source.states and kind not in _OF_A_RUN:
        raise UsageError("--segments goes with a run, and the reference names a state")
    path = output or f"{file_stem(first, states, ref)}-{kind}.pdf"
    check_target(path, overwrite)
    picture = draw(kind, source, style)
    run = source.run.name if source.run else None
    caption = picture.words or (
        state_caption(picture.states, run, source.names) if picture.states else str(run)
    )
    shown = None if no_caption else f"{picture.title}. {caption}."
    if form == ANIMATED:
        data = animate(picture, source, style, shown, title)
    else:
        figure = dressed(picture.figure, style, shown, title)
        data = image(figure, form, style, title or picture.title, caption)
    write_atomic(path, data, overwrite=overwrite)
    warn(settings, contact_warning(picture.states))
    if settings.json:
        labels = [record.label for record in picture.states]
        document = {"path": path, "kind": kind, "run": run, "labels": labels, "caption": caption}
        emit_json(document | _mode_document(picture.mode))
    else:
        emit(path)
        say(settings, f"{picture.title}. {caption}.")


def _check_options(
    kind: str, index: int | None, view: str | None, segments: int | None, others: tuple[str, ...]
) -> None:
    """Refuse an option that would do nothing for this kind of picture. Raises UsageError."""
    if index and kind != "mode":
        raise UsageError("--index goes with the kind mode")
    if view and kind not in _SEEN:
        raise UsageError(f"--view does nothing for {kind}: it is for {', '.join(_SEEN)}")
    if segments and kind not in _ON_ONE_GRID:
        raise UsageError(f"--segments does nothing for {kind}: it is for {', '.join(_ON_ONE_GRID)} of a run")
    if others and kind in _OF_A_RUN and kind not in _OF_RUNS:
        raise UsageError(f"--with does nothing for {kind}, which shows a run: it goes with a state")


def _mode_document(mode: ModeShape | None) -> dict[str, Any]:
    """What JSON says of the mode that a picture shows."""
    if mode is None:
        return {}
    return {
        "mode": {
            "number": mode.number,
            "value": mode.value,
            "bound": mode.bound,
            "label": mode.label,
            "symmetries": list(mode.symmetries),
            "verdict": mode.verdict,
        }
    }


def _source(
    settings: Settings,
    ref: str,
    run: Run | None,
    states: tuple[StateRecord, ...],
    kind: str,
    others: tuple[str, ...],
    view: str | None,
    segments: int | None,
    index: int | None,
) -> Source:
    """What the first reference and the `others` name. Raises UsageError."""
    from functools import partial

    from ribbon_cli.plot.kinds import Source
    from ribbon_cli.plot.labels import plain, run_texts
    from ribbon_cli.study import multiplier_curves, run_table

    if others and kind == "branch" and states:
        raise UsageError(f"branch shows runs: name the run of {ref}")
    more = [open_run_or_state(settings, other) for other in others]
    beside: tuple[Run, ...] = ()
    names: tuple[str, ...] = ()
    run_names: tuple[str, ...] = ()
    if more and not states:
        if kind not in _OF_RUNS:
            raise UsageError("--with goes with a state, and the reference names a run")
        if any(found for _, found in more):
            raise UsageError("--with needs a run beside a run, not a state")
        beside = tuple(other for other, _ in more if other)
    elif more:
        if any(not found for _, found in more):
            raise UsageError("--with needs a state, not a run")
        given = [(run, states), *more]
        states = tuple(record for _, found in given for record in found)
        if run is None or any(other is None or other.path != run.path for other, _ in more):
            run, refs = None, (ref, *others)
            names = tuple(_name(*each) for each in zip(given, refs, strict=True))
            texts = zip(run_texts([found for found, _ in given]), refs, strict=True)
            run_names = tuple(text or plain(os.path.basename(ref)) for text, ref in texts)
    mode = partial(_mode, index=index)
    return Source(
        run, states, run_table, multiplier_curves, mode, _angles(view), segments, beside, names, run_names
    )


def _name(found: tuple[Run | None, tuple[StateRecord, ...]], ref: str) -> str:
    """RUN:LABEL of a state, or its file's name outside of a run."""
    run, (record,) = found
    return f"{run.name}:{record.label}" if run else os.path.basename(ref)


def _mode(record: StateRecord, index: int | None) -> ModeShape:
    """A mode of a state by its number in `ribbon spectrum`, else the lowest that is no rotation.

    Raises UsageError as `ribbon spectrum` does.
    """
    from ribbon_cli.plot.modes import ModeShape
    from ribbon_cli.study import stability_of

    found = stability_of(record, modes=max(12, index or 1))
    if index is None:
        index = 1 + next(k for k, mode in enumerate(found.modes) if mode.label != "rotation")
    if index > len(found.vectors):
        raise UsageError(f"--index {index}: the state has {len(found.vectors)} modes")
    mode = found.modes[index - 1]
    words = {"s": "symmetric under", "a": "antisymmetric under", "x": "mixed with its like by"}
    names = {
        word: [name for sign, name in zip(mode.parity, mode.symmetry, strict=True) if sign == letter]
        for letter, word in words.items()
    }
    symmetries = tuple(f"{word} {' and '.join(under)}" for word, under in names.items() if under)
    return ModeShape(
        index,
        mode.value,
        mode.bound,
        f"{found.metric} metric",
        mode.label,
        () if mode.label == "rotation" else symmetries,
        found.verdict.sentence,
        found.vectors[index - 1],
    )


def open_run_or_state(settings: Settings, ref: str) -> tuple[Run | None, tuple[StateRecord, ...]]:
    """A run and no state, or a state in a tuple and its run if it has one. Raises UsageError."""
    from ribbon_cli.api import open_state
    from ribbon_cli.store import find_run, names_state

    if not names_state(ref):
        return find_run(settings.root, ref), ()
    run, record, _ = open_state(ref, settings.runs, teller(settings))
    return run, (record,)


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


def file_stem(run: Run | None, states: tuple[StateRecord, ...], ref: str) -> str:
    """Name of a default file without its ending: RUN, RUN-LABEL, or outside of a run the state's file's."""
    if run is None:
        return os.path.splitext(os.path.basename(ref))[0]
    return "-".join([run.short_name, *(str(record.label) for record in states)])
