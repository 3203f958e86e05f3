"""On which side of each other sheets are while they slide: known from a shape that does not cross.

A vertex that slides off a facet comes over the next one, and a side that crosses a ruling crosses the next.
Normals u x g turn little from one facet to the next, so that a feature is on that side of a sheet, over its
normal or under it, on which the nearest one, along both strips, is known to be; planes of facets far away
say nothing of it, nor does the sign of a gap, which changes where edges pass through being parallel. Over the
seam of a one-sided band normals change their sign, and sides are those of the other edge.

Sides against sides have no sheet between them: of these the gap's sign is that of the nearest pair.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .touching import EDGE, FACET, VERTEX, IntArray, Shape, cross
from .touching_audit import audit
from .touching_barrier import Surroundings
from .touching_features import boxes_near
from .touching_gaps import ONE, TWO, Pairs, arguments, gap_values, places, vectors

TOUCHING = 1e-9
"""Gap, as part of l, below which its sign says nothing."""
KNOWN = 5e-3
"""Distance, as part of l, up to which pairs of the first shape make sides known."""
FARTHEST = 0.06
"""How far along both strips together, as part of l, a pair may be from one that is known."""
ROOM = 0.01
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""
MARGIN = 0.05
"""How far off its features, as part of h, a place may be while the gap counts, where that still bounds it."""
INSIDE = 1e-9
"""The same in the features' coordinates, everywhere."""


Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class _Known:
    """What is on which side (k,): features at `one` along the strip, on `track` 1 or 2 of its edges or 0 for
    rulings, over sheets at `two`, or beside sides there on track `other` > 0."""

    one: IntArray
    track: IntArray
    two: IntArray
    other: IntArray
    side: Array


class Sides:
    """Signs of gaps, from those of a shape that does not cross; `kept` are gaps that are closed there.

    With `corners` gaps count as well where others, which are larger, bound their places: sheets are then held
    where they could slip off each other.
    """

    def __init__(self, shape: Shape, kept: Pairs, corners: bool = False) -> None:
        self.corners = corners
        near = audit(shape, KNOWN * shape.length).near
        value, inside = gap_values(shape, near), _off(shape, near) <= 0.0
        clear = inside & (np.abs(value) > TOUCHING * shape.length)
        signed = Pairs(near.first, near.second, np.where(value < 0.0, -1.0, 1.0)).take(clear)
        known = signed.joined(kept)
        parts = [_asked(shape, known, turned) for turned in (False, True)]
        turns = [known.sign[at] * turn for at, _, turn in parts]
        one, track, two, other = (
            np.concatenate([getattr(asked, name) for _, asked, _ in parts])
            for name in ("one", "track", "two", "other")
        )
        self.known = _Known(one, track, two, other, np.concatenate(turns))
        self._near: Surroundings | None = None

    def near(self, shape: Shape, reach: float) -> tuple[Pairs, Array]:
        """The pairs whose gaps are less than a reach, with places on their features or hardly off, and their
        gaps; those whose side is not known are left out."""
        if self._near is None or reach > self._near.reach:
            self._near = Surroundings(reach, ROOM * shape.length)
        features = self._near.of(shape).features
        vf, ee = features.vertex_facet, features.edge_edge
        vf = vf[boxes_near(shape, vf, reach)]
        pairs = _typed(VERTEX, vf[:, 0], FACET, vf[:, 1]).joined(_typed(EDGE, ee[:, 0], EDGE, ee[:, 1]))
        pairs = pairs.take(np.abs(gap_values(shape, pairs)) <= reach)
        pairs = pairs.take(_off(shape, pairs) <= MARGIN)
        sign = self._signs(shape, pairs)
        pairs = Pairs(pairs.first, pairs.second, sign).take(sign != 0.0).ordered()
        value = gap_values(shape, pairs)
        if not self.corners:
            counts = _counts(shape, pairs, value)
            pairs, value = pairs.take(counts), value[counts]
        return pairs, value

    def _signs(self, shape: Shape, pairs: Pairs) -> Array:
        """The signs (k,) of pairs, 0 where they are not known."""
        sign, best = np.zeros(len(pairs)), np.full(len(pairs), FARTHEST * shape.segments)
        for turned in (False, True):
            at, asked, turn = _asked(shape, pairs, turned)
            away, side = self._nearest(shape, asked)
            nearer = away < best[at]
            best[at[nearer]] = away[nearer]
            sign[at[nearer]] = (side * turn)[nearer]
        return sign

    def _nearest(self, shape: Shape, asked: _Known) -> tuple[Array, Array]:
        """How far along both strips the nearest known side is, and that side."""
        known = self.known
        if not len(known.side):
            return np.full(len(asked.side), np.inf), asked.side
        far_one, over_one = _along(shape, asked.one, known.one)
        far_two, over_two = _along(shape, asked.two, known.two)
        away = far_one + far_two
        for track, theirs, over in (
            (asked.track, known.track, over_one),
            (asked.other, known.other, over_two),
        ):
            there = np.where(over & (theirs > 0) & (shape.sigma < 0), 3 - theirs, theirs)
            away = np.where(there == track[:, None], away, np.inf)
        best = away.argmin(axis=1)
        row = np.arange(len(best))
        flips = over_two[row, best] & (asked.other == 0)
        return away[row, best], np.where(flips, shape.sigma, 1) * known.side[best]


