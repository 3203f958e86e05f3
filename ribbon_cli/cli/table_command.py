"""`ribbon convergence-table`: energies under refinement."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_source
from ribbon_cli.cli.output import complain, deliver, text_format
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import run_stages
from ribbon_cli.errors import StoreError, TargetError, UsageError

if TYPE_CHECKING:
    from ribbon_cli.report.convergence import Table
    from ribbon_cli.store import Run
    from ribbon_cli.study import Outcome

_FORMATS = ("text", "markdown", "latex", "csv", "json")


@click.command("convergence-table")
@click.argument("source", metavar="CONFIG|RUN", shell_complete=complete_source)
@click.option("--format", "style", type=click.Choice(_FORMATS), help="Default: text.")
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Write to a file instead.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
@common_options
@pass_settings
def convergence_table(
    settings: Settings, source: str, style: str | None, output: str | None, overwrite: bool
) -> int:
    """Energies under refinement: differences, orders, limits.

    Of a CONFIG, what is missing is solved first. Of both, an energy without certificate is named on standard
    error, and the exit code is 3.
    """
    from ribbon_cli.cli.render import gathered
    from ribbon_cli.report.tables import RENDERERS

    style = text_format(settings, style)
    if output is not None:
        check_target(output, overwrite)
    run, outcome = _run(settings, source)
    table = _table(run, outcome)
    deliver(settings, RENDERERS[style](table), output)
    failures = [*gathered(outcome.failures if outcome else ()), *_uncertified(run, table, outcome)]
    for failure in failures:
        complain(f"ribbon: {failure}")
    return TargetError.exit_code if failures else 0


def _run(settings: Settings, source: str) -> tuple[Run, Outcome | None]:
    """The run that a reference or a config stands for, and what solving the config came to."""
    from ribbon_cli.config import load_config
    from ribbon_cli.store import find_run

    if source.endswith((".yaml", ".yml")) or os.path.isfile(source):
        outcome = run_stages(settings, load_config(source))
        return outcome.run, outcome
    return find_run(settings.root, source), None


def _table(run: Run, outcome: Outcome | None) -> Table:
    """The run's table, empty when solving its config came to nothing.

    Raises UsageError when a run that was named has nothing to show, StoreError where a state's file is not
    what was committed.
    """
    from ribbon_cli.report.convergence import convergence_rows
    from ribbon_cli.store.refs import no_equilibria
    from ribbon_cli.study import table_entries

    states = run.states()
    if not states and outcome is None:
        raise UsageError(no_equilibria(run))
    entries = table_entries(run)
    damaged = run.damage(int(entry.label or 0) for entry in entries)
    if damaged:
        files = "; ".join(f"{run.state_path(label)}: {word}" for label, word in damaged.items())
        raise StoreError(f"{files}: the table would rest on states that are not there")
    return convergence_rows(entries, *(state.length for state in states[:1]))


def _uncertified(run: Run, table: Table, outcome: Outcome | None) -> list[str]:
    """A line for each energy without certificate.

    Not of targets, of which the outcome speaks, and not of points of a branch, which may be unstable.
    """
    targets = {(target.half_width, target.segments) for target in (outcome.targets if outcome else ())}
    followed = {state.label for state in run.states() if state.branch is not None}
    return [
        f"{run.short_name}:{row.label}: no certificate at b = {row.half_width:.10g}, N = {row.segments}"
        for row in table.rows
        if not row.certified and row.label not in followed and (row.half_width, row.segments) not in targets
    ]
