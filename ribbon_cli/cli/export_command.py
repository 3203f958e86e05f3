"""`ribbon export`: states in the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from ribbon_cli.cli.completion import complete_file, complete_state
from ribbon_cli.cli.output import check_target, emit, emit_json
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError

if TYPE_CHECKING:
    from ribbon_cli.store import StateRecord


def _to_npz(record: StateRecord, path: str, overwrite: bool) -> None:
    from ribbon_cli.store import export_npz

    export_npz(record, path, overwrite)


_WRITERS: dict[str, Callable[[StateRecord, str, bool], None]] = {"npz": _to_npz}
"""Writer by format, which is the default file's suffix as well. A new format is a new row."""


@click.command()
@click.argument("state", shell_complete=complete_state)
@click.option("--to", "form", metavar="FORMAT", required=True, help=f"One of: {', '.join(_WRITERS)}.")
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Else RUN-LABEL.FORMAT.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def export(settings: Settings, state: str, form: str, output: str | None, overwrite: bool) -> None:
    """Write a STATE in another format."""
    from ribbon_cli.api import open_state
    from ribbon_cli.store import content_sha256, suggest

    if form not in _WRITERS:
        known = f"known: {', '.join(_WRITERS)}"
        raise UsageError(f"no format {form!r} ({known}){suggest(form, _WRITERS)}")
    run, record, source = open_state(state, settings.runs)
    stem = f"{run.short_name}-{record.label}" if run else source.stem
    path = output or f"{stem}.{form}"
    check_target(path, overwrite, "add --overwrite, or choose another with -o")
    _WRITERS[form](record, path, overwrite)
    if settings.json:
        emit_json({"path": path, "format": form, "content_sha256": content_sha256(record)})
    else:
        emit(path)
