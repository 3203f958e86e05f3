"""A barrier against touching: kappa B(d / reach) over pairs of features nearer than a reach.

    B(y) = -(1 - y)^2 ln y for y < 1, else 0 (M. Li et al. 2020, Incremental Potential Contact, (6)).

Pairs are vertices with facets and edges with edges, each at its distance: from a face, from an edge or
from an end, whichever is nearest. So the sum is smooth where the nearest place passes from one feature to
the next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .touching import EDGE, FACET, VERTEX, IntArray, Shape, cross
from .touching_audit import first_meeting
from .touching_features import Features, boxes_meet, boxes_near, facets_near, within_reach
from .touching_gaps import Pairs, gap_values, places

SHORT = 0.125
"""Motion, as part of a long list's, that a short one allows of."""
PARALLEL = 1e-9
"""Sine of an angle below which two edges are nearest at an end of one of them."""
BESIDE = 0.1
"""How near its end, as a part of it, a side crosses a ruling for the vertex there to be of account too."""


def barrier(y: Array) -> tuple[Array, Array, Array]:
    """B and its derivatives at y (k,), 0 < y < 1."""
    log, left = np.log(y), 1.0 - y
    return (
        -left * left * log,
        2.0 * left * log - left * left / y,
        -2.0 * log + 4.0 * left / y + (left / y) ** 2,
    )


@dataclass(frozen=True)
class Neighbourhood:
    """Pairs of features that can come within a reach while no vertex moves by more than `bound` from where it
    was when they were collected."""

    vertices: Array
    bound: float
    features: Features

    @classmethod
    def of(cls, shape: Shape, reach: float, bound: float) -> Neighbourhood:
        """Collect them, over all pairs."""
        slack = np.full(shape.segments, bound)
        i, j = facets_near((shape,), shape.vertices, slack, reach)
        features = Features.of((shape,), i, j, within_reach(shape, reach + 2.0 * bound))
        return cls(shape.vertices, bound, features)

    def covers(self, shape: Shape) -> bool:
        """Whether a shape is within the bound on motion."""
        return farthest(self.vertices, shape.vertices) <= self.bound

    def passes(self, before: Shape, after: Shape) -> bool:
        """Whether features meet while vertices move straight from one shape to another, both covered."""
        return first_meeting(before, after, self.features) <= 1.0


class Surroundings:
    """Lists of neighbours within a reach of shapes that follow each other.

    One is collected over all pairs, and serves while no vertex moves by more than `room`; a shorter one is
    taken from it, for less motion.
    """

    def __init__(self, reach: float, room: float) -> None:
        self.reach, self.room = reach, room
        self.collected = 0
        self._wide: Neighbourhood | None = None
        self._short: Neighbourhood | None = None

    def of(self, *shapes: Shape) -> Neighbourhood:
        """A list that covers shapes."""
        short, shape = self._short, shapes[0]
        if short is not None and all(short.covers(each) for each in shapes):
            return short
        far = max(farthest(each.vertices, shape.vertices) for each in shapes)
        bound = max(SHORT * self.room, 1.001 * far)
        wide = self._wide
        if wide is None or farthest(wide.vertices, shape.vertices) + bound > wide.bound:
            wide = self._wide = Neighbourhood.of(shape, self.reach, max(self.room, bound))
            self.collected += 1
        features = within_reach(shape, self.reach + 2.0 * bound)(wide.features)
        short = self._short = Neighbourhood(shape.vertices, bound, features)
        return short

    def first_meeting(self, before: Shape, after: Shape) -> float:
        """When features first meet on the straight way from one shape to another, infinite if they do not. A
        motion that no list is made for is looked at over all pairs."""
        far = farthest(before.vertices, after.vertices) > self.room
        return first_meeting(before, after, None if far else self.of(before, after).features)


def farthest(one: Array, other: Array) -> float:
    """The longest way of a vertex from one shape to another."""
    moved = other - one
    return float(np.sqrt((moved * moved).sum(axis=1).max()))


