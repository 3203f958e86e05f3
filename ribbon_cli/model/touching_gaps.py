"""Signed gaps of pairs of features, with their first and second derivatives.

A vertex against a facet and an edge against an edge have one and the same gap. With D from a point of the
second feature to one of the first, and two directions p and q,

    T = D.n,     n = c / |c|,     c = p x q.

Facet k gives r_k for the point and u_k, g_k for the directions. Two edges give a point and a direction
each: a ruling r_k and g_k, a side r_k -+ b g_k and u_k. With w = (D - T n) / |c|,

    T_D = n,                   T_p = q x w,              T_q = w x p,
    T_Dc = (1 - n n') / |c|,   T_cc = -(n w' + w n') / |c| - T (1 - n n') / |c|^2,
    T_pq = ... - [w]x,         dc = dp x q + p x dq,

and T_DD = 0. Where a gap is wanted that is not zero, the distance of a vertex and an edge,
|D - (D.d) d / d.d|, and that of two vertices, |D|, count as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .band import Array
from .touching import EDGE, FACET, VERTEX, IntArray, Shape, cross


@dataclass(frozen=True)
class Pairs:
    """Pairs of features: `first` and `second` (k,2), kind and number, and the `sign` (k,) of each gap.

    A vertex comes before a facet or an edge; of two alike the lower number comes first. The gap is `sign`
    times T, positive where the features are on the sides on which they are to stay.
    """

    first: IntArray
    second: IntArray
    sign: Array

    @classmethod
    def none(cls) -> Pairs:
        """No pairs."""
        return cls(np.empty((0, 2), np.int64), np.empty((0, 2), np.int64), np.empty(0))

    def __len__(self) -> int:
        return len(self.sign)

    def names(self) -> list[tuple[int, int, int, int]]:
        """What names each pair."""
        return [tuple(row) for row in np.hstack((self.first, self.second)).tolist()]

    def take(self, which: NDArray[np.bool_] | IntArray) -> Pairs:
        """Some of the pairs."""
        return Pairs(self.first[which], self.second[which], self.sign[which])

    def joined(self, other: Pairs) -> Pairs:
        """These pairs and others."""
        return Pairs(
            np.vstack((self.first, other.first)),
            np.vstack((self.second, other.second)),
            np.concatenate((self.sign, other.sign)),
        )

    def unique(self) -> Pairs:
        """The pairs, each once."""
        first = {key: k for k, key in reversed(list(enumerate(self.names())))}
        return self.take(np.array(sorted(first.values()), dtype=np.int64))

    def ordered(self) -> Pairs:
        """The pairs in the order of their names."""
        return self.take(np.lexsort(np.hstack((self.first, self.second)).T[::-1]))

    def flipped(self) -> Pairs:
        """The pairs with the other sign."""
        return replace(self, sign=-self.sign)


R_FIRST, G_FIRST, R_SECOND, G_SECOND, ONE, TWO = range(6)
"""What a gap depends on, 3 numbers each: a node and a ruling on either side, and two directions."""
NODE, RULING, TANGENT = 0, 1, 2
"""Kinds of what it depends on."""


@dataclass(frozen=True)
class Arguments:
    """What the gaps of pairs depend on: `kind` and `number` (k,6) of their six vectors, `reach` (k,2), how
    many b g belong to the points on either side, and `pointed` (k,), 2 where both directions count, 1
    where one does (vertex and edge), 0 where none does."""

    kind: IntArray
    number: IntArray
    reach: Array
    pointed: IntArray


def _edge(edges: IntArray) -> tuple[IntArray, Array, IntArray]:
    """Of edges: the node of their points, how many b g, and whether the direction is a ruling or a
    tangent."""
    which = edges % 3
    return edges // 3, np.array([0.0, -1.0, 1.0])[which], np.where(which == 0, RULING, TANGENT)


def arguments(pairs: Pairs) -> Arguments:
    """What the gaps of pairs depend on. Raises ValueError for pairs that have no gap."""
    count = len(pairs)
    kind = np.tile(np.array([NODE, RULING, NODE, RULING, TANGENT, RULING]), (count, 1))
    number = np.zeros((count, 6), dtype=np.int64)
    reach, pointed = np.zeros((count, 2)), np.full(count, 2)
    for k, (features, node, ruling) in enumerate(
        ((pairs.first, R_FIRST, G_FIRST), (pairs.second, R_SECOND, G_SECOND))
    ):
        of, at = features[:, 0], features[:, 1]
        vertex, edge, facet = of == VERTEX, of == EDGE, of == FACET
        place, lean, along = _edge(np.where(edge, at, 0))
        number[:, node] = number[:, ruling] = np.where(vertex, at // 2, np.where(edge, place, at))
        reach[:, k] = np.where(vertex, 2.0 * (at % 2) - 1.0, np.where(edge, lean, 0.0))
        direction = TWO if k else ONE
        kind[edge, direction], number[edge, direction] = along[edge], place[edge]
        number[facet, ONE] = number[facet, TWO] = at[facet]
        if facet.any() and not k:
            raise ValueError("a facet is the second of a pair")
    alone = pairs.first[:, 0] == VERTEX
    pointed[alone & (pairs.second[:, 0] == EDGE)] = 1
    pointed[alone & (pairs.second[:, 0] == VERTEX)] = 0
    return Arguments(kind, number, reach, pointed)


def vectors(shape: Shape, what: Arguments) -> Array:
    """The six vectors (k,6,3) of each gap in a shape."""
    tables = (shape.nodes, shape.rulings, shape.u)
    size = np.array([len(table) for table in tables])
    first = np.concatenate(([0], np.cumsum(size)[:-1]))
    at = first[what.kind] + np.minimum(what.number, size[what.kind] - 1)
    out: Array = np.concatenate(tables)[at]
    return out


@dataclass(frozen=True)
class Gaps:
    """Gaps (k,), their gradients (k,6,3) and Hessians (k,18,18) in the six vectors."""

    value: Array
    gradient: Array
    hessian: Array


@dataclass(frozen=True)
class GapRates:
    """Derivatives of gaps by the half-width, once and twice (k,), and of their gradients, (k,6,3)."""

    rate: Array
    gradient: Array
    second: Array


def gap_values(shape: Shape, pairs: Pairs) -> Array:
    """Gaps (k,) alone, the same to the last digit as `gaps` has them."""
    what = arguments(pairs)
    six = vectors(shape, what)
    offset, p, q = _offset(six, what, shape.half_width), six[:, ONE], six[:, TWO]
    value = np.zeros(len(pairs))
    for kind, function in ((2, _height), (1, _off_line), (0, _apart)):
        chosen = what.pointed == kind
        if chosen.all():
            return pairs.sign * function(offset, p, q)
        if chosen.any():
            value[chosen] = function(offset[chosen], p[chosen], q[chosen])
    return pairs.sign * value


def _offset(six: Array, what: Arguments, half_width: float) -> Array:
    """D (k,3) = r + lean b g - r' - lean' b g'."""
    lean_first, lean_second = what.reach[:, 0], what.reach[:, 1]
    arm = lean_first[:, None] * six[:, G_FIRST] - lean_second[:, None] * six[:, G_SECOND]
    out: Array = six[:, R_FIRST] - six[:, R_SECOND] + half_width * arm
    return out


