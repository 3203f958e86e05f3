"""An open run: its states as tables and grids, one by one, and in pictures."""

from __future__ import annotations

import operator
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from ribbon_cli import analysis, api, plot
from ribbon_cli import export as exports
from ribbon_cli.api import display
from ribbon_cli.api.drawing import Named, figure_of
from ribbon_cli.api.exporting import Exported, export_to
from ribbon_cli.api.opening import path_text, runs_text
from ribbon_cli.api.tables import as_found, damage_in_words, frame
from ribbon_cli.errors import RibbonWarning, UsageError
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.store import Run, Summary, find_run, names_state, runs_root, suggest
from ribbon_cli.store.refs import select

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

    from ribbon_cli.report.convergence import Table


def open(run: str | os.PathLike[str] | Run, runs: str | os.PathLike[str] | None = None) -> OpenRun:
    """Open a run by its name, a unique prefix of it, or its folder; or one that an outcome holds.

    `runs` is the folder of the runs, by default RIBBON_RUNS, else ./runs. Raises UsageError where none or
    more than one fits, TypeError for arguments of other types.
    """
    if isinstance(run, Run):
        return OpenRun.of(run)
    text = path_text("run", run)
    if isinstance(run, os.PathLike):
        return OpenRun(Run.open(text).path)
    if names_state(text) and ("@" in text or ":" in text):
        raise UsageError(f"{text!r} names a state: open its run, then use at() or state()")
    return OpenRun.of(find_run(runs_root(runs_text(runs)), text))


class OpenRun(Run):
    """A run with the methods for programs and notebooks."""

    @classmethod
    def of(cls, run: Run) -> Self:
        """The same run."""
        return run if isinstance(run, cls) else cls(run.path)

    def found(self, all: bool = False) -> tuple[list[Summary], dict[int, str]]:
        """Summaries of the equilibria or of all states, and a word on each whose file is not as committed.

        Raises StoreError for a damaged log.
        """
        return as_found(self, self.states(all=all))

    def table(self, all: bool = False) -> DataFrame:
        """A row an equilibrium, or a state of any kind; columns are the fields of `ribbon ls --json`.

        A state whose file is not what was committed has no certificate there, and is warned of. Raises
        StoreError for a damaged log, ImportError without pandas.
        """
        states, lost = self.found(all)
        for line in damage_in_words(self, lost):
            warnings.warn(line, RibbonWarning, stacklevel=2)
        return frame(self, states, "run.table()")

    def to_xarray(self, grid: bool | None = None, modes: int = 12) -> Dataset:
        """The equilibria as a dataset: facts as variables over half-width and N, or over labels.

        They are over half-width and N where no two share both, or if `grid` is True, and then of several the
        one that `at` takes; else over labels. It holds the lowest `modes` eigenvalues of the stored spectra;
        for 0 no spectrum is read. Raises UsageError for a run without equilibria, StoreError for a damaged
        one, ImportError without xarray.
        """
        return api.datasets.dataset(self, grid, modes)

    def convergence(self) -> Table:
        """Energies under refinement as in `ribbon convergence-table`: rows, and an extrapolation for each b.

        Raises StoreError for a damaged log.
        """
        return analysis.run_table(self)

    def at(self, b: float | None = None, N: int | None = None, **parameters: float) -> api.OpenState:
        """The equilibrium that `RUN@b=...,shear=...,N=...` names in a command; any part may be left out.

        Other parameters that are left out have the last value in the config. Of several it is the latest of
        the finest certified ones; `choice` of the state says which was taken. Warns where that has no
        certificate. Raises UsageError, which says what there is, StoreError.
        """
        if b is None and N is None and not parameters:
            raise UsageError("at() needs b, N or both")
        for name in parameters:
            if name not in PARAMETERS:
                hint = suggest(name, ("b", "N")) or suggest(name.upper(), "N") or suggest(name, PARAMETERS)
                raise UsageError(f"at(): no parameter {name!r}{hint}")
        values = {name: _real(value) for name, value in parameters.items()}
        values |= {} if b is None else {HALF_WIDTH: _real(b)}
        found, choice = select(self, values, None if N is None else operator.index(N))
        if not found.certified:
            warnings.warn(f"{self.name}: {choice}", RibbonWarning, stacklevel=2)
        return self.state(found.label, choice)

    def state(self, label: int, choice: str = "") -> api.OpenState:
        """The state with a label, of whatever kind. Raises UsageError, StoreError."""
        label = operator.index(label)
        return api.OpenState.of(self.load(label), self, self.state_path(label), choice)

    def plot(
        self,
        kind: str,
        *,
        beside: Sequence[Run] = (),
        style: str = "paper",
        view: tuple[float, float] | None = None,
        segments: int | None = None,
        width: float | None = None,
        title: str | None = None,
        caption: bool = True,
    ) -> plot.canvas.Figure:
        """A picture as by `ribbon plot`: a figure of matplotlib, which shows itself in notebooks.

        `kind` is geometry, multipliers, spectrum, convergence, branch or family; `beside` are further runs,
        `segments` the N of the states. Raises UsageError.
        """
        more = [Named(run.name, run) for run in beside]
        return figure_of(kind, self._named(), more, style, view, segments, None, width, title, caption)

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        format: str | None = None,
        segments: int | None = None,
        overwrite: bool = False,
    ) -> Exported:
        """Write the states of one N, by width, as vtkhdf or html. Raises UsageError, StoreError."""
        return export_to(path, format, self._named(), exports.formats.Options(segments=segments), overwrite)

    def _named(self) -> Named:
        """The run as a reference names it."""
        return Named(self.name, self)

    def __reduce__(self) -> tuple[type[Self], tuple[Path]]:
        """To another process it goes by its folder, and its log is read there."""
        return type(self), (self.path,)

    def __repr__(self) -> str:
        return display.run_text(self)

    def _repr_html_(self) -> str:
        return display.run_html(self)


def _real(b: float) -> float:
    """A half-width as a float. Raises TypeError for texts and truth values."""
    if isinstance(b, bool | str):
        raise TypeError(f"b must be a number, got {b!r}")
    return float(b)
