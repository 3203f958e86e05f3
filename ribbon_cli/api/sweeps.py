"""Sweeps for programs: the points that a file gives, and the runs that they have."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ribbon_cli import api, plot, sweeps
from ribbon_cli.api.extras import extra
from ribbon_cli.api.gathering import Source, gathered
from ribbon_cli.api.opening import path_text, runs_text
from ribbon_cli.api.tables import data_frame
from ribbon_cli.config import Point, load_sweep
from ribbon_cli.errors import RibbonWarning, UsageError
from ribbon_cli.store import find_sweep, keep_sweep, list_sweeps, runs_root, suggest

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True)
class OpenPoint:
    """A point of a sweep: the values that vary, by dotted key, and its run, None where there is none yet."""

    name: str
    values: Mapping[str, Any]
    run: api.OpenRun | None


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
        these are dimensions as well; of several states at one place it is the one that `at` takes. Facts are
        variables; what has not been run is not-a-number. Raises UsageError for a sweep without equilibria,
        StoreError, ImportError without xarray.
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
        return [Source(p.run, self.name, p.values) for p in self.points if p.run is not None]


def points(sweep: str | os.PathLike[str]) -> tuple[Point, ...]:
    """The points that SWEEP.yaml gives: each its values and its config. Raises ConfigError, TypeError."""
    return load_sweep(path_text("sweep", sweep)).points


def run_sweep(
    sweep: str | os.PathLike[str],
    runs: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    retry: bool = False,
) -> OpenSweep:
    """Run what is left of a SWEEP.yaml's points, and open the sweep; the same call again resumes.

    Points are run in this process or, with `workers`, in so many of their own: then the calling script needs
    `if __name__ == "__main__":` around what it does. `retry` tries points again that failed; those that
    failed are warned of. Raises ConfigError, StoreError, TypeError.
    """
    loaded, root = load_sweep(path_text("sweep", sweep)), runs_root(runs_text(runs))
    points = range(len(loaded.points))
    record = keep_sweep(root, loaded)
    left = sweeps.what_is_left(loaded, record, root, points, retry, sys.argv)
    with sweeps.executor_for(left, workers, None, here=workers is None) as executor:
        outcome = sweeps.run_sweep(record, left, points, executor, lambda _: None)
    for run, why in outcome.failures:
        warnings.warn(f"{run}: {why}", RibbonWarning, stacklevel=2)
    return open_sweep(record.name, root)


def open_sweep(name: str, runs: str | os.PathLike[str] | None = None) -> OpenSweep:
    """The sweep that has been run, or begun, under a name, with the runs that its points have.

    `runs` is the folder of the runs, by default RIBBON_RUNS, else ./runs. Raises UsageError where there is no
    such sweep, StoreError for a damaged record, TypeError for arguments of other types.
    """
    root = runs_root(runs_text(runs))
    record = find_sweep(root, path_text("name", name))
    if record is None:
        raise UsageError(f"no sweep {name!r} in {root}{suggest(name, list_sweeps(root))}")
    found = (OpenPoint(p.name, p.values, api.OpenRun(p.path) if p.exists else None) for p in record.points)
    return OpenSweep(record.name, record.groups, tuple(found))
