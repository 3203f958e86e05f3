"""Which triangles of a mesh pass through each other, decided exactly.

Signs of determinants come from floating point where its error is too small to matter, and else from fractions.
Two triangles cross if they share more than the vertices or the edge that joins them.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Indices = NDArray[np.int64]
    Signs = NDArray[np.int8]
    Flags = NDArray[np.bool_]

ROUNDING = 2.0**-48
"""Bound of the relative error of a determinant of three differences of floats: 16 roundings are more than it takes."""
CHUNK = 1 << 20
"""Pairs looked at at once."""


def crossing_pairs(points: Array, triangles: Indices) -> Indices:
    """Pairs (k, 2) of rows of `triangles` (n, 3) that pass through each other, the vertices in `points` (m, 3).

    Vertices are the same if their coordinates are. Triangles with two corners in one place have no area and
    are left out.
    """
    places, names = np.unique(points, axis=0, return_inverse=True)
    faces = names.reshape(-1)[triangles]
    proper = np.flatnonzero(
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    found = [pairs[_cross(places, faces[pairs])] for pairs in _near_pairs(places, faces, proper)]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *found])


def _near_pairs(points: Array, faces: Indices, rows: Indices) -> Iterator[Indices]:
    """Pairs (k, 2) of rows whose boxes meet, in portions."""
    corners = points[faces[rows]]
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = int(np.argmax((high.max(axis=0) - low.min(axis=0)) / (1e-300 + (high - low).mean(axis=0))))
    order = np.argsort(low[:, axis], kind="stable")
    rows, low, high = rows[order], low[order], high[order]
    stop = np.searchsorted(low[:, axis], high[:, axis], side="right")
    counts = stop - np.arange(len(rows)) - 1
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(rows):
        end = max(begin + 1, int(np.searchsorted(ends, (ends[begin - 1] if begin else 0) + CHUNK)))
        count = counts[begin:end]
        one = np.repeat(np.arange(begin, end), count)
        other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
        meet = ((low[one] <= high[other]) & (low[other] <= high[one])).all(axis=1)
        yield np.column_stack((rows[one[meet]], rows[other[meet]]))
        begin = end


def _cross(points: Array, faces: Indices) -> Flags:
    """Which pairs of triangles, `faces` (k, 2, 3), have more in common than their shared corners."""
    shared = (faces[:, 0, :, None] == faces[:, 1, None, :]).sum(axis=(1, 2))
    result: Flags = shared == 3
    apart = np.flatnonzero(shared == 0)
    for one, other in ((0, 1), (1, 0)):
        for k in range(3):
            open_ = apart[~result[apart]]
            ends = faces[open_, one][:, [k, (k + 1) % 3]]
            result[open_] = _meets(points, ends, faces[open_, other])
    at = np.flatnonzero(shared == 1)
    for one, other in ((0, 1), (1, 0)):
        # From the common corner what two triangles share reaches the side opposite to it of one of them.
        open_ = at[~result[at]]
        mine, others = faces[open_, one], faces[open_, other]
        ends = mine[~(mine[:, :, None] == others[:, None, :]).any(axis=2)].reshape(-1, 2)
        result[open_] = _meets(points, ends, others)
    at = np.flatnonzero(shared == 2)
    if len(at):
        mine, others = faces[at, 0], faces[at, 1]
        alone = ~(mine[:, :, None] == others[:, None, :]).any(axis=2)
        tip = others[~(others[:, :, None] == mine[:, None, :]).any(axis=2)]
        flat = _signs(points, np.column_stack((mine, tip))) == 0
        for row, apex, tips in zip(at[flat], mine[alone][flat], tip[flat], strict=True):
            a, b = (int(v) for v in faces[row, 0] if v != apex)
            result[row] = _same_side(_exact(points, [a, b, int(apex), int(tips)]))
    return result


def _meets(points: Array, ends: Indices, faces: Indices) -> Flags:
    """Which segments, `ends` (k, 2), meet the triangles `faces` (k, 3), borders included."""
    first = _signs(points, np.column_stack((faces, ends[:, 0])))
    second = _signs(points, np.column_stack((faces, ends[:, 1])))
    result: Flags = np.zeros(len(ends), dtype=bool)
    through = np.flatnonzero((first * second <= 0) & ((first != 0) | (second != 0)))
    p, q, f = ends[through, 0], ends[through, 1], faces[through]
    around = np.array([_signs(points, np.column_stack((p, q, f[:, k], f[:, k - 2]))) for k in range(3)])
    result[through] = (around >= 0).all(axis=0) | (around <= 0).all(axis=0)
    for row in np.flatnonzero((first == 0) & (second == 0)):
        result[row] = _meets_flat(_exact(points, [*faces[row].tolist(), *ends[row].tolist()]))
    return result


def _signs(points: Array, corners: Indices) -> Signs:
    """Signs (k,) of the volumes of tetrahedra, `corners` (k, 4), exactly."""
    a, b, c = (points[corners[:, k]] - points[corners[:, 3]] for k in range(3))
    products = a[:, [0, 1, 2, 0, 1, 2]] * b[:, [1, 2, 0, 2, 0, 1]] * c[:, [2, 0, 1, 1, 2, 0]]
    volume = products[:, :3].sum(axis=1) - products[:, 3:].sum(axis=1)
    signs = np.sign(volume).astype(np.int8)
    for row in np.flatnonzero(np.abs(volume) <= ROUNDING * np.abs(products).sum(axis=1)):
        u, v, w, origin = _exact(points, corners[row].tolist())
        signs[row] = _sign(_dot(_times(_less(u, origin), _less(v, origin)), _less(w, origin)))
    return signs


Vector = tuple[Fraction, ...]


def _exact(points: Array, rows: list[int]) -> list[Vector]:
    return [tuple(map(Fraction, points[row].tolist())) for row in rows]


def _less(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _times(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: Vector, b: Vector) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _sign(x: Fraction) -> int:
    return (x > 0) - (x < 0)


def _same_side(corners: list[Vector]) -> bool:
    """Whether c and d lie on the same side of the line through a and b, all four in a plane."""
    a, b, c, d = corners
    one, other = (_times(_less(b, a), _less(x, a)) for x in (c, d))
    return _dot(one, other) > 0


def _meets_flat(corners: list[Vector]) -> bool:
    """Whether a segment p q meets a triangle a b c in its plane; a triangle without area has sides alone."""
    a, b, c, p, q = corners
    normal = _times(_less(b, a), _less(c, a))
    if not any(normal):
        return False
    # Within the plane, sides are told by products with its normal.
    sides = [(a, b), (b, c), (c, a)]
    around = {
        point: [_sign(_dot(_times(_less(y, x), _less(point, x)), normal)) for x, y in sides] for point in (p, q)
    }
    if any(min(values) >= 0 for values in around.values()):
        return True
    along = _less(q, p)
    for k, (x, y) in enumerate(sides):
        x_side, y_side = (_sign(_dot(_times(along, _less(v, p)), normal)) for v in (x, y))
        if around[p][k] * around[q][k] <= 0 and x_side * y_side <= 0 and (x_side or y_side):
            return True
    return False
