"""`ribbon convergence-table`: energies under refinement."""

from __future__ import annotations

import os

import click

from ribbon_cli import analysis, report, store, study
from ribbon_cli import config as configs
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_source
from ribbon_cli.cli.output import complain, deliver, text_format
from ribbon_cli.cli.render import gathered
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import run_stages
from ribbon_cli.errors import StoreError, TargetError, UsageError

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

    For a CONFIG, missing states are solved first. Energies without a certificate are named on standard error,
    and the exit code is then 3.
    """
    style = text_format(settings, style)
    if output is not None:
        check_target(output, overwrite)
    run, outcome = _run(settings, source)
    table = _table(run, outcome)
    deliver(settings, report.tables.RENDERERS[style](table), output)
    failures = [*gathered(outcome.causes if outcome else ()), *_uncertified(run, table, outcome)]
    for failure in failures:
        complain(f"ribbon: {failure}")
    return TargetError.exit_code if failures else 0


def _run(settings: Settings, source: str) -> tuple[store.Run, study.Outcome | None]:
    """The run that a reference or a config means, and the outcome of solving the config."""
    if source.endswith((".yaml", ".yml")) or os.path.isfile(source):
        outcome = run_stages(settings, configs.load_config(source))
        return outcome.run, outcome
    return store.find_run(settings.root, source), None


def _table(run: store.Run, outcome: study.Outcome | None) -> report.convergence.Table:
    """The run's table, empty if solving its config reached nothing.

    Raises UsageError when a run that was named has nothing to show, StoreError where a state's file is not
    what was committed.
    """
    if not run.states() and outcome is None:
        raise UsageError(store.refs.no_equilibria(run))
    table = analysis.run_table(run)
    damaged = run.damage(int(row.label or 0) for row in table.rows)
    if damaged:
        files = "; ".join(f"{run.state_path(label)}: {word}" for label, word in damaged.items())
        raise StoreError(f"{files}: the table would rest on states that are not there")
    return table


def _uncertified(run: store.Run, table: report.convergence.Table, outcome: study.Outcome | None) -> list[str]:
    """A line for each energy without certificate.

    Targets are left out, because the outcome reports them, and points of a branch, which may be unstable.
    """
    targets = {(target.half_width, target.segments) for target in (outcome.targets if outcome else ())}
    followed = {state.label for state in run.states() if state.branch is not None}
    return [
        f"{run.short_name}:{row.label}: no certificate at b = {row.half_width:.10g}, N = {row.segments}"
        for row in table.rows
        if not row.certified and row.label not in followed and (row.half_width, row.segments) not in targets
    ]
