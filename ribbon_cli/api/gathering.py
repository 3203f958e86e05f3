"""One table over runs and sweeps: a row a state, from the logs; only eigenvalues are read from the states."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.api.aims import Aims, is_leading, repeats
from ribbon_cli.api.extras import extra
from ribbon_cli.api.opening import path_text, runs_text
from ribbon_cli.api.tables import as_found, column_types, data_frame, flat
from ribbon_cli.errors import UsageError
from ribbon_cli.report.rows import Column, Rows
from ribbon_cli.store import Run, Summary, find_run, find_sweep, list_sweeps, runs_root, suggest
from ribbon_cli.store.folder import is_run
from ribbon_cli.text import listed

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN = ("half_width", "segments", "energy", "status", "certified", "self_contact")
"""Columns that people see beside what varies and what names a state."""


@dataclass(frozen=True)
class Source:
    """A run, and where it is a sweep's point the sweep and the values that vary, by dotted key.

    Such a run need not have begun.
    """

    run: Run
    sweep: str | None = None
    values: Mapping[str, Any] | None = None

    @property
    def begun(self) -> bool:
        """Whether there is a run yet."""
        return self.sweep is None or is_run(self.run.path)


def sources(root: Path, names: Iterable[str]) -> list[Source]:
    """The runs that names of runs and sweeps stand for, each once. Raises UsageError, StoreError."""
    found: dict[Path, Source] = {}
    for name in names:
        for source in _named(root, name):
            found.setdefault(source.run.path, source)
    return list(found.values())


def _named(root: Path, name: str) -> Iterator[Source]:
    sweep = find_sweep(root, name)
    if sweep is not None:
        yield from (Source(Run(p.path), sweep.name, p.values) for p in sweep.points)
        return
    try:
        yield Source(find_run(root, name))
    except UsageError as error:
        near = suggest(name, list_sweeps(root))
        raise UsageError(f"{error}{near}") from error


def gathered(found: Sequence[Source], all: bool = False, modes: int = 0) -> Rows:
    """A row for each equilibrium of these runs, or each state; with `modes` the lowest eigenvalues stored.

    A state whose file is not what was committed has that word as its status, and no certificate. A key that
    varies is None beside a state of which it is not true. Raises StoreError for a damaged log, and of sweeps
    StoreError, ConfigError for a run's config that cannot be read.
    """
    begun = [source for source in found if source.begun]
    keys = list(dict.fromkeys(key for source in begun for key in source.values or ()))
    states: list[tuple[Source, Summary]] = []
    for source in begun:
        summaries, _ = as_found(source.run, source.run.states(all=all))
        states += [(source, state) for state in summaries]
    known = column_types([state for _, state in states])
    aims = {source.run.path: Aims.of(source.run) for source in begun if source.sweep is not None}
    rows = [_row(source, state, modes, aims.get(source.run.path)) for source, state in states]
    columns = [Column("state", "utf-8", False)]
    if keys:
        own = [key for key in keys if key not in known]  # others, as the length, states have themselves
        values = [source.values or {} for source in begun]
        columns += [Column("sweep", "utf-8"), *(key_column(key, values) for key in own)]
    columns += [Column(name, dtype, optional) for name, (dtype, optional) in known.items()]
    columns += [Column(f"eigenvalue_{k}", "float64") for k in range(1, modes + 1)]
    moved = [name for name in known if name.startswith("parameter_")]
    kinds = ["kind"] if all else []
    shown = ["state", *keys, *kinds, *(name for name in (*SHOWN[:1], *moved, *SHOWN[1:]) if name not in keys)]
    shown += [f"eigenvalue_{k}" for k in range(1, modes + 1)]
    leading = tuple(filter(is_leading, keys))
    telling = [key for key in keys if key not in leading or any(not repeats(key, row) for row in rows)]
    apart = [*telling, *(name for name in ("half_width", *moved, "segments") if name not in keys)]
    return Rows(tuple(columns), tuple(rows), tuple(shown), tuple(apart), leading, tuple(_missed(found, aims)))


def _missed(found: Sequence[Source], aims: Mapping[Path, Aims]) -> Iterator[str]:
    """A sentence on each sweep some of whose points have no state where their configs lead."""
    for sweep in dict.fromkeys(source.sweep for source in found if source.sweep is not None):
        points = [source for source in found if source.sweep == sweep]
        begun = [source.run for source in points if source.begun]
        missed = [run.short_name for run in begun if aims[run.path].missed(run.states())]
        words = []
        if missed:
            words.append(f"targets not reached at {len(missed)} of {len(points)} points: {listed(missed)}")
        if len(begun) < len(points):
            words.append(f"{len(points) - len(begun)} of {len(points)} points not run yet")
        if words:
            yield f"{sweep}: {'; '.join(words)}"


def _row(source: Source, state: Summary, modes: int, aims: Aims | None) -> dict[str, Any]:
    run, values = source.run, source.values or {}
    row = {
        key: spelled(value) if aims is None or aims.holds(key, value, state) else None
        for key, value in values.items()
    }
    row |= {"state": f"{run.name}:{state.label}", "sweep": source.sweep, **flat(state, run.name)}
    if modes:
        row |= {f"eigenvalue_{k}": value for k, value in enumerate(lowest(run, state, modes), start=1)}
    return row


def spelled(value: Any) -> Any:
    """A value that varies as a cell holds it: lists and sections as text."""
    return value if isinstance(value, bool | int | float | str) else str(value)


def key_column(key: str, rows: Sequence[Mapping[str, Any]]) -> Column:
    """The column of a key that varies: whole numbers where all are, else float64, else texts."""
    types = {type(spelled(row[key])) for row in rows if key in row}
    if types <= {bool}:
        return Column(key, "bool")
    if types <= {int, float}:
        return Column(key, "int64" if types == {int} and not key.endswith("half_width") else "float64")
    return Column(key, "utf-8")


def lowest(run: Run, state: Summary, modes: int) -> list[float]:
    """The lowest stored eigenvalues besides rotations, in the physical metric where that is stored."""
    spectra = {spectrum.metric: spectrum for spectrum in run.load(state.label).spectra}
    found = spectra.get("physical") or next(iter(spectra.values()), None)
    if found is None:
        return []
    pairs = zip(found.values, found.labels, strict=True)
    return [float(value) for value, label in pairs if label != "rotation"][:modes]


def table(
    *names: str,
    where: str | None = None,
    all: bool = False,
    modes: int = 0,
    runs: str | os.PathLike[str] | None = None,
) -> DataFrame:
    """One data frame over runs and sweeps, as `ribbon table` makes it: a row a state.

    `where` is a condition such as "energy < 5 and certified", `modes` the number of lowest eigenvalues.
    Raises UsageError, StoreError, ImportError without pandas.
    """
    if not names:
        raise UsageError("table() needs the name of a run or a sweep")
    root = runs_root(runs_text(runs))
    found = gathered(sources(root, [path_text("name", name) for name in names]), all, modes).where(where)
    return data_frame(extra("pandas", "table()"), found)
