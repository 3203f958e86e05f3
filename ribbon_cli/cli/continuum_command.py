"""`ribbon verify --continuum`: how far discrete states are from the continuum, and at which order."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ribbon_cli import analysis, api, report, store
from ribbon_cli.cli.output import complain, emit, emit_json, teller
from ribbon_cli.cli.settings import Settings
from ribbon_cli.errors import TargetError, UsageError


def show_continuum(settings: Settings, ref: str) -> int:
    """Print what a state, or the states of a run over N, say of the continuum; return the exit code.

    Equilibria without certificate are named on standard error, and make it 3, but for points of a branch.
    Those may be unstable. Raises UsageError for a reference to nothing, to an auxiliary state or to a run
    without equilibria.
    """
    if ref == "all":
        raise UsageError("--continuum needs a RUN or a STATE: name one (`ribbon ls` lists the runs)")
    show = _show_state if store.names_state(ref) else _show_run
    document, text, uncertified = show(settings, ref)
    emit_json(document) if settings.json else emit(text)
    for name in uncertified:
        complain(f"ribbon: {name}: no certificate")
    return TargetError.exit_code if uncertified else 0


def _show_state(settings: Settings, ref: str) -> tuple[dict[str, Any], str, list[str]]:
    """One state as a document and as text; its name if it is an equilibrium without certificate."""
    run, record, path = api.open_state(ref, settings.runs, teller(settings))
    name = f"{run.short_name}:{record.label}" if run else str(path)
    found = analysis.continuum_of(record, name)
    failed = record.kind == "equilibrium" and not record.certified and record.branch is None
    document = {"run": run.name if run else None, **asdict(found)}
    return document, report.continuum.state_text(found), [name] if failed else []


def _show_run(settings: Settings, ref: str) -> tuple[dict[str, Any], str, list[str]]:
    """A run's tables over N as a document and as text; the states without certificate."""
    run = store.find_run(settings.root, ref)
    found = analysis.continuum_of_run(run)
    if not found:
        raise UsageError(store.refs.no_equilibria(run))
    tables = report.continuum.order_tables(found)
    followed = {state.label for state in run.states() if state.branch is not None}
    failed = [
        f"{run.short_name}:{state.label}"
        for state in found
        if not state.certified and state.label not in followed
    ]
    document = {"run": run.name, "tables": [asdict(table) for table in tables]}
    return document, report.continuum.tables_text(tables), failed