def nearest(shape: Shape, features: Features, reach: float) -> Pairs:
    """The pairs nearer than a reach, each as the features at which it is nearest, with the sign that makes
    signed gaps positive."""
    vf, ee = features.vertex_facet, features.edge_edge
    vf = vf[boxes_near(shape, vf, reach)]
    ee = ee[boxes_meet(shape.edge_boxes, shape.edge_boxes, ee, reach)]
    found = _of_facets(shape, vf).joined(_of_edges(shape, ee))
    if not len(found):
        return found
    value = gap_values(shape, found)
    found = Pairs(found.first, found.second, np.where(value < 0, -1.0, 1.0))
    return found.take(np.abs(value) < reach)


def _typed(kinds: tuple[int, int], first: IntArray, second: IntArray) -> Pairs:
    count = len(first)
    return Pairs(
        np.column_stack((np.full(count, kinds[0]), first)).astype(np.int64),
        np.column_stack((np.full(count, kinds[1]), second)).astype(np.int64),
        np.ones(count),
    )


def _of_facets(shape: Shape, vf: IntArray) -> Pairs:
    """Vertices with facets at their nearest."""
    over = _typed((VERTEX, FACET), vf[:, 0], vf[:, 1])
    if not len(vf):
        return over
    at = places(shape, over)
    inside: NDArray[np.bool_] = np.all(np.maximum(-at, at - 1.0) <= 0.0, axis=1)
    outside = np.flatnonzero(~inside)
    v = np.repeat(vf[outside, 0], 4)
    edges = shape.edge_numbers[vf[outside, 1]].ravel()
    return over.take(inside).joined(_least(shape, v, edges, 4))


def _of_edges(shape: Shape, ee: IntArray) -> Pairs:
    """Edges with edges at their nearest."""
    across = _typed((EDGE, EDGE), ee[:, 0], ee[:, 1])
    if not len(ee):
        return across
    at = places(shape, across)
    inside: NDArray[np.bool_] = np.all(np.maximum(-at, at - 1.0) <= 0.0, axis=1)
    first, last = (shape.vertices[ends] for ends in shape.edge_ends(ee))
    along = (last - first) / np.maximum(np.linalg.norm(last - first, axis=2), np.finfo(float).tiny)[..., None]
    inside &= np.linalg.norm(cross(along[:, 0], along[:, 1]), axis=1) > PARALLEL
    outside = ee[~inside]
    a, b = outside[:, 0], outside[:, 1]
    v = np.column_stack((*shape.edge_ends(a), *shape.edge_ends(b))).ravel()
    edges = np.column_stack((b, b, a, a)).ravel()
    return across.take(inside).joined(_least(shape, v, edges, 4))


def _least(shape: Shape, v: IntArray, edges: IntArray, of: int) -> Pairs:
    """Of vertices with edges, `of` at a time, the nearest, at the edge's inside or at its end."""
    if not len(v):
        return Pairs.none()
    points = shape.vertices
    first, last = shape.edge_ends(edges)
    p, along = points[first], points[last] - points[first]
    square = np.maximum((along * along).sum(axis=1), np.finfo(float).tiny)
    part = ((points[v] - p) * along).sum(axis=1) / square
    rest = points[v] - p - np.clip(part, 0.0, 1.0)[:, None] * along
    away = (rest * rest).sum(axis=1).reshape(-1, of)
    best = np.arange(len(away)) * of + away.argmin(axis=1)
    v, edges, part, first, last = v[best], edges[best], part[best], first[best], last[best]
    inside = (part > 0.0) & (part < 1.0) & ~shape.slivers[edges]
    end = np.where(part <= 0.5, first, last)
    on_edge = _typed((VERTEX, EDGE), v[inside], edges[inside])
    v, end = v[~inside], end[~inside]
    return on_edge.joined(_typed((VERTEX, VERTEX), np.minimum(v, end), np.maximum(v, end)))


