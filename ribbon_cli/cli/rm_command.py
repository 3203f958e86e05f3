"""`ribbon rm`: a run deleted, or states that commands added to one."""

from __future__ import annotations

import click

from ribbon_cli import store, study
from ribbon_cli.cli.completion import complete_any
from ribbon_cli.cli.output import complain, emit_json, say
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.text import ranges


@click.command()
@click.argument("refs", metavar="RUN|STATE...", nargs=-1, required=True, shell_complete=complete_any)
@click.option(
    "--branch",
    "branches",
    metavar="K",
    type=click.IntRange(min=1),
    multiple=True,
    help="Remove only the branch with this number in ribbon show RUN.",
)
@click.option(
    "--with-dependents", "dependents", is_flag=True, help="Also remove the states that came from these."
)
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@common_options
@pass_settings
def rm(
    settings: Settings, refs: tuple[str, ...], branches: tuple[int, ...], dependents: bool, yes: bool
) -> int:
    """Delete a RUN, or states of one, for good; asks first.

    Only states (each as RUN:LABEL) and branches that ribbon continue or ribbon refine added can be removed:
    the next solve would compute all others again.
    """
    if any(map(store.names_state, refs)):
        if branches:
            raise UsageError("--branch goes with a run, and the reference names a state")
        run, labels = _states_of_a_run(settings, refs)
        return _remove(settings, run, study.Request(labels=labels, dependents=dependents), yes)
    if len(refs) > 1:
        raise UsageError(f"rm: takes one run at a time, or states of one run, got {', '.join(refs)}")
    run = store.find_run(settings.root, refs[0])
    if branches:
        return _remove(settings, run, study.Request(numbers=branches, dependents=dependents), yes)
    if dependents:
        raise UsageError("--with-dependents goes with states, or with --branch")
    return _delete(settings, run, yes)


def _states_of_a_run(settings: Settings, refs: tuple[str, ...]) -> tuple[store.Run, tuple[int, ...]]:
    """The run and the labels of the states that are named. Raises UsageError."""
    found: list[tuple[store.Run, int]] = []
    for ref in refs:
        if not store.names_state(ref) or "@" in ref:
            raise UsageError(f"{ref}: a state that is to be removed is named by its label, as in RUN:12")
        run, label, path = store.resolve_state(settings.root, ref)
        if run is None or label is None:
            raise UsageError(f"{path}: not in a run")
        found.append((run, label))
    paths = dict.fromkeys(run.path for run, _ in found)
    if len(paths) > 1:
        raise UsageError(
            f"rm: takes states of one run at a time, got {', '.join(path.name for path in paths)}"
        )
    return found[0][0], tuple(label for _, label in found)


def _remove(settings: Settings, run: store.Run, request: study.Request, yes: bool) -> int:
    """Remove states and branches of a run."""
    removal = study.removal_of(run, request)
    count = len(removal.labels)
    what = f"{count} state{'s' * (count != 1)}" + (f" ({ranges(removal.labels)})" if count else "")
    if not yes and not _agreed(f"remove {what} of {run.path}?"):
        complain(f"ribbon: {run.path} is kept as it is")
        return UsageError.exit_code
    study.remove(run, removal)
    for remark in run.remarks:
        say(settings, remark)
    if settings.json:
        facts = {"removed": list(removal.labels), "branches": list(removal.branches)}
        emit_json({"run": run.name, "path": str(run.path)} | facts)
    else:
        say(settings, f"{run.path}: removed {what}")
    return 0


def _delete(settings: Settings, run: store.Run, yes: bool) -> int:
    """Delete a whole run."""
    try:
        states = f"{len(run.entries())} states"
    except StoreError:
        states = "a damaged log"
    if not yes and not _agreed(f"delete {run.path} with {states}?"):
        complain(f"ribbon: {run.path} is kept")
        return UsageError.exit_code
    run.remove()
    if settings.json:
        emit_json({"run": run.name, "deleted": str(run.path)})
    else:
        say(settings, f"{run.path}: deleted")
    return 0


def _agreed(question: str) -> bool:
    """Ask on standard error; anything but yes is no, and so is no answer."""
    try:
        return click.confirm(question, err=True)
    except (click.Abort, OSError, RuntimeError):  # standard input may be closed
        return False
