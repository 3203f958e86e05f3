"""What of a folded strip can touch: vertices, edges and facets, and where they are in space and on the
flat strip.

Vertex 2k is P_k^- = r_k - b g_k, vertex 2k + 1 is P_k^+ = r_k + b g_k, with r_1 = 0 and r_{k+1} = r_k + h u_k
(nodes are counted from 0 here). Edge 3k is the ruling at node k; edges 3k + 1 and 3k + 2 are the lower and
the upper side of facet k. The isometry constraints make a side parallel to u_k, with the length
h (1 -+ tanh xi_k), and u_k, g_k span the facet's plane with |u_k x g_k| = 1.

On the flat strip node k is at (k h, 0), its ruling has the direction (eta_k, 1) with eta_k = u_k.g_k. A
closed band is the infinite strip up to (s, y) -> (s + l, sigma y). A pair of features counts as one that
may touch where they are farther apart on the flat strip than `excluded_distance`: nearer ones are kept
apart by injectivity, b |eta'| < 1. In the fans of rulings beside inflections facets that are many numbers
apart lie next to each other, so that numbers would not do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .band import Array, State

IntArray = NDArray[np.int64]

VERTEX, EDGE, FACET = 0, 1, 2
"""Kinds of features, as files keep them."""
EXCLUDED = 0.005
"""Flat distance, as part of l, from which a pair counts."""
SLIVER = 1e-7
"""Edges shorter than this part of the mean edge h are no features: their direction is lost to rounding."""


def excluded_distance(length: float, gap: float = 0.0) -> float:
    """Flat distance from which pairs count on a strip of a length: sheets a gap apart turn over in pi/2
    gap."""
    return EXCLUDED * length + 0.5 * math.pi * gap


@dataclass(frozen=True)
class Shape:
    """A state's features in space.

    `nodes` (M,3) and `rulings` (M,3) at nodes, M = N on a closed band and N + 1 on a strip; `u` (N,3),
    `xi` (N,) and `eta` (M,) = u.g; `sigma` is 0 on a strip.
    """

    half_width: float
    h: float
    sigma: int
    u: Array
    xi: Array
    nodes: Array
    rulings: Array
    far: Array
    far_node: Array
    eta: Array
    excluded: float

    @classmethod
    def of(cls, state: State, gap: float = 0.0) -> Shape:
        """The features of a state, for pairs that keep a gap."""
        band = state.band
        steps = np.vstack((np.zeros(3), np.cumsum(band.h * state.u, axis=0)))
        n = band.segments
        rulings = state.g if state.g_end is None else np.vstack((state.g, state.g_end))
        tangents = state.u if state.g_end is None else np.vstack((state.u, state.u[-1:]))
        return cls(
            band.half_width,
            band.h,
            band.sigma,
            state.u,
            state.xi,
            steps[: len(rulings)],
            rulings,
            state.next_rulings()[-1],
            steps[n],
            np.einsum("ij,ij->i", tangents, rulings),
            excluded_distance(band.length, gap),
        )

    def turned(self, turn: Array, shift: Array) -> Shape:
        """The shape turned by a matrix from the right (3,3), and shifted (3,)."""
        turning = {name: getattr(self, name) @ turn for name in ("u", "rulings", "far")}
        placed = {name: getattr(self, name) @ turn + shift for name in ("nodes", "far_node")}
        vectors: dict[str, Any] = {**turning, **placed}
        return replace(self, **vectors)

    def between(self, other: Shape, part: float) -> Shape:
        """The shape whose vertices are a part of the straight way to another's."""
        b = (1.0 - part) * self.half_width + part * other.half_width

        def mixed(name: str, scaled: bool) -> Array:
            one, two = getattr(self, name), getattr(other, name)
            if scaled:
                one, two = one * (self.half_width / b), two * (other.half_width / b)
            out: Array = (1.0 - part) * one + part * two
            return out

        names = ("u", "xi", "nodes", "far_node", "eta")
        vectors: dict[str, Any] = {name: mixed(name, False) for name in names}
        return replace(self, half_width=b, **vectors, rulings=mixed("rulings", True), far=mixed("far", True))

    @property
    def closed(self) -> bool:
        """Whether the strip is joined to itself."""
        return self.sigma != 0

    @property
    def segments(self) -> int:
        """N."""
        return len(self.u)

    @property
    def length(self) -> float:
        """l."""
        return self.segments * self.h

    @cached_property
    def vertices(self) -> Array:
        """All vertices (2M,3)."""
        out = np.empty((2 * len(self.nodes), 3))
        out[0::2] = self.nodes - self.half_width * self.rulings
        out[1::2] = self.nodes + self.half_width * self.rulings
        return out

    @cached_property
    def corner_numbers(self) -> IntArray:
        """The vertices (N,4) of each facet, in the order lower and upper at its node, upper and lower
        beyond."""
        return _corner_numbers(self.segments, self.sigma)

    @cached_property
    def edge_numbers(self) -> IntArray:
        """The edges (N,4) of each facet: its ruling, its upper side, the ruling beyond, its lower side."""
        k = np.arange(self.segments)
        beyond = 3 * (k + 1)
        if self.closed:
            beyond[-1] = 0
        return np.column_stack((3 * k, 3 * k + 2, beyond, 3 * k + 1)).astype(np.int64)

    def edge_ends(self, edges: IntArray) -> tuple[IntArray, IntArray]:
        """The vertices at both ends of edges: rulings from below to above, sides forwards."""
        first, last = self._ends
        return first[edges], last[edges]

    @property
    def _ends(self) -> tuple[IntArray, IntArray]:
        return _edge_ends(self.segments, self.sigma, len(self.nodes))

    @cached_property
    def facet_boxes(self) -> tuple[Array, Array]:
        """The lowest and the highest corners (N,3) of the boxes of facets."""
        return box_of(self.vertices[self.corner_numbers])

    @cached_property
    def edge_boxes(self) -> tuple[Array, Array]:
        """The same of edges, (3M,3)."""
        first, last = (self.vertices[ends] for ends in self._ends)
        return np.minimum(first, last), np.maximum(first, last)

    @cached_property
    def slivers(self) -> NDArray[np.bool_]:
        """Edges (3M,) that are too short to be features; rulings never are."""
        out = np.zeros(3 * len(self.nodes), dtype=bool)
        rise = np.tanh(self.xi)
        out[1 : 3 * self.segments : 3] = 1.0 - rise < SLIVER
        out[2 : 3 * self.segments : 3] = 1.0 + rise < SLIVER
        out[3 * self.segments + 1 :] = True  # beyond a strip's end there are no sides
        return out

    # --- the flat strip ---

    @cached_property
    def flat_corners(self) -> Array:
        """Corners (N,4,2) of each facet on the flat strip, in the order of `corner_numbers`."""
        n, b, h = self.segments, self.half_width, self.h
        rise = h * np.tanh(self.xi)
        at = h * np.arange(n)
        near, far = b * self.eta[:n], b * self.eta[:n] + rise
        low, high = np.full(n, -b), np.full(n, b)
        return np.stack(
            (
                np.column_stack((at - near, low)),
                np.column_stack((at + near, high)),
                np.column_stack((at + h + far, high)),
                np.column_stack((at + h - far, low)),
            ),
            axis=1,
        )

    def flat_of_facets(self, facets: IntArray) -> Array:
        """Flat outlines (k,4,2) of facets."""
        return self.flat_corners[facets]

    def flat_of_edges(self, edges: IntArray) -> Array:
        """Flat ends (k,2,2) of edges."""
        return self._flat_ends[edges]

    @cached_property
    def _flat_ends(self) -> Array:
        index = np.arange(3 * len(self.nodes))
        k, which = np.divmod(index, 3)
        corners = self.flat_corners[np.minimum(k, self.segments - 1)]
        beyond = k == self.segments  # the ruling at a strip's end
        first = np.where(which == 2, 1, 0)
        last = np.where(which == 0, 1, np.where(which == 1, 3, 2))
        first, last = np.where(beyond, 3, first), np.where(beyond, 2, last)
        return np.stack((corners[index, first], corners[index, last]), axis=1)

    def flat_of_vertices(self, vertices: IntArray) -> Array:
        """Flat places (k,1,2) of vertices."""
        ends = self.flat_of_edges(3 * (vertices // 2))
        return ends[np.arange(len(vertices)), vertices % 2][:, None]

    def flat_distance(self, one: Array, other: Array, within: float = np.inf) -> Array:
        """Distances (k,) on the strip of convex outlines (k,p,2) and (k,q,2), the shortest way round;
        infinite where they are seen to be more than `within`."""
        least = np.full(len(one), np.inf)
        low, high = box_of(one)
        first, last = box_of(other)
        for turn in (-1, 0, 1) if self.closed else (0,):
            shift = turn * self.length
            apart = np.maximum(first[:, 0] + shift - high[:, 0], low[:, 0] - last[:, 0] - shift)
            at = np.flatnonzero(apart <= np.minimum(least, within))
            over = turn and self.sigma < 0
            below, above = (-last[at, 1], -first[at, 1]) if over else (first[at, 1], last[at, 1])
            beside = np.maximum(below - high[at, 1], low[at, 1] - above)
            at = at[beside <= np.minimum(least[at], within)]
            moved = other[at] + (shift, 0.0)
            if over:
                moved[..., 1] *= -1.0
            least[at] = np.minimum(least[at], _planar_distance(one[at], moved))
        return least


@lru_cache(maxsize=4)
def _corner_numbers(segments: int, sigma: int) -> IntArray:
    """See `Shape.corner_numbers`."""
    k = np.arange(segments)
    beyond = np.column_stack((2 * k + 3, 2 * k + 2))
    if sigma:
        beyond[-1] = (1, 0) if sigma > 0 else (0, 1)
    return np.column_stack((2 * k, 2 * k + 1, beyond)).astype(np.int64)


@lru_cache(maxsize=4)
def _edge_ends(segments: int, sigma: int, nodes: int) -> tuple[IntArray, IntArray]:
    """The vertices at both ends of all edges; see `Shape.edge_ends`."""
    k, which = np.divmod(np.arange(3 * nodes), 3)
    corners = _corner_numbers(segments, sigma)[np.minimum(k, segments - 1)]
    low, high = 2 * k, 2 * k + 1
    first = np.where(which == 2, high, low)
    last = np.where(which == 0, high, np.where(which == 1, corners[:, 3], corners[:, 2]))
    return first, last


def cross(v: Array, w: Array) -> Array:
    """Vector products over the last axis; numpy's own turns axes about for longer than it multiplies."""
    out = np.empty(np.broadcast_shapes(v.shape, w.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = v[..., j] * w[..., k] - v[..., k] * w[..., j]
    return out


def dots(v: Array, w: Array) -> Array:
    """Scalar products (k,) of vectors (k,3)."""
    out: Array = v[:, 0] * w[:, 0] + v[:, 1] * w[:, 1] + v[:, 2] * w[:, 2]
    return out


def box_of(points: Array) -> tuple[Array, Array]:
    """The lowest and the highest corner (k,d) of the boxes of points (k,p,d)."""
    each = [points[:, k] for k in range(points.shape[1])]
    return reduce(np.minimum, each), reduce(np.maximum, each)


def _planar_distance(one: Array, other: Array) -> Array:
    """Distances (k,) in the plane of points, segments and convex outlines; 0 where they overlap."""
    least = np.minimum(_points_to_outline(one, other), _points_to_outline(other, one))
    if one.shape[1] > 1 and other.shape[1] > 1:
        least = np.where(_outlines_cross(one, other), 0.0, least)
    return least


def _sides(outline: Array) -> tuple[Array, Array]:
    """Starts and directions (k,s,2) of an outline's sides; a segment has one."""
    count = outline.shape[1]
    if count <= 2:
        return outline[:, :1], outline[:, -1:] - outline[:, :1]
    return outline, np.roll(outline, -1, axis=1) - outline


def _points_to_outline(points: Array, outline: Array) -> Array:
    """Least distances (k,) of points (k,p,2) to an outline, 0 for a point inside."""
    start, along = _sides(outline)
    least, within = np.full(len(points), np.inf), np.zeros(len(points), dtype=bool)
    # Components one by one: arrays with a short last axis take several times as long.
    for x, y in points.transpose(1, 2, 0):
        left, right = np.ones(len(points), dtype=bool), np.ones(len(points), dtype=bool)
        for (x0, y0), (dx, dy) in zip(start.transpose(1, 2, 0), along.transpose(1, 2, 0), strict=True):
            off_x, off_y = x - x0, y - y0
            square = np.maximum(dx * dx + dy * dy, np.finfo(float).tiny)
            part = np.clip((off_x * dx + off_y * dy) / square, 0.0, 1.0)
            rest_x, rest_y = off_x - part * dx, off_y - part * dy
            least = np.minimum(least, rest_x * rest_x + rest_y * rest_y)
            turn = dx * off_y - dy * off_x
            left, right = left & (turn >= 0), right & (turn <= 0)
        within |= left | right
    inside = within & (outline.shape[1] > 2)
    out: Array = np.where(inside, 0.0, np.sqrt(least))
    return out


def _outlines_cross(one: Array, other: Array) -> NDArray[np.bool_]:
    """Whether a side of one outline crosses one of the other, (k,)."""
    p, d = (a[:, :, None] for a in _sides(one))
    q, e = (a[:, None] for a in _sides(other))

    def turn(v: Array, w: Array) -> Array:
        out: Array = v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]
        return out

    first = turn(d, q - p) * turn(d, q + e - p)
    second = turn(e, p - q) * turn(e, p + d - q)
    out: NDArray[np.bool_] = np.any((first < 0) & (second < 0), axis=(1, 2))
    return out
