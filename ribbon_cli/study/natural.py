"""`ribbon continue` without arclength: from width to width among minima, up to the first fold."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..config import Arclength
from ..solver.branch import End, Reason
from ..solver.status import Status
from ..store import Summary
from .branch_tables import course_point
from .failure import Failure
from .outcome import Course
from .plan import MOST_HALVINGS
from .records import multipliers_of, state_of
from .stepping import width_step
from .walk import Ended, Stage, Walk, bracketed

CONTACT_ACCURACY = 1e-7
"""Part of the band's length to which the first width of contact is bracketed."""


class Natural:
    """Natural continuation from a stored minimum; every step is a function of stored states.

    Steps that fail are kept in the log, so that the same line again has nothing to solve.
    """

    def __init__(self, walk: Walk, request: Arclength, start: Summary) -> None:
        self.walk, self.journal = walk, walk.journal
        self.request, self.start = request, start
        self.met: list[tuple[Summary, str]] = []
        self.beyond: list[float] = []

    def follow(self, name: str) -> Course:
        """Reach the widths `at` on the way and `to`; the course ends with the first that is not reached."""
        start, to = self.start.half_width, self.request.to
        sign = math.copysign(1.0, to - start)
        between = (b for b in self.request.at if 0.0 < sign * (b - start) < sign * (to - start))
        current, end = self.start, None
        for b in (*sorted(between, key=lambda b: sign * b), to):
            current, end = self._reach(name, current, b)
            if end is not None:
                break
        end = end or End(Reason.RANGE, to)
        message = f"{end.reason.sentence} {end.detail}".strip()
        self.journal.note(f"{name} ends at b = {end.half_width:.12g}: {message}")
        points = tuple(course_point(record, kind) for record, kind in self.met)
        return Course(name, self.start.label, points, end.reason.value, end.half_width, message)

    def _reach(self, name: str, current: Summary, b: float) -> tuple[Summary, End | None]:
        """Go to a width in steps as long as they succeed; where it ends if it is not reached."""
        step = b - current.half_width
        while current.half_width != b:
            here = current
            following, failures = self.walk.longest(
                self._stages(name, here, b, step),
                lambda stage, _, here=here: self._solved(stage, here),  # type: ignore[misc]
                lambda _, why: f"{name}: {why.bare}",
            )
            self._see(failures)
            if following is None:
                hint = self._hint(current, failures[-1].sentence)
                return current, End(Reason.STEP_TOO_SMALL, current.half_width, hint)
            if following.self_contact and not current.self_contact:
                touching, end = self._locate_contact(name, current, following)
                if "contact" in self.request.stop_at:
                    return touching, end
                if end.reason is not Reason.CONTACT:
                    self.journal.note(f"{name}: contact not located: {end.detail}")
            self.met.append((following, "width" if following.kind == "equilibrium" else "step"))
            step = 2.0 * (following.half_width - current.half_width)
            current = following
        return current, None

    def _stages(self, name: str, current: Summary, b: float, step: float) -> Iterator[Stage]:
        """The step towards a width, or all the way if it is as long, then its half, a quarter, ..."""
        left, shortest = b - current.half_width, abs(b - self.start.half_width) / 2**MOST_HALVINGS
        while True:
            aim = b if abs(step) >= abs(left) * (1.0 - 1e-9) else current.half_width + step
            yield _stage(name, current, aim, "equilibrium" if aim == b else "intermediate")
            if abs(aim - current.half_width) <= shortest:
                return
            step = 0.5 * (aim - current.half_width)

    def _locate_contact(self, name: str, before: Summary, after: Summary) -> tuple[Summary, End]:
        """Halve the step that led to contact until the width is known; the end is in contact."""

        def step(start: Summary, b: float) -> Summary | Failure:
            stage = _stage(name, start, b, "intermediate")
            found = self.walk.reach(stage, lambda: self._solved(stage, start))
            if isinstance(found, Failure):
                self._see((found,))
                self.journal.note(f"{name}: {found.bare}")
            return found

        free, touching, why = bracketed(before, after, CONTACT_ACCURACY * before.length, step)
        if why is not None:
            return free, End(Reason.STEP_TOO_SMALL, free.half_width, why.sentence)
        self.met.append((touching, "contact"))
        return touching, End(Reason.CONTACT, touching.half_width)

    def _see(self, failures: tuple[Failure, ...]) -> None:
        """Remember where another branch was met."""
        self.beyond += [why.values["end"] for why in failures if why.status is Status.LEFT_BRANCH]

    def _hint(self, current: Summary, why: str) -> str:
        """Why no step succeeds: a fold, if another branch was met beyond."""
        if self.beyond:
            nearest = min(self.beyond, key=lambda b: abs(b - current.half_width))
            near = 0.5 * (current.half_width + nearest)
            why = f"The branch seems to turn back (fold) near b = {near:.6g}: {why}"
        return f"{why} --arclength goes on around folds and past losses of stability, and locates them."

    def _solved(self, stage: Stage, start: Summary) -> Ended | Failure:
        """A minimum at a width from the state before it."""
        record = self.journal.load(start)
        return width_step(self.walk, state_of(record), multipliers_of(record), stage.half_width)


def _stage(name: str, start: Summary, b: float, kind: str) -> Stage:
    return Stage(f"{name}, b = {float(b)!r}", b, start.segments, kind, start.label, start=start.half_width)
