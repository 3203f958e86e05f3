"""Self-contact of a discrete folded band and its clearance, exactly, facet by facet.

Facet i is the flat convex quadrilateral with corners P_i - b g_i, P_i + b g_i, P_{i+1} + b g_{i+1} and
P_{i+1} - b g_{i+1}. Only pairs of facets more than max(3, N/20) apart along the band count, going the shorter
way round on a closed band: nearer ones are kept apart by injectivity (b |eta'| < 1), and near inflections
they almost touch.

Pairs are found by a descent through a binary tree of runs of consecutive facets. A run lies within a radius
rho of one of its rulings, with v along the ruling equal on both, so that two runs are at least (distance of
these rulings) - rho_1 - rho_2 apart; such bounds stay sharp on facets that are long and thin, where boxes do
not. The rulings of the runs themselves bound the clearance from above. Between facets, the distance of two
flat convex polygons that do not meet is taken on an edge of each, or on a corner of one and the other's face.

Reference:
    C. Ericson (2005), Real-Time Collision Detection: closest points of segments 5.1.9, separating axes 5.2.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .stencil import dot

IntArray = NDArray[np.intp]

# Facets meet when they come this near, as part of the band's length; rounding of the corners is about 1e-15.
GRAZING_TOLERANCE = 1e-12
# Pairs of runs, and pairs of facets, worked on at once: temporaries of a few megabytes, whatever N is.
RUN_BLOCK = 16384
FACET_BLOCK = 1024
# The descent starts with all pairs of 2^5 runs.
FIRST_LEVEL = 5
# Squared sine of an angle below which two segments count as parallel.
PARALLEL_TOLERANCE = 1e-28
TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Contact:
    """Self-contact of a band.

    `pairs` (K, 2) are the facets that meet, numbered from 0, i < j, in lexicographic order. `clearance` is
    the least distance between two facets that count, in the unit of length of the half-width; 0 in contact,
    inf if no pair counts (N < 8).
    """

    contact: bool
    pairs: IntArray
    clearance: float


def self_contact(
    u: Array, g: Array, g_end: Array, half_width: float, h: float, *, closed: bool = True
) -> Contact:
    """Find the facets that meet and the clearance between those that do not.

    Args:
        u: facet tangents (N, 3), unit vectors.
        g: rulings (N, 3) at the nodes 1..N.
        g_end: ruling (3,) at node N+1: sigma g_1 where the seam is closed.
        half_width: b.
        h: length of a facet along the midline.
        closed: whether the strip is joined to itself, so that there is a shorter way round.

    The clearance is exact to GRAZING_TOLERANCE times the length N h. Facets must not be inverted (a
    quadrilateral that crosses itself is not convex) and flat: what they lack of it enters as an error of the
    same size.

    Raises:
        ValueError: shapes do not agree, a value is not finite, or half_width or h is not positive.
    """
    facets = _facets(u, g, g_end, half_width, h)
    tree = _tree(facets)
    first = least_gap(len(u)) + 1
    last = len(u) - first if closed else len(u) - 1
    search = _Search(first, last, GRAZING_TOLERANCE * len(u) * h)
    meeting = [np.empty((0, 2), dtype=np.intp)]
    for i, j in _facet_pairs(facets, tree, search):
        distance = _facet_distance(facets, i, j, search.tolerance)
        search.lower(distance)
        touch = distance <= search.tolerance
        meeting.append(np.column_stack((i[touch], j[touch])))
    pairs = np.concatenate(meeting)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return Contact(len(pairs) > 0, pairs, 0.0 if len(pairs) else search.bound)


def near_facets(corners: Array, slack: Array, reach: float) -> tuple[IntArray, IntArray]:
    """Pairs i < j of facets that may be nearer than `reach` while each moves by its slack.

    `corners` (3, 4, N) in the order of the quadrilaterals above; a facet's points stay within `slack` (N,) of
    where they are. A superset of those pairs; memory grows with their number.
    """
    facets = _facets_of(corners)
    tree = [level.wider(slack) for level in _tree(facets)]
    search = _Within(1, corners.shape[2] - 1, 0.0, reach)
    found = [np.empty((2, 0), dtype=np.intp)]
    stack = list(_visit(tree[0], 0, *np.triu_indices(len(tree[0].start)), search))
    while stack:
        level, a, b, _ = stack.pop()
        if level + 1 < len(tree):
            stack.extend(_visit(tree[level + 1], level + 1, *_children(a, b), search))
        else:
            found.append(np.stack((tree[level].start[a], tree[level].start[b])))
    i, j = np.concatenate(found, axis=1)
    return i, j


def least_gap(segments: int) -> int:
    """Largest number of facets apart at which a pair does not yet count: max(3, N/20), rounded down."""
    return max(3, segments // 20)


@dataclass(frozen=True)
class _Facets:
    """Facets by components first: corners, edges (from corner k to k+1) and inward (3, 4, N), others (3, N).

    Corner x is on the inner side of edge k where inward_k.x >= inward_offset_k, and `inward` are unit
    vectors.
    """

    corners: Array
    edges: Array
    edge_squares: Array  # (4, N)
    normal: Array
    normal_offset: Array  # (N,)
    inward: Array
    inward_offset: Array  # (4, N)


def _facets(u: Array, g: Array, g_end: Array, half_width: float, h: float) -> _Facets:
    tangents, rulings = np.asarray(u, dtype=np.float64), np.asarray(g, dtype=np.float64)
    last = np.asarray(g_end, dtype=np.float64)
    shapes = tangents.shape, rulings.shape, last.shape
    if tangents.ndim != 2 or shapes != ((len(tangents), 3), (len(tangents), 3), (3,)):
        raise ValueError(f"u, g and g_end must be (N, 3), (N, 3) and (3,), got {shapes}")
    if len(tangents) == 0 or not all(np.isfinite(a).all() for a in (tangents, rulings, last)):
        raise ValueError("the band is empty or holds values that are not finite")
    if not (half_width > 0 and h > 0):
        raise ValueError(f"half-width and facet length must be positive, got {half_width} and {h}")
    midline = np.zeros((3, len(u) + 1))
    np.cumsum(h * tangents.T, axis=1, out=midline[:, 1:])
    reach = half_width * np.column_stack((rulings.T, last))
    left, right = midline - reach, midline + reach
    return _facets_of(np.stack((left[:, :-1], right[:, :-1], right[:, 1:], left[:, 1:]), axis=1))


def _facets_of(corners: Array) -> _Facets:
    edges = np.roll(corners, -1, axis=1) - corners
    normal = _unit(_cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))
    inward = _unit(_cross(normal[:, None], edges))
    return _Facets(
        corners, edges, dot(edges, edges), normal, dot(normal, corners[:, 0]), inward, dot(inward, corners)
    )


@dataclass(frozen=True)
class _Level:
    """The runs of one level of the tree, [start, stop) each: run r splits into 2r and 2r+1 of the next level.

    The point of a run's facets at the part v of a ruling is within (1 - v) radius_0 + v radius_1 of the point
    base + v axis, radius (2, R), base and axis (3, R). The segment base + [0, 1] axis lies in facet `owner`.
    """

    start: IntArray
    stop: IntArray
    owner: IntArray
    base: Array
    axis: Array
    axis_square: Array
    radius: Array

    def wider(self, slack: Array) -> _Level:
        """The level with runs whose facets may move by their slack (N,)."""
        more = np.zeros(len(self.start))
        filled = self.stop > self.start
        more[filled] = np.maximum.reduceat(slack, self.start[filled])
        return replace(self, radius=self.radius + more)


def _tree(facets: _Facets) -> list[_Level]:
    """Levels of the tree from 2^FIRST_LEVEL runs, or fewer, down to single facets."""
    depth = (facets.corners.shape[2] - 1).bit_length()
    return [_level(facets, k, k == depth) for k in range(min(FIRST_LEVEL, depth), depth + 1)]


def _level(facets: _Facets, k: int, last: bool) -> _Level:
    """Level of 2^k runs; on the last one some are empty, unless N is a power of two.

    The segment of a run is the ruling at its middle node, that of a single facet halfway between its two
    rulings.
    """
    n = facets.corners.shape[2]
    cuts = (np.arange(2**k + 1) * n) >> k
    start, stop = cuts[:-1], cuts[1:]
    owner = np.minimum((start + stop) // 2, n - 1)
    left, right = facets.corners[:, 0, owner], facets.corners[:, 1, owner]
    if last:
        left, right = (left + facets.corners[:, 3, owner]) / 2, (right + facets.corners[:, 2, owner]) / 2
    run = np.repeat(np.arange(2**k), stop - start)
    ends = np.stack((left, right, right, left), axis=1)[:, :, run]
    away = facets.corners - ends
    square = dot(away, away)
    spread = np.maximum(square[[0, 1]], square[[3, 2]])
    radius = np.zeros((2, 2**k))
    filled = stop > start
    radius[:, filled] = np.sqrt(np.maximum.reduceat(spread, start[filled], axis=1))
    axis = right - left
    return _Level(start, stop, owner, left, axis, dot(axis, axis), radius)


@dataclass
class _Search:
    """What the descent knows: which pairs count, and the least distance met so far."""

    first: int  # least and largest number of facets apart that counts
    last: int
    tolerance: float
    bound: float = math.inf

    def counts(self, nearest: IntArray, farthest: IntArray) -> NDArray[np.bool_]:
        """Where some number of facets from `nearest` to `farthest`, both >= 0, counts."""
        return np.maximum(nearest, self.first) <= np.minimum(farthest, self.last)

    def lower(self, distance: Array) -> None:
        """Take distances of pairs that count into the bound."""
        if distance.size:
            self.bound = min(self.bound, float(distance.min()))

    def open(self, least: Array) -> NDArray[np.bool_]:
        """Where a pair at least `least` apart may meet, or be nearer than any pair so far."""
        return least <= max(self.bound - self.tolerance, self.tolerance)


class _Within(_Search):
    """A search for all pairs within a fixed bound."""

    def lower(self, distance: Array) -> None:
        """Leave the bound as it is."""


def _facet_pairs(facets: _Facets, tree: list[_Level], search: _Search) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs of facets i < j that may meet or be the nearest, in blocks, the nearest of each branch first.

    The caller lowers search.bound between blocks. Depth first, so that memory stays with the block size.
    """
    runs = len(tree[0].start)
    a, b = np.triu_indices(runs)
    stack = list(_visit(tree[0], 0, a, b, search))
    while stack:
        level, a, b, least = stack.pop()
        keep = search.open(least)
        a, b, least = a[keep], b[keep], least[keep]
        if level + 1 < len(tree):
            stack.extend(_visit(tree[level + 1], level + 1, *_children(a, b), search))
            continue
        i, j = tree[level].start[a], tree[level].start[b]
        for k in range(0, len(i), FACET_BLOCK):
            block = slice(k, k + FACET_BLOCK)
            close = search.open(least[block])
            near_i, near_j = i[block][close], j[block][close]
            close = search.open(_separation(facets, near_i, near_j))
            if close.any():
                yield near_i[close], near_j[close]


