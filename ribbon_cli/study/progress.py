"""What a study tells whoever watches it: events, handed to a callable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .. import digits


@dataclass(frozen=True)
class Stage:
    """A stage begins, `index` (from 1) of about `total`, which is 0 where nobody knows how many will come."""

    name: str
    index: int
    total: int
    half_width: float
    segments: int

    @property
    def count(self) -> str:
        """Which of how many it is."""
        width = len(str(self.total))
        return f"[{self.index:{width}}/{self.total}]" if self.total else f"[{self.index}]"

    def __str__(self) -> str:
        return f"{self.count} {self.name}: b = {self.half_width:g}, N = {self.segments}"


@dataclass(frozen=True)
class Step:
    """A Newton step of the stage was taken.

    `half_width` is given where only the step has found it, and `place`, as `shear = 0.12`, where a branch is
    followed in another parameter.
    """

    iteration: int
    energy: float
    residual: float
    half_width: float | None = None
    place: str = ""

    def __str__(self) -> str:
        return f"step {self.iteration}: E = {digits.energy(self.energy)}, residual {self.residual:.1e}"


@dataclass(frozen=True)
class Note:
    """Something happened that is worth a line: a halved step, a saddle left, a change of grid phase."""

    text: str

    def __str__(self) -> str:
        return self.text


Event = Stage | Step | Note
Progress = Callable[[Event], object]
"""Who watches; see `ribbon_cli.api.console` for what a terminal shows."""


def silence(_: Event) -> None:
    """Tell nobody."""