def gaps(six: Array, what: Arguments, sign: Array, half_width: float) -> Gaps:
    """Gaps and derivatives at vectors (k,6,3)."""
    value, local, second = _in_offset(six, what, sign, half_width)
    weight = _weights(what, half_width)
    spread = np.zeros((len(sign), 3, 3, 6, 3))
    spread[:, :, [0, 1, 2], :, [0, 1, 2]] = weight
    nine = spread.reshape(-1, 9, 18)
    hessian = nine.transpose(0, 2, 1) @ second @ nine
    return Gaps(value, np.einsum("kas,kai->ksi", weight, local), hessian)


def gap_rates(six: Array, what: Arguments, sign: Array, half_width: float) -> GapRates:
    """Derivatives of gaps by the half-width at vectors (k,6,3)."""
    _, local, second = _in_offset(six, what, sign, half_width)
    lean_first, lean_second = what.reach[:, 0], what.reach[:, 1]
    turn = np.zeros((len(sign), 3, 6))
    turn[:, 0, G_FIRST], turn[:, 0, G_SECOND] = lean_first, -lean_second
    arm = lean_first[:, None] * six[:, G_FIRST] - lean_second[:, None] * six[:, G_SECOND]
    pushed = np.einsum("kaij,kj->kai", second.reshape(-1, 3, 3, 3, 3)[:, :, :, 0], arm)
    weight = _weights(what, half_width)
    return GapRates(
        np.einsum("ki,ki->k", local[:, 0], arm),
        np.einsum("kas,kai->ksi", weight, pushed) + np.einsum("kas,kai->ksi", turn, local),
        np.einsum("ki,ki->k", pushed[:, 0], arm),
    )


