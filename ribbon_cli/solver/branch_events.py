"""What happens between two points of a branch: folds, changes of stability, contact, requested values.

Everything is located on the branch itself: a place within a step is the point at which the branch meets the
hyperplane <t, z - z_0> = s, 0 <= s <= ds, found by the corrector from an interpolation between the ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy

from ..model.band import Array
from ..parts import HALF_WIDTH, PARAMETERS
from .arclength import (
    TOLERANCE,
    CorrectorError,
    Point,
    Tangent,
    correct,
    correct_at,
    moved,
    tangent_from,
    unit,
)
from .kkt import FactorisationError
from .singular import Mode, mode_of, settled, soft_direction, soft_value

FOLD_ACCURACY = 1e-9
BRACKET = 1e-3
SINGULAR_ACCURACY = 1e-9
WIDTH_ACCURACY = 1e-6
CONTACT_ACCURACY = 1e-7
"""Parts of a step to which events are located along the branch, the rest being left to what follows: b is
stationary at folds, branch points are interpolated in a bracket of about `BRACKET` of the step, and widths
are met by a corrector. Contact is bracketed to a part of the band's length."""
ASIDE = 1e-3
"""Part of a step to either side of a fold at which the index is counted when it does not change by one."""
MOST_BISECTIONS = 40
MIDDLES = (0.5, 0.4, 0.6)
"""Places at which a bracket is cut in two, in the order tried: at the first the index may not be sure."""
TRANSVERSAL = 1e-5
"""Part of its terms below which v.r counts as zero; at folds it has been 1e-2, at bifurcations 1e-9."""


WIDTH, VALUE = "width", "value"
"""Types of events at a value of the parameter that was asked for."""


class LocationError(ArithmeticError):
    """Something happened within a step that could not be located; the step is too long."""


@dataclass(frozen=True, eq=False)
class Event:
    """A place on a branch: `type` is fold, branch-point, contact, or width (value, of other parameters than
    the half-width); with contact forces touch or lift, the last place before they begin or end.

    `position` is s within the step. At folds and branch points `before` and `after` are the indices on
    either side, and `mode` is the direction that is soft there (along the branch at a fold). `begins` tells
    the first facets that touch from the last, `bracket` is how far the parameter is from the other side of a
    contact.
    """

    type: str
    point: Point
    tangent: Tangent
    position: float
    before: int | None = None
    after: int | None = None
    mode: Mode | None = None
    begins: bool = False
    bracket: float = 0.0

    @property
    def loses_stability(self) -> bool:
        """Whether a minimum ends here."""
        return self.before == 0 and self.after is not None and self.after > 0


@dataclass
class Segment:
    """The branch between two accepted points; `tangent` and `end_tangent` are its unit tangents at both."""

    base: Point
    tangent: Tangent
    end: Point
    end_tangent: Tangent
    length: float
    _known: dict[float, Point] = field(default_factory=dict)

    def at(self, s: float) -> Point:
        """The point at a position. Raises CorrectorError."""
        if s <= 0.0:
            return self.base
        if s >= self.length:
            return self.end
        if s not in self._known:
            self._known[s] = correct(self.base, self.tangent, s, self._between(s))
        return self._known[s]

    def _between(self, s: float) -> tuple[Array, Array, float]:
        """A guess at a position, interpolated between the ends."""
        return _hermite(
            (self.base, self.tangent),
            (self.end, self.end_tangent),
            s / self.length,
            self.length,
            self.tangent,
        )

    def tangent_at(self, s: float) -> Tangent:
        """The unit tangent at a position."""
        if s <= 0.0:
            return self.tangent
        if s >= self.length:
            return self.end_tangent
        return tangent_from(self.at(s), self.tangent)


def _root(f: Callable[[float], float], low: float, high: float, accuracy: float) -> float:
    """A zero of f between two places at which its signs differ. Raises LocationError if there is none."""

    try:
        return float(scipy.optimize.brentq(f, low, high, xtol=accuracy, rtol=8.9e-16))
    except (ValueError, RuntimeError) as error:  # equal signs, not-a-number; no convergence
        raise LocationError(f"no zero was found: {error}") from error


