"""`ribbon ls` and `ribbon show`: what is in the store."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from ribbon_cli.cli.completion import complete_any, complete_run
from ribbon_cli.cli.output import complain, emit, emit_json, say
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import RibbonError, StoreError

if TYPE_CHECKING:
    from ribbon_cli.store import Run, StateRecord
    from ribbon_cli.study import Course


@click.command()
@click.argument("run", required=False, shell_complete=complete_run)
@click.option("--all", "everything", is_flag=True, help="All kinds of state; all runs, those set aside too.")
@common_options
@pass_settings
def ls(settings: Settings, run: str | None, everything: bool) -> int:
    """List the runs, or the equilibria of a RUN."""
    from ribbon_cli.cli.render import runs_table, states_table
    from ribbon_cli.store import find_run, list_runs

    if run is not None:
        found = find_run(settings.root, run)
        states = found.states(all=everything)
        lost = found.damage(state["label"] for state in states)
        states = [_as_found(state, lost.get(state["label"])) for state in states]
        if settings.json:
            emit_json(states)
        elif states:
            emit(states_table(states, kinds=everything))
        else:
            say(settings, _emptiness(found))
        for label, word in lost.items():
            complain(f"ribbon: {found.state_path(label)}: {word}: what is listed of it is what was committed")
        return StoreError.exit_code if lost else 0
    runs = [_describe(item) for item in list_runs(settings.root, aside=everything)]
    if settings.json:
        emit_json(runs)
    elif runs:
        emit(runs_table(runs))
    else:
        say(settings, f"no runs in {settings.root} (see --runs)")
    damaged = [item["damage"] for item in runs if item["damage"]]
    for line in damaged:
        complain(f"ribbon: {line}")
    return StoreError.exit_code if damaged else 0


def _as_found(state: dict[str, Any], damage: str | None) -> dict[str, Any]:
    """A state's summary, without a certificate where its file is not what was committed."""
    return state if damage is None else {**state, "status": damage, "certified": False}


def _emptiness(run: Run) -> str:
    """Why a run's listing is empty."""
    if run.entries():
        return f"{run.name} has no equilibria yet; `ribbon ls {run.short_name} --all` lists its states"
    return f"{run.name} has no states yet"


def _describe(run: Run) -> dict[str, Any]:
    """A run in a few words; `damage` is empty or says why the rest is unknown."""
    facts: dict[str, Any] = {"name": run.name, "short_name": run.short_name, "path": str(run.path)}
    unknown = dict.fromkeys(("equilibria", "states", "last_change", "complete"))
    try:
        events = run.events()
        states = run.states()
    except StoreError as error:
        return facts | unknown | {"aside": run.is_aside, "damage": str(error)}
    return facts | {
        "equilibria": len(states),
        "states": sum(event["event"] == "state" for event in events),
        "last_change": events[-1]["time"] if events else None,
        "complete": _is_complete(run, states),
        "aside": run.is_aside,
        "damage": "",
    }


def _is_complete(run: Run, states: list[dict[str, Any]]) -> bool | None:
    """Whether a run has an equilibrium for all that its config names; None where that cannot be told."""
    from ribbon_cli.config import load_config
    from ribbon_cli.study import plan_of

    try:
        stages = plan_of(load_config(run.path / "resolved.yaml")).stages
    except RibbonError:
        return None
    wanted = {(stage.half_width, stage.segments) for stage in stages if stage.kind == "equilibrium"}
    if any(None in place for place in wanted):
        return None
    return wanted <= {(state["half_width"], state["segments"]) for state in states}


@click.command()
@click.argument("ref", metavar="RUN|STATE", shell_complete=complete_any)
@common_options
@pass_settings
def show(settings: Settings, ref: str) -> None:
    """Show a state and its certificate, or a run.

    Of a state all but its arrays, provenance included; of a run its config, history and branches.
    """
    from ribbon_cli.cli.render import branch_text, history_lines, listing, status_in_words

    if names_state(ref):
        document = _show_state(settings, ref)
        words: dict[str, Any] = {"status": status_in_words(document)}
        emit_json(document) if settings.json else emit(listing({**document, **words}))
        return
    document, branches = _show_run(settings, ref)
    if settings.json:
        emit_json(document | {"branches": [asdict(course) for course in branches]})
    else:
        words = {"history": history_lines(document["history"])}
        emit("\n\n".join([listing({**document, **words}), *map(branch_text, branches)]))


def names_state(ref: str) -> bool:
    """Whether a reference is to a state rather than a run."""
    if os.path.isdir(ref):
        return False
    return ":" in ref or "@" in ref or ref.endswith((".h5", ".hdf5", ".npz")) or os.path.isfile(ref)


def _show_state(settings: Settings, ref: str) -> dict[str, Any]:
    """All of a state but its arrays."""
    from ribbon_cli.api import open_state
    from ribbon_cli.store import summary

    run, record, path = open_state(ref, settings.runs)
    return {
        **summary(record, run.name if run else None),
        "path": str(path),
        "spectra": _spectra(record),
        "provenance": dict(record.provenance),
    }


def _spectra(record: StateRecord) -> dict[str, Any]:
    """How much of each spectrum is stored, by metric."""
    return {
        spectrum.metric: {
            "modes": len(spectrum.values),
            "complete": spectrum.complete,
            "lowest": spectrum.values[:12].tolist(),
            "labels": list(spectrum.labels[:12]),
        }
        for spectrum in record.spectra
    }


def _show_run(settings: Settings, ref: str) -> tuple[dict[str, Any], tuple[Course, ...]]:
    """A run: what `ribbon ls` says of it, its config, its history apart from states, and its branches."""
    from ribbon_cli.store import find_run
    from ribbon_cli.study import courses

    run = find_run(settings.root, ref)
    facts = _describe(run)
    if facts["damage"]:
        raise StoreError(facts["damage"])
    events = [event for event in run.events() if event["event"] != "state"]
    return facts | {"config": str(run.path / "config.yaml"), "history": events}, courses(run)
