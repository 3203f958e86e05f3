"""`ribbon report`: a run on one page."""

from __future__ import annotations

import click

from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_run
from ribbon_cli.cli.output import emit, emit_json
from ribbon_cli.cli.settings import Settings, common_options, pass_settings


@click.command("report")
@click.argument("run", shell_complete=complete_run)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Else RUN.html.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def report_page(settings: Settings, run: str, output: str | None, overwrite: bool) -> None:
    """Write a RUN as one HTML page.

    Config, states with their certificates, pictures, convergence, stages and provenance, in one file that
    needs no network.
    """
    from ribbon_cli.pages.run import run_page
    from ribbon_cli.store import find_run, write_atomic

    found = find_run(settings.root, run)
    path = output or f"{found.short_name}.html"
    check_target(path, overwrite)
    write_atomic(path, run_page(found), overwrite=overwrite)
    emit_json({"path": path, "run": found.name}) if settings.json else emit(path)
