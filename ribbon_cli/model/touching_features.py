"""Which features of a strip are to be looked at together: pairs that are near each other and count.

Candidates are pairs of facets from a descent through a tree of runs (`contact.near_facets`) that misses no
pair within a bound. In fans, where a third of all facets may be near each other, most of them are left out by
where on the flat strip they are near; what is left is taken in blocks, so that memory is linear in N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .contact import near_facets
from .touching import IntArray, Shape, cross, dots

BLOCK = 100_000
"""Pairs of features worked on at once."""
FACETS_AT_ONCE = 4096
"""Pairs of facets whose features are looked at at once."""
ROUNDING = 1e-9
"""Margin of bounds by which pairs are left out, for rounding."""


@dataclass(frozen=True)
class Features:
    """Pairs of numbers (k,2): vertices with facets, and edges with edges, in the order of their numbers."""

    vertex_facet: IntArray
    edge_edge: IntArray

    @classmethod
    def of(
        cls,
        shapes: tuple[Shape, ...],
        i: IntArray,
        j: IntArray,
        near: Callable[[Features], Features] | None = None,
    ) -> Features:
        """The features of pairs of facets that count in any of the shapes of one strip, of those that `near`
        leaves."""
        slivers = np.all([s.slivers for s in shapes], axis=0)
        none = np.empty((0, 2), dtype=np.int64)
        parts = [cls(none, none)]
        # In fans many facets are near each other whose features do not count: memory is that of a block.
        for first in range(0, len(i), FACETS_AT_ONCE):
            block = slice(first, first + FACETS_AT_ONCE)
            part = cls._of_facets(shapes[0], i[block], j[block], slivers)
            part = part if near is None else near(part)
            vf, ee = part.vertex_facet, part.edge_edge
            vf = vf[counted(shapes, Shape.flat_of_vertices, Shape.flat_of_facets, vf)]
            parts.append(cls(vf, ee[counted(shapes, Shape.flat_of_edges, Shape.flat_of_edges, ee)]))
        return cls(
            unique_pairs(np.vstack([part.vertex_facet for part in parts])),
            unique_pairs(np.vstack([part.edge_edge for part in parts])),
        )

    @classmethod
    def _of_facets(cls, shape: Shape, i: IntArray, j: IntArray, slivers: NDArray[np.bool_]) -> Features:
        """All features of pairs of facets but slivers, and what has a vertex in common."""
        corners, edges = shape.corner_numbers, shape.edge_numbers
        one = np.stack((corners[i], np.broadcast_to(j[:, None], (len(j), 4))), axis=-1).reshape(-1, 2)
        other = np.stack((corners[j], np.broadcast_to(i[:, None], (len(i), 4))), axis=-1).reshape(-1, 2)
        vf = unique_pairs(np.vstack((one, other)))
        first = np.repeat(edges[i], 4, axis=1).reshape(-1)
        second = np.tile(edges[j], (1, 4)).reshape(-1)
        ee = unique_pairs(np.stack((np.minimum(first, second), np.maximum(first, second)), axis=-1))
        ee = ee[(ee[:, 0] != ee[:, 1]) & ~slivers[ee].any(axis=1)]
        vf = vf[(corners[vf[:, 1]] != vf[:, :1]).all(axis=1)]
        (first, last), (start, end) = (shape.edge_ends(ee[:, k]) for k in (0, 1))
        return cls(vf, ee[(first != start) & (first != end) & (last != start) & (last != end)])


def within_reach(shape: Shape, reach: float) -> Callable[[Features], Features]:
    """What leaves out pairs that are farther apart in a shape: vertices from facets' boxes and planes."""

    def near(features: Features) -> Features:
        vf = features.vertex_facet
        return Features(vf[boxes_near(shape, vf, reach)], edges_near(shape, features.edge_edge, reach))

    return near


def boxes_near(shape: Shape, vf: IntArray, within: float) -> IntArray:
    """Which vertices (k,) are within a distance of facets' boxes, and of their planes."""
    points = shape.vertices
    at = boxes_meet((points, points), shape.facet_boxes, vf, within)
    vf = vf[at]
    out: IntArray = at[np.abs(_heights(shape, points[vf[:, 0]], vf[:, 1])) <= within]
    return out


