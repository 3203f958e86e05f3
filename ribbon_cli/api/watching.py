"""What a solve tells a program that watches it, and how it is handed over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ribbon_cli import digits, study
from ribbon_cli.api.console import console


@dataclass(frozen=True)
class Stage:
    """A stage begins, `index` (from 1) of about `total`."""

    name: str
    index: int
    total: int
    half_width: float
    segments: int

    def __str__(self) -> str:
        return f"[{self.index}/{self.total}] {self.name}: b = {self.half_width:g}, N = {self.segments}"


@dataclass(frozen=True)
class Step:
    """A Newton step of the stage was taken; `half_width` is given where only the step has found it."""

    iteration: int
    energy: float
    residual: float
    half_width: float | None = None

    def __str__(self) -> str:
        return f"step {self.iteration}: E = {digits.energy(self.energy)}, residual {self.residual:.1e}"


@dataclass(frozen=True)
class Note:
    """Something happened that is worth a line: a halved step, a saddle left, a change of grid phase."""

    text: str

    def __str__(self) -> str:
        return self.text


Event = Stage | Step | Note
Watcher = Callable[[Event], object] | bool | None
"""A callable that gets every event; True for the console's progress on standard error; None for silence."""


class _Told:
    """The progress of a study that hands each event to a callable."""

    def __init__(self, tell: Callable[[Event], object]) -> None:
        self._tell = tell

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """Tell of a stage."""
        self._tell(Stage(name, index, total, half_width, segments))

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """Tell of a step."""
        self._tell(Step(iteration, energy, residual, half_width))

    def note(self, text: str) -> None:
        """Tell of something worth a line."""
        self._tell(Note(text))

    def done(self) -> None:
        """The call's return tells the end."""


@contextmanager
def watched(progress: Watcher) -> Iterator[study.Progress | None]:
    """The progress to hand to a study. Raises TypeError for what is no watcher."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        with console() as shown:
            yield shown
    elif callable(progress):
        yield _Told(progress)
    else:
        raise TypeError(f"progress must be a callable, True or None, got {type(progress).__name__}")
