"""`ribbon continue` without arclength: from width to width among minima, up to the first fold."""

from __future__ import annotations

import math

from ..config import Arclength
from ..solver.branch import End, Reason
from ..solver.continuation import to_width
from ..solver.status import Status
from ..store import Summary
from .outcome import Course, CoursePoint
from .plan import MOST_HALVINGS
from .records import multipliers_of, state_of
from .remedies import remedied
from .steps import Steps

CONTACT_ACCURACY = 1e-7
"""Part of the band's length to which the first width of contact is bracketed."""


class Natural:
    """Natural continuation from a stored minimum; every step is a function of stored states."""

    def __init__(self, steps: Steps, request: Arclength, start: Summary) -> None:
        self.steps, self.journal = steps, steps.journal
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
        points = tuple(_point(record, kind) for record, kind in self.met)
        return Course(name, self.start.label, points, end.reason.value, end.half_width, message)

    def _reach(self, name: str, current: Summary, b: float) -> tuple[Summary, End | None]:
        """Go to a width in steps as long as they succeed; where it ends if it is not reached."""
        step = b - current.half_width
        while current.half_width != b:
            left = b - current.half_width
            aim = b if abs(step) >= abs(left) * (1.0 - 1e-9) else current.half_width + step
            following = self._step(name, current, aim, "equilibrium" if aim == b else "intermediate")
            if isinstance(following, str):
                if abs(aim - current.half_width) <= abs(b - self.start.half_width) / 2**MOST_HALVINGS:
                    return current, End(
                        Reason.STEP_TOO_SMALL, current.half_width, self._hint(current, following)
                    )
                step = 0.5 * (aim - current.half_width)
                continue
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

    def _locate_contact(self, name: str, before: Summary, after: Summary) -> tuple[Summary, End]:
        """Halve the step that led to contact until the width is known; the end is in contact."""
        low, high = before, after
        near = CONTACT_ACCURACY * before.length
        while abs(high.half_width - low.half_width) > near:
            middle = 0.5 * (low.half_width + high.half_width)
            found = self._step(name, low, middle, "intermediate")
            if isinstance(found, str):
                return low, End(Reason.STEP_TOO_SMALL, low.half_width, found)
            low, high = (low, found) if found.self_contact else (found, high)
        self.met.append((high, "contact"))
        return high, End(Reason.CONTACT, high.half_width)

    def _hint(self, current: Summary, why: str) -> str:
        """Why no step succeeds: a fold, if another branch was met beyond."""
        if self.beyond:
            nearest = min(self.beyond, key=lambda b: abs(b - current.half_width))
            near = 0.5 * (current.half_width + nearest)
            why = f"The branch seems to turn back (fold) near b = {near:.6g}: {why}"
        return f"{why} --arclength goes on around folds and past losses of stability, and locates them."

    def _step(self, name: str, current: Summary, b: float, kind: str) -> Summary | str:
        """A minimum at a width, stored or computed from the state before it; a sentence if there is none."""
        stage = f"{name}, b = {float(b)!r}"
        known = self.journal.finished(stage)
        if known is not None:
            return known
        self.steps.begin(stage, b, current.segments)
        clock = self.journal.clock()
        record = self.journal.load(current)
        move = to_width(state_of(record), multipliers_of(record), b, self.steps.options)
        result = self.steps.checked(move.result)
        if result.status is not Status.MINIMUM:
            self.beyond += [b] if result.status is Status.LEFT_BRANCH else []
            why = f"a step from b = {current.half_width:.12g} to {b:.12g} failed: {result.message}"
            self.journal.note(f"{name}: {why}")
            return remedied(why, result.status)
        return self.steps.store_move(move, result, clock, kind=kind, stage=stage, parent=current.label)


def _point(record: Summary, kind: str) -> CoursePoint:
    return CoursePoint(
        label=record.label,
        type=kind,
        half_width=record.half_width,
        energy=record.energy,
        status=record.status,
        negative_eigenvalues=record.negative_eigenvalues,
        index_before=None,
        index_after=None,
        lowest_eigenvalue=None,
        sliding_overlap=None,
        linking_number=record.linking_number,
        self_contact=record.self_contact,
        clearance=record.clearance,
        arclength=None,
    )
