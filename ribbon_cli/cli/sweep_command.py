"""`ribbon sweep`: many runs from one file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

import click

from ribbon_cli import api, store, sweeps
from ribbon_cli import config as configs
from ribbon_cli.api.names import SCRIPTS
from ribbon_cli.cli.completion import complete_file, complete_words
from ribbon_cli.cli.numbers import whole
from ribbon_cli.cli.output import complain, emit, emit_json, say, teller
from ribbon_cli.cli.render import columns, counts_text
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.digits import duration
from ribbon_cli.errors import UsageError

ARRAY_INDEX = "SLURM_ARRAY_TASK_ID"
"""Where Slurm tells an element of a job array its index."""


@click.command()
@click.argument("sweep", shell_complete=complete_file)
@click.option(
    "--workers", metavar="K", callback=whole(1), help="Worker processes; by default one a processor."
)
@click.option(
    "--dask",
    metavar="ADDRESS|local|FILE",
    help="Run on a Dask cluster: that of a scheduler, one made here, or one of jobs as a settings file says.",
)
@click.option(
    "--array-index",
    metavar="I",
    help=f"Run point I alone, from 0, or points I:END:STEP; by default what {ARRAY_INDEX} says.",
)
@click.option("--retry", is_flag=True, help="Try points again that failed.")
@click.option("--dry-run", is_flag=True, help="Print what is left to run and its cost, and run nothing.")
@click.option(
    "--script",
    type=click.Choice(SCRIPTS),
    shell_complete=complete_words(SCRIPTS),
    help="Print a script that runs the sweep as a job array.",
)
@common_options
@pass_settings
def sweep(
    settings: Settings,
    sweep: str,
    workers: int | None,
    dask: str | None,
    array_index: str | None,
    retry: bool,
    dry_run: bool,
    script: str | None,
) -> int:
    """Run all points of SWEEP.yaml; the same line resumes.

    A point that fails is named and stops no other; it is tried again with --retry. The exit code is 3 when
    one has failed. `ribbon ls NAME` tells where each point stands.
    """
    loaded = configs.load_sweep(sweep)
    if script is not None:
        emit(sweeps.script_of(script, loaded, settings.root))
        return 0
    alone = array_index is not None or (workers is None and dask is None and not dry_run)
    chosen = _chosen(settings, loaded, array_index) if alone else None
    points = range(len(loaded.points)) if chosen is None else chosen
    record = store.record_of(settings.root, loaded)
    tell = teller(settings)
    left = sweeps.what_is_left(loaded, record, settings.root, points, retry, settings.argv, tell)
    if dry_run:
        _show_plan(settings, record, left, workers)
        return 0
    settings.commits = True
    store.keep_sweep(settings.root, loaded)
    here = chosen is not None
    with sweeps.executor_for(left, workers, dask, here, tell) as executor, _progress(settings) as shown:
        outcome = sweeps.run_sweep(record, left, points, executor, shown, wait_for_others=not here)
    return _report(settings, outcome)


def _chosen(settings: Settings, loaded: configs.Sweep, text: str | None) -> range | None:
    """The points that a job array's element is to run; None where this is none. Raises UsageError."""
    count, source = len(loaded.points), "--array-index"
    if text is None:
        text, source = os.environ.get(ARRAY_INDEX), ARRAY_INDEX
    if text is None:
        return None
    words = text.split(":")
    numbers = [int(word) for word in words if word.isascii() and word.isdecimal() and len(word) < 10]
    if not len(words) == len(numbers) <= 3 or numbers[2:] == [0]:
        raise UsageError(f"{source}: must be a point's number, from 0, or I:END:STEP, got {text!r}")
    chosen = range(numbers[0], numbers[0] + 1) if len(numbers) == 1 else range(*numbers)
    if not chosen or chosen[-1] >= count:
        raise UsageError(f"{source}: {text}: the sweep has points 0 to {count - 1}")
    if len(chosen) == 1:
        say(settings, f"{source} {text}: {loaded.points[chosen[0]].run}")
    return chosen


@contextmanager
def _progress(settings: Settings) -> Iterator[Callable[[sweeps.SweepEvent], object]]:
    """The progress of a sweep; where users want quiet, bugs are still shown to those who debug."""
    with (
        nullcontext()
        if settings.quiet
        else api.sweep_console.sweep_console(settings.verbose, complain) as shown
    ):

        def watch(event: sweeps.SweepEvent) -> None:
            if shown is not None:
                shown(event)
            if settings.debug and isinstance(event, sweeps.Ended) and event.trace:
                complain(event.trace.rstrip())

        yield watch


def _report(settings: Settings, outcome: sweeps.SweepOutcome) -> int:
    """Print how many points stand where, and name on standard error those that failed; the exit code."""
    record, found = outcome.record, sweeps.counts(outcome.points)
    new = sum(point.new_states for point in outcome.points)
    if settings.json:
        points = [point.to_dict() | {"new_states": point.new_states} for point in outcome.points]
        about = {"sweep": record.name, "path": str(record.folder), "exit_code": outcome.exit_code}
        emit_json(about | {"counts": found, "points": points})
    else:
        emit(f"{record.name}: {counts_text(found)}")
    say(settings, f"{new} new state{'s' * (new != 1)}; `ribbon ls {record.name}` lists the points")
    for run, why in outcome.failures:
        complain(f"ribbon: {run}: {why}")
    for point in outcome.points:
        if point.status == "running":
            complain(f"ribbon: {point.point.run}: others write to it: {point.words}")
    return outcome.exit_code


def _show_plan(settings: Settings, record: store.SweepRecord, left: sweeps.Left, workers: int | None) -> None:
    """Print what is left to run, and its cost as `ribbon check` tells it."""
    words = {task.run: duration(task.cost) for task in left.tasks}
    words |= {run: result.status for run, result in left.passed.items()}
    asked = [task.point.config for task in left.tasks]
    count, why = sweeps.workers_for(workers, asked)
    if settings.json:
        costs = {task.run: task.cost for task in left.tasks}
        points = [
            {"name": point.name, "run": point.run, "values": dict(point.values), "left": point.run in costs}
            | {"cost_seconds": costs.get(point.run, 0.0)}
            for point in record.points
            if point.run in words
        ]
        emit_json({"sweep": record.name, "points": points, "workers": count, "cost_seconds": left.cost})
        return
    rows = [[point.run, words[point.run]] for point in record.points if point.run in words]
    emit(
        f"{columns(['run', 'cost'], rows)}\n\n{len(left.tasks)} of {len(words)} runs left, "
        f"about {duration(left.cost)} on one core, {duration(left.cost / count)} on {count}"
    )
    if why:
        say(settings, why)