def edges_near(shape: Shape, ee: IntArray, within: float) -> IntArray:
    """The pairs of edges (k,2) that are within a distance of each other."""
    ee = ee[boxes_meet(shape.edge_boxes, shape.edge_boxes, ee, within)]
    return ee[edge_distances(shape, ee) <= within]


def boxes_meet(
    one: tuple[Array, Array], other: tuple[Array, Array], pairs: IntArray, within: float = 0.0
) -> IntArray:
    """Which pairs (k,2) have boxes, given by their lowest and highest corners (n,3), that are nowhere farther
    apart than `within` along an axis."""
    at = np.arange(len(pairs))
    a, b = pairs.T
    for axis in range(3):
        low, high, below, above = (box[:, axis] for box in (*one, *other))
        keep = (low[a] <= above[b] + within) & (below[b] <= high[a] + within)
        at, a, b = at[keep], a[keep], b[keep]
    return at


def unique_pairs(pairs: IntArray) -> IntArray:
    """Sorted pairs (k,2), each once."""
    big = np.int64(1) << 31
    key = np.sort(pairs[:, 0].astype(np.int64) * big + pairs[:, 1])
    first = np.ones(len(key), dtype=bool)
    first[1:] = key[1:] != key[:-1]
    return np.stack(np.divmod(key[first], big), axis=-1)


def counted(shapes, first, second, pairs: IntArray) -> NDArray[np.bool_]:  # type: ignore[no-untyped-def]
    """Where features are far enough apart on the flat strip, in one of the shapes at least."""
    out = np.zeros(len(pairs), dtype=bool)
    for start in range(0, len(pairs), BLOCK):
        block = slice(start, start + BLOCK)
        a, b = pairs[block, 0], pairs[block, 1]
        for shape in shapes:
            apart = shape.flat_distance(first(shape, a), second(shape, b), shape.excluded)
            out[block] |= apart >= shape.excluded
    return out


def corners_of(shape: Shape, vertices: Array) -> Array:
    """Facets' corners (3,4,N) at given places of the vertices."""
    return np.ascontiguousarray(vertices[shape.corner_numbers].transpose(2, 1, 0))


def facets_near(
    shapes: tuple[Shape, ...], points: Array, slack: Array, reach: float
) -> tuple[IntArray, IntArray]:
    """Pairs i < j of facets with features that count in any of the shapes of one strip, and may come nearer
    than a reach while no vertex of facet k moves by more than `slack` (N,) from `points` (2M,3).

    In a fan of rulings facets are near each other at one rim only, and less than the excluded distance apart
    there on the flat strip: so is whatever of them has a place on that rim. What else there is has a place
    on the other side of one of the two facets.
    """
    i, j = near_facets(corners_of(shapes[0], points), slack, reach)
    kept = [np.empty(0, dtype=np.int64)]
    for first in range(0, len(i), FACETS_AT_ONCE):
        block = slice(first, first + FACETS_AT_ONCE)
        kept.append(first + _outside_fans(shapes, points, slack, reach, i[block], j[block]))
    at = np.concatenate(kept)
    return i[at], j[at]


def _outside_fans(
    shapes: tuple[Shape, ...], points: Array, slack: Array, reach: float, i: IntArray, j: IntArray
) -> IntArray:
    """Which pairs of facets are not near each other at a rim alone where nothing counts."""
    shape = shapes[0]
    rim = np.full(len(i), -1)
    over = shape.closed & (2 * (j - i) > shape.segments)
    swapped = over & (shape.sigma < 0)
    for k in (0, 1):
        rim = np.where(_at_rim(shapes, k, i, j, over, swapped), k, rim)
    at = np.flatnonzero(rim >= 0)
    a, b = i[at], j[at]
    outer = 1 - rim[at], 1 - np.where(swapped, 1 - rim, rim)[at]
    corners = points[shape.corner_numbers]
    sides = np.stack((corners[:, [0, 3]], corners[:, [1, 2]]), axis=1)  # (N, rim, end, 3)
    middle = 0.5 * (sides[:, :, 0] + sides[:, :, 1])
    half = 0.5 * np.sqrt(((sides[:, :, 1] - sides[:, :, 0]) ** 2).sum(axis=2))
    wide = half.max(axis=1) + slack
    bound = (1.0 + ROUNDING) * (reach + wide[a] + wide[b])
    far = _from_rulings(middle[a, outer[0]], middle, b) > bound
    far[far] = _from_rulings(middle[b, outer[1]][far], middle, a[far]) > bound[far]
    keep = np.ones(len(i), dtype=bool)
    keep[at[far]] = False
    return np.flatnonzero(keep)


