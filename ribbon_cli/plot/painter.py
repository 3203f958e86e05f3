"""Which facet to draw first: an exact depth order of flat polygons in an orthographic view.

Sorting facets by the depth of their centres fails for bands: a facet is as long as the strip is wide. Here
each pair that overlaps in the picture is compared at a point of the overlap, and the comparisons are sorted
topologically, as in Newell, Newell and Sancha (1972). Where they run in a circle, which facets that pass
through each other make, the circle is cut at its farthest facet.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TOUCHING = 1e-9
"""Depth, relative to the picture's size, below which two facets meet and neither is before the other."""
IN_FRONT = 1e-6
"""Depth, relative to the picture's size, by which a facet must be in front of a line to hide it."""
_CHUNK = 40_000


def depth_order(polygons: Array) -> tuple[Indices, Indices]:
    """Order (n,) in which to paint convex polygons (n, k, 3) of (right, up, depth), farthest first.

    The second array (n,) says how many of the others lie in front of each somewhere.
    """
    behind, front = _relations(polygons)
    covered = np.bincount(behind, minlength=len(polygons))
    return _sorted(polygons[:, :, 2].mean(axis=1), behind, front), covered


def hidden(points: Array, owners: Indices, polygons: Array) -> NDArray[np.bool_]:
    """Which points (n, 3) lie behind one of the convex polygons (m, k, 3), other than those they belong to.

    `owners` (n, j) are each point's own polygons.
    """
    size = float(np.ptp(polygons[:, :, :2], axis=(0, 1)).max())
    low, high = polygons[:, :, :2].min(axis=1), polygons[:, :, :2].max(axis=1)
    planes = _planes(polygons)
    covered = np.zeros(len(points), dtype=bool)
    for j, polygon in enumerate(polygons):
        close = (points[:, :2] > low[j]).all(axis=1) & (points[:, :2] < high[j]).all(axis=1)
        at = np.flatnonzero(close & ~covered & (owners != j).all(axis=1))
        inside = _inside(points[None, at, :2], polygon[None, :, :2])[0]
        covered[at] = inside & (_depth(planes[j], points[at]) - points[at, 2] > IN_FRONT * size)
    return covered


def _relations(polygons: Array) -> tuple[Indices, Indices]:
    """Pairs (behind, front) of polygons that overlap in the picture."""
    first, second = _overlapping_boxes(polygons[:, :, :2])
    size = float(np.ptp(polygons[:, :, :2], axis=(0, 1)).max())
    planes = _planes(polygons)
    behind, front = [], []
    for start in range(0, first.size, _CHUNK):
        i, j = first[start : start + _CHUNK], second[start : start + _CHUNK]
        points, found = _common_points(polygons[i, :, :2], polygons[j, :, :2], size)
        gap = _depth(planes[i], points) - _depth(planes[j], points)
        found &= np.abs(gap) > TOUCHING * size
        i_behind = gap[found] < 0
        i, j = i[found], j[found]
        behind.append(np.where(i_behind, i, j))
        front.append(np.where(i_behind, j, i))
    return np.concatenate([*behind, np.empty(0, int)]), np.concatenate([*front, np.empty(0, int)])


def _overlapping_boxes(flat: Array) -> tuple[Indices, Indices]:
    """Pairs of polygons whose bounding boxes overlap, by a sweep along the first axis."""
    low, high = flat.min(axis=1), flat.max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    low, high = low[order], high[order]
    # Boxes in sweep order overlap along the first axis those that begin before they end.
    last = np.searchsorted(low[:, 0], high[:, 0], side="left")
    counts = np.maximum(last - np.arange(len(flat)) - 1, 0)
    first = np.repeat(np.arange(len(flat)), counts)
    second = first + 1 + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    meet = (low[first, 1] < high[second, 1]) & (low[second, 1] < high[first, 1])
    return order[first[meet]], order[second[meet]]


def _planes(polygons: Array) -> Array:
    """Coefficients (n, 3) of depth = a + b right + c up; NaN where a polygon is seen edge-on."""
    p = polygons[:, 0]
    normal = np.cross(polygons[:, 2] - p, polygons[:, 3] - polygons[:, 1])
    edge_on = np.abs(normal[:, 2]) <= 1e-12 * np.linalg.norm(normal, axis=1)
    height = np.where(edge_on, np.nan, normal[:, 2])
    b, c = -normal[:, 0] / height, -normal[:, 1] / height
    return np.stack((p[:, 2] - b * p[:, 0] - c * p[:, 1], b, c), axis=1)