def candidates(shape: Shape, near: Pairs, forces: Array, gap: float = 0.0) -> tuple[Pairs, Array]:
    """The signed gaps that stand for near pairs, and their forces (k,): those of faces and crossing edges
    themselves, and for a vertex near an edge, or a vertex, those of what meets there, in equal parts. With a
    gap that is not zero all stand for themselves.

    Over a ruling in a valley the planes of both its facets bound a vertex; over a ridge neither does, and the
    sides that meet at the vertex may cross the ruling. The shape crosses nothing, so that signs are known.
    """
    if gap:
        return _merged(near, forces)
    found: dict[tuple[int, int, int, int], float] = {}
    rows = zip(near.first.tolist(), near.second.tolist(), forces.tolist(), strict=True)
    for first, second, force in rows:
        stand = [(first[0], first[1], second[0], second[1])]
        if first[0] == VERTEX and second[0] == EDGE:
            stand = _at_edge(shape, first[1], second[1])
        elif second[0] == VERTEX:
            sides = [(a, b) for a in sides_at(shape, first[1]) for b in sides_at(shape, second[1])]
            stand = [(EDGE, min(p), EDGE, max(p)) for p in sides]
        for name in stand:
            found[name] = found.get(name, 0.0) + force / len(stand)
    for name in _beside_ends(shape, near):
        found.setdefault(name, 0.0)
    if not found:
        return Pairs.none(), np.empty(0)
    names = sorted(found)
    table = np.array(names, dtype=np.int64)
    pairs = Pairs(table[:, :2], table[:, 2:], np.ones(len(table)))
    value = gap_values(shape, pairs)
    signed = Pairs(pairs.first, pairs.second, np.where(value < 0, -1.0, 1.0))
    return signed, np.array([found[name] for name in names])


def _merged(near: Pairs, forces: Array) -> tuple[Pairs, Array]:
    """Near pairs, each once, with the sums of their forces (k,)."""
    summed: dict[tuple[int, int, int, int], float] = {}
    for name, force in zip(near.names(), forces.tolist(), strict=True):
        summed[name] = summed.get(name, 0.0) + force
    once = near.unique()
    return once, np.array([summed[name] for name in once.names()])


def _beside_ends(shape: Shape, near: Pairs) -> list[tuple[int, int, int, int]]:
    """What stands for the vertices near which sides cross rulings."""
    crossing = near.take((near.first[:, 0] == EDGE) & (near.second[:, 0] == EDGE))
    found: list[tuple[int, int, int, int]] = []
    if not len(crossing):
        return found
    for name, place in zip(crossing.names(), places(shape, crossing), strict=True):
        for side, at, other in ((name[1], place[0], name[3]), (name[3], place[2], name[1])):
            if side % 3 and other % 3 == 0 and min(at, 1.0 - at) < BESIDE:
                ends = shape.edge_ends(np.array([side]))
                found += _at_edge(shape, int(ends[0 if at < 0.5 else 1][0]), other)
    return found


def _at_edge(shape: Shape, vertex: int, edge: int) -> list[tuple[int, int, int, int]]:
    """What stands for a vertex near an edge."""
    crossing = [(EDGE, min(a, edge), EDGE, max(a, edge)) for a in sides_at(shape, vertex)]
    k = edge // 3
    if edge % 3:
        return crossing
    before = k - 1 if k or not shape.closed else shape.segments - 1
    if before < 0 or k >= shape.segments:
        return crossing
    facing = [(VERTEX, vertex, FACET, before), (VERTEX, vertex, FACET, k)]
    normal = cross(shape.u[before], shape.rulings[before])
    side = np.sign((shape.vertices[vertex] - shape.nodes[k]) @ normal)
    if (
        before == shape.segments - 1
    ):  # across the seam the strip's ends may lie elsewhere in space by rounding
        side = np.sign((shape.vertices[vertex] - shape.far_node) @ normal)
    return facing if side * (shape.u[k] @ normal) > 0 else crossing


def sides_at(shape: Shape, vertex: int) -> list[int]:
    """The sides that meet at a vertex."""
    k, upper = vertex // 2, vertex % 2
    ahead, behind = 3 * k + 1 + upper, 3 * (k - 1) + 1 + upper
    if k == 0:
        n = shape.segments
        behind = 3 * (n - 1) + 1 + (upper if shape.sigma >= 0 else 1 - upper) if shape.closed else -1
    return [e for e in (behind, ahead) if e >= 0 and not shape.slivers[e]]