def _at_rim(
    shapes: tuple[Shape, ...],
    k: int,
    i: IntArray,
    j: IntArray,
    over: NDArray[np.bool_],
    swapped: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Whether facets' sides on rim k of the first, 0 or 1, are within the excluded distance in all shapes."""
    out = np.ones(len(i), dtype=bool)
    for shape in shapes:
        along = shape.flat_corners[:, :, 0]
        ends = np.stack((along[:, [0, 3]], along[:, [1, 2]]), axis=1)
        low, high = ends.min(axis=2), ends.max(axis=2)
        theirs, shift = np.where(swapped, 1 - k, k), np.where(over, -shape.length, 0.0)
        last = np.maximum(high[i, k], high[j, theirs] + shift)
        first = np.minimum(low[i, k], low[j, theirs] + shift)
        out &= last - first < (1.0 - ROUNDING) * shape.excluded
    return out


def _from_rulings(points: Array, middle: Array, facets: IntArray) -> Array:
    """Distances (k,) of points (k,3) from the middle rulings of facets, from one side to the other."""
    start, along = middle[facets, 0], middle[facets, 1] - middle[facets, 0]
    off = points - start
    part = np.clip(dots(off, along) / np.maximum(dots(along, along), np.finfo(float).tiny), 0.0, 1.0)
    rest = off - part[:, None] * along
    out: Array = np.sqrt(dots(rest, rest))
    return out


def in_facet(shape: Shape, points: Array, f: IntArray) -> tuple[Array, Array, Array]:
    """Coordinates of points (k,3) in facets: multiples of h u and of b g, and the height over u x g."""
    u, g, off = shape.u[f], shape.rulings[f], points - shape.nodes[f]
    normal = cross(u, g)
    square = (normal * normal).sum(axis=1)
    along = (cross(off, g) * normal).sum(axis=1) / (square * shape.h)
    across = (cross(u, off) * normal).sum(axis=1) / (square * shape.half_width)
    return along, across, (off * normal).sum(axis=1) / np.sqrt(square)


def _heights(shape: Shape, points: Array, f: IntArray) -> Array:
    """The last of these coordinates alone."""
    normal = cross(shape.u[f], shape.rulings[f])
    off = points - shape.nodes[f]
    out: Array = (off * normal).sum(axis=1) / np.sqrt((normal * normal).sum(axis=1))
    return out


def edge_distances(shape: Shape, pairs: IntArray) -> Array:
    """Distances (k,) of edges."""
    points = shape.vertices
    ends = [points[e] for which in (0, 1) for e in shape.edge_ends(pairs[:, which])]
    return segment_distance(*ends)


def segment_distance(p: Array, p1: Array, q: Array, q1: Array) -> Array:
    """Distances (k,) of segments p p1 and q q1, (k,3) each; C. Ericson (2005), 5.1.9."""
    tiny = np.finfo(float).tiny
    d, e, r = p1 - p, q1 - q, p - q
    dd, ee = (d * d).sum(1), (e * e).sum(1)
    de, dr, er = (d * e).sum(1), (d * r).sum(1), (e * r).sum(1)
    normal = cross(d, e)
    square = (normal * normal).sum(1)
    parallel = square <= 1e-24 * dd * ee
    s = np.where(parallel, 0.0, (cross(e, r) * normal).sum(1) / np.where(parallel, 1.0, square))
    s = np.clip(s, 0.0, 1.0)
    t = (de * s + er) / np.maximum(ee, tiny)
    inside = np.clip(t, 0.0, 1.0)
    s = np.where(t == inside, s, np.clip((de * inside - dr) / np.maximum(dd, tiny), 0.0, 1.0))
    out: Array = np.linalg.norm(r + s[:, None] * d - inside[:, None] * e, axis=1)
    return out