def _in_offset(six: Array, what: Arguments, sign: Array, half_width: float) -> tuple[Array, Array, Array]:
    """Gaps (k,), and their derivatives (k,3,3) and (k,9,9) in D, p and q."""
    offset = _offset(six, what, half_width)
    value, first, second = _of_offset(offset, six[:, ONE], six[:, TWO], what.pointed)
    local = (sign[:, None] * first).reshape(-1, 3, 3)
    return sign * value, local, sign[:, None, None] * second


def _weights(what: Arguments, half_width: float) -> Array:
    """What (D, p, q) have of the six vectors, (k,3,6): D = r + lean b g - r' - lean' b g'."""
    lean = half_width * what.reach
    out = np.zeros((len(lean), 3, 6))
    out[:, 0, R_FIRST], out[:, 0, R_SECOND] = 1.0, -1.0
    out[:, 0, G_FIRST], out[:, 0, G_SECOND] = lean[:, 0], -lean[:, 1]
    out[:, 1, ONE] = out[:, 2, TWO] = 1.0
    return out


def _of_offset(offset: Array, p: Array, q: Array, pointed: IntArray) -> tuple[Array, Array, Array]:
    """Values (k,), gradients (k,9) and Hessians (k,9,9) in D, p and q."""
    count = len(offset)
    value, first, second = np.zeros(count), np.zeros((count, 9)), np.zeros((count, 9, 9))
    for kind, function in ((2, _signed), (1, _to_line), (0, _to_point)):
        chosen = pointed == kind
        if chosen.any():
            value[chosen], first[chosen], second[chosen] = function(offset[chosen], p[chosen], q[chosen])
    return value, first, second


