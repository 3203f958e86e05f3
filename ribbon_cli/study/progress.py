"""What a study tells whoever watches it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Progress(Protocol):
    """Receives the course of a study; see `ribbon_cli.api.console` for what a terminal shows."""

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """Note that a stage begins, `index` (from 1) of about `total`."""

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """Note a Newton step of the stage; `half_width` where only the step has found it, as on a branch."""

    def note(self, text: str) -> None:
        """Note something worth a line: a halved step, a saddle left, a change of grid phase."""

    def done(self) -> None:
        """Note the end."""


class Silence:
    """Tells nobody."""

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """Ignore a stage."""

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """Ignore a step."""

    def note(self, text: str) -> None:
        """Ignore a note."""

    def done(self) -> None:
        """Ignore the end."""


class Recording:
    """Keeps what it is told, to tell it to someone else."""

    def __init__(self) -> None:
        self._told: list[Callable[[Progress], None]] = []

    def stage(self, name: str, index: int, total: int, half_width: float, segments: int) -> None:
        """Keep a stage."""
        self._told.append(lambda to: to.stage(name, index, total, half_width, segments))

    def step(self, iteration: int, energy: float, residual: float, half_width: float | None = None) -> None:
        """Keep a step."""
        self._told.append(lambda to: to.step(iteration, energy, residual, half_width))

    def note(self, text: str) -> None:
        """Keep a note."""
        self._told.append(lambda to: to.note(text))

    def done(self) -> None:
        """Keep the end."""
        self._told.append(lambda to: to.done())

    def replay(self, to: Progress) -> None:
        """Tell it all."""
        for tell in self._told:
            tell(to)