def _depth(planes: Array, points: Array) -> Array:
    """Depth (n,) of planes (n, 3), or of one (3,), above points (n, 2) of the picture."""
    depth: Array = planes[..., 0] + planes[..., 1] * points[:, 0] + planes[..., 2] * points[:, 1]
    return depth


def _common_points(one: Array, other: Array, size: float) -> tuple[Array, NDArray[np.bool_]]:
    """A point (n, 2) inside both of convex polygons (n, k, 2), and whether (n,) there is one.

    It is the middle of the corners of the overlap: corners of either inside the other, and crossings of
    edges.
    """
    crossings, cross = _crossings(one, other)
    candidates = np.concatenate((one, other, crossings), axis=1)
    valid = np.concatenate((_inside(one, other), _inside(other, one), cross), axis=1)
    weight = valid.sum(axis=1)
    points = np.where(valid[:, :, None], candidates, 0.0).sum(axis=1) / np.maximum(weight, 1)[:, None]
    spread = np.where(valid[:, :, None], np.abs(candidates - points[:, None]), 0.0).max(axis=(1, 2))
    # Neighbours share a ruling: three corners that are not on one line make an overlap, two do not.
    found = (weight >= 3) & (spread > 1e-7 * size)
    return points, found


def _inside(points: Array, polygon: Array) -> NDArray[np.bool_]:
    """Whether points (n, m, 2) lie strictly inside convex polygons (n, k, 2) of either sense."""
    edge = np.roll(polygon, -1, axis=1) - polygon
    offset = points[:, :, None] - polygon[:, None]
    turn = edge[:, None, :, 0] * offset[..., 1] - edge[:, None, :, 1] * offset[..., 0]
    slack = 1e-9 * np.abs(edge).max(axis=(1, 2))[:, None, None] ** 2
    left: NDArray[np.bool_] = (turn > slack).all(axis=2) | (turn < -slack).all(axis=2)
    return left


def _crossings(one: Array, other: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Crossing points (n, k k, 2) of the edges of two polygons, and which are there."""
    n, k = one.shape[:2]
    p, q = one[:, :, None], other[:, None]
    r = (np.roll(one, -1, axis=1) - one)[:, :, None]
    s = (np.roll(other, -1, axis=1) - other)[:, None]
    turn = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    scale = np.linalg.norm(r, axis=-1) * np.linalg.norm(s, axis=-1)
    parallel = np.abs(turn) <= 1e-9 * scale
    gap = q - p
    safe = np.where(parallel, 1.0, turn)
    t = (gap[..., 0] * s[..., 1] - gap[..., 1] * s[..., 0]) / safe
    v = (gap[..., 0] * r[..., 1] - gap[..., 1] * r[..., 0]) / safe
    cross = ~parallel & (t > 1e-9) & (t < 1 - 1e-9) & (v > 1e-9) & (v < 1 - 1e-9)
    points = p + np.where(parallel, 0.0, t)[..., None] * r
    return points.reshape(n, k * k, 2), cross.reshape(n, k * k)


def _sorted(depth: Array, behind: Indices, front: Indices) -> Indices:
    """Sort topologically: what is behind first, otherwise by depth of the centres."""
    count = len(depth)
    order = np.argsort(behind, kind="stable")
    starts = np.searchsorted(behind[order], np.arange(count + 1)).tolist()
    after = front[order].tolist()
    waiting = np.bincount(front, minlength=count).tolist()
    depths = depth.tolist()
    ready = [(depths[i], i) for i in range(count) if waiting[i] == 0]
    heapq.heapify(ready)
    by_depth = iter(np.argsort(depth, kind="stable").tolist())
    done = [False] * count
    painted: list[int] = []
    while len(painted) < count:
        i = heapq.heappop(ready)[1] if ready else next(k for k in by_depth if not done[k])
        if done[i]:
            continue
        done[i] = True
        painted.append(i)
        for j in after[starts[i] : starts[i + 1]]:
            waiting[j] -= 1
            if waiting[j] == 0 and not done[j]:
                heapq.heappush(ready, (depths[j], j))
    return np.array(painted, dtype=np.int64)
