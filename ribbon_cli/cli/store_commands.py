"""`ribbon ls` and `ribbon show`: what is in the store."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import click

from ribbon_cli import api, store, study, sweeps
from ribbon_cli.cli.completion import complete_any, complete_kind, complete_listed, complete_status
from ribbon_cli.cli.output import complain, emit, emit_json, say, teller
from ribbon_cli.cli.render import (
    branch_text,
    certificate_in_words,
    counts_text,
    history_lines,
    listing,
    number,
    points_table,
    runs_table,
    states_table,
    status_in_words,
)
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import StoreError, UsageError

_WHOLE_CONFIGS = ("config_text", "config_resolved")
"""Provenance that only `--json` shows."""


@click.command()
@click.argument("run", metavar="[RUN|SWEEP]", required=False, shell_complete=complete_listed)
@click.option(
    "--all", "everything", is_flag=True, help="All kinds of state; all runs, including those set aside."
)
@click.option(
    "--status", metavar="WORD", shell_complete=complete_status, help="Only runs, or states, with this status."
)
@click.option("--kind", metavar="KIND", shell_complete=complete_kind, help="Only states of this kind.")
@common_options
@pass_settings
def ls(settings: Settings, run: str | None, everything: bool, status: str | None, kind: str | None) -> int:
    """List runs, equilibria of a RUN, or points of a SWEEP.

    For each run it shows how many of the equilibria that the config asks for are done, running, waiting or
    failed. RUN@b=0.5 and RUN@b=0.5,N=400 list the states of a width or mesh. For each point of a
    sweep it shows whether it is done, failed and why, running, unfinished or missing.
    """
    record = None if run is None else store.find_sweep(settings.root, run)
    if record is not None:
        return _list_points(settings, record, everything, status, kind)
    if run is not None:
        return _list_states(settings, run, everything, status, kind)
    if kind is not None:
        raise UsageError("--kind is of states: name a run as well")
    if status is not None:
        _known("status", status, study.RUN_STATUSES)
    runs = [study.standing(item) for item in store.list_runs(settings.root, aside=everything)]
    damaged = [item.damage for item in runs if item.damage]
    runs = [item for item in runs if status is None or item.status == status]
    if settings.json:
        emit_json([item.to_dict() for item in runs])
    elif runs:
        emit(runs_table(runs))
    else:
        what = "no runs" if status is None else f"no runs with status {status}"
        say(settings, f"{what} in {settings.root} (see --runs)")
    for line in damaged:
        complain(f"ribbon: {line}")
    return StoreError.exit_code if damaged else 0


def _list_points(
    settings: Settings, record: store.SweepRecord, everything: bool, status: str | None, kind: str | None
) -> int:
    """List the points of a sweep."""
    if kind is not None or everything:
        raise UsageError(f"--kind and --all are of states: {record.name} is a sweep; name one of its runs")
    if status is not None:
        _known("status", status, sweeps.POINT_STATUSES)
    points = sweeps.standings(record)
    shown = [point for point in points if status is None or point.status == status]
    if settings.json:
        emit_json([point.to_dict() for point in shown])
    elif shown:
        emit(f"{points_table(shown)}\n\n{counts_text(sweeps.counts(points))}")
    else:
        say(settings, f"no points with status {status} in {record.name}")
    return 0


def _list_states(settings: Settings, ref: str, everything: bool, status: str | None, kind: str | None) -> int:
    """List a run's states that the filters leave."""
    if kind is not None:
        _known("kind", kind, store.KINDS)
    if status is not None:
        _known("status", status, study.STATE_STATUSES)
    run, states = store.find_states(settings.root, ref, everything or kind is not None)
    states, lost = api.tables.as_found(run, states)
    shown = [
        state
        for state in states
        if (status is None or state.status == status) and (kind is None or state.kind == kind)
    ]
    if settings.json:
        emit_json([state.listed(run.name) for state in shown])
    elif shown:
        emit(states_table(shown, kinds=everything or kind is not None))
    else:
        say(settings, _emptiness(run) if not states else f"{run.name} has no such states")
    for line in api.tables.damage_in_words(run, lost):
        complain(f"ribbon: {line}")
    return StoreError.exit_code if lost else 0


def _known(name: str, word: str, known: Iterable[str]) -> None:
    """Refuse an option's value that cannot match anything. Raises UsageError."""
    if word not in known:
        raise UsageError(f"--{name}: {word!r} is none of {', '.join(known)}{store.suggest(word, known)}")


def _emptiness(run: store.Run) -> str:
    """Why a run's listing is empty."""
    if run.states():
        return f"{run.name} has no such states"
    if run.entries():
        return store.refs.no_equilibria(run)
    return f"{run.name} has no states yet"


@click.command()
@click.argument("ref", metavar="RUN|STATE", shell_complete=complete_any)
@common_options
@pass_settings
def show(settings: Settings, ref: str) -> None:
    """Show a state and its certificate, or a run.

    For a state: everything except its arrays. For a run: its config, history and branches.
    """
    (_show_state if store.names_state(ref) else _show_run)(settings, ref)


def _show_state(settings: Settings, ref: str) -> None:
    """Show everything about a state except its arrays; whole configs only in JSON."""
    run, record, path = api.open_state(ref, settings.runs, teller(settings))
    document = {
        **store.Summary.of(record).listed(run.name if run else None),
        "path": str(path),
        **({} if record.contacts is None else {"contact_pairs": _contact_pairs(record.contacts)}),
        "spectra": _spectra(record),
        "provenance": dict(record.provenance),
    }
    if settings.json:
        emit_json(document)
        return
    facts = {key: value for key, value in record.provenance.items() if key not in _WHOLE_CONFIGS}
    words = {"status": status_in_words(record), "certified": certificate_in_words(record)}
    del document["event_kinds"]  # people read the events' sentences
    shown = document | words | {"provenance": facts}
    if record.contacts is not None and not len(record.contacts):
        del shown["contact_pairs"]
    elif record.contacts is not None:
        forces = zip(record.contacts.names(), record.contacts.force.tolist(), strict=True)
        shown["contact_pairs"] = {name: f"force {number(force, '.6g')}" for name, force in forces}
    # Between separated ends no curves are linked: what is stored is Tw + Wr.
    names = {"linking_number": "twist_plus_writhe"} if record.parts.ends is not None else {}
    emit(listing({names.get(key, key): value for key, value in shown.items()}))


def _contact_pairs(contacts: store.Contacts) -> list[dict[str, Any]]:
    """Each contact for a program: its features (kind and number, from 0), force and gap."""
    columns = {
        "pair": contacts.names(),
        **{name: getattr(contacts, name).tolist() for name in ("first", "second", "sign", "force", "value")},
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _spectra(record: store.StateRecord) -> dict[str, Any]:
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


def _show_run(settings: Settings, ref: str) -> None:
    """Show what `ribbon ls` says of a run, its config, its history apart from states, and its branches."""
    run = store.find_run(settings.root, ref)
    facts = study.standing(run)
    if facts.damage:
        raise StoreError(facts.damage)
    events = [event for event in run.events() if event.kind != "state"]
    branches, document = study.courses(run), facts.to_dict() | {"config": str(run.path / "config.yaml")}
    if settings.json:
        history = {"history": [event.document for event in events]}
        emit_json(document | history | {"branches": [course.to_dict() for course in branches]})
    else:
        numbered = (f"{k}. {branch_text(course)}" for k, course in enumerate(branches, start=1))
        del document["not_reached"]  # told above, with how many there are
        listed = listing({**document, "history": history_lines(events)})
        emit("\n\n".join([*facts.failures, listed, *numbered]))
