"""`ribbon convergence-table`: energies under refinement, beside the published ones if asked."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import click

from ribbon_cli.cli.completion import complete_file, complete_source, complete_state
from ribbon_cli.cli.output import check_target, complain, emit, say
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import solve_config_file
from ribbon_cli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ribbon_cli.report.convergence import ComparisonRow, Entry, Table
    from ribbon_cli.store import Run

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
@common_options
@pass_settings
def convergence_table(
    settings: Settings,
    source: str,
    style: str | None,
    thesis: bool,
    second_minimum: str | None,
    output: str | None,
) -> int:
    """Energies under refinement: differences, orders, limits.

    Of a CONFIG, what is missing is solved first. Of both, an energy without certificate is named on standard
    error, and the exit code is 3.
    """
    style = _style(settings, style)
    if second_minimum and not thesis:
        raise UsageError("--second-minimum needs --thesis")
    if output is not None:
        check_target(output, overwrite=True)
    other = _entry_of(settings, second_minimum) if second_minimum else None
    run, failures = _run(settings, source)
    table, uncertified = _table(run)
    comparison = _comparison(settings, run, table, other) if thesis else ()
    _write(settings, table, comparison, style, output)
    for failure in failures or uncertified:
        complain(f"ribbon: {failure}")
    return 3 if failures or uncertified else 0


def _style(settings: Settings, style: str | None) -> str:
    """The format to write. Raises UsageError when two are asked for."""
    if settings.json and style not in (None, "json"):
        raise UsageError(f"--json and --format {style} exclude each other: give one")
    return "json" if settings.json else style or "text"


def _run(settings: Settings, source: str) -> tuple[Run, Sequence[str]]:
    """The run that a config or a reference stands for, and what its solve failed at."""
    from ribbon_cli.store import find_run

    if source.endswith((".yaml", ".yml")) or os.path.isfile(source):
        outcome = solve_config_file(settings, source)
        return outcome.run, outcome.failures
    return find_run(settings.root, source), ()


def _table(run: Run) -> tuple[Table, list[str]]:
    """The run's table, and a line for each energy in it without certificate. Raises UsageError."""
    from ribbon_cli.report.convergence import convergence_rows
    from ribbon_cli.study import table_entries

    states = run.states()
    if not states:
        raise UsageError(
            f"{run.name} has no equilibria yet; `ribbon ls {run.short_name} --all` lists its states"
        )
    table = convergence_rows(table_entries(run), states[0]["length"])
    return table, [
        f"{run.short_name}:{row.label}: no certificate at b = {row.half_width:g}, N = {row.segments}"
        for row in table.rows
        if not row.certified
    ]


def _entry_of(settings: Settings, ref: str) -> Entry:
    """A state of another minimum, as an entry for the comparison."""
    from ribbon_cli import load_state
    from ribbon_cli.report.convergence import Entry

    record = load_state(ref, settings.runs)
    return Entry(record.half_width, record.segments, record.energy, record.certified, record.label)


def _comparison(settings: Settings, run: Run, table: Table, other: Entry | None) -> tuple[ComparisonRow, ...]:
    """The published numbers beside ours; those of which the run has nothing are named in a message.

    Raises UsageError unless the run's bands are those of the published table.
    """
    from ribbon_cli.report.convergence import compare_with_thesis, is_at, thesis_table

    band = run.states()[0]
    same = band["discretisation"] == "thesis" and abs(band["topology"]["half_twists"]) == 1
    if not (same and math.isclose(band["length"], 2 * math.pi, rel_tol=1e-9)):
        raise UsageError(
            f"{run.name}: not in Table 3.1, which is of pi-bands of length 2*pi with discretisation thesis"
        )
    comparison = compare_with_thesis(table, thesis_table(), other)
    missing = [
        f"b = {item.half_width:g}, N = {item.segments}"
        for item in comparison
        if not any(is_at(row, item.half_width, item.segments) for row in table.rows)
    ]
    if missing:
        say(settings, f"in Table 3.1 but not in {run.name}: {'; '.join(missing)}")
    return comparison


def _write(
    settings: Settings, table: Table, comparison: Sequence[ComparisonRow], style: str, output: str | None
) -> None:
    """Print the table, or write it to a file."""
    from ribbon_cli.report.tables import RENDERERS
    from ribbon_cli.store import write_atomic

    text = RENDERERS[style](table, comparison)
    if output is None:
        emit(text)
        return
    write_atomic(output, text.encode(), overwrite=True)
    say(settings, f"wrote {output}")
