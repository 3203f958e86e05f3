"""What bounds the shapes near one that touches itself, so that they do not cross.

Let an edge and a facet touch at a place, the edge not in the facet's plane. The points of the facet less
those of the edge are a prism. In the shape that touches 0 is on its rim; in a shape nearby that does not
cross 0 is outside, beyond one of the prism's planes, which near the first shape can only be one of those on
whose face 0 is there: those of an end of the edge with the facet, and of the edge with a side of the facet,
where they touch. So at least one of these gaps is not negative.

Each edge with each facet makes such a clause, and shapes that do not cross fulfil all of them. A clause with
a single gap is a bound. To leave a clause out, or to add a gap to one, makes more shapes admissible, never
less: a minimum among them is one among the shapes that do not cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .touching import EDGE, FACET, VERTEX, IntArray, Shape, cross
from .touching_barrier import sides_at
from .touching_distances import nearer
from .touching_features import segment_distance
from .touching_gaps import (
    G_FIRST,
    G_SECOND,
    ONE,
    R_FIRST,
    R_SECOND,
    TWO,
    Pairs,
    arguments,
    places,
    vectors,
)

TOUCHES = 1e-8
"""Distance, as part of l, up to which features touch."""
Name = tuple[int, int, int, int]
EDGE_OF_KIND = 1e-6
"""Coordinate, or cosine, up to which a nearest place is where distances become ones of another kind."""
LEVEL = 1e-7
"""Height, as part of l, up to which a feature may lie in the plane of another one, and sine of an angle up to
which edges may be parallel: of these no clause is made."""


@dataclass(frozen=True)
class Pieces:
    """Gaps of what touches, with the signs of the sides on which features are, and clauses: of the gaps of
    each at least one is not negative in shapes nearby that do not cross.

    No shape nearby has all gaps positive of a set that is `void`.
    """

    pairs: Pairs
    clauses: tuple[frozenset[int], ...]
    void: tuple[frozenset[int], ...] = ()


def pieces(shape: Shape, near: Pairs) -> Pieces:
    """The clauses of the edges and facets to which `near` pairs, those that touch, belong."""
    edge, facet = _edges_and_facets(shape, near)
    count = len(edge)
    every, touch, side = _parts(shape, edge, facet)
    names = every.names()
    kept: list[int] = []
    known: dict[tuple[Name, float], int] = {}
    clauses: dict[frozenset[int], None] = {}
    for k in range(count):
        rows = np.concatenate((2 * k + np.arange(2), 2 * count + 4 * k + np.arange(4)))
        rows = rows[touch[rows]]
        if not rows.size or touch[2 * k : 2 * k + 2].all() or (side[rows] == 0.0).any():
            continue
        for row in rows.tolist():
            if known.setdefault((names[row], float(side[row])), len(kept)) == len(kept):
                kept.append(row)
        clauses[frozenset(known[names[row], float(side[row])] for row in rows.tolist())] = None
    pairs = every.take(np.array(kept, dtype=np.int64))
    pairs = Pairs(pairs.first, pairs.second, side[kept])
    return Pieces(pairs, tuple(clauses), (*_both_sides(pairs), *_all_round(shape, pairs)))


def at_distance(shape: Shape, kept: Pairs, gap: float) -> Pieces:
    """The same for shapes that keep a gap that is not zero: the distance of each pair that touches is a
    bound."""
    pairs = kept.joined(nearer(shape, gap + TOUCHES * shape.length)).unique()
    return Pieces(pairs, tuple(frozenset((k,)) for k in range(len(pairs))))


def jumps(shape: Shape, pairs: Pairs) -> bool:
    """Whether distances of pairs become ones of another kind where they touch.

    A distance and its gradient are continuous there, second derivatives are not.
    """
    at, what = places(shape, pairs), arguments(pairs)
    if len(pairs) and min(float(at.min()), 1.0 - float(at.max())) <= EDGE_OF_KIND:
        return True
    for name, reach, six in zip(pairs.names(), what.reach, vectors(shape, what), strict=True):
        if name[0] != VERTEX or name[2] == FACET:
            continue
        lean = shape.half_width * reach
        apart = six[R_FIRST] + lean[0] * six[G_FIRST] - six[R_SECOND] - lean[1] * six[G_SECOND]
        ends = [(name[1], apart)]
        if name[2] == EDGE:
            apart -= (apart @ six[TWO]) / (six[TWO] @ six[TWO]) * six[TWO]
        else:
            ends.append((name[3], -apart))
        if any(_leads_away(shape, *end) <= EDGE_OF_KIND for end in ends):
            return True
    return False


def _leads_away(shape: Shape, vertex: int, apart: Array) -> float:
    """The least cosine between the edges at a vertex and a direction."""
    edges = np.array([3 * (vertex // 2), *sides_at(shape, vertex)])
    first, last = shape.edge_ends(edges)
    other = shape.vertices[np.where(first == vertex, last, first)] - shape.vertices[vertex]
    out = other @ apart / (np.linalg.norm(other, axis=1) * np.linalg.norm(apart))
    return float(out.min())


def _both_sides(pairs: Pairs) -> list[frozenset[int]]:
    """Gaps that are listed with both signs."""
    keys = list(zip(pairs.names(), pairs.sign.tolist(), strict=True))
    at = {key: k for k, key in enumerate(keys)}
    return [frozenset((k, at[n, -1.0])) for k, (n, sign) in enumerate(keys) if sign > 0 and (n, -1.0) in at]


def _all_round(shape: Shape, pairs: Pairs) -> list[frozenset[int]]:
    """Threes of gaps of one edge with what meets at a vertex on it that are nowhere all positive.

    Such gaps are D.n with one D from the edge's line to the vertex, and normals n off the line, so that only
    two components of D count. Where 0 is inside the triangle of three normals no D has all three positive,
    and it is so in shapes nearby as well.
    """
    around, found = _at_vertices_on_edges(shape, pairs), set()
    normal = pairs.sign[:, None] * _normals(shape, pairs)
    for (edge, _), rows in around.items():
        first = (pairs.first[rows] == (EDGE, edge)).all(axis=1)
        n = np.where(first, -1.0, 1.0)[:, None] * normal[rows]
        plane = np.linalg.svd(n)[2]
        angle = np.arctan2(n @ plane[1], n @ plane[0])
        level = np.abs(n @ plane[2]) > LEVEL
        for three in combinations(np.flatnonzero(~level).tolist(), 3):
            low, middle, high = np.sort(angle[list(three)])
            if max(middle - low, high - middle, 2.0 * np.pi - (high - low)) < np.pi - LEVEL:
                found.add(frozenset(rows[k] for k in three))
    return sorted(found, key=sorted)


def _at_vertices_on_edges(shape: Shape, pairs: Pairs) -> dict[tuple[int, int], list[int]]:
    """Of edges and vertices that lie on them: the gaps, three or more, of the edge with edges that end at the
    vertex, and of the vertex with facets beside the edge."""
    found: dict[tuple[int, int], list[int]] = {}
    first, last = shape.edge_ends(np.arange(3 * len(shape.nodes)))
    for k, (kind, one, _, other) in enumerate(pairs.names()):
        if kind == VERTEX:
            at = [(edge, one) for edge in shape.edge_numbers[other].tolist()]
        else:
            ends = [(one, first[other]), (one, last[other]), (other, first[one]), (other, last[one])]
            at = [(edge, int(end)) for edge, end in ends]
        for key in at:
            found.setdefault(key, []).append(k)
    edge, vertex = np.array([key for key, rows in found.items() if len(rows) > 2], np.int64).reshape(-1, 2).T
    v, p, q = (shape.vertices[at] for at in (vertex, first[edge], last[edge]))
    near = segment_distance(v, v, p, q) <= TOUCHES * shape.length
    return {(int(e), int(v)): found[e, v] for e, v in zip(edge[near], vertex[near], strict=True)}


def _parts(shape: Shape, edge: IntArray, facet: IntArray) -> tuple[Pairs, NDArray[np.bool_], Array]:
    """Of edges with facets (k,): the gaps of ends with facets (2k), and of edges with sides (4k), whether
    each touches (6k,), and the signs that keep the edge off the rest of the facet, 0 where that is level."""
    points, rim = shape.vertices, shape.edge_numbers[facet]
    ends, sides = np.stack(shape.edge_ends(edge), axis=1), np.stack(shape.edge_ends(rim.ravel()), axis=1)
    facing = _pairs(VERTEX, ends.ravel(), FACET, np.repeat(facet, 2))
    low, high = np.minimum(edge[:, None], rim).ravel(), np.maximum(edge[:, None], rim).ravel()
    crossing = _pairs(EDGE, low, EDGE, high)
    start, end = points[sides[:, 0]], points[sides[:, 1]]

    first, last = points[np.repeat(ends, 4, axis=0)].transpose(1, 0, 2)
    away = segment_distance(first, last, start, end)
    v = np.repeat(points[ends], 4, axis=1).reshape(-1, 3)
    start_of, end_of = (np.repeat(p.reshape(-1, 1, 4, 3), 2, axis=1).reshape(-1, 3) for p in (start, end))
    beside = segment_distance(v, v, start_of, end_of).reshape(-1, 4).min(axis=1)
    at, normal = places(shape, facing), _normals(shape, facing)
    inside = (at.min(axis=1) >= 0.0) & (at.max(axis=1) <= 1.0)
    over = points[ends] - shape.nodes[facet][:, None]
    height = np.einsum("kei,kei->ke", over, normal.reshape(-1, 2, 3))
    within = TOUCHES * shape.length
    touch = (np.abs(height).ravel() <= within) & (inside | (beside <= within))

    corners = points[shape.corner_numbers[np.repeat(facet, 4)]] - start[:, None]
    from_plane = (corners * _normals(shape, crossing)[:, None]).sum(axis=2)
    furthest = from_plane[np.arange(len(low)), np.abs(from_plane).argmax(axis=1)]
    beyond = np.where(low == rim.ravel(), furthest, -furthest)
    rise = np.concatenate((height[:, ::-1].ravel(), beyond))
    side = np.where(np.abs(rise) > LEVEL * shape.length, np.sign(rise), 0.0)
    return facing.joined(crossing), np.concatenate((touch, away <= within)), side


def _normals(shape: Shape, pairs: Pairs) -> Array:
    """The normals (k,3) of gaps; nearly zero where directions are nearly parallel."""
    six = vectors(shape, arguments(pairs))
    c = cross(six[:, ONE], six[:, TWO])
    size = np.linalg.norm(c, axis=1)
    lengths = np.linalg.norm(six[:, ONE], axis=1) * np.linalg.norm(six[:, TWO], axis=1)
    out: Array = np.where((size > LEVEL * lengths)[:, None], c / np.maximum(size, 1e-300)[:, None], 0.0)
    return out


def _edges_and_facets(shape: Shape, near: Pairs) -> tuple[IntArray, IntArray]:
    """Edges with facets, that count, to which pairs belong."""
    starts, stops = shape.edge_ends(np.arange(3 * len(shape.nodes)))
    found: set[tuple[int, int]] = set()
    for kind, first, of, second in near.names():
        if kind == VERTEX and of == FACET:
            at = np.flatnonzero((starts == first) | (stops == first))
            found.update((int(e), second) for e in at)
        elif kind == EDGE:
            for one, other in ((first, second), (second, first)):
                facets = np.flatnonzero((shape.edge_numbers == other).any(axis=1))
                found.update((one, int(f)) for f in facets)
    table = np.array(sorted(found), dtype=np.int64).reshape(-1, 2)
    table = table[~shape.slivers[table[:, 0]]]
    edge, facet = table.T
    apart = shape.flat_distance(shape.flat_of_edges(edge), shape.flat_of_facets(facet))
    counts = apart >= shape.excluded
    return edge[counts], facet[counts]


def _pairs(one: int, first: IntArray, two: int, second: IntArray) -> Pairs:
    return Pairs(
        np.column_stack((np.full(len(first), one), first)).astype(np.int64),
        np.column_stack((np.full(len(second), two), second)).astype(np.int64),
        np.ones(len(first)),
    )
