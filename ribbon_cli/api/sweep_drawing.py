"""From sweeps and runs beside each other to the source of a picture."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ribbon_cli import analysis, export, plot
from ribbon_cli.api.gathering import Source, gathered, sources
from ribbon_cli.errors import UsageError
from ribbon_cli.report.rows import Rows
from ribbon_cli.store import StateRecord

_EIGENVALUE = re.compile(r"eigenvalue_(\d{1,3})")


def source_of(
    kind: str,
    root: Path,
    names: Iterable[str],
    choice: plot.fields.Choice,
    where: str | None,
    angles: tuple[float, float] | None = None,
) -> plot.kinds.Source:
    """What a picture of runs and sweeps shows, by their names. Raises UsageError, StoreError."""
    return source_of_runs(kind, sources(root, names), choice, where, angles)


def source_of_runs(
    kind: str,
    found: Sequence[Source],
    choice: plot.fields.Choice,
    where: str | None,
    angles: tuple[float, float] | None = None,
) -> plot.kinds.Source:
    """The same of the runs. Raises UsageError, StoreError."""
    if kind not in ("table", "shapes"):
        raise UsageError(f"{kind} shows one run: sweeps have the kinds table and shapes")
    rows = gathered(found, modes=_modes(choice, where)).where(where)
    if not rows.rows:
        raise UsageError("there are no equilibria to draw" + (f" where {where}" if where else ""))
    states = _shapes(found, rows) if kind == "shapes" else []
    return plot.kinds.Source(
        None,
        tuple(record for record, _ in states),
        analysis.run_table,
        analysis.multiplier_curves,
        angles=angles,
        names=tuple(name for _, name in states),
        rows=rows,
        choice=choice,
    )


def _modes(choice: plot.fields.Choice, where: str | None) -> int:
    """How many eigenvalues a picture needs."""
    texts = [choice.of or "", choice.over or "", *(choice.by or ()), where or ""]
    return max((int(number) for text in texts for number in _EIGENVALUE.findall(text)), default=0)


def _shapes(found: Sequence[Source], rows: Rows) -> list[tuple[StateRecord, str]]:
    """The shapes of the finest mesh of each run and place, each with what tells it from the others.

    A state that several runs have, as the start of their schedules, comes once.
    """
    kept = {row["state"]: row for row in rows.rows}
    runs = {source.run.path: source.run for source in found if source.begun}.values()
    keys = [key for key in plot.fields.keys_apart(rows) if key != "segments"]
    states, seen = [], set()
    for run in runs:
        for state in export.series.finest(run) if run.states() else ():
            row = kept.get(f"{run.name}:{state.label}")
            if row is not None and state.content_sha256 not in seen:
                seen.add(state.content_sha256)
                told = [_told(key, row[key]) for key in keys] or [plot.labels.plain(run.short_name)]
                states.append((run.load(state.label), ", ".join(told)))
    if not states:
        raise UsageError("shapes: the condition leaves out all states of the finest meshes")
    return states


def _told(key: str, value: object) -> str:
    return f"{plot.fields.axis_text(key)} = {plot.fields.value_text(value)}"
