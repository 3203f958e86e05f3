"""A branch step by step: how long a step may be, what happens within it, and where the branch ends.

A step is accepted where the corrector contracts and the branch turns little: jumps to another branch show
as a point off the tangent at either end. What happens between its ends (`branch_events`) is located on the
branch itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from ..facts import Event as Happening
from ..facts import event as happening
from ..parts import HALF_WIDTH
from .arclength import (
    CorrectorError,
    Point,
    Tangent,
    along,
    correct,
    tangent_from,
)
from .branch_events import VALUE, WIDTH, Event, Segment, events_of, value_type
from .newton import Guard
from .resting_branch import Cut, last_allowed, onward, pairs_of

LARGEST_TURN = 0.45
WANTED_TURN = 0.2
"""Angle between tangents, or between one and the chord, at which a step is refused, and at which it is
repeated with the same length."""
WANTED_CONTRACTION = 0.1
WANTED_CORRECTION = 0.03
WANTED_STEPS = 5
"""Ratio of the first two Newton steps, size of the first, and number of them, that keep the length."""
SHRINK, GROW = 0.5, 2.0


class Reason(Enum):
    """Why a branch ends; the value is what is stored, `sentence` what a user reads."""

    RANGE = "range"
    FOLD = "fold"
    STABILITY_LOST = "stability-lost"
    CONTACT = "contact"
    STEP_TOO_SMALL = "step-too-small"
    STEPS = "step-limit"
    CLOSED = "closed"

    @property
    def sentence(self) -> str:
        """The reason as a sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.RANGE: "The end of the range of widths.",
    Reason.FOLD: "A fold, at which the branch was to stop.",
    Reason.STABILITY_LOST: "The band lost its stability, at which the branch was to stop.",
    Reason.CONTACT: "The band touches itself, at which the branch was to stop.",
    Reason.STEP_TOO_SMALL: "No step along the branch is short enough to be followed.",
    Reason.STEPS: "The limit on the number of steps.",
    Reason.CLOSED: "The branch is closed: it repeats itself, but for numbering and handedness.",
}
STOPS = (Reason.FOLD, Reason.STABILITY_LOST, Reason.CONTACT)


@dataclass(frozen=True)
class BranchOptions:
    """What a branch is followed for.

    It ends where the parameter leaves [low, high], at the first event of the kinds in `stop_at`. `values` of
    it are met exactly. `first_step`, `least_step` and `largest_step` are lengths along the branch. `guard` as
    in a solve.
    """

    low: float
    high: float
    values: tuple[float, ...] = ()
    stop_at: frozenset[Reason] = frozenset()
    first_step: float = 0.01
    least_step: float = 1e-6
    largest_step: float = 0.1
    guard: Guard | None = None


@dataclass(frozen=True)
class End:
    """Where (by the parameter's value) and why a branch ends."""

    reason: Reason
    value: float
    detail: str = ""

    def message(self, parameter: str) -> str:
        """Why a branch in this parameter ends, with the details that there are."""
        said = self.reason.sentence
        if self.reason is Reason.RANGE and parameter != HALF_WIDTH:
            said = f"The end of the range of {parameter}."
        return f"{said} {self.detail}".strip()


@dataclass(frozen=True)
class Advance:
    """One step: its events in order, and its end point with the tangent there, unless the branch ends before.

    `length` is the step's, `following` that to be tried next. `refused` says why longer steps were not taken,
    `changes` which contacts end and begin within it.
    """

    events: tuple[Event, ...]
    point: Point | None
    tangent: Tangent | None
    length: float
    following: float
    refused: tuple[Happening, ...]
    end: End | None
    changes: tuple[Happening, ...] = ()


def advance(base: Point, tangent: Tangent, length: float, options: BranchOptions) -> Advance:
    """Take one step from a point of a branch along its unit tangent, of `length` or shorter.

    Of a band with contact forces it ends where the gaps that are kept change, a little beyond that place.
    """
    refused: list[Happening] = []
    length = min(max(length, options.least_step), options.largest_step)
    values = (*options.values, options.low, options.high)
    while True:
        try:
            segment = _attempt(base, tangent, length, options.guard)
            cut = last_allowed(segment)
            if cut is not None:
                return _changed(cut, length, values, options, tuple(refused))
            found = events_of(segment, values)
            break
        except ArithmeticError as error:  # those of corrector, factorisation, location, and division by zero
            start = {"symbol": base.symbol, "start": base.value}
            refused.append(happening("step-refused", length=length, **start, why=error))
            if length <= options.least_step:
                stuck = End(Reason.STEP_TOO_SMALL, base.value, str(error))
                return Advance((), None, None, 0.0, 0.0, tuple(refused), stuck)
            length = max(SHRINK * length, options.least_step)
    events, end = _until_end(found, options)
    following = min(segment.length * _factor(segment), options.largest_step)
    if end is not None:
        return Advance(events, None, None, segment.length, following, tuple(refused), end)
    return Advance(events, segment.end, segment.end_tangent, segment.length, following, tuple(refused), None)


