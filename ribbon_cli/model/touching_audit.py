"""Whether a strip crosses itself, and whether it did on the way from one shape to another: over all pairs.

Nothing here knows which pairs a solver has thought of. Candidates come from a descent through a tree of
runs of facets (`contact.near_facets`) that misses no pair within a bound; pairs of features nearer on the
flat strip than the excluded distance do not count.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .touching import EDGE, FACET, VERTEX, IntArray, Shape, box_of, cross
from .touching_features import (
    BLOCK,
    Features,
    boxes_meet,
    boxes_near,
    counted,
    edge_distances,
    facets_near,
    in_facet,
    unique_pairs,
    within_reach,
)
from .touching_gaps import Pairs

CLEAR = 1e-3
"""Reach, as part of l, within which a clearance is looked for first; it grows tenfold."""
ROOT_STEPS = 60
MOST_PARTS = 16
"""Places of a motion at which depths are measured at most."""
INSIDE = 1e-12
"""Margin of a feature's coordinates within which a crossing counts as inside."""


# --- a shape ---


@dataclass(frozen=True)
class Crossing:
    """An edge through a facet: their numbers (k,), the depth (k,) of each, and the pair of features whose gap
    would have to open least to undo it."""

    edge: IntArray
    facet: IntArray
    depth: Array


@dataclass(frozen=True)
class Audit:
    """What all pairs of a shape say.

    `clearance` is the least distance of two features, in the unit of length, `penetration` the greatest depth
    of an edge through a facet: how far the edge's end is beyond the facet's plane, or the edge beyond the
    facet's rim, whichever is less. `near` are the pairs within the reach asked for, `distance` theirs.
    """

    clearance: float
    penetration: float
    near: Pairs
    distance: Array
    crossing: Crossing

    def lacks(self, gap: float) -> float:
        """How much features are nearer than a gap that they are to keep, or how deep they cross."""
        return max(self.penetration, gap - self.clearance)


def audit(shape: Shape, reach: float | None = None) -> Audit:
    """Look at all pairs of a shape.

    With a `reach`, only pairs within it are measured, and `clearance` is `reach` where there are none.
    """
    within = CLEAR * shape.length if reach is None else reach
    while True:
        found = _audit(shape, within)
        if reach is not None or found.clearance < within or within > shape.length:
            return found
        within *= 10.0


def _audit(shape: Shape, reach: float) -> Audit:
    i, j = facets_near((shape,), shape.vertices, np.zeros(shape.segments), reach)
    features = Features.of((shape,), i, j, within_reach(shape, reach))
    heights, over = _over_facets(shape, features.vertex_facet)
    between = edge_distances(shape, features.edge_edge)
    vf = np.flatnonzero(over & (np.abs(heights) <= reach))
    ee = np.flatnonzero(between <= reach)
    distance = np.concatenate((np.abs(heights[vf]), between[ee]))
    near = _pairs(features.vertex_facet[vf], features.edge_edge[ee])
    crossing = _crossings(shape, i, j)
    beside = _beside_facets(shape, features.vertex_facet[~over], reach)
    clearance = min(float(distance.min(initial=reach)), float(beside.min(initial=reach)))
    depth = float(crossing.depth.max()) if crossing.depth.size else 0.0
    return Audit(0.0 if depth > 0 else clearance, depth, near, distance, crossing)


def penetration(shape: Shape) -> float:
    """The greatest depth of an edge through a facet."""
    i, j = facets_near((shape,), shape.vertices, np.zeros(shape.segments), 0.0)
    return float(_crossings(shape, i, j).depth.max(initial=0.0))


def _pairs(vf: IntArray, ee: IntArray) -> Pairs:
    first = np.vstack(
        (
            np.column_stack((np.full(len(vf), VERTEX), vf[:, 0])),
            np.column_stack((np.full(len(ee), EDGE), ee[:, 0])),
        )
    )
    second = np.vstack(
        (
            np.column_stack((np.full(len(vf), FACET), vf[:, 1])),
            np.column_stack((np.full(len(ee), EDGE), ee[:, 1])),
        )
    )
    return Pairs(first, second, np.ones(len(first)))


def _over_facets(shape: Shape, pairs: IntArray) -> tuple[Array, NDArray[np.bool_]]:
    """Heights (k,) of vertices over facets' planes, and whether their feet are on the facets."""
    v, f = pairs[:, 0], pairs[:, 1]
    along, across, height = in_facet(shape, shape.vertices[v], f)
    return height, _on_facet(along, across, shape.xi[f])


