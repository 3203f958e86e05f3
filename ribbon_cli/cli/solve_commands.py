"""`ribbon solve` and `ribbon refine`: commands that store new states."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any, Literal

import click

from ribbon_cli import config as configs
from ribbon_cli import store, study
from ribbon_cli.cli.completion import complete_file, complete_state
from ribbon_cli.cli.numbers import whole
from ribbon_cli.cli.output import complain, emit, emit_json, say
from ribbon_cli.cli.progress import progress
from ribbon_cli.cli.render import branch_text, gathered, targets_table
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError


@click.command()
@click.argument("config", shell_complete=complete_file)
@click.option("--fresh", is_flag=True, help="Start over; an earlier run is set aside, not deleted.")
@common_options
@pass_settings
def solve(settings: Settings, config: str, fresh: bool) -> int:
    """Run all stages of CONFIG; the same command resumes.

    Prints the result for each target. The exit code is 3 if one was not reached or has no certificate.
    """
    return report(settings, run_stages(settings, configs.load_config(config), fresh))


def run_stages(settings: Settings, config: configs.Config, fresh: bool = False) -> study.Outcome:
    """Solve what a config's run still lacks, with progress shown."""
    settings.commits = True
    study.hold_memory()
    with progress(settings) as shown:
        return study.solve_config(config, settings.root, fresh=fresh, progress=shown, argv=settings.argv)


@click.command()
@click.argument("state", shell_complete=complete_state)
@click.option("--to", metavar="N", callback=whole(8), help="Number of segments to go to.")
@click.option("--levels", metavar="K", callback=whole(1), help="How often to double the segments.")
@click.option(
    "--method",
    type=click.Choice(["smooth", "split"]),
    default="smooth",
    show_default=True,
    help="How the finer guess is made: by a smooth curve, or by splitting each facet.",
)
@common_options
@pass_settings
def refine(
    settings: Settings, state: str, to: int | None, levels: int | None, method: Literal["smooth", "split"]
) -> int:
    """Refine a stored STATE; the results are added to its run."""
    if (to is None) == (levels is None):
        raise UsageError("give one of --to N and --levels K")

    settings.commits = True
    study.hold_memory()
    with progress(settings) as shown:
        outcome = study.refine_state(
            settings.root, state, to=to, levels=levels, method=method, progress=shown, argv=settings.argv
        )
    return report(settings, outcome)


def report(settings: Settings, outcome: study.Outcome) -> int:
    """Print the result for every target, and name failures on standard error; return the exit code.

    The outcome's notes have been shown as they came up; only JSON repeats them.
    """
    states = {state.label: state for state in outcome.run.states(all=True)}

    def document() -> dict[str, Any]:
        labels = {target.label for target in outcome.targets}
        listed = [state.listed(outcome.run.name) for label, state in states.items() if label in labels]
        return {"targets": [asdict(target) for target in outcome.targets], "states": listed}

    def text() -> str:
        return "\n\n".join([targets_table(outcome.targets, states), *map(branch_text, outcome.branches)])

    more = f"`ribbon ls {store.typed(outcome.run)}` lists the run"
    return conclude(settings, outcome, document, text, more, gathered(outcome.causes))


def conclude(
    settings: Settings,
    outcome: study.Outcome,
    document: Callable[[], dict[str, Any]],
    text: Callable[[], str],
    more: str,
    failures: Iterable[str],
) -> int:
    """Print the outcome of a study, as text or as JSON with its own `document`; return the exit code.

    `more` says which command tells more.
    """
    run = outcome.run
    if settings.json:
        emit_json(
            {"run": run.name, "path": str(run.path)}
            | {"exit_code": outcome.exit_code, "new_states": outcome.new_states}
            | document()
            | {"branches": [course.to_dict() for course in outcome.branches]}
            | {"notes": list(outcome.notes), "failures": list(outcome.failures)}
        )
    else:
        emit(text())
    new = f"{outcome.new_states} new state{'s' * (outcome.new_states != 1)}"
    say(settings, f"{run.path}: {new}; {more}")
    for failure in failures:
        complain(f"ribbon: {failure}")
    return outcome.exit_code