def _children(a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of halves of the paired runs a <= b, those of a run with itself once only."""
    first, second = np.concatenate((2 * a, 2 * a, 2 * a + 1)), np.concatenate((2 * b, 2 * b + 1, 2 * b + 1))
    distinct = a != b
    return np.concatenate((first, 2 * a[distinct] + 1)), np.concatenate((second, 2 * b[distinct]))


def _visit(
    level: _Level, depth: int, a: IntArray, b: IntArray, search: _Search
) -> Iterator[tuple[int, IntArray, IntArray, Array]]:
    """Blocks (depth, a, b, least distance) of the pairs of runs that stay open, the nearest block last."""
    nearest, farthest = level.start[b] - level.stop[a] + 1, level.stop[b] - 1 - level.start[a]
    some = search.counts(np.maximum(nearest, 0), farthest)
    some &= (level.stop[a] > level.start[a]) & (level.stop[b] > level.start[b])
    a, b = a[some], b[some]
    gap = _segment_gap(
        level.base[:, a],
        level.axis[:, a],
        level.axis_square[a],
        level.base[:, b],
        level.axis[:, b],
        level.axis_square[b],
    )
    distance = np.sqrt(dot(gap, gap))
    steps = level.owner[b] - level.owner[a]
    search.lower(distance[search.counts(steps, steps)])
    least = distance - level.radius[:, a].max(axis=0) - level.radius[:, b].max(axis=0)
    keep = search.open(least)
    a, b = a[keep], b[keep]
    least = np.maximum(least[keep], _fan_gap(level, a, b))
    order = np.argsort(least, kind="stable")
    order = order[search.open(least[order])]
    for k in reversed(range(0, len(order), RUN_BLOCK)):
        block = order[k : k + RUN_BLOCK]
        yield depth, a[block], b[block], least[block]


def _fan_gap(level: _Level, a: IntArray, b: IntArray) -> Array:
    """Distances (M,) by which runs a and b are at least apart, seen along their directions' difference.

    Rulings that fan out from a point near the edge, as beside inflections, all come close to each other
    there. So do the sides of each run: along this line distances and radii grow in proportion.
    """
    axis_a, axis_b = level.axis[:, a], level.axis[:, b]
    unit_a, unit_b = _unit(axis_a), _unit(axis_b)
    line = _unit(unit_b - np.copysign(1.0, dot(unit_a, unit_b)) * unit_a)
    low_a, high_a = _extent(line, level.base[:, a], axis_a, level.radius[:, a])
    low_b, high_b = _extent(line, level.base[:, b], axis_b, level.radius[:, b])
    result: Array = np.maximum(low_b - high_a, low_a - high_b)
    return result


def _extent(line: Array, base: Array, axis: Array, radius: Array) -> tuple[Array, Array]:
    """Least and greatest coordinate (M,) of runs along the unit vectors `line` (3, M)."""
    start = dot(line, base)
    stop = start + dot(line, axis)
    low = np.minimum(start - radius[0], stop - radius[1])
    return low, np.maximum(start + radius[0], stop + radius[1])


def _separation(facets: _Facets, i: IntArray, j: IntArray) -> Array:
    """Distances (M,) by which facets i and j are at least apart, seen along one line (Ericson (2005), 5.2.1).

    The line is the shortest between their middle rulings; a facet does not reach beyond its corners along it.
    """
    ci, cj = facets.corners[:, :, i], facets.corners[:, :, j]
    base_i, base_j = (ci[:, 0] + ci[:, 3]) / 2, (cj[:, 0] + cj[:, 3]) / 2
    axis_i, axis_j = (ci[:, 1] + ci[:, 2]) / 2 - base_i, (cj[:, 1] + cj[:, 2]) / 2 - base_j
    line = _unit(_segment_gap(base_i, axis_i, dot(axis_i, axis_i), base_j, axis_j, dot(axis_j, axis_j)))
    result: Array = dot(line[:, None], cj).min(axis=0) - dot(line[:, None], ci).max(axis=0)
    return result


def _facet_distance(facets: _Facets, i: IntArray, j: IntArray, tolerance: float) -> Array:
    """Distances (M,) of facets i and j, 0 where an edge of one passes through the other."""
    gap = _segment_gap(
        facets.corners[:, :, None, i],
        facets.edges[:, :, None, i],
        facets.edge_squares[:, None, i],
        facets.corners[:, None, :, j],
        facets.edges[:, None, :, j],
        facets.edge_squares[None, :, j],
    )
    edges = np.sqrt(dot(gap, gap).min(axis=(0, 1)))
    over_j, over_i = _corner_distance(facets, i, j, tolerance), _corner_distance(facets, j, i, tolerance)
    result: Array = np.minimum(edges, np.minimum(over_j, over_i))
    return result


def _corner_distance(facets: _Facets, i: IntArray, j: IntArray, tolerance: float) -> Array:
    """Distances (M,) of facet i's corners to facet j's face where they project into it, else inf.

    Zero where an edge of i passes through j: where its ends are on different sides and the point between, at
    which the height vanishes, is inside.
    """
    x = facets.corners[:, :, i]
    height = dot(x, facets.normal[:, None, j]) - facets.normal_offset[j]
    # (4 corners, 4 edges, M)
    depth = dot(x[:, :, None], facets.inward[:, None, :, j]) - facets.inward_offset[:, j]
    over = depth.min(axis=1) >= -tolerance
    distance: Array = np.where(over, np.abs(height), math.inf).min(axis=0)
    next_height, next_depth = np.roll(height, -1, axis=0), np.roll(depth, -1, axis=0)
    through = height * next_height < 0
    part = height / np.where(through, height - next_height, 1.0)
    inside = (depth + part[:, None] * (next_depth - depth)).min(axis=1) >= -tolerance
    distance[(through & inside).any(axis=0)] = 0.0
    return distance


def _segment_gap(p: Array, d: Array, dd: Array, q: Array, e: Array, ee: Array) -> Array:
    """Shortest vectors (3, ...) from segments p + [0, 1] d to q + [0, 1] e; dd = d.d and ee = e.e.

    Ericson (2005), 5.1.9, but with the cross product where there the determinant dd ee - (d.e)^2 stands: it
    cancels between segments that are nearly parallel, as rulings are.
    """
    r = p - q
    de, dr, er = dot(d, e), dot(d, r), dot(e, r)
    normal = _cross(d, e)
    square = dot(normal, normal)
    parallel = square <= PARALLEL_TOLERANCE * dd * ee
    s = np.where(parallel, 0.0, dot(_cross(e, r), normal) / np.where(parallel, 1.0, square))
    s = np.clip(s, 0.0, 1.0)
    t = (de * s + er) / np.maximum(ee, TINY)
    t_inside = np.clip(t, 0.0, 1.0)
    s = np.where(t == t_inside, s, np.clip((de * t_inside - dr) / np.maximum(dd, TINY), 0.0, 1.0))
    result: Array = t_inside * e - s * d - r
    return result


def _cross(a: Array, b: Array) -> Array:
    """Vector products over the first axis, which holds the three components."""
    result: Array = np.stack(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )
    return result


def _unit(a: Array) -> Array:
    """Unit vectors along a (3, ...), zero where a is zero."""
    result: Array = a / np.sqrt(np.maximum(dot(a, a), TINY))
    return result
