"""An open state: everything that is stored about it, and what can be done with it."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Self

from ribbon_cli import analysis, api, plot, study
from ribbon_cli import export as exports
from ribbon_cli.api import display
from ribbon_cli.api.drawing import Named, figure_of
from ribbon_cli.api.exporting import Exported, export_to
from ribbon_cli.api.following import Followed, contact_request, request
from ribbon_cli.api.watching import Watcher, watched
from ribbon_cli.errors import RibbonWarning, TargetError, UsageError
from ribbon_cli.store import Run, StateRecord

Metric = Literal["physical", "euclidean", "folding"]
Method = Literal["smooth", "split"]
Stop = Literal["fold", "stability-lost", "contact"]


class OpenState(StateRecord):
    """A `StateRecord` that knows its file and its run: it can be drawn, refined, followed and exported.

    `path` is its file, `run` its run, None outside of one. `choice` says which state was taken, and why that
    one, where the reference to it left a choice; else it is empty. A copy with other values, as
    `dataclasses.replace` makes it, has neither run nor file.
    """

    path: Path = Path()
    run: api.OpenRun | None = None
    choice: str = ""

    @classmethod
    def of(cls, record: StateRecord, run: Run | None, path: Path, choice: str = "") -> Self:
        """A record with its place."""
        state = object.__new__(cls)
        place = {"path": path, "run": None if run is None else api.OpenRun.of(run), "choice": choice}
        state.__dict__.update(record.__dict__, **place)  # a record is frozen
        return state

    @property
    def run_name(self) -> str | None:
        """NAME-HASH8 of its run, None outside of one."""
        return None if self.run is None else self.run.name

    def spectrum(self, modes: int = 12, metric: Metric = "physical", full: bool = False) -> api.Spectrum:
        """Eigenvalues with bounds, modes with names and the verdict, computed anew as by `ribbon spectrum`.

        The lowest `modes` and the rotations, or all of them if `full`. What a solve stored is in `spectra`.
        Raises UsageError, TargetError.
        """
        return api.Spectrum(self, analysis.stability_of(self, metric, modes, full), self.run_name)

    def plot(
        self,
        kind: str = "shape",
        *,
        beside: Sequence[OpenState] = (),
        style: str = "paper",
        view: tuple[float, float] | None = None,
        index: int | None = None,
        width: float | None = None,
        title: str | None = None,
        caption: bool = True,
    ) -> plot.canvas.Figure:
        """A picture as by `ribbon plot`: a figure of matplotlib, which shows itself in notebooks.

        `kind` is shape, geometry, multipliers, spectrum, mode or pattern; `beside` are further states, `view`
        azimuth and elevation in degrees, `index` the number of a mode, `width` the picture's in millimetres.
        Its `savefig` writes it. Raises UsageError.
        """
        more = [state._named() for state in beside]
        return figure_of(kind, self._named(), more, style, view, None, index, width, title, caption)

    def refine(
        self,
        to: int | None = None,
        *,
        levels: int | None = None,
        method: Method = "smooth",
        progress: Watcher = None,
    ) -> OpenState:
        """The state on a finer grid, as by `ribbon refine`; it is added to the run, and solved for only once.

        `to` is a number of segments N, `levels` how often to double it. Warns of a result without
        certificate. Raises TargetError where N is not reached, UsageError, StoreError, LockedError.
        """
        run = self._in_a_run("refine")
        with watched(progress) as shown:
            outcome = study.refine_state(
                run.path.parent,
                str(self.path),
                to=to,
                levels=levels,
                method=method,
                progress=shown,
                argv=sys.argv,
            )
        last = outcome.targets[-1]
        if last.label is None:
            raise TargetError("; ".join(outcome.failures) or last.message)
        for failure in outcome.failures:
            warnings.warn(f"{run.name}: {failure}", RibbonWarning, stacklevel=2)
        return run.state(last.label)

    def follow(
        self,
        to: float,
        arclength: bool = False,
        *,
        in_: str | None = None,
        back_to: float | None = None,
        both: bool = False,
        at: Sequence[float] = (),
        stop_at: Sequence[Stop] = (),
        max_step: float | None = None,
        steps: int | None = None,
        switch: int | None = None,
        contact: str | None = None,
        progress: Watcher = None,
    ) -> Followed:
        """Continue the state to the half-width `to`, as by `ribbon continue`; the states join the run.

        With `in_`, `to` is a value of that parameter ("twist"). `contact` is "forces", for a band that rests
        on itself, "gap=0.02", or "record"; None: as the state has it.
        Without `arclength` it goes from minimum to minimum, and ends at the first fold. The options are those
        of the command. The same call resumes. Warns of a branch that breaks off. Raises
        UsageError, StoreError, LockedError.
        """
        run = self._in_a_run("follow")
        wanted = request(to, arclength, back_to, both, at, stop_at, max_step, steps, switch, in_)
        with watched(progress) as shown:
            outcome = study.continue_state(
                run.path.parent,
                str(self.path),
                wanted,
                natural=not arclength,
                contact=contact_request(contact),
                progress=shown,
                argv=sys.argv,
            )
        for failure in outcome.failures:
            warnings.warn(f"{run.name}: {failure}", RibbonWarning, stacklevel=2)
        return Followed(run, outcome)

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        format: str | None = None,
        size: float | None = None,
        thickness: float | None = None,
        paper: str | None = None,
        overwrite: bool = False,
    ) -> Exported:
        """Write the state in the format of the path's suffix, or `format`, as by `ribbon export`.

        Returns the files' names with remarks about them. Warns of a band that meets itself. Raises
        UsageError, StoreError.
        """
        options = exports.formats.Options(size, thickness, paper)
        return export_to(path, format, self._named(), options, overwrite)

    def _named(self) -> Named:
        """The state as a reference names it."""
        return Named(str(self.path), self.run, (self,))

    def _in_a_run(self, what: str) -> api.OpenRun:
        """The run that results are added to. Raises UsageError for a state outside a run."""
        if self.run is None:
            raise UsageError(f"{self.path}: not in a run: {what} adds its results to the state's run")
        return self.run

    def __repr__(self) -> str:
        return display.state_text(self)

    def _repr_html_(self) -> str:
        return display.state_html(self)