def _beside_facets(shape: Shape, pairs: IntArray, reach: float) -> Array:
    """Distances (k,) within a reach of vertices from facets' rims."""
    pairs = pairs[boxes_near(shape, pairs, reach)]
    points = shape.vertices[pairs[:, 0]]
    rim = shape.vertices[shape.corner_numbers[pairs[:, 1]]]
    along = np.roll(rim, -1, axis=1) - rim
    off = points[:, None] - rim
    square = np.maximum((along * along).sum(axis=2), np.finfo(float).tiny)
    part = np.clip((off * along).sum(axis=2) / square, 0.0, 1.0)
    out: Array = np.linalg.norm(off - part[..., None] * along, axis=2).min(axis=1, initial=np.inf)
    return out


def _on_facet(along: Array, across: Array, xi: Array) -> NDArray[np.bool_]:
    far = 1.0 + across * np.tanh(xi)
    out: NDArray[np.bool_] = (np.abs(across) <= 1.0 + INSIDE) & (along >= -INSIDE) & (along <= far + INSIDE)
    return out


def _crossings(shape: Shape, i: IntArray, j: IntArray) -> Crossing:
    """Edges through facets, of pairs of facets that may meet."""
    edges = shape.edge_numbers
    one = np.stack((edges[i], np.broadcast_to(j[:, None], (len(j), 4))), axis=-1).reshape(-1, 2)
    other = np.stack((edges[j], np.broadcast_to(i[:, None], (len(i), 4))), axis=-1).reshape(-1, 2)
    ef = unique_pairs(np.vstack((one, other)))
    ef = ef[~shape.slivers[ef[:, 0]]]
    first, last = shape.edge_ends(ef[:, 0])
    points, f = shape.vertices, ef[:, 1]
    a0, c0, h0 = in_facet(shape, points[first], f)
    a1, c1, h1 = in_facet(shape, points[last], f)
    through = np.flatnonzero(h0 * h1 < 0)
    ef, f = ef[through], f[through]
    a0, c0, h0, a1, c1, h1 = (v[through] for v in (a0, c0, h0, a1, c1, h1))
    part = h0 / (h0 - h1)
    along, across = a0 + part * (a1 - a0), c0 + part * (c1 - c0)
    inside = np.flatnonzero(_on_facet(along, across, shape.xi[f]))
    ef, f, h0, h1 = ef[inside], f[inside], h0[inside], h1[inside]
    far = np.flatnonzero(counted((shape,), Shape.flat_of_edges, Shape.flat_of_facets, ef))
    ef, f, h0, h1 = ef[far], f[far], h0[far], h1[far]
    depth = np.minimum(np.abs(h0), np.abs(h1))
    for k in range(4):
        depth = np.minimum(depth, edge_distances(shape, np.column_stack((ef[:, 0], edges[f, k]))))
    return Crossing(ef[:, 0], f, depth)


# --- a motion ---


@dataclass(frozen=True)
class Passages:
    """Where features pass through each other on a straight way: the pairs, with the sign that keeps them
    on the side where they were, and when (k,), 0 to 1, in order."""

    pairs: Pairs
    when: Array

    def __len__(self) -> int:
        return len(self.when)


class Motion:
    """The straight way of all vertices from one shape to another, which is first turned to where the first is
    (Kabsch 1976)."""

    def __init__(self, before: Shape, after: Shape) -> None:
        self.before = before
        p, q = before.vertices, after.vertices
        here, there = q.mean(axis=0), p.mean(axis=0)
        u, _, v = np.linalg.svd((q - here).T @ (p - there))
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        self.after = after.turned(turn, there - here @ turn)
        self._p, self._q = p, self.after.vertices

    def at(self, part: float) -> Shape:
        """The shape at a part of the way."""
        return self.before.between(self.after, part)

    def passages(self) -> Passages:
        """Continuous collision detection over all pairs.

        No bound on the motion is assumed: the search for candidates has each facet's own motion for its
        slack.
        """
        return self._among(*_swept_facets((self.before, self.after), self._p, self._q))

    def passages_of_all_pairs(self) -> Passages:
        """The same over every pair of facets, without a search: for small N, and for tests."""
        return self._among(*np.triu_indices(self.before.segments, 1))

    def _among(self, i: IntArray, j: IntArray) -> Passages:
        shapes = self.before, self.after
        features = Features.of(shapes, i, j, partial(_swept_near, self.before, self._p, self._q))
        return _passages(self.before, self.after, self._p, self._q, features)

    def depth(self, met: Passages) -> float:
        """The greatest depth of a crossing, looked for once between any two times at which features meet."""
        times = np.unique(np.concatenate((met.when, [0.0, 1.0])))
        parts = 0.5 * (times[1:] + times[:-1])
        if len(parts) > MOST_PARTS:
            parts = parts[np.linspace(0, len(parts) - 1, MOST_PARTS).astype(int)]
        return max(penetration(self.at(float(part))) for part in parts)


