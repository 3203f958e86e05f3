"""`ribbon convergence-table`: energies under refinement, beside the published ones if asked."""

from __future__ import annotations

import math
import os

import click

from ribbon_cli import analysis, api, report, store, study
from ribbon_cli import config as configs
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_file, complete_source, complete_state
from ribbon_cli.cli.output import complain, deliver, say, teller, text_format
from ribbon_cli.cli.render import gathered
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import run_stages
from ribbon_cli.errors import StoreError, TargetError, UsageError

_FORMATS = ("text", "markdown", "latex", "csv", "json")


@click.command("convergence-table")
@click.argument("source", metavar="CONFIG|RUN", shell_complete=complete_source)
@click.option("--format", "style", type=click.Choice(_FORMATS), help="Default: text.")
@click.option("--thesis", is_flag=True, help="Show Table 3.1 of Koldaev (2022) beside the result.")
@click.option(
    "--second-minimum",
    metavar="STATE",
    shell_complete=complete_state,
    help="With --thesis: a state in another minimum, which may explain a published number.",
)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Write to a file instead.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
@common_options
@pass_settings
def convergence_table(
    settings: Settings,
    source: str,
    style: str | None,
    thesis: bool,
    second_minimum: str | None,
    output: str | None,
    overwrite: bool,
) -> int:
    """Energies under refinement: differences, orders, limits.

    Of a CONFIG, what is missing is solved first. Of both, an energy without certificate is named on standard
    error, and the exit code is 3.
    """
    style = text_format(settings, style)
    if second_minimum and not thesis:
        raise UsageError("--second-minimum needs --thesis")
    if output is not None:
        check_target(output, overwrite)
    other = _entry_of(settings, second_minimum) if second_minimum else None
    run, outcome = _run(settings, source, thesis)
    table = _table(run, outcome)
    comparison = _comparison(settings, run, table, other) if thesis else ()
    deliver(settings, report.tables.RENDERERS[style](table, comparison), output)
    failures = [*gathered(outcome.failures if outcome else ()), *_uncertified(run, table, outcome)]
    for failure in failures:
        complain(f"ribbon: {failure}")
    return TargetError.exit_code if failures else 0


def _run(settings: Settings, source: str, thesis: bool) -> tuple[store.Run, study.Outcome | None]:
    """The run that a reference or a config stands for, and what solving the config came to.

    Raises UsageError, before anything is solved, where a comparison with the thesis makes no sense.
    """
    if source.endswith((".yaml", ".yml")) or os.path.isfile(source):
        config = configs.load_config(source)
        if thesis:
            _check_comparable(config.name, config.half_twists, config.length, config.discretisation)
        outcome = run_stages(settings, config)
        return outcome.run, outcome
    run = store.find_run(settings.root, source)
    for state in run.states()[:1]:
        if thesis:
            twists = state["topology"]["half_twists"]
            _check_comparable(run.name, twists, state["length"], state["discretisation"])
    return run, None


def _check_comparable(name: str, half_twists: int, length: float, discretisation: str) -> None:
    """Raise UsageError unless a run's bands are those of the thesis's table."""
    same = abs(half_twists) == 1 and discretisation == "thesis"
    if not (same and math.isclose(length, 2 * math.pi, rel_tol=1e-9)):
        raise UsageError(
            f"{name}: not in Table 3.1, which is of pi-bands of length 2*pi with discretisation thesis"
        )


def _table(run: store.Run, outcome: study.Outcome | None) -> report.convergence.Table:
    """The run's table, empty when solving its config came to nothing.

    Raises UsageError when a run that was named has nothing to show, StoreError where a state's file is not
    what was committed.
    """
    states = run.states()
    if not states and outcome is None:
        raise UsageError(store.refs.no_equilibria(run))
    entries = analysis.table_entries(run)
    damaged = run.damage(int(entry.label or 0) for entry in entries)
    if damaged:
        files = "; ".join(f"{run.state_path(label)}: {word}" for label, word in damaged.items())
        raise StoreError(f"{files}: the table would rest on states that are not there")
    return report.convergence.convergence_rows(entries, *(state["length"] for state in states[:1]))


def _uncertified(run: store.Run, table: report.convergence.Table, outcome: study.Outcome | None) -> list[str]:
    """A line for each energy without certificate.

    Not of targets, of which the outcome speaks, and not of points of a branch, which may be unstable.
    """
    targets = {(target.half_width, target.segments) for target in (outcome.targets if outcome else ())}
    followed = {state["label"] for state in run.states() if state.get("branch")}
    return [
        f"{run.short_name}:{row.label}: no certificate at b = {row.half_width:.10g}, N = {row.segments}"
        for row in table.rows
        if not row.certified and row.label not in followed and (row.half_width, row.segments) not in targets
    ]


def _entry_of(settings: Settings, ref: str) -> report.convergence.Entry:
    """A state of another minimum, as an entry for the comparison."""
    record = api.open_state(ref, settings.runs, teller(settings))[1]
    return report.convergence.Entry(
        record.half_width, record.segments, record.energy, record.certified, record.label
    )


def _comparison(
    settings: Settings,
    run: store.Run,
    table: report.convergence.Table,
    other: report.convergence.Entry | None,
) -> tuple[report.convergence.ComparisonRow, ...]:
    """The published numbers beside ours; those of which the run has nothing are named in a message."""
    comparison = report.convergence.compare_with_thesis(table, report.convergence.thesis_table(), other)
    missing: dict[str, list[str]] = {}
    for item in comparison:
        if not any(report.convergence.is_at(row, item.half_width, item.segments) for row in table.rows):
            missing.setdefault(f"b = {item.half_width:.10g}", []).append(str(item.segments))
    if missing:
        places = "; ".join(f"{b}, N = {', '.join(segments)}" for b, segments in missing.items())
        say(settings, f"in Table 3.1 but not in {run.name}: {places}")
    return comparison
