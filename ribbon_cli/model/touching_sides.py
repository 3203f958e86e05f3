"""On which side of each other features are while sheets slide: known from a shape that does not cross.

A vertex that slides off a facet comes over the next one, and a side that crosses a ruling crosses the next.
Tangents, rulings and facets' normals turn little from one facet to the next, so that the sign of a gap is
that of the nearest pair, along both strips, whose sign is known; the planes of facets far away say nothing of
it. Over the seam of a one-sided band rulings and normals change their sign, and sides are those of the other
edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .touching import EDGE, FACET, VERTEX, IntArray, Shape
from .touching_audit import audit, boxes_near
from .touching_barrier import Neighbourhood, nearest
from .touching_gaps import Pairs, arguments, gaps, places, vectors

TOUCHING = 1e-9
"""Gap, as part of l, below which its sign says nothing."""
KNOWN = 5e-3
"""Distance, as part of l, up to which pairs of the first shape make sides known."""
FARTHEST = 0.06
"""How far along both strips together, as part of l, a pair may be from one that is known."""
ROOM = 0.01
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""
MARGIN = 0.05
"""How far off its features, in their coordinates, a place may be while the gap counts."""


class Sides:
    """Signs of gaps, from those of a shape that does not cross; `kept` are gaps that are closed there."""

    def __init__(self, shape: Shape, kept: Pairs) -> None:
        near = audit(shape, KNOWN * shape.length).near
        value, inside = _gaps(shape, near), _off(shape, near) <= 0.0
        clear = inside & (np.abs(value) > TOUCHING * shape.length)
        signed = Pairs(near.first, near.second, np.where(value < 0.0, -1.0, 1.0)).take(clear)
        known = signed.joined(kept)
        self.known = known.joined(Pairs(known.second, known.first, known.sign))
        self._near: Neighbourhood | None = None

    def near(self, shape: Shape, reach: float) -> tuple[Pairs, NDArray[np.float64]]:
        """The pairs whose gaps are less than a reach, with places on their features or hardly off, and their
        gaps; those whose side is not known are left out."""
        if self._near is None or not self._near.covers(shape):
            self._near = Neighbourhood.of(shape, reach, ROOM * shape.length)
        features = self._near.features
        vf = features.vertex_facet
        vf = vf[boxes_near(shape, vf, reach)]
        ee = features.edge_edge
        pairs = _typed(VERTEX, vf[:, 0], FACET, vf[:, 1]).joined(_typed(EDGE, ee[:, 0], EDGE, ee[:, 1]))
        value = _gaps(shape, pairs)
        pairs = pairs.take(np.abs(value) <= reach)
        pairs = pairs.take(_off(shape, pairs) <= MARGIN)
        sign = self._signs(shape, pairs)
        pairs = Pairs(pairs.first, pairs.second, sign).take(sign != 0.0).ordered()
        return pairs, _gaps(shape, pairs)

    def _signs(self, shape: Shape, pairs: Pairs) -> NDArray[np.float64]:
        """The signs (k,) of pairs, 0 where they are not known."""
        known = self.known
        if not len(known) or not len(pairs):
            return np.zeros(len(pairs))
        away = np.zeros((len(pairs), len(known)))
        sign = np.broadcast_to(known.sign, away.shape).copy()
        for mine, theirs in ((pairs.first, known.first), (pairs.second, known.second)):
            far, turned = _along(shape, mine, theirs)
            away += far
            sign = np.where(turned, shape.sigma * sign, sign)
        best = away.argmin(axis=1)
        row = np.arange(len(pairs))
        return np.where(away[row, best] <= FARTHEST * shape.segments, sign[row, best], 0.0)


class Distances:
    """The same for a gap that is not zero: pairs as they are nearest, whose distances need no side."""

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self._near: Neighbourhood | None = None

    def near(self, shape: Shape, reach: float) -> tuple[Pairs, NDArray[np.float64]]:
        """See `Sides`."""
        if self._near is None or not self._near.covers(shape):
            self._near = Neighbourhood.of(shape, reach, ROOM * shape.length)
        pairs = nearest(shape, self._near.features, reach).unique()
        return pairs, _gaps(shape, pairs)


def nearer(shape: Shape, reach: float) -> Pairs:
    """The pairs nearer than a reach, over all pairs, each once and as it is nearest."""
    return nearest(shape, Neighbourhood.of(shape, reach, 0.0).features, reach).unique()


def _along(shape: Shape, mine: IntArray, theirs: IntArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """How many facets apart features (k,2) and (m,2) are along the strip, infinitely many for those that are
    not alike; and whether directions across the strip change their sign on the way."""
    (k, track, across), (m, other, also) = (_tracks(of) for of in (mine, theirs))
    apart = np.abs(k[:, None] - m)
    over_seam = shape.closed & (2 * apart > shape.segments)
    swapped = over_seam & (shape.sigma < 0)
    same = np.where(swapped & (other > 0), 3 - other, other) == track[:, None]
    alike = same & (mine[:, 0][:, None] == theirs[:, 0])
    far = np.where(over_seam, shape.segments - apart, apart)
    return np.where(alike, far, np.inf), over_seam & across[:, None] & also


def _tracks(features: IntArray) -> tuple[IntArray, IntArray, NDArray[np.bool_]]:
    """Of features (k,2): where along the strip, 1 for what is on its lower and 2 for what is on its upper
    edge, 0 for rulings and facets, and whether it is one of these."""
    kind, number = features.T
    vertex, edge = kind == VERTEX, kind == EDGE
    at = np.where(vertex, number // 2, np.where(edge, number // 3, number))
    track = np.where(vertex, number % 2 + 1, np.where(edge, number % 3, 0))
    return at, track, track == 0


def _gaps(shape: Shape, pairs: Pairs) -> NDArray[np.float64]:
    what = arguments(pairs)
    return gaps(vectors(shape, what), what, pairs.sign, shape.half_width).value


def _off(shape: Shape, pairs: Pairs) -> NDArray[np.float64]:
    """How far (k,) places are off their features, in the features' coordinates."""
    at = places(shape, pairs)
    out: NDArray[np.float64] = np.maximum(-at, at - 1.0).max(axis=1, initial=0.0)
    return out


def _typed(one: int, first: IntArray, two: int, second: IntArray) -> Pairs:
    count = len(first)
    return Pairs(
        np.column_stack((np.full(count, one), first)).astype(np.int64),
        np.column_stack((np.full(count, two), second)).astype(np.int64),
        np.ones(count),
    )
