"""`ribbon continue` without arclength: from value to value among minima, up to the first fold."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..config import Arclength
from ..parts import HALF_WIDTH, PARAMETERS
from ..solver.branch import End, Reason
from ..solver.status import Status
from ..store import Summary
from .branch_tables import course_point
from .failure import CHECKERBOARDS, Failure
from .outcome import Course, Target
from .plan import MOST_HALVINGS, place_name
from .stepping import step_from
from .touch_down import locate
from .turning import soft_in_checkerboards, turns_back
from .walk import Ended, Stage, Walk, bracketed

CONTACT_ACCURACY = 1e-7
"""Part of the band's length to which the first width of contact is bracketed; of others the like."""


class Natural:
    """Natural continuation from a stored minimum; every step is a function of stored states.

    Steps that fail are kept in the log, so that the same line again has nothing to solve.
    """

    def __init__(self, walk: Walk, request: Arclength, start: Summary) -> None:
        self.walk, self.journal = walk, walk.journal
        self.request, self.start, self.name = request, start, request.parameter
        self.symbol = PARAMETERS[self.name].symbol
        self.met: list[tuple[Summary, str]] = []
        self.beyond: list[float] = []

    def follow(self, name: str) -> Course:
        """Reach the values `at` on the way and `to`; the course ends with the first that is not reached."""
        start, to = self._value(self.start), self.request.to
        sign = math.copysign(1.0, to - start)
        between = (b for b in self.request.at if 0.0 < sign * (b - start) < sign * (to - start))
        current, end = self.start, None
        for b in (*sorted(between, key=lambda b: sign * b), to):
            current, end = self._reach(name, current, b)
            if end is not None:
                break
        end = end or End(Reason.RANGE, to)
        message = end.message(self.name)
        self.journal.note(f"{name} ends at {self.symbol} = {end.value:.12g}: {message}")
        points = tuple(course_point(record, kind) for record, kind in self.met)
        last = self.met[-1][0] if self.met else self.start
        width = end.value if self.name == HALF_WIDTH else last.half_width
        where = (width, message, self.name, None if self.name == HALF_WIDTH else end.value)
        return Course(name, self.start.label, points, end.reason.value, *where)

    @property
    def uncertified(self) -> tuple[Target, ...]:
        """The values that were asked for and reached by a state at rest that is undecided."""
        return tuple(
            Target(s.half_width, s.segments, s.label, True, False, s.message, place=self._place(s))
            for s, _ in self.met
            if s.kind == "equilibrium" and not s.certified
        )

    def _place(self, state: Summary) -> str:
        return "" if self.name == HALF_WIDTH else place_name({self.name: self._value(state)})

    def _value(self, state: Summary) -> float:
        """The parameter's value at a state."""
        return state.parameters[self.name] or 0.0

    def _reach(self, name: str, current: Summary, b: float) -> tuple[Summary, End | None]:
        """Go to a value in steps as long as they succeed; where it ends if it is not reached."""
        step = b - self._value(current)
        while self._value(current) != b:
            here = current
            following, failures = self.walk.longest(
                self._stages(name, here, b, step),
                lambda stage, _, here=here: self._solved(stage, here),  # type: ignore[misc]
                lambda _, why: f"{name}: {why.bare}",
            )
            self._see(failures)
            if following is None:
                hint = self._hint(current, failures[-1].sentence)
                return current, End(Reason.STEP_TOO_SMALL, self._value(current), hint)
            if self.walk.gap is not None:
                end = self._locate_forces(name, current, following)
                if end is not None:
                    return current, end
            elif following.self_contact and not current.self_contact:
                touching, end = self._locate_contact(name, current, following)
                if "contact" in self.request.stop_at:
                    return touching, end
                if end.reason is not Reason.CONTACT:
                    self.journal.note(f"{name}: contact not located: {end.detail}")
            self.met.append((following, self._asked if following.kind == "equilibrium" else "step"))
            step = 2.0 * (self._value(following) - self._value(current))
            current = following
        return current, None

    def _stages(self, name: str, current: Summary, b: float, step: float) -> Iterator[Stage]:
        """The step towards a value, or all the way if it is as long, then its half, a quarter, ..."""
        here = self._value(current)
        left, shortest = b - here, abs(b - self._value(self.start)) / 2**MOST_HALVINGS
        while True:
            aim = b if abs(step) >= abs(left) * (1.0 - 1e-9) else here + step
            yield self._stage(name, current, aim, "equilibrium" if aim == b else "intermediate")
            if abs(aim - here) <= shortest:
                return
            step = 0.5 * (aim - here)

    def _locate_contact(self, name: str, before: Summary, after: Summary) -> tuple[Summary, End]:
        """Halve the step that led to contact until the value is known; the end is in contact."""

        def step(start: Summary, b: float) -> Summary | Failure:
            stage = self._stage(name, start, b, "intermediate")
            found = self.walk.reach(stage, lambda: self._solved(stage, start))
            if isinstance(found, Failure):
                self._see((found,))
                self.journal.note(f"{name}: {found.bare}")
            return found

        within = CONTACT_ACCURACY * before.length
        if self.name != HALF_WIDTH:
            within = 2.0 * math.pi * CONTACT_ACCURACY / PARAMETERS[self.name].weight(before.length)
        free, touching, why = bracketed(before, after, within, self._value, step)
        if why is not None:
            return free, End(Reason.STEP_TOO_SMALL, self._value(free), why.sentence)
        self.met.append((touching, "contact"))
        return touching, End(Reason.CONTACT, self._value(touching))

    def _locate_forces(self, name: str, before: Summary, after: Summary) -> End | None:
        """Locate where contact forces begin or end on a step; the end where the request stops there."""
        found = locate(self.walk, before, after, f"{name}, ")
        if not isinstance(found, Summary):
            return None
        begins = bool(after.contacts)
        self.met.append((found, "touch" if begins else "lift"))
        stops = begins and "contact" in self.request.stop_at
        return End(Reason.CONTACT, self._value(found)) if stops else None

    def _see(self, failures: tuple[Failure, ...]) -> None:
        """Remember where another branch was met."""
        self.beyond += [why.values["end"] for why in failures if why.status is Status.LEFT_BRANCH]

    def _hint(self, current: Summary, why: str) -> str:
        """Why no step succeeds: where another branch was met beyond, a fold, if stored states tell of one."""
        here = self._value(current)
        nearest = min(self.beyond, key=lambda b: abs(b - here), default=None)
        if nearest is not None and turns_back(self.journal, current, self.name, nearest):
            near = 0.5 * (here + nearest)
            why = f"The branch seems to turn back (fold) near {self.symbol} = {near:.6g}: {why}"
        elif nearest is not None and soft_in_checkerboards(self.journal, current):
            why = f"{why} Also {CHECKERBOARDS}."
        return f"{why} --arclength continues around folds and past losses of stability, and locates them."

    def _solved(self, stage: Stage, start: Summary) -> Ended | Failure:
        """A minimum at a value from the state before it."""
        return step_from(self.walk, self.journal.load(start), stage.target)

    @property
    def _asked(self) -> str:
        """The type of a point at a value that was asked for."""
        return "width" if self.name == HALF_WIDTH else "value"

    def _stage(self, name: str, start: Summary, value: float, kind: str) -> Stage:
        target = {self.name: value}
        return Stage(
            f"{name}, {self.symbol} = {float(value)!r}",
            target.get(HALF_WIDTH, start.half_width),
            start.segments,
            kind,
            start.label,
            start=start.parameters,
            target=target,
        )