def _skew(v: Array) -> Array:
    """[v]x (k,3,3), for which [v]x w = v x w."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _outer(v: Array, w: Array) -> Array:
    out: Array = v[:, :, None] * w[:, None, :]
    return out


def _normal(p: Array, q: Array) -> tuple[Array, Array]:
    """n (k,3) and |c| (k,1)."""
    c = cross(p, q)
    size = np.maximum(np.linalg.norm(c, axis=1), np.finfo(float).tiny)[:, None]
    return c / size, size


def _height(d: Array, p: Array, q: Array) -> Array:
    """T alone."""
    out: Array = (d * _normal(p, q)[0]).sum(axis=1)
    return out


def _signed(d: Array, p: Array, q: Array) -> tuple[Array, Array, Array]:
    """T and its derivatives."""
    n, size = _normal(p, q)
    value = (d * n).sum(axis=1)
    w = (d - value[:, None] * n) / size
    across = (np.eye(3) - _outer(n, n)) / size[:, :, None]
    bend = -(_outer(n, w) + _outer(w, n)) / size[:, :, None] - (value[:, None] / size)[:, :, None] * across
    by_p, by_q = -_skew(q), _skew(p)
    first = np.concatenate((n, cross(q, w), cross(w, p)), axis=1)
    second = np.zeros((len(d), 9, 9))
    second[:, :3, 3:6], second[:, :3, 6:] = across @ by_p, across @ by_q
    turned_p, turned_q = np.swapaxes(by_p, 1, 2), np.swapaxes(by_q, 1, 2)
    second[:, 3:6, 3:6], second[:, 6:, 6:] = turned_p @ bend @ by_p, turned_q @ bend @ by_q
    second[:, 3:6, 6:] = turned_p @ bend @ by_q - _skew(w)
    return value, first, _symmetric(second)


def _symmetric(second: Array) -> Array:
    """Copy the blocks above the diagonal below it."""
    for i, j in ((0, 1), (0, 2), (1, 2)):
        here, there = slice(3 * i, 3 * i + 3), slice(3 * j, 3 * j + 3)
        second[:, there, here] = np.swapaxes(second[:, here, there], 1, 2)
    return second


def _from_line(d: Array, q: Array) -> tuple[Array, Array, Array]:
    """Of a point and the line along q: what is across (k,3), which part of q is along, q.q (k,1)."""
    square = (q * q).sum(axis=1)[:, None]
    part = (d * q).sum(axis=1)[:, None] / square
    return d - part * q, part, square


def _off_line(d: Array, p: Array, q: Array) -> Array:
    """The distance of a point from the line along q, alone."""
    return _apart(_from_line(d, q)[0], p, q)


def _to_line(d: Array, p: Array, q: Array) -> tuple[Array, Array, Array]:
    """The distance of a point from the line along q."""
    rest, part, square = _from_line(d, q)
    value = _apart(rest, p, q)
    n = rest / value[:, None]
    first = np.zeros((len(d), 9))
    first[:, :3], first[:, 6:] = n, -part * n
    # d(rest) = P dD - q (dq.rest)/q.q - part P dq with P = 1 - q q'/q.q; value n' d(value) = rest'...
    along = _outer(q, q) / square[:, :, None]
    across = (np.eye(3) - along - _outer(n, n)) / value[:, None, None]
    tilt = _outer(q, n) / square[:, :, None]
    second = np.zeros((len(d), 9, 9))
    k = part[:, :, None]
    second[:, :3, :3] = across
    second[:, :3, 6:] = -k * across - tilt
    second[:, 6:, 6:] = (
        k * k * across
        + k * (tilt + np.swapaxes(tilt, 1, 2))
        - (value[:, None, None] / square[:, :, None]) * _outer(n, n)
    )
    return value, first, _symmetric(second)


def _apart(d: Array, p: Array, q: Array) -> Array:
    """The length of D, alone."""
    del p, q
    out: Array = np.maximum(np.linalg.norm(d, axis=1), np.finfo(float).tiny)
    return out


def _to_point(d: Array, p: Array, q: Array) -> tuple[Array, Array, Array]:
    """The length of D."""
    value = _apart(d, p, q)
    n = d / value[:, None]
    first, second = np.zeros((len(d), 9)), np.zeros((len(d), 9, 9))
    first[:, :3] = n
    second[:, :3, :3] = (np.eye(3) - _outer(n, n)) / value[:, None, None]
    return value, first, second


def places(shape: Shape, pairs: Pairs) -> Array:
    """Where on their features the pairs touch, (k,4): two coordinates on the first and two on the second.

    All are between 0 and 1 inside: along an edge from its first end to its last; on a facet along the band
    and across it. What a feature does not have is 1/2.
    """
    out = np.full((len(pairs), 4), 0.5)
    what = arguments(pairs)
    six = vectors(shape, what)
    b = shape.half_width
    lean = b * what.reach[:, :, None]
    first, second = (
        six[:, R_FIRST] + lean[:, 0] * six[:, G_FIRST],
        six[:, R_SECOND] + lean[:, 1] * six[:, G_SECOND],
    )
    facing = pairs.second[:, 0] == FACET
    p, q = six[:, ONE], six[:, TWO]
    c = cross(p, q)
    square = np.maximum((c * c).sum(axis=1), np.finfo(float).tiny)
    d = first - second
    if facing.any():
        facet = pairs.second[facing, 1]
        along = (cross(d, q) * c).sum(axis=1)[facing] / square[facing]
        across = (cross(p, d) * c).sum(axis=1)[facing] / (square[facing] * b)
        far = shape.h * np.maximum(1.0 + across * np.tanh(shape.xi[facet]), np.finfo(float).tiny)
        with np.errstate(over="ignore"):  # at a tip of no width a place is infinitely far off
            out[facing, 2], out[facing, 3] = along / far, 0.5 * (across + 1.0)
    crossing = (pairs.first[:, 0] == EDGE) & (pairs.second[:, 0] == EDGE)
    if crossing.any():
        on_first = -(cross(d, q) * c).sum(axis=1) / square
        on_second = -(cross(d, p) * c).sum(axis=1) / square
        out[crossing, 0] = _part(shape, pairs.first[crossing, 1], on_first[crossing])
        out[crossing, 2] = _part(shape, pairs.second[crossing, 1], on_second[crossing])
    beside = (pairs.first[:, 0] == VERTEX) & (pairs.second[:, 0] == EDGE)
    if beside.any():
        on = (d * q).sum(axis=1) / np.maximum((q * q).sum(axis=1), np.finfo(float).tiny)
        out[beside, 2] = _part(shape, pairs.second[beside, 1], on[beside])
    return out


def _part(shape: Shape, edges: IntArray, along: Array) -> Array:
    """Coordinates along edges, from multiples of their directions."""
    k, which = np.minimum(edges // 3, shape.segments - 1), edges % 3
    rise = np.tanh(shape.xi[k])
    side = shape.h * np.maximum(np.where(which == 1, 1.0 - rise, 1.0 + rise), np.finfo(float).tiny)
    with np.errstate(over="ignore"):  # on a side of no length a place is infinitely far off
        out: Array = np.where(which == 0, 0.5 * (along / shape.half_width + 1.0), along / side)
    return out
