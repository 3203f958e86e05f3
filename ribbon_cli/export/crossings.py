"""Which triangles of a mesh pass through each other, decided exactly.

Signs of determinants come from floating point where its error is too small to matter, and else from integers.
Two triangles cross if they share more than the vertices or the edge that joins them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[Any]
Indices = NDArray[np.int64]
Signs = NDArray[np.int8]
Flags = NDArray[np.bool_]

ROUNDING = 2.0**-48
"""Bound of the relative error of a determinant of three differences of floats: ten roundings are fewer."""
CHUNK = 1 << 20
"""Pairs looked at at once."""


@dataclass(frozen=True)
class _Places:
    """Vertices (m, 3) as floats and, where these do not decide, as integers of a fine enough unit."""

    floats: Array

    @cached_property
    def integers(self) -> Integers:
        ratios = [value.as_integer_ratio() for value in self.floats.ravel().tolist()]
        unit = max((below for _, below in ratios), default=1)
        values = np.array([above * (unit // below) for above, below in ratios], dtype=object)
        return values.reshape(-1, 3)


def crossing_pairs(points: Array, triangles: Indices) -> Indices:
    """Pairs (k, 2) of rows of `triangles` (n, 3), vertices in `points` (m, 3), that pass through each other.

    Vertices are the same if their coordinates are. Triangles with two corners in one place have no area and
    are left out.
    """
    unique, names = np.unique(points, axis=0, return_inverse=True)
    places, faces = _Places(unique), names.reshape(-1)[triangles]
    a, b, c = faces.T
    proper = np.flatnonzero((a != b) & (b != c) & (c != a))
    found = [pairs[_cross(places, faces[pairs])] for pairs in _near_pairs(unique, faces, proper)]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *found])


def _near_pairs(points: Array, faces: Indices, rows: Indices) -> Iterator[Indices]:
    """Pairs (k, 2) of rows whose boxes meet, in portions."""
    corners = points[faces[rows]]
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = int(np.argmin((high - low).mean(axis=0) / (np.ptp(points, axis=0) + 1e-300)))
    order = np.argsort(low[:, axis], kind="stable")
    rows, low, high = rows[order], low[order], high[order]
    counts = np.searchsorted(low[:, axis], high[:, axis], side="right") - np.arange(len(rows)) - 1
    ends = np.cumsum(counts)
    begin = 0
    while begin < len(rows):
        done = ends[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(ends, done + CHUNK)))
        count = counts[begin:end]
        one = np.repeat(np.arange(begin, end), count)
        other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
        meet = ((low[one] <= high[other]) & (low[other] <= high[one])).all(axis=1)
        yield np.column_stack((rows[one[meet]], rows[other[meet]]))
        begin = end


def _cross(places: _Places, faces: Indices) -> Flags:
    """Which pairs of triangles, `faces` (k, 2, 3), have more in common than their shared corners."""
    shared = (faces[:, 0, :, None] == faces[:, 1, None, :]).sum(axis=(1, 2))
    result: Flags = shared == 3
    for one, other in ((0, 1), (1, 0)):
        for k in range(3):
            apart = np.flatnonzero((shared == 0) & ~result)
            result[apart] = _meets(places, faces[apart, one][:, [k, k - 2]], faces[apart, other])
        # From the common corner what two triangles share reaches the side opposite to it of one of them.
        touching = np.flatnonzero((shared == 1) & ~result)
        mine, others = faces[touching, one], faces[touching, other]
        result[touching] = _meets(places, _alone(mine, others, 2), others)
    # Triangles with a common edge cross only if they lie in a plane, on the same side of it.
    hinged = np.flatnonzero(shared == 2)
    tips = [_alone(faces[hinged, one], faces[hinged, 1 - one], 1)[:, 0] for one in (0, 1)]
    flat = _signs(places, np.column_stack((faces[hinged, 0], tips[1]))) == 0
    for row, *two in zip(hinged[flat], tips[0][flat], tips[1][flat], strict=True):
        start, end = (places.integers[v] for v in faces[row, 0] if v != two[0])
        across = [np.cross(end - start, places.integers[tip] - start) for tip in two]
        result[row] = across[0] @ across[1] > 0
    return result


def _alone(mine: Indices, others: Indices, count: int) -> Indices:
    """The `count` corners (k, count) of triangles that others do not have."""
    found: Indices = mine[~(mine[:, :, None] == others[:, None, :]).any(axis=2)]
    return found.reshape(-1, count)


def _meets(places: _Places, ends: Indices, faces: Indices) -> Flags:
    """Which segments, `ends` (k, 2), meet the triangles `faces` (k, 3), borders included."""
    first = _signs(places, np.column_stack((faces, ends[:, 0])))
    second = _signs(places, np.column_stack((faces, ends[:, 1])))
    result: Flags = np.zeros(len(ends), dtype=bool)
    through = np.flatnonzero((first * second <= 0) & ((first != 0) | (second != 0)))
    sides = [
        _signs(places, np.column_stack((ends[through], faces[through][:, [k, k - 2]]))) for k in range(3)
    ]
    around = np.array(sides)
    result[through] = (around >= 0).all(axis=0) | (around <= 0).all(axis=0)
    for row in np.flatnonzero((first == 0) & (second == 0)):
        result[row] = _meets_flat(*places.integers[faces[row]], *places.integers[ends[row]])
    return result


def _signs(places: _Places, corners: Indices) -> Signs:
    """Signs (k,) of the volumes of tetrahedra, `corners` (k, 4), exactly."""
    volume, size = _volumes(places.floats, corners)
    signs = np.sign(volume).astype(np.int8)
    unsure = np.flatnonzero(np.abs(volume) <= ROUNDING * size)
    if len(unsure):
        volume, _ = _volumes(places.integers, corners[unsure])
        signs[unsure] = (volume > 0).astype(np.int8) - (volume < 0).astype(np.int8)
    return signs


def _volumes(points: Array, corners: Indices) -> tuple[Array, Array]:
    """Six times the volumes (k,) of tetrahedra, and the sums of the moduli of their terms."""
    a, b, c = (points[corners[:, k]] - points[corners[:, 3]] for k in range(3))
    terms = a[:, [0, 1, 2, 0, 1, 2]] * b[:, [1, 2, 0, 2, 0, 1]] * c[:, [2, 0, 1, 1, 2, 0]]
    return terms[:, :3].sum(axis=1) - terms[:, 3:].sum(axis=1), np.abs(terms).sum(axis=1)


def _meets_flat(a: Integers, b: Integers, c: Integers, p: Integers, q: Integers) -> bool:
    """Whether a segment p q meets a triangle a b c in its plane; one without area has sides alone."""
    normal = np.cross(b - a, c - a)
    if not normal.any():
        return False

    def side(start: Integers, end: Integers, point: Integers) -> Any:
        return np.cross(end - start, point - start) @ normal

    edges = ((a, b), (b, c), (c, a))
    for point in (p, q):
        if all(side(*edge, point) >= 0 for edge in edges):
            return True
    return any(
        side(*edge, p) * side(*edge, q) <= 0
        and side(p, q, edge[0]) * side(p, q, edge[1]) <= 0
        and bool(side(p, q, edge[0]) or side(p, q, edge[1]))
        for edge in edges
    )
