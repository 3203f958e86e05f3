"""Progress of a sweep on standard error: a bar over all runs on a terminal, elsewhere a line for each run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from ribbon_cli import sweeps
from ribbon_cli.api.console import bar_over, on_terminal
from ribbon_cli.digits import duration
from ribbon_cli.study.progress import Note, Stage
from ribbon_cli.text import visible

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

_SHOWN = 3
"""Most runs that are named where all that are in hand would not fit."""


@contextmanager
def sweep_console(
    verbose: bool, write: Callable[[str], object]
) -> Iterator[Callable[[sweeps.SweepEvent], object]]:
    """The progress of a sweep on the command line; `write` is where its lines go."""
    with bar_over() if on_terminal() else nullcontext() as bar:
        yield SweepLines(verbose, write) if bar is None else SweepBar(bar, verbose)


class SweepLines:
    """A line for each run that has ended; with `verbose` one for each of their stages and notes as well."""

    def __init__(self, verbose: bool, write: Callable[[str], object]) -> None:
        self._verbose = verbose
        self._put = write
        self._began = sweeps.Began(0, 0, 0.0, 1)
        self._since = time.monotonic()
        self._ended = self._failed = 0
        self._paid = 0.0

    def __call__(self, event: sweeps.SweepEvent) -> None:
        """Show an event."""
        match event:
            case sweeps.Began():
                self._began, self._since = event, time.monotonic()
                self._begin()
            case sweeps.Within():
                self._within(event)
            case sweeps.Ended():
                self._ended += 1
                self._failed += event.result.status == "failed"
                self._paid += event.task.cost
                self._end(event)
            case sweeps.Waiting():
                runs = f"{len(event.runs)} run{'s' * (len(event.runs) > 1)}"
                self._write(f"waiting for {runs} that others write to, first {event.runs[0]}: {event.holder}")

    def _begin(self) -> None:
        """A sweep begins: nothing to say."""

    def _within(self, event: sweeps.Within) -> None:
        if self._verbose and isinstance(event.event, Stage | Note):
            self._write(f"    {event.task.point.name}: {event.event}")

    def _end(self, event: sweeps.Ended) -> None:
        result = event.result
        words = "; ".join(result.failures) if result.failures else f"done, {duration(result.seconds)}"
        left = self.time_left()
        more = "" if left is None else f"; about {duration(left)} left"
        count = f"[{self._ended:{len(str(self._began.left))}}/{self._began.left}]"
        status = "" if result.status == "done" else f"{result.status}: "
        self._write(f"{count} {event.task.point.name}: {status}{words}{more}")

    def time_left(self) -> float | None:
        """Seconds to the end, by what runs were to cost and have taken; None where that is not known."""
        ahead = self._began.cost - self._paid
        if self._paid <= 0.0 or self._ended >= self._began.left:
            return None
        return (time.monotonic() - self._since) * ahead / self._paid

    def _write(self, text: str) -> None:
        self._put(text)


class SweepBar(SweepLines):
    """One line that is redrawn, with the runs ended and in hand and the time left; failures stay above it."""

    def __init__(self, bar: RichProgress, verbose: bool) -> None:
        super().__init__(verbose, lambda text: bar.console.print(text, markup=False, highlight=False))
        self._bar = bar
        self._task = bar.add_task("", total=None, figures="")
        self._in_hand: dict[str, float] = {}
        """What the stages that are behind have cost, by the name of each point in hand."""

    def _begin(self) -> None:
        self._show()

    def _within(self, event: sweeps.Within) -> None:
        if isinstance(event.event, Stage):
            part = (event.event.index - 1) / event.event.total
            self._in_hand[event.task.point.name] = event.task.cost * min(part, 1.0)
            self._show()
        super()._within(event)

    def _end(self, event: sweeps.Ended) -> None:
        self._in_hand.pop(event.task.point.name, None)
        self._show()
        if event.result.failures or self._verbose:
            super()._end(event)

    def _show(self) -> None:
        names = list(self._in_hand)
        hand = ", ".join(names[:_SHOWN]) + " ..." * (len(names) > _SHOWN)
        failed = f", {self._failed} failed" if self._failed else ""
        words = f"{self._ended}/{self._began.left} runs{failed}"
        paid = self._paid + sum(self._in_hand.values())
        self._bar.update(
            self._task, description=words, total=self._began.cost, completed=paid, figures=visible(hand)
        )

    def _write(self, text: str) -> None:
        self._put(visible(text, "\n"))
