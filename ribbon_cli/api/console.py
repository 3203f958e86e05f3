"""Progress of a solve on standard error: a bar on a terminal, a line for each stage elsewhere.

Both are a `ribbon_cli.study.Progress`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ribbon_cli import digits
from ribbon_cli.digits import duration
from ribbon_cli.study.progress import Event, Note, Progress, Stage, Step
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress


def _to_standard_error(text: str) -> None:
    """Write a line where people look for messages; where nobody can read it, nothing happens."""
    if sys.stderr is not None:
        with suppress(OSError):
            sys.stderr.write(visible(text, "\n\t") + "\n")
            sys.stderr.flush()


@contextmanager
def console(verbose: bool = False, write: Callable[[str], object] = _to_standard_error) -> Iterator[Progress]:
    """The progress of the command line, to hand to a study; `write` is where its lines go."""
    with _bar() if _on_terminal() else nullcontext() as bar:
        shown = Lines(verbose, write) if bar is None else Bar(bar, verbose)
        try:
            yield shown
        finally:
            shown.done()


def _on_terminal() -> bool:
    """Whether standard error is a terminal that can redraw a line."""
    if sys.stderr is None or os.environ.get("TERM", "") in ("", "dumb", "unknown"):
        return False
    return sys.stderr.isatty()


@dataclass
class _Current:
    """The stage under way, and its last Newton step, None before the first.

    `written` tells that a note has made the stage's line come early.
    """

    stage: Stage
    last: Step | None = None
    started: float = field(default_factory=time.monotonic)
    written: bool = False

    @property
    def moved(self) -> bool:
        """Whether a step was taken; the point that a solve begins at is told as its step 0."""
        return self.last is not None and self.last.iteration > 0

    @property
    def heading(self) -> str:
        """Which of how many stages this is, and where it is."""
        stage, found = self.stage, None if self.last is None else self.last.half_width
        moved = f", {self.last.place}" if self.last and self.last.place else ""
        place = f"b = {stage.half_width if found is None else found:g}{moved}, N = {stage.segments}"
        # Some stages are named by where they end.
        name = "" if stage.name.startswith("b = ") else f"{stage.name}: "
        return f"{stage.count} {name}{place}"

    def line(self) -> str:
        """The whole stage, once it is over."""
        if self.last is None or not self.moved:
            return f"{self.heading}: no steps"
        _, figures = str(self.last).split(": ", 1)
        steps = f"{self.last.iteration} step{'s' * (self.last.iteration > 1)}"
        return f"{self.heading}: {figures}, {steps}, {duration(time.monotonic() - self.started)}"


class Lines:
    """A line for each stage when it is over; every step as well if `verbose`.

    Stages without a step, such as those that a resumed run has already, share a line unless `verbose`.
    """

    def __init__(self, verbose: bool = False, write: Callable[[str], object] = _to_standard_error) -> None:
        self._verbose = verbose
        self._put = write
        self._current: _Current | None = None
        self._idle: list[_Current] = []

    def __call__(self, event: Event) -> None:
        """Show an event."""
        match event:
            case Stage():
                self._end_stage()
                self._begin(_Current(event))
            case Step() if self._current is not None:
                self._step(self._current, event)
            case Note():
                if self._current is not None and not self._current.written:
                    self._flush_idle()
                    self._show_stage(self._current)
                self._write(f"    {event}")

    def _begin(self, begun: _Current) -> None:
        self._current = begun

    def _step(self, current: _Current, step: Step) -> None:
        known = None if current.last is None else current.last.half_width
        current.last = step if step.half_width is not None else replace(step, half_width=known)
        if self._verbose:
            self._write(f"    {step}")

    def done(self) -> None:
        """The last stage is over."""
        self._end_stage()
        self._flush_idle()

    def _end_stage(self) -> None:
        """Write the line of the stage under way, if there is one."""
        ended, self._current = self._current, None
        if ended is None or ended.written:
            return
        if ended.moved or self._verbose:
            self._flush_idle()
            self._show_stage(ended)
        else:
            self._idle.append(ended)

    def _show_stage(self, current: _Current) -> None:
        """Write a stage's line."""
        current.written = True
        self._write(current.line())

    def _flush_idle(self) -> None:
        """Write the line that stages without a step share."""
        idle, self._idle = self._idle, []
        if len(idle) == 1:
            self._write(idle[0].line())
        elif idle:
            first, last = idle[0].stage, idle[-1].stage
            of = f"/{last.total}" if last.total else ""
            self._write(f"[{first.index}-{last.index}{of}] no steps")

    def _write(self, text: str) -> None:
        self._put(text)


class Bar(Lines):
    """One line that is redrawn, with stage, energy, residual and time left; notes stay above it."""

    def __init__(self, bar: RichProgress, verbose: bool = False) -> None:
        super().__init__(verbose)
        self._bar = bar
        self._task = bar.add_task("", total=None, figures="")

    def _begin(self, begun: _Current) -> None:
        """Set the bar to the number of earlier stages."""
        super()._begin(begun)
        heading, stage = visible(begun.heading), begun.stage
        self._bar.update(
            self._task, description=heading, total=stage.total or None, completed=stage.index - 1, figures=""
        )

    def _step(self, current: _Current, step: Step) -> None:
        super()._step(current, step)
        self._bar.update(self._task, figures=f"E = {digits.energy(step.energy)}  {step.residual:.1e}")

    def _end_stage(self) -> None:
        """Advance the bar, whether or not the stage leaves a line."""
        if self._current is not None:
            self._bar.update(self._task, completed=self._current.stage.index)
        super()._end_stage()

    def _show_stage(self, current: _Current) -> None:
        """Lines stay only with `verbose`."""
        if self._verbose:
            super()._show_stage(current)

    def _flush_idle(self) -> None:
        """The bar does not move."""
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
