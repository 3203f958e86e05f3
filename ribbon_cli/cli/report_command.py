"""`ribbon report`: a run on one page."""

from __future__ import annotations

import click

from ribbon_cli import pages, store
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_run
from ribbon_cli.cli.output import emit, emit_json
from ribbon_cli.cli.settings import Settings, common_options, pass_settings


@click.command("report")
@click.argument("run", shell_complete=complete_run)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Default: RUN.html.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def report_page(settings: Settings, run: str, output: str | None, overwrite: bool) -> None:
    """Write a RUN as one HTML page.

    Config, states with their certificates, pictures, convergence, stages and provenance, in one file that
    needs no network.
    """
    found = store.find_run(settings.root, run)
    path = output or f"{found.short_name}.html"
    check_target(path, overwrite)
    store.write_atomic(path, pages.run.run_page(found), overwrite=overwrite)
    emit_json({"path": path, "run": found.name}) if settings.json else emit(path)
