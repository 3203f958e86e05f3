"""`ribbon export`: states and runs in the formats of other programs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from ribbon_cli.cli.completion import complete_file, complete_state, complete_words
from ribbon_cli.cli.output import check_target, emit, emit_json, say, warn
from ribbon_cli.cli.plot_command import file_stem, open_run_or_state
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError

if TYPE_CHECKING:
    from ribbon_cli.store import Run, StateRecord

EXPORT_FORMATS = ("npz", "vtkhdf", "obj", "stl", "ply", "glb", "csv", "json", "svg", "pdf", "fold", "html")
"""Formats, which are the default file's suffix as well; `export.formats` is not loaded for a line of help."""


@click.command()
@click.argument("state", shell_complete=complete_state)
@click.option(
    "--to",
    "form",
    metavar="FORMAT",
    required=True,
    shell_complete=complete_words(EXPORT_FORMATS),
    help=f"One of: {', '.join(EXPORT_FORMATS)}.",
)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Else RUN-LABEL.FORMAT.")
@click.option("--size", metavar="MM", type=float, help="Length of the midline: stl (200), svg and pdf (500).")
@click.option("--thickness", metavar="MM", type=float, help="Of the wall: stl (1).")
@click.option(
    "--paper",
    metavar="NAME",
    shell_complete=complete_words(("A4", "Letter")),
    help="A4 or Letter: svg (one sheet unless given), pdf (A4).",
)
@click.option("--segments", metavar="N", type=click.IntRange(min=3), help="Of a run, the states with this N.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def export(
    settings: Settings,
    state: str,
    form: str,
    output: str | None,
    size: float | None,
    thickness: float | None,
    paper: str | None,
    segments: int | None,
    overwrite: bool,
) -> None:
    """Write a STATE in another format.

    svg and pdf are the fold pattern at true scale, fold has its creases for origami programs, glb is the
    surface for browsers and Blender. vtkhdf and html take a run as well, and then its states of one N, by
    width.
    """
    from ribbon_cli.export.formats import FORMATS, Options, check_options, states_of_run
    from ribbon_cli.export.words import contact_warning
    from ribbon_cli.store import content_sha256, suggest, typed

    if form not in EXPORT_FORMATS:
        known = f"known: {', '.join(EXPORT_FORMATS)}"
        raise UsageError(f"no format {form!r} ({known}){suggest(form, EXPORT_FORMATS)}")
    options = Options(size, thickness, paper, segments)
    if form != "npz":
        check_options(form, options)
    elif options != Options():
        raise UsageError("npz has no options: it holds the state as it is")
    run, states = open_run_or_state(settings, state)
    if not states:
        assert run is not None
        if form == "npz":
            raise UsageError(f"npz takes one state: name one of {run.name}, as in {typed(run)}:1")
        stem = file_stem(run, states, state)
        states, rest = states_of_run(form, run, options)
        say(settings, f"{_title(run, states)}, N = {states[0].segments}{rest}; --segments takes another N")
    elif segments is not None:
        raise UsageError("--segments goes with a run, and the reference names a state")
    else:
        stem = file_stem(run, states, state)
    path = output or f"{stem}.{form}"
    check_target(path, overwrite)
    facts: dict[str, float] = {}
    if form == "npz":
        from ribbon_cli.store import export_npz

        export_npz(states[0], path, overwrite)
        paths = [path]
    else:
        title = _title(run, states)
        data = FORMATS[form].write(states, title, run.name if run else None, options)
        paths = _write(path, data, overwrite)
        if (remarks := FORMATS[form].remarks) is not None:
            facts, words = remarks(states[0], options)
            for line in words:
                say(settings, line)
    warn(settings, contact_warning(states))
    if settings.json:
        hashes = [content_sha256(record) for record in states]
        document = {"path": paths[0], "format": form, "content_sha256": hashes[0]}
        more = {"paths": paths, "states": hashes} if len(paths) > 1 or len(states) > 1 else {}
        emit_json(document | more | facts)
    else:
        emit("\n".join(paths))


def _title(run: Run | None, states: tuple[StateRecord, ...]) -> str:
    """What a file says of its data, in one line whatever a state from elsewhere holds."""
    from ribbon_cli.plot.figure import state_caption
    from ribbon_cli.text import visible

    return visible(state_caption(states, run.name if run else None))


def _write(path: str, data: list[bytes], overwrite: bool) -> list[str]:
    """Write the files, numbered where there are several, and return their names."""
    from ribbon_cli.store import write_atomic

    stem, suffix = os.path.splitext(path)
    paths = [path] if len(data) == 1 else [f"{stem}-{k}{suffix}" for k in range(1, len(data) + 1)]
    for name in paths:
        check_target(name, overwrite)
    for name, content in zip(paths, data, strict=True):
        write_atomic(name, content, overwrite=overwrite)
    return paths
