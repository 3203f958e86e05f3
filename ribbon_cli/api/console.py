"""Progress of a solve on standard error: a bar on a terminal, a line for each stage elsewhere.

Both follow the protocol `ribbon_cli.study.Progress`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ribbon_cli import digits
from ribbon_cli.digits import duration
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

    from ribbon_cli.study import Progress


def _to_standard_error(text: str) -> None:
    """Write a line where people look for messages; where nobody can read it, nothing happens."""
    if sys.stderr is not None:
        with suppress(OSError):
            sys.stderr.write(visible(text, "\n\t") + "\n")
            sys.stderr.flush()


@contextmanager
def console(verbose: bool = False, write: Callable[[str], object] = _to_standard_error) -> Iterator[Progress]:
    """The progress of the command line, to hand to a study; `write` is where its lines go."""
    if _on_terminal():
        with _bar() as bar:
            yield Bar(bar, verbose)
    else:
        yield Lines(verbose, write)


def _on_terminal() -> bool:
    """Whether standard error is a terminal that can redraw a line."""
    if sys.stderr is None or os.environ.get("TERM", "") in ("", "dumb", "unknown"):
        return False
    return sys.stderr.isatty()


@dataclass
class _Stage:
    """The stage under way, and its last Newton step (`iteration` 0: none yet).

    `written` tells that a note has made the stage's line come early.
    """

    name: str = ""
    index: int = 0
    total: int = 0
    half_width: float = 0.0
    segments: int = 0
    iteration: int = 0
    energy: float = 0.0
    residual: float = 0.0
    started: float = field(default_factory=time.monotonic)
    written: bool = False

    @property
    def heading(self) -> str:
        """Which of how many stages this is, and where it is."""
        width = len(str(self.total))
        place = f"b = {self.half_width:g}, N = {self.segments}"
        # Some stages are named by where they end.
        name = "" if self.name.startswith("b = ") else f"{self.name}: "
        return f"[{self.index:{width}}/{self.total}] {name}{place}"

    def step_line(self) -> str:
        """The last step."""
        return f"    step {self.iteration}: E = {digits.energy(self.energy)}, residual {self.residual:.1e}"

    def line(self) -> str:
        """The whole stage, once it is over."""
        if not self.iteration:
            return f"{self.heading}: no steps"
        result = f"E = {digits.energy(self.energy)}, residual {self.residual:.1e}"
        steps = f"{self.iteration} step{'s' * (self.iteration > 1)}"
        return f"{self.heading}: {result}, {steps}, {duration(time.monotonic() - self.started)}"


class Lines:
    """A line for each stage when it is over; every step as well if `verbose`.

    Stages without a step, such as those that a resumed run has already, share a line unless `verbose`.
    """

    def __init__(self, verbose: bool = False, write: Callable[[str], object] = _to_standard_error) -> None:
        self._verbose = verbose
        self._put = write
        self._current = _Stage()
        self._idle: list[_Stage] = []

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """A stage begins, which ends the one before."""
        self._end_stage()
        self._current = _Stage(name, index, total, half_width, segments)

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """A Newton step was taken."""
        current = self._current
        current.iteration, current.energy, current.residual = iteration, energy, residual
        if half_width is not None:
            current.half_width = half_width
        if self._verbose:
            self._write(current.step_line())

    def note(self, text: str) -> None:
        """Something worth a line of its own happened: the line of its stage comes first."""
        if self._current.index and not self._current.written:
            self._flush_idle()
            self._show_stage(self._current)
        self._write(f"    {text}")

    def done(self) -> None:
        """The last stage is over."""
        self._end_stage()
        self._flush_idle()

    def _end_stage(self) -> None:
        """Write the line of the stage under way, if there is one."""
        ended, self._current = self._current, _Stage()
        if not ended.index or ended.written:
            return
        if ended.iteration or self._verbose:
            self._flush_idle()
            self._show_stage(ended)
        else:
            self._idle.append(ended)

    def _show_stage(self, stage: _Stage) -> None:
        """Write a stage's line."""
        stage.written = True
        self._write(stage.line())

    def _flush_idle(self) -> None:
        """Write the line that stages without a step share."""
        idle, self._idle = self._idle, []
        if len(idle) == 1:
            self._write(idle[0].line())
        elif idle:
            self._write(f"[{idle[0].index}-{idle[-1].index}/{idle[-1].total}] no steps")

    def _write(self, text: str) -> None:
        self._put(text)


class Bar(Lines):
    """One line that is redrawn, with stage, energy, residual and time left; notes stay above it."""

    def __init__(self, bar: RichProgress, verbose: bool = False) -> None:
        super().__init__(verbose)
        self._bar = bar
        self._task = bar.add_task("", total=None, figures="")

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """A stage begins: the bar stands at the stages before it."""
        super().stage(name, index, total, half_width, segments)
        heading = visible(self._current.heading)
        self._bar.update(self._task, description=heading, total=total, completed=index - 1, figures="")

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """A Newton step was taken."""
        super().step(iteration, energy, residual, half_width)
        self._bar.update(self._task, figures=f"E = {digits.energy(energy)}  {residual:.1e}")

    def _end_stage(self) -> None:
        """Move the bar on, whether or not the stage leaves a line."""
        if self._current.index:
            self._bar.update(self._task, completed=self._current.index)
        super()._end_stage()

    def _show_stage(self, stage: _Stage) -> None:
        """Only those who want every step want lines that stay."""
        if self._verbose:
            super()._show_stage(stage)

    def _flush_idle(self) -> None:
        """The bar stands where it stands."""
        self._idle = []

    def _write(self, text: str) -> None:
        self._bar.console.print(visible(text, "\n"), markup=False, highlight=False, soft_wrap=True)


def _bar() -> RichProgress:
    """An empty bar on standard error; it vanishes when it is over."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.table import Column

    return Progress(
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
        BarColumn(bar_width=None, table_column=Column(ratio=1, min_width=4)),
        TextColumn("{task.fields[figures]}", markup=False, table_column=Column(no_wrap=True)),
        TimeRemainingColumn(compact=True),
        console=Console(stderr=True),
        expand=True,
        transient=True,
        refresh_per_second=4,
    )
