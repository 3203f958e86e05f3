"""`ribbon export`: states and runs in the formats of other programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from ribbon_cli import api, store
from ribbon_cli import export as exports
from ribbon_cli.api.names import EXPORT_FORMATS
from ribbon_cli.cli.completion import complete_file, complete_state, complete_words
from ribbon_cli.cli.output import emit, emit_json, say, teller, warn
from ribbon_cli.cli.plot_command import named
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError


@click.command()
@click.argument("state", shell_complete=complete_state)
@click.option(
    "--to",
    "form",
    metavar="FORMAT",
    shell_complete=complete_words(EXPORT_FORMATS),
    help=f"One of: {', '.join(EXPORT_FORMATS)}. Else the suffix of -o.",
)
@click.option(
    "-o", "--output", metavar="PATH", shell_complete=complete_file, help="Default: RUN-LABEL.FORMAT."
)
@click.option("--size", metavar="MM", type=float, help="Length of the midline: stl (200), svg and pdf (500).")
@click.option("--thickness", metavar="MM", type=float, help="Thickness of the wall: stl (1).")
@click.option(
    "--paper",
    metavar="NAME",
    shell_complete=complete_words(("A4", "Letter")),
    help="A4 or Letter: svg (one sheet unless given), pdf (A4).",
)
@click.option(
    "--segments", metavar="N", type=click.IntRange(min=3), help="For a run: its states with this N."
)
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def export(
    settings: Settings,
    /,
    state: str,
    form: str | None,
    output: str | None,
    overwrite: bool,
    **asked: Any,
) -> None:
    """Write a STATE in another format.

    svg and pdf are the fold pattern at true scale, fold has its creases for origami programs, glb is the
    surface for browsers and Blender. vtkhdf and html also take a RUN: its states of one N, ordered by
    width.
    """
    options = exports.formats.Options(**asked)
    if not (form or output):
        known = ", ".join(EXPORT_FORMATS)
        raise UsageError(f"missing option '--to': one of {known}; or -o PATH with one of these as its suffix")
    form = api.exporting.format_of(form, output)
    api.exporting.check_format(form, options)
    done = api.exporting.export(form, named(settings, state), options, output, overwrite, teller(settings))
    for line in done.remarks:
        say(settings, line)
    warn(settings, done.warning)
    if settings.json:
        hashes = [store.content_sha256(record) for record in done.states]
        document = {"path": done.paths[0], "format": form, "content_sha256": hashes[0]}
        several = len(done.paths) > 1 or len(done.states) > 1
        more = {"paths": list(done.paths), "states": hashes} if several else {}
        emit_json(document | more | (asdict(done.facts) if done.facts else {}))
    else:
        emit("\n".join(done.paths))