def _hermite(
    first: tuple[Point, Tangent], last: tuple[Point, Tangent], w: float, length: float, along: Tangent
) -> tuple[Array, Array, float]:
    """Cubic Hermite interpolation of (x, lambda, b) at a part w of the way between two points of a branch.

    `length` is the difference of their positions, measured along the direction `along`.
    """
    (a, t), (b, e) = first, last
    h0, h1 = (1.0 + 2.0 * w) * (1.0 - w) ** 2, w * w * (3.0 - 2.0 * w)
    k0 = w * (1.0 - w) ** 2 * length / a.product(along, t)
    k1 = w * w * (w - 1.0) * length / a.product(along, e)
    return (
        h0 * a.x + h1 * b.x + k0 * t.x + k1 * e.x,
        h0 * a.multipliers + h1 * b.multipliers + k0 * t.multipliers + k1 * e.multipliers,
        h0 * a.value + h1 * b.value + k0 * t.value + k1 * e.value,
    )


def events_of(segment: Segment, values: Iterable[float]) -> tuple[Event, ...]:
    """All events of a step in the order of the branch.

    Raises LocationError, CorrectorError, FactorisationError where the step is too long for that.
    """
    found: list[Event] = []
    bends = [0.0, segment.length]
    if segment.tangent.value * segment.end_tangent.value < 0.0:
        fold = _fold(segment)
        bends.insert(1, fold.position)
        before, after = segment.base.negative, segment.end.negative
        if before is None or after is None or abs(after - before) == 1:
            found.append(_typed(fold, before, after))
        else:
            found += _around(segment, fold)
    else:
        found += _changes(segment, 0.0, segment.length)
    for low, high in pairwise(bends):
        found += (_value(segment, p, low, high) for p in set(values) if _crosses(segment, p, low, high))
    if segment.base.contact != segment.end.contact:
        found.append(_contact(segment))
    return tuple(sorted(found, key=lambda event: event.position))


# --- folds ---


def _fold(segment: Segment) -> Event:
    """Where db/ds = 0."""
    s = _root(lambda s: segment.tangent_at(s).value, 0.0, segment.length, FOLD_ACCURACY * segment.length)
    point, tangent = segment.at(s), segment.tangent_at(s)
    kind = "branch-point" if _crossed(point, tangent) else "fold"
    return Event(kind, point, tangent, s, mode=mode_of(point, tangent))


def _crossed(point: Point, null: Tangent) -> bool:
    """Whether another branch crosses where dp/ds = 0: the derivative by p then has no part along the null
    vector.

    At a fold the null vector v of K (the tangent) has v.r != 0, with r the derivative of the residual by b.
    At the vertex of a pitchfork v.r = 0, and the branch that crosses goes on in b. Where p is a place or turn
    of an end, r has so few entries that their products show no cancellation: see `_around`.
    """
    gradient = point.rates.gradient * null.x
    constraints = point.rates.constraints * null.multipliers
    size = float(np.abs(gradient).sum() + np.abs(constraints).sum())
    return abs(float(gradient.sum() - constraints.sum())) <= TRANSVERSAL * size


def _typed(fold: Event, before: int | None, after: int | None) -> Event:
    return Event(fold.type, fold.point, fold.tangent, fold.position, before, after, fold.mode)


def _around(segment: Segment, fold: Event) -> list[Event]:
    """A fold together with changes of the index on either side of it.

    At a fold det K changes its sign with dp/ds, and the index by one. At the vertex of a pitchfork it does
    not: the eigenvalue that vanishes there has the same sign on either side.
    """
    aside = min(ASIDE * segment.length, 0.5 * fold.position, 0.5 * (segment.length - fold.position))
    low, high = fold.position - aside, fold.position + aside
    before, after = segment.at(low).negative, segment.at(high).negative
    turn = _typed(fold, before, after)
    if PARAMETERS[fold.point.parameter].part == "ends" and before is not None and before == after:
        turn = replace(turn, type="branch-point")
    return [*_changes(segment, 0.0, low), turn, *_changes(segment, high, segment.length)]


# --- stability ---


