"""What a study reports when it ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from ..parts import HALF_WIDTH, PARAMETERS
from ..store import Run


@dataclass(frozen=True)
class Target:
    """A width and number of segments that the config or command names, and what came of it.

    `place` are its parameters in words, where they are more than the half-width.
    `kept` tells of a saddle that it is the one asked for, `beyond` of a target not reached that it lies
    beyond the event at which the config stops, `of_branch` that a branch was to meet it.
    """

    half_width: float
    segments: int
    label: int | None
    reached: bool
    certified: bool
    message: str
    kept: bool = False
    beyond: bool = False
    place: str = ""
    of_branch: bool = False

    @property
    def where(self) -> str:
        """Its parameters in words."""
        return self.place or f"b = {self.half_width:.12g}"

    @property
    def failed(self) -> bool:
        """Whether the target was to be reached, and was not, or has no certificate and was to have one."""
        return not (self.beyond or (self.reached and (self.certified or self.kept)))


@dataclass(frozen=True, kw_only=True)
class CoursePoint:
    """A point of a branch, as in the table of branches.

    `index_before` and `index_after` are given at folds and branch points. `lowest_eigenvalue` is in the
    physical metric, without rotations; `sliding_overlap` belongs to it or, at folds and branch points, to the
    mode that is soft there. Without arclength continuation these, and `arclength`, are None, and so are
    `contacts` and `contact_force`, the sum of their forces, without contact forces.
    """

    label: int
    type: str
    half_width: float
    energy: float | None
    status: str
    negative_eigenvalues: int | None
    index_before: int | None = None
    index_after: int | None = None
    lowest_eigenvalue: float | None = None
    sliding_overlap: float | None = None
    linking_number: float | None
    self_contact: bool
    clearance: float | None
    contacts: int | None = None
    contact_force: float | None = None
    arclength: float | None = None
    parameters: Mapping[str, float | None] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The fields for JSON; contacts only where they have forces."""
        return {
            name: value
            for name, value in asdict(self).items()
            if self.contacts is not None or name not in ("contacts", "contact_force")
        }


@dataclass(frozen=True)
class Course:
    """A branch from its start: its points in order, and why and where it ends.

    The last is the half-width there, and the `value` of the `parameter` in which it was followed.
    """

    name: str
    start: int
    points: tuple[CoursePoint, ...]
    reason: str
    half_width: float
    message: str
    parameter: str = HALF_WIDTH
    value: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The fields for JSON, its points among them."""
        return asdict(self) | {"points": [point.to_dict() for point in self.points]}

    @property
    def place(self) -> str:
        """Where it ends, in words."""
        value = self.half_width if self.value is None else self.value
        return f"{PARAMETERS[self.parameter].symbol} = {value:.12g}"

    @property
    def arclength(self) -> float:
        """Its length up to its last point."""
        return max((point.arclength or 0.0 for point in self.points), default=0.0)

    @property
    def failed(self) -> bool:
        """Whether the branch ends without coming to its range's end or to an event it was to stop at."""
        return self.reason == "step-too-small"


@dataclass(frozen=True)
class Outcome:
    """The run, its targets in the order of the config, remarks, how many states are new, and branches."""

    run: Run
    targets: tuple[Target, ...]
    notes: tuple[str, ...]
    new_states: int
    branches: tuple[Course, ...] = ()

    @property
    def causes(self) -> tuple[tuple[str, str], ...]:
        """Where and why a target was not reached or has no certificate, or a branch broke off."""
        missed = ((f"{t.where}, N = {t.segments}", t.message) for t in self.targets if t.failed)
        broken = ((f"{c.name}, {c.place}", c.message) for c in self.branches if c.failed)
        return (*missed, *broken)

    @property
    def failures(self) -> tuple[str, ...]:
        """The same, a line each."""
        return tuple(f"{place}: {cause}" for place, cause in self.causes)

    @property
    def exit_code(self) -> int:
        """0 if no target failed and no branch broke off, else 3."""
        return 3 if self.failures else 0