def passages(before: Shape, after: Shape) -> Passages:
    """Where features pass through each other on the straight way from one shape to another."""
    return Motion(before, after).passages()


def _passages(before: Shape, after: Shape, p: Array, q: Array, features: Features) -> Passages:
    """The pairs of features that meet while vertices go from p to q."""
    corners = before.corner_numbers
    found: list[tuple[int, IntArray, Array, Array]] = []
    for start in range(0, len(features.vertex_facet), BLOCK):
        block = features.vertex_facet[start : start + BLOCK]
        rim, v = corners[block[:, 1]], block[:, 0]
        four = np.vstack([np.column_stack((rim[:, three], v)) for three in ((0, 1, 2), (0, 2, 3))])
        k, t, s = _meetings(p, q, four, _in_triangle)
        # The triangle's normal is along g x u, that of gaps along u x g.
        found.append((FACET, block[k % len(block)], t, -s))
    for start in range(0, len(features.edge_edge), BLOCK):
        block = features.edge_edge[start : start + BLOCK]
        four = np.column_stack((*before.edge_ends(block[:, 0]), *before.edge_ends(block[:, 1])))
        k, t, s = _meetings(p, q, four, _in_both)
        found.append((EDGE, block[k], t, s))
    facing = [f for f in found if f[0] == FACET]
    beside = [f for f in found if f[0] == EDGE]
    none = np.empty((0, 2), dtype=np.int64)
    pairs = _pairs(
        np.vstack([f[1] for f in facing]) if facing else none,
        np.vstack([f[1] for f in beside]) if beside else none,
    )
    when = np.concatenate([f[2] for f in (*facing, *beside)]) if found else np.empty(0)
    rate = np.concatenate([f[3] for f in (*facing, *beside)]) if found else np.empty(0)
    order = np.lexsort((*np.hstack((pairs.first, pairs.second)).T[::-1], when))
    pairs = Pairs(pairs.first, pairs.second, np.where(rate > 0, -1.0, 1.0))
    return Passages(pairs.take(order), when[order])


def _swept_facets(shapes: tuple[Shape, ...], p: Array, q: Array) -> tuple[IntArray, IntArray]:
    """Pairs of facets with features that count and may meet on the way from p to q."""
    middle, half = 0.5 * (p + q), 0.5 * np.linalg.norm(q - p, axis=1)
    slack = half[shapes[0].corner_numbers].max(axis=1)
    return facets_near(shapes, middle, slack, 0.0)


def _swept_near(shape: Shape, p: Array, q: Array, features: Features) -> Features:
    """The pairs whose boxes, of all of their way from p to q, meet."""
    points = np.minimum(p, q), np.maximum(p, q)
    first, last = shape.edge_ends(np.arange(3 * len(shape.nodes)))
    edges = np.minimum(points[0][first], points[0][last]), np.maximum(points[1][first], points[1][last])
    facets = box_of(points[0][shape.corner_numbers])[0], box_of(points[1][shape.corner_numbers])[1]
    vf, ee = features.vertex_facet, features.edge_edge
    return Features(vf[boxes_meet(points, facets, vf)], ee[boxes_meet(edges, edges, ee)])


def first_meeting(before: Shape, after: Shape, features: Features | None = None) -> float:
    """When features first meet on the straight way from one shape to another, infinite if they do not: some
    features, or all that count in the first shape."""
    p, q = before.vertices, after.vertices
    near = partial(_swept_near, before, p, q)
    if features is None:
        features = Features.of((before,), *_swept_facets((before,), p, q), near)
    when = _passages(before, before, p, q, near(features)).when
    return float(when[0]) if len(when) else np.inf


def _meetings(  # type: ignore[no-untyped-def]
    p: Array, q: Array, four: IntArray, inside
) -> tuple[IntArray, Array, Array]:
    """Of quadruples of vertices (k,4): which become coplanar with their features touching, when, and which
    way the volume goes then; once for each of three roots."""
    # Boxes of the whole motion first.
    count = 3 if inside is _in_triangle else 2
    low, high = np.minimum(p, q), np.maximum(p, q)
    (low_one, _), (_, high_one) = box_of(low[four[:, :count]]), box_of(high[four[:, :count]])
    (low_two, _), (_, high_two) = box_of(low[four[:, count:]]), box_of(high[four[:, count:]])
    rows = np.arange(len(four))
    kept = boxes_meet((low_one, high_one), (low_two, high_two), np.column_stack((rows, rows)))
    a, d = p[four[kept]], q[four[kept]] - p[four[kept]]
    coefficients = _volume(a, d)
    at, t = _roots(coefficients)
    good = inside(a[at] + t[:, None, None] * d[at])
    at, t = at[good], t[good]
    c = coefficients[at]
    return kept[at], t, c[:, 1] + t * (2.0 * c[:, 2] + 3.0 * t * c[:, 3])