def _changes(segment: Segment, low: float, high: float, depth: int = 0) -> list[Event]:
    """Branch points between two positions without a fold between them, one for each change of the index."""
    before, after = segment.at(low).negative, segment.at(high).negative
    if before is None or after is None or before == after:
        return []
    if abs(after - before) == 1:
        event = _branch_point(segment, low, high, before, after)
        if event is not None:
            return [event]
    if depth >= MOST_BISECTIONS:
        raise LocationError(f"the index changes from {before} to {after} at once")
    between = (low + part * (high - low) for part in MIDDLES)
    middle = next((s for s in between if segment.at(s).negative is not None), None)
    if middle is None:  # neither half could be asked: what changes within it would be passed over
        raise LocationError(f"the index changes from {before} to {after} where it cannot be told")
    return [
        *_changes(segment, low, middle, depth + 1),
        *_changes(segment, middle, high, depth + 1),
    ]


def _branch_point(segment: Segment, low: float, high: float, before: int, after: int) -> Event | None:
    """Where the eigenvalue passes zero, None if the test function made in the middle does not show it.

    At the place itself the corrector is singular, and what it finds near by is as vague along the soft mode
    as the cube root of its tolerance. The bracket is therefore closed to a small part of the step only, and
    within it the branch is interpolated, with an error of the fourth power of that part; what this leaves of
    the residuals is removed beside the soft mode.
    """
    c = soft_direction(segment.at(0.5 * (low + high)))
    near = BRACKET * (high - low)
    try:
        if soft_value(segment.at(low), c)[0] * soft_value(segment.at(high), c)[0] >= 0.0:
            return None
        s = _root(lambda s: soft_value(segment.at(s), c)[0], low, high, near)
        low, high = max(low, s - 2.0 * near), min(high, s + 2.0 * near)
        # g changes its sign at its poles too, where K is regular: the index tells.
        if (segment.at(low).negative, segment.at(high).negative) != (before, after):
            return None
        ends = [(segment.at(p), segment.tangent_at(p)) for p in (low, high)]

        def between(w: float) -> Point:
            return moved(segment.base, *_hermite(ends[0], ends[1], w, high - low, segment.tangent))

        if soft_value(ends[0][0], c)[0] * soft_value(ends[1][0], c)[0] >= 0.0:
            return None
        w = _root(lambda w: soft_value(between(w), c)[0], 0.0, 1.0, SINGULAR_ACCURACY)
        point = settled(between(w), c)
        if not point.worst <= TOLERANCE:
            return None
        mode = mode_of(point, soft_value(point, c)[1])
    except (FactorisationError, CorrectorError, LocationError):
        return None
    (_, t), (_, e) = ends
    tangent = Tangent(
        (1.0 - w) * t.x + w * e.x,
        (1.0 - w) * t.multipliers + w * e.multipliers,
        (1.0 - w) * t.value + w * e.value,
    )
    position = low + w * (high - low)
    return Event("branch-point", point, unit(point, tangent), position, before, after, mode)


# --- values and contact ---


def _crosses(segment: Segment, p: float, low: float, high: float) -> bool:
    """Whether the branch reaches p after `low` and not after `high`, the parameter being monotone between."""
    first, last = segment.at(low).value, segment.at(high).value
    return (first < p <= last or last <= p < first) and first != p


def _value(segment: Segment, p: float, low: float, high: float) -> Event:
    """The point at exactly p."""
    if segment.at(high).value == p:
        s = high
    else:
        s = _root(lambda s: segment.at(s).value - p, low, high, WIDTH_ACCURACY * segment.length)
    near = segment.at(s)
    point = correct_at(near, (near.x, near.multipliers, p))
    return Event(value_type(point), point, tangent_from(point, segment.tangent), s)


def value_type(point: Point) -> str:
    """The type of an event at a value of a point's parameter."""
    return WIDTH if point.parameter == HALF_WIDTH else VALUE


def _contact(segment: Segment) -> Event:
    """Where facets begin to touch, or cease to, by halving; the point is on the side of contact."""
    begins = segment.end.contact
    low, high = 0.0, segment.length
    near = CONTACT_ACCURACY * segment.base.problem.band.length
    for _ in range(MOST_BISECTIONS):
        gap = abs(segment.at(high).value - segment.at(low).value)
        if gap <= near and high - low <= CONTACT_ACCURACY:
            break
        middle = 0.5 * (low + high)
        if segment.at(middle).contact == begins:
            high = middle
        else:
            low = middle
    s = high if begins else low
    gap = abs(segment.at(high).value - segment.at(low).value)
    return Event("contact", segment.at(s), segment.tangent_at(s), s, begins=begins, bracket=gap)