def _asked(shape: Shape, pairs: Pairs, turned: bool) -> tuple[IntArray, _Known, Array]:
    """Of pairs whose second feature is a sheet's, or if `turned` whose first one is: which, what of them lies
    on a side of what, and the sign of their gaps on the upper side. Pairs of sides come as they are."""
    (one, track), (two, other) = _tracks(pairs.first), _tracks(pairs.second)
    alike = (track > 0) & (other > 0)
    at = np.flatnonzero((track == 0) & ~alike if turned else (other == 0) | alike)
    six = vectors(shape, arguments(pairs))[at]
    if turned:
        one, track, two, other = two, other, one, track
    sheet = np.minimum(two[at], shape.segments - 1)
    normal = cross(shape.u[sheet], shape.rulings[sheet])
    upper = np.sign((cross(six[:, ONE], six[:, TWO]) * normal).sum(axis=1))
    turn = np.where(alike[at], 1.0, -upper if turned else upper)
    return at, _Known(one[at], track[at], two[at], other[at], turn), turn


def _along(shape: Shape, mine: IntArray, theirs: IntArray) -> tuple[Array, Flags]:
    """How many facets apart places (k,) and (m,) are along the strip, and whether the seam is between."""
    apart = np.abs(mine[:, None] - theirs)
    over = shape.closed & (2 * apart > shape.segments)
    return np.where(over, shape.segments - apart, apart).astype(np.float64), over


def _tracks(features: IntArray) -> tuple[IntArray, IntArray]:
    """Of features (k,2): where along the strip, and 1 for what is on its lower and 2 for what is on its upper
    edge, 0 for rulings and facets."""
    kind, number = features.T
    vertex, edge = kind == VERTEX, kind == EDGE
    at = np.where(vertex, number // 2, np.where(edge, number // 3, number))
    return at, np.where(vertex, number % 2 + 1, np.where(edge, number % 3, 0))


def _counts(shape: Shape, pairs: Pairs, value: Array) -> Flags:
    """Which gaps (k,) count. A gap whose place is off a feature bounds that place still where the next facet
    rises, or the next side bends, to the other feature: the gap is the less of the two there. Elsewhere it is
    the larger one, and the one that is less does not count."""
    at, six, names = places(shape, pairs), vectors(shape, arguments(pairs)), pairs.names()
    known = dict(zip(names, value.tolist(), strict=True))
    normal = pairs.sign[:, None] * cross(six[:, ONE], six[:, TWO])
    out = np.abs(at[:, 3] - 0.5) <= 0.5 + INSIDE
    for k, features, toward in ((0, pairs.first, -normal), (2, pairs.second, normal)):
        for row in np.flatnonzero(np.abs(at[:, k] - 0.5) > 0.5 + INSIDE).tolist():
            kind, number = features[row].tolist()
            beyond, rises = _beyond(shape, kind, number, bool(at[row, k] > 0.5))
            if beyond < 0:
                out[row] = False
            elif rises @ toward[row] <= 0.0:
                ends = [names[row][:2], names[row][2:]]
                ends[k // 2] = (kind, beyond)
                one, other = sorted(ends)
                out[row] &= known.get((*one, *other), -np.inf) <= value[row]
    return out


def _beyond(shape: Shape, kind: int, number: int, ahead: bool) -> tuple[int, Array]:
    """The facet or side that comes next to one, -1 if none does, and where it rises or bends to."""
    n, track = shape.segments, 0 if kind == FACET else number % 3
    k = number if kind == FACET else number // 3
    there = k + 1 if ahead else k - 1
    if (kind == EDGE and not track) or (not shape.closed and not 0 <= there < n):
        return -1, np.zeros(3)
    over = there % n
    if kind == FACET:
        return over, shape.u[over] if ahead else -shape.u[over]
    swapped = 3 - track if over != there and shape.sigma < 0 else track
    turn = shape.u[over] - shape.u[k] if ahead else shape.u[k] - shape.u[over]
    return 3 * over + swapped, turn


def _off(shape: Shape, pairs: Pairs) -> Array:
    """How far (k,) places are off their features, as parts of h."""
    at, across = places(shape, pairs), 2.0 * shape.half_width / shape.h
    size = np.ones_like(at)
    for k, features in ((0, pairs.first), (2, pairs.second)):
        size[(features[:, 0] == EDGE) & (features[:, 1] % 3 == 0), k] = across
    size[pairs.second[:, 0] == FACET, 3] = across
    out: Array = (size * np.maximum(-at, at - 1.0)).max(axis=1, initial=0.0)
    return out


def _typed(one: int, first: IntArray, two: int, second: IntArray) -> Pairs:
    count = len(first)
    return Pairs(
        np.column_stack((np.full(count, one), first)).astype(np.int64),
        np.column_stack((np.full(count, two), second)).astype(np.int64),
        np.ones(count),
    )
