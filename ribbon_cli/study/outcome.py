"""What a study reports when it ends."""

from __future__ import annotations

from dataclasses import dataclass

from ..store import Run


@dataclass(frozen=True)
class Target:
    """A width and number of segments that the config or command names, and what came of it."""

    half_width: float
    segments: int
    label: int | None
    reached: bool
    certified: bool
    message: str


@dataclass(frozen=True)
class Outcome:
    """The run, its targets in the order of the config, remarks, and how many states are new."""

    run: Run
    targets: tuple[Target, ...]
    notes: tuple[str, ...]
    new_states: int

    @property
    def failures(self) -> tuple[str, ...]:
        """A line for each target that was not reached or has no certificate."""
        return tuple(
            f"b = {t.half_width:.12g}, N = {t.segments}: {t.message}"
            for t in self.targets
            if not (t.reached and t.certified)
        )

    @property
    def exit_code(self) -> int:
        """0 if every target was reached with a certificate, else 3."""
        return 3 if self.failures else 0
