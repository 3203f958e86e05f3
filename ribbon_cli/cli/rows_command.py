"""`ribbon table`: one table over runs and sweeps."""

from __future__ import annotations

import os

import click

from ribbon_cli import api, report, store
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_run
from ribbon_cli.cli.numbers import whole
from ribbon_cli.cli.output import emit, emit_json, say
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError


@click.command("table")
@click.argument("names", metavar="RUN|SWEEP...", nargs=-1, required=True, shell_complete=complete_run)
@click.option("--where", metavar="EXPR", help='Rows to keep, as in --where "energy < 5 and certified".')
@click.option("--columns", metavar="NAMES", help="Columns to keep, with commas between them.")
@click.option("--all", "every", is_flag=True, help="States of every kind, not equilibria alone.")
@click.option("--modes", metavar="K", callback=whole(1), help="The lowest K stored eigenvalues as well.")
@click.option("-o", "--output", metavar="FILE", shell_complete=complete_file, help="Else to the screen.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def table(
    settings: Settings,
    names: tuple[str, ...],
    where: str | None,
    columns: str | None,
    every: bool,
    modes: int | None,
    output: str | None,
    overwrite: bool,
) -> None:
    """Print one table over runs and sweeps, a row a state.

    Columns are what varies in a sweep and the fields of `ribbon ls --json`. FILE is csv, parquet or nc by its
    suffix. EXPR compares columns with numbers, texts in quotes and each other, with and, or, not; a
    comparison with a value that is missing does not hold.
    """
    form = None if output is None else _format(output, overwrite)
    found = api.gathering.gathered(api.gathering.sources(settings.root, names), every, modes or 0)
    found = found.where(where)
    for words in (*found.missed, *report.where.hints(where, [column.name for column in found.columns])):
        say(settings, words)
    if columns is not None:
        found = found.only([name.strip() for name in columns.split(",")])
    if form is not None and output is not None:
        store.write_atomic(output, report.rows.FORMATS[form](found), overwrite=overwrite)
        emit_json({"path": output, "rows": len(found.rows)}) if settings.json else emit(output)
        say(settings, f"{len(found.rows)} rows, {len(found.columns)} columns")
    elif settings.json:
        emit_json({"columns": [column.name for column in found.columns], "rows": report.rows.records(found)})
    else:
        emit(report.rows.text(found))


def _format(output: str, overwrite: bool) -> str:
    """The format that a file's suffix names. Raises UsageError."""
    form = os.path.splitext(output)[1].removeprefix(".").lower()
    if form not in report.rows.FORMATS:
        near = store.suggest(form, report.rows.FORMATS)
        raise UsageError(f"{output}: a table is written as .csv, .parquet or .nc{near}")
    check_target(output, overwrite)
    return form