def _volume(a: Array, d: Array) -> Array:
    """Coefficients (k,4) of (x1 - x0) x (x2 - x0).(x3 - x0) for x = a + t d."""
    e, f = a[:, 1:] - a[:, :1], d[:, 1:] - d[:, :1]
    out = np.zeros((len(a), 4))
    normals = [cross(one[:, 0], two[:, 1]) for two in (e, f) for one in (e, f)]
    for mask in range(8):
        third = (f if mask >> 2 else e)[:, 2]
        out[:, mask.bit_count()] += (normals[mask & 3] * third).sum(axis=1)
    return out


def _roots(c: Array) -> tuple[IntArray, Array]:
    """The roots in [0, 1] of cubics (k,4), ascending powers: which cubic, and where, (m,) each.

    Between 0, the extrema and 1 a cubic is monotone: a change of sign there is halved down to rounding.
    """
    a, b = 3.0 * c[:, 3], c[:, 2]
    square = b * b - a * c[:, 1]
    stop = -b - np.copysign(np.sqrt(np.maximum(square, 0.0)), b)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turns = np.stack((stop / a, c[:, 1] / stop))
    turns = np.where(np.isfinite(turns) & (square > 0), np.clip(turns, 0.0, 1.0), 0.0)
    cuts = np.vstack((np.zeros(len(c)), turns.min(axis=0), turns.max(axis=0), np.ones(len(c))))
    values = _cubic(c, cuts)
    part, at = np.nonzero((values[:-1] * values[1:] <= 0) & (cuts[1:] > cuts[:-1]))
    return at, _halved(c[at], cuts[part, at], cuts[part + 1, at], values[part, at])


def _cubic(c: Array, t: Array) -> Array:
    """Cubics (k,4), ascending powers, at t (...,k)."""
    out: Array = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3]))
    return out


def _halved(c: Array, low: Array, high: Array, at_low: Array) -> Array:
    """The one root between each low and high: by Newton's method where that stays between them and more than
    halves what is left, else by halving."""
    t, width = 0.5 * (low + high), high - low
    for _ in range(ROOT_STEPS):
        value = _cubic(c, t)
        same = value * at_low > 0
        low, high = np.where(same, t, low), np.where(same, high, t)
        slope = c[:, 1] + t * (2.0 * c[:, 2] + 3.0 * t * c[:, 3])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            following = t - value / slope
        far = np.abs(following - t)
        good = (following > low) & (following < high) & (far < 0.5 * width)
        width = np.where(good, far, 0.5 * (high - low))
        before, t = t, np.where(value == 0.0, t, np.where(good, following, 0.5 * (low + high)))
        if (np.abs(t - before) <= np.finfo(float).eps * t).all():
            break
    return t


MARGIN = 1e-9
"""Margin of a triangle's and an edge's coordinates at a meeting: a passage between two features counts for
both."""


def _in_triangle(x: Array) -> NDArray[np.bool_]:
    """Whether the fourth of coplanar points (k,4,3) is in the triangle of the others."""
    e, f, off = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    normal = cross(e, f)
    square = np.maximum((normal * normal).sum(1), np.finfo(float).tiny)
    first = (cross(off, f) * normal).sum(1) / square
    second = (cross(e, off) * normal).sum(1) / square
    out: NDArray[np.bool_] = (first >= -MARGIN) & (second >= -MARGIN) & (first + second <= 1.0 + MARGIN)
    return out


def _in_both(x: Array) -> NDArray[np.bool_]:
    """Whether coplanar segments x0 x1 and x2 x3 meet."""
    d, e, off = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2], x[:, 2] - x[:, 0]
    normal = cross(d, e)
    square = np.maximum((normal * normal).sum(1), np.finfo(float).tiny)
    s = (cross(off, e) * normal).sum(1) / square
    t = (cross(off, d) * normal).sum(1) / square
    low, high = -MARGIN, 1.0 + MARGIN
    out: NDArray[np.bool_] = (s >= low) & (s <= high) & (t >= low) & (t <= high)
    return out
