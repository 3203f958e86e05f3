"""`ribbon survey`: which equilibria are there?"""

from __future__ import annotations

from dataclasses import asdict

import click

from ribbon_cli import config as configs
from ribbon_cli import pages, store, surveys, sweeps
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file
from ribbon_cli.cli.numbers import whole
from ribbon_cli.cli.output import emit, emit_json, say
from ribbon_cli.cli.progress import progress
from ribbon_cli.cli.settings import Settings, common_options, pass_settings


@click.command()
@click.argument("config", shell_complete=complete_file)
@click.option(
    "--starts",
    metavar="K",
    default="100",
    show_default=True,
    callback=whole(1),
    help="Number of random starts.",
)
@click.option(
    "--seed", metavar="S", default="1", show_default=True, callback=whole(0), help="Of the random numbers."
)
@click.option(
    "--climb",
    metavar="K",
    default="0",
    show_default=True,
    callback=whole(0),
    help="Saddles up to index K as well.",
)
@click.option("--workers", metavar="K", callback=whole(1), help="Processes; by default one a core.")
@click.option(
    "-o", "--output", metavar="PATH", shell_complete=complete_file, help="Write a page with pictures."
)
@click.option("--overwrite", is_flag=True, help="Replace the page if there is one.")
@common_options
@pass_settings
def survey(
    settings: Settings,
    config: str,
    starts: int,
    seed: int,
    climb: int,
    workers: int | None,
    output: str | None,
    overwrite: bool,
) -> None:
    """Look for all equilibria of CONFIG from random starts.

    It is done at the first width that the config names, on its coarsest mesh. Equilibria are told apart up to
    rotation, sliding and mirror image. Each is followed to meshes of 2N, 4N and 8N: those that are met again
    with energies that converge are called continuum, those that are lost mesh, others open. The same line
    again resumes; more starts go on from those there are.
    """
    if output is not None:
        check_target(output, overwrite)
    loaded = configs.load_config(config)
    request = surveys.Request(starts, seed, climb, workers or sweeps.cores())
    settings.commits = True
    with progress(settings) as shown:
        outcome = surveys.survey_config(loaded, settings.root, request, progress=shown, argv=settings.argv)
    found = surveys.findings(outcome.run)
    if settings.json:
        new = {"path": str(outcome.run.path), "new_states": outcome.new_states}
        emit_json(asdict(found) | new | {"notes": list(outcome.notes)})
    else:
        emit(surveys.text.survey_text(found))
    if output is not None:
        store.write_atomic(output, pages.survey.survey_page(outcome.run), overwrite=overwrite)
        say(settings, f"wrote {output}")
    say(settings, f"{outcome.run.path}: {outcome.new_states} new states; `ribbon report` makes a page of it")
