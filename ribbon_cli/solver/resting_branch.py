"""Branches of strips that rest on themselves, by arclength.

As long as the gaps stay the same the branch is a smooth curve like any other, with their rows in its system;
it even goes on where forces would pull, features would cross, or a contact would leave its features. So the
last place at which it may be taken is located on it. From there a short step in the parameter, onwards,
finds the gaps that are kept next (`resting_set.found`), and the branch goes on with them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..model.touching import Shape
from ..model.touching_audit import Motion, audit
from ..model.touching_gaps import Pairs
from ..parts import PARAMETERS
from .arclength import CorrectorError, Point, Tangent, initial_tangent, point_at
from .branch_events import Segment
from .kkt import FactorisationError
from .resting import RestingProblem
from .resting_certificate import PULLS
from .resting_exchange import OFF, NoRestError, off_features
from .resting_set import DEPTH, SLIP, Rest, found, rest_at, slopes
from .status import STATIONARY
from .steps import change

ACCURACY = 1e-7
"""Part of a step, and of the parameter as a pure number, to which the last place with the same gaps is
located."""
MOST_HALVINGS = 40
ONWARDS = (1e-3, 4e-3, 2.5e-4)
"""Steps in the parameter, as a pure number, over which the next gaps are looked for, in the order tried."""
NEXT_DOOR = 0.3
"""Largest change over such a step: a longer one leads to another branch."""


@dataclass(frozen=True, eq=False)
class Onward:
    """Where a branch goes on with other gaps: a point with its unit tangent, and how far it is along the
    branch from the place where the others end."""

    point: Point
    tangent: Tangent
    length: float


@dataclass(frozen=True, eq=False)
class Cut:
    """A step up to the last place at which its gaps may be kept; `bracket` is how far beyond in the parameter
    they may not."""

    segment: Segment
    bracket: float


def allowed(base: Point, point: Point) -> bool:
    """Whether a point with the same gaps is a shape at rest, and the straight way to it passes through
    nothing."""
    problem = point.problem
    assert isinstance(problem, RestingProblem)
    shape, depth = Shape.of(point.state, problem.gap), DEPTH * problem.band.length
    forces = problem.split(point.multipliers)[1]
    if len(forces):
        off = float(off_features(shape, problem.pairs).max())
        if off > OFF or forces.min() < -PULLS * max(1.0, float(forces.max())):
            return False
    if audit(shape, problem.gap + depth).lacks(problem.gap) > depth:
        return False
    motion = Motion(Shape.of(base.state, problem.gap), shape)
    met = motion.passages()
    slip = SLIP * problem.band.length if len(forces) else 10.0 * depth
    return not len(met) or motion.depth(met) <= slip


def pairs_of(point: Point) -> Pairs:
    """The gaps that a point keeps."""
    return point.problem.pairs if isinstance(point.problem, RestingProblem) else Pairs.none()


def last_allowed(segment: Segment) -> Cut | None:
    """The last place of a step at which its gaps may be kept, None where that is its end, or where the band
    has no contact forces."""
    if not isinstance(segment.base.problem, RestingProblem) or allowed(segment.base, segment.end):
        return None
    low, high = 0.0, segment.length
    near = ACCURACY / PARAMETERS[segment.base.parameter].weight(segment.base.problem.band.length)
    for _ in range(MOST_HALVINGS):
        bracket = abs(segment.at(high).value - segment.at(low).value)
        if bracket <= near and high - low <= ACCURACY:
            break
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(segment.base, segment.at(middle)) else (low, middle)
    end = (segment.at(low), segment.tangent_at(low))
    part = Segment(segment.base, segment.tangent, *end, low)
    return Cut(part, abs(segment.at(high).value - segment.at(low).value))


def onward(point: Point, tangent: Tangent, values: Iterable[float]) -> Onward:
    """The branch beyond the last place with the same gaps; it is met exactly at the first of the values that
    are near. Raises CorrectorError where it is not found."""
    problem = point.problem
    assert isinstance(problem, RestingProblem)
    own, forces = problem.split(point.multipliers)
    rest = rest_at(point.state, own, problem.pairs, forces, problem.gap)
    try:
        along = slopes(rest, point.parameter)
    except FactorisationError:
        along = None
    sign = math.copysign(1.0, tangent.value)
    why = ""
    for size in ONWARDS:
        by = sign * size / PARAMETERS[point.parameter].weight(problem.band.length)
        near = (v for v in values if 0.0 < sign * (v - point.value) <= abs(by))
        value = min(near, key=lambda v: abs(v - point.value), default=point.value + by)
        by = value - point.value
        band = problem.band.with_parameter(point.parameter, value)
        try:
            end = found(rest, band, by, along)
        except NoRestError as error:
            why = str(error)
            continue
        there = _there(point, end)
        if there is not None:
            return Onward(there, initial_tangent(there, int(sign)), _distance(point, there))
        why = "what is found there is on another branch"
    raise CorrectorError(f"no contacts were found beyond {point.symbol} = {point.value:.12g}: {why}")


def _there(point: Point, end: Rest) -> Point | None:
    """The shape at rest as a point of the branch, None where it is no neighbour of the point before it."""
    if end.result.status not in STATIONARY or change(point.x, end.result.x - point.x) > NEXT_DOOR:
        return None
    return point_at(end.problem, end.result.x, end.result.multipliers, point.parameter)


def _distance(one: Point, other: Point) -> float:
    """The length of the straight way between two points, whose multipliers need not be as many."""
    none = np.zeros_like(one.multipliers)
    chord = Tangent(other.x - one.x, none, other.value - one.value)
    return math.sqrt(one.product(chord, chord))
