"""Sweeps for programs: the points that a file gives, and the runs that they have."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli import api, plot
from ribbon_cli.api.console import to_standard_error
from ribbon_cli.api.extras import extra
from ribbon_cli.api.gathering import Source, gathered
from ribbon_cli.api.opening import path_text, runs_text
from ribbon_cli.api.sweep_console import sweep_console
from ribbon_cli.api.tables import data_frame
from ribbon_cli.config import Point, load_sweep
from ribbon_cli.errors import UsageError
from ribbon_cli.store import Run, find_sweep, keep_sweep, list_sweeps, record_of, runs_root, suggest
from ribbon_cli.sweeps import SweepEvent, SweepOutcome, executor_for, run_sweep, what_is_left

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True)
class OpenPoint:
    """A point of a sweep: the values that vary, by dotted key, and its run, None where there is none yet.

    `path` is the folder of its run.
    """

    name: str
    values: Mapping[str, Any]
    run: api.OpenRun | None
    path: Path


@dataclass(frozen=True)
class OpenSweep:
    """A sweep's points in order; `groups` are the keys that go together."""

    name: str
    groups: tuple[tuple[str, ...], ...]
    points: tuple[OpenPoint, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary."""
        return tuple(key for group in self.groups for key in group)

    def table(self, all: bool = False, modes: int = 0) -> DataFrame:
        """A row an equilibrium of any of its runs, or a state; the keys that vary come first.

        `modes` is the number of lowest eigenvalues. Raises StoreError, ImportError without pandas.
        """
        pandas = extra("pandas", "sweep.table()")
        return data_frame(pandas, gathered(self._sources(), all, modes))

    def to_xarray(self, modes: int = 0) -> Dataset:
        """The equilibria as a dataset over the keys that vary, by their dotted names.

        Keys that go together share a dimension. Where runs have several half-widths or numbers of segments,
        these are dimensions as well; of several states at one place it is the one that `at` takes. A cell
        has a state only where the run has one at the end of its schedule, and not on the way there. Facts are
        variables; what was not run or not reached is not-a-number, and not certified. Raises UsageError for a
        sweep without such states, StoreError, ConfigError, ImportError without xarray.
        """
        return api.sweep_datasets.dataset(self, modes)

    def plot(
        self,
        kind: str = "table",
        *,
        of: str | None = None,
        over: str | None = None,
        by: Sequence[str] | None = None,
        where: str | None = None,
        style: str = "paper",
        view: tuple[float, float] | None = None,
        width: float | None = None,
        title: str | None = None,
        caption: bool = True,
    ) -> plot.canvas.Figure:
        """A picture as by `ribbon plot`: a figure of matplotlib, which shows itself in notebooks.

        `kind` is table, a field `of` the table `over` another with a curve for each value of `by`, or shapes.
        Raises UsageError.
        """
        api.drawing.check_kind(kind, None, view, None, ())
        choice = plot.fields.Choice(of, over, None if by is None else tuple(by))
        api.drawing.check_choice(kind, choice, where)
        api.drawing.check_title(title)
        look = plot.figure.find_style(style)
        look = look if width is None else plot.style.of_width(look, width)
        source = api.sweep_drawing.source_of_runs(kind, self._sources(), choice, where, view)
        return plot.kinds.draw(kind, source, look).dressed(look, caption, title)

    def _sources(self) -> list[Source]:
        return [Source(p.run or Run(p.path), self.name, p.values) for p in self.points]


def sweep(
    path: str | os.PathLike[str],
    runs: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    dask: str | None = None,
    retry: bool = False,
    progress: Callable[[SweepEvent], object] | bool | None = None,
) -> SweepOutcome:
    """Run every point of SWEEP.yaml, or those that are left, as `ribbon sweep` does.

    `workers` and `dask` are as there: worker processes, by default one a processor; or `local`, the address
    of a scheduler, or a settings file. Points that failed are tried again with `retry`. `progress` is a
    callable that gets every event, True for the progress of the command line, None for silence. Points that
    failed are in the outcome and raise nothing; ConfigError, UsageError, StoreError are raised.
    """
    root = runs_root(runs_text(runs))
    loaded = load_sweep(path_text("path", path))
    everything = range(len(loaded.points))
    left = what_is_left(loaded, record_of(root, loaded), root, everything, retry, sys.argv)
    record = keep_sweep(root, loaded)
    with executor_for(left, workers, dask) as executor, _watched(progress) as shown:
        return run_sweep(record, left, everything, executor, shown)


@contextmanager
def _watched(
    progress: Callable[[SweepEvent], object] | bool | None,
) -> Iterator[Callable[[SweepEvent], object]]:
    """Who hears of a sweep. Raises TypeError for what is no watcher."""
    if progress is True:
        with sweep_console(False, to_standard_error) as shown:
            yield shown
    elif progress is None or progress is False:
        yield lambda _: None
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress must be a callable, True or None, got {type(progress).__name__}")


def points(sweep: str | os.PathLike[str]) -> tuple[Point, ...]:
    """The points that SWEEP.yaml gives: each its values and its config. Raises ConfigError, TypeError."""
    return load_sweep(path_text("sweep", sweep)).points


def open_sweep(name: str, runs: str | os.PathLike[str] | None = None) -> OpenSweep:
    """The sweep that has been run, or begun, under a name, with the runs that its points have.

    `runs` is the folder of the runs, by default RIBBON_RUNS, else ./runs. Raises UsageError where there is no
    such sweep, StoreError for a damaged record, TypeError for arguments of other types.
    """
    root = runs_root(runs_text(runs))
    record = find_sweep(root, path_text("name", name))
    if record is None:
        raise UsageError(f"no sweep {name!r} in {root}{suggest(name, list_sweeps(root))}")
    found = (
        OpenPoint(p.name, p.values, api.OpenRun(p.path) if p.exists else None, p.path) for p in record.points
    )
    return OpenSweep(record.name, record.groups, tuple(found))