def _changed(
    cut: Cut, length: float, values: tuple[float, ...], options: BranchOptions, refused: tuple[Happening, ...]
) -> Advance:
    """A step that ends where its gaps do, and goes on with others. Raises ArithmeticError."""
    part = cut.segment
    found = events_of(part, values) if part.length else ()
    events, end = _until_end(found, options)
    if end is not None:
        return Advance(events, None, None, part.length, length, refused, end)
    after = onward(part.end, part.end_tangent, values)
    old, new = (len(pairs_of(point)) for point in (part.end, after.point))
    more: list[Event] = []
    if bool(old) != bool(new):
        what, where = "touch" if new else "lift", (part.end, part.end_tangent, part.length)
        more.append(Event(what, *where, begins=new > 0, bracket=cut.bracket))
    gone = part.length + after.length
    if after.point.value in values:
        more.append(Event(value_type(after.point), after.point, after.tangent, gone))
    events, end = _until_end((*events, *more), options)
    if end is not None:
        return Advance(events, None, None, gone, length, refused, end)
    return Advance(
        events,
        after.point,
        after.tangent,
        gone,
        length,
        refused,
        None,
        _contacts_change(part.end, after.point),
    )


def _contacts_change(before: Point, after: Point) -> tuple[Happening, ...]:
    """What became of contacts, where there are some on both sides."""
    old, new = (set(pairs_of(point).names()) for point in (before, after))
    if not (old and new) or old == new:
        return ()
    here, there = (f"{point.symbol} = {point.value:.12g}" for point in (before, after))
    facts = {"before": len(old), "after": len(new), "gone": len(old - new), "new": len(new - old)}
    return (happening("contacts-change", here=here, there=there, **facts),)


def _attempt(base: Point, tangent: Tangent, length: float, guard: Guard | None) -> Segment:
    """One step of exactly this length. Raises CorrectorError, FactorisationError."""
    end = correct(base, tangent, length, along(base, tangent, length), guard)
    there = tangent_from(end, tangent)
    segment = Segment(base, tangent, end, there, length)
    turn = _turn(segment)
    if not turn <= LARGEST_TURN:
        raise CorrectorError(f"the branch turns by {turn:.2g}")
    rise = end.value - base.value
    if tangent.value * there.value > 0.0 and rise * tangent.value < 0.0:
        raise CorrectorError(f"{base.symbol} turns twice within it")
    return segment


def _turn(segment: Segment) -> float:
    """The largest angle between the tangents at the ends and the chord."""
    base, end = segment.base, segment.end
    chord = Tangent(end.x - base.x, end.multipliers - base.multipliers, end.value - base.value)
    size = math.sqrt(base.product(chord, chord))
    t, there = segment.tangent, segment.end_tangent
    cosines = (base.product(t, there), base.product(t, chord) / size, base.product(there, chord) / size)
    return math.acos(max(-1.0, min(1.0, *cosines)))


def _factor(segment: Segment) -> float:
    """By how much the next step may be longer: Newton's count, its contraction, the branch's turning."""
    point = segment.end
    factor = min(
        GROW,
        WANTED_TURN / max(_turn(segment), 1e-6),
        # The predictor's error, and with it the contraction, grow like the square of the length.
        math.sqrt(WANTED_CONTRACTION / max(point.contraction, 1e-6)),
        math.sqrt(WANTED_CORRECTION / max(point.correction, 1e-6)),
    )
    if point.steps > WANTED_STEPS:
        factor = min(factor, WANTED_STEPS / point.steps)
    return max(SHRINK, factor)


def _until_end(found: tuple[Event, ...], options: BranchOptions) -> tuple[tuple[Event, ...], End | None]:
    """The events up to the first that ends the branch, and the end."""
    for k, event in enumerate(found):
        reason = reason_to_end(
            options,
            event.type,
            event.point.value,
            loses=event.loses_stability,
            begins=event.begins,
        )
        if reason is not None:
            return found[: k + 1], End(reason, event.point.value)
    return found, None


def reason_to_end(
    options: BranchOptions, type: str, value: float, *, loses: bool, begins: bool
) -> Reason | None:
    """Why a branch ends at an event of a type, if it does; whether it `loses` stability there, or contact
    `begins`.
    """
    wanted = options.stop_at
    if type == "fold" and Reason.FOLD in wanted:
        return Reason.FOLD
    if loses and Reason.STABILITY_LOST in wanted:
        return Reason.STABILITY_LOST
    if type in ("contact", "touch") and begins and Reason.CONTACT in wanted:
        return Reason.CONTACT
    if type in (WIDTH, VALUE) and value in (options.low, options.high):
        return Reason.RANGE
    return None
