"""Commands on whole runs: repair, pack, unpack, path, rerun."""

from __future__ import annotations

import os
from pathlib import Path

import click

from ribbon_cli import report, store, verify
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.compare_command import (
    answer_of_pairs,
    exact_option,
    pair_document,
    pairs_answer,
    pairs_table,
)
from ribbon_cli.cli.completion import complete_any, complete_file, complete_folder, complete_run
from ribbon_cli.cli.output import complain, emit, emit_json, emit_path, say, teller
from ribbon_cli.cli.progress import progress
from ribbon_cli.cli.settings import Settings, common_options, pass_settings


@click.command()
@click.argument("run", shell_complete=complete_run)
@common_options
@pass_settings
def repair(settings: Settings, run: str) -> None:
    """Repair a RUN after damage.

    Nothing is deleted: the log is rebuilt from the states, damaged files are renamed to *.damaged-K, config
    files are restored from the states. The next `ribbon solve` recomputes what was lost.
    """
    found = store.find_run(settings.root, run)
    done = found.repair()
    if settings.json:
        emit_json({"run": found.name, "path": str(found.path), "done": done})
    else:
        for note in done:
            emit(note)
        say(settings, f"{found.path}: {'repaired' if done else 'nothing to repair'}")


@click.command()
@click.argument("run", shell_complete=complete_run)
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Default: RUN.pack.h5.")
@click.option("--overwrite", is_flag=True, help="Replace the file if there is one.")
@common_options
@pass_settings
def pack(settings: Settings, run: str, output: str | None, overwrite: bool) -> None:
    """Write a RUN to one HDF5 file, to share.

    `ribbon unpack` restores the run with the same bytes. Other programs can read the states' datasets in it.
    """
    found = store.find_run(settings.root, run)
    path = output or f"{found.name}.pack.h5"
    check_target(path, overwrite)
    states = store.pack.pack(found, Path(path), overwrite)
    if settings.json:
        emit_json({"run": found.name, "path": path, "states": states, "bytes": os.path.getsize(path)})
    else:
        emit(path)


@click.command()
@click.argument("file", shell_complete=complete_file)
@common_options
@pass_settings
def unpack(settings: Settings, file: str) -> None:
    """Restore the run from a packed FILE.

    The run is placed in the folder of runs, with every file as it was.
    """
    run = store.pack.unpack(Path(file), settings.root)
    if settings.json:
        emit_json({"run": run.name, "path": str(run.path), "states": len(run.entries())})
    else:
        emit(str(run.path))


@click.command()
@click.argument("ref", metavar="RUN|STATE", shell_complete=complete_any)
@common_options
@pass_settings
def path(settings: Settings, ref: str) -> None:
    """Print where a RUN or a STATE is."""
    if store.names_state(ref):
        found = store.resolve_state(settings.root, ref, teller(settings))[2]
    else:
        found = store.find_run(settings.root, ref).path
    absolute = os.path.abspath(found)
    emit_json({"path": absolute}) if settings.json else emit_path(absolute)


@click.command()
@click.argument("run", shell_complete=complete_run)
@click.option(
    "--into", metavar="DIR", shell_complete=complete_folder, help="Keep the new run in this folder."
)
@exact_option
@common_options
@pass_settings
def rerun(settings: Settings, run: str, into: str | None, exact: bool) -> int:
    """Repeat a RUN from its stored config alone.

    Reports whether each state is `identical`, `same to rounding` (as on another machine, or with other
    versions of libraries) or `different`. The exit code is 3 if one differs or is not reached.
    """
    with progress(settings) as shown:
        target = None if into is None else Path(into)
        found = verify.rerun(settings.root, run, into=target, progress=shown, argv=settings.argv)
    if settings.json:
        document = {"run": found.run.name, "equal": found.equal} | pairs_answer(found.pairs)
        states = {"states": found.pairs, "not_from_config": found.extra}
        emit_json(document | {key: list(map(pair_document, pairs)) for key, pairs in states.items()})
    else:
        emit(pairs_table(_worth_showing(found.pairs)))
    same = sum(pair.equal for pair in found.pairs)
    verdict = f"{same} of {len(found.pairs)} states are the same, byte for byte of their scientific part"
    if found.extra:
        verdict += f"; {len(found.extra)} more are not from the config"
    say(settings, f"{found.run.name}: {verdict}")
    code = answer_of_pairs(settings, found.pairs, exact)
    if code:
        hint = "`--into DIR` keeps the new run, to compare" if into is None else f"the new run is in {into}"
        complain(f"ribbon: {found.run.name}: the result is not the same: {hint}")
    return code


def _worth_showing(pairs: tuple[report.comparison.StatePair, ...]) -> list[report.comparison.StatePair]:
    """Equilibria, and whatever differs."""
    return [pair for pair in pairs if pair.kind == "equilibrium" or not pair.equal]
