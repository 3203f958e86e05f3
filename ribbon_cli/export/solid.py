"""A band with a thickness: a closed skin around it whose walls do not pass through each other at fans.

Either side of the band is offset by half the thickness, a ruling's corners along the bisector of the two
facets that meet there. Where rulings run together at an edge of the band and the band bends, the edge on the
inner side would turn back on itself. There neighbouring corners are joined into one, where the offset planes
of the facets before and after them meet: the crotch of the fan is filled.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.errors import UsageError
from ribbon_cli.export.crossings import crossing_pairs
from ribbon_cli.export.mesh import Strip, facet_normals, strip
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SHORTEST = 0.01
"""Least length of an offset edge, relative to the thickness and to the distance of two rulings."""
SHARPEST = -0.985
"""Cosine of the angle (170 degrees) of two facets, beyond which their offset planes meet too far off."""


@dataclass(frozen=True)
class Solid:
    """Vertices (n, 3) and triangles (k, 3) of a closed skin.

    `joined` is the number of corners that became one with the corner before them. There alone the wall is not
    as thick as elsewhere, but `thinnest` to `thickest`, across the facets and in the unit of the vertices.
    """

    points: Array
    triangles: Indices
    joined: int
    thinnest: float
    thickest: float


@dataclass(frozen=True)
class _Chain:
    """One edge of the skin, along the band: corners in order, and the facets between them.

    `corners` (m,) number the skin's corners; `places`, `rulings` (m, 3) are the band's edge and the rulings'
    directions there; `before`, `after` (m, 3) are the normals, towards this side, of the facets at a corner,
    and `along` (m, 3) is the direction of the band in the facet after it. The last corner of a `closed` chain
    is followed by the first.
    """

    corners: Indices
    places: Array
    rulings: Array
    before: Array
    after: Array
    along: Array
    closed: bool


def solid(record: StateRecord, thickness: float) -> Solid:
    """The band thickened by `thickness` / 2 to either side, in the unit of its length.

    The surface is closed and oriented outwards also on a one-sided band, where the four corners are joined
    after half a turn: the solid's skin is one torus. Raises UsageError where the thickness is not positive or
    not below the band's width, or where a fold is sharper than 120 degrees.
    """
    if not (np.isfinite(thickness) and thickness > 0):
        raise UsageError(f"a thickness must be positive, got {thickness:g}")
    if thickness >= 2.0 * record.half_width:
        part = 0.5 * thickness / record.half_width
        raise UsageError(f"a thickness must be less than the band's width 2 b, got {part:.3g} times as much")
    rulings = strip(record)
    following = 4 * rulings.far[:, None] + np.arange(4)
    if rulings.closed and record.sigma < 0:
        # g and the normal both change sign across the seam: half a turn of the four corners.
        following[-1] = following[-1, [2, 3, 0, 1]]
    ring = 4 * rulings.near[:, None] + np.arange(4)
    shortest = SHORTEST * min(thickness, record.length / record.segments)
    points = np.empty((4 * len(rulings.low), 3))
    name = np.arange(len(points))
    heights = [np.array([0.5 * thickness])]
    for chain in _chains(record, rulings, following):
        corners, first = _offset(chain, 0.5 * thickness, shortest)
        points[chain.corners], name[chain.corners] = corners, chain.corners[first]
        inside = first == np.roll(first, -1)
        heights.append(np.einsum("ij,ij->i", chain.after, corners - chain.places)[inside])
    a, b = ring, np.roll(ring, -1, axis=1)
    c, d = np.roll(following, -1, axis=1), following
    triangles = np.concatenate((np.stack((a, d, c), axis=2), np.stack((a, c, b), axis=2))).reshape(-1, 3)
    n = record.segments
    for start, end in zip(rulings.first, (n + k for k in range(len(rulings.last))), strict=True):
        p, q = 4 * start, 4 * end
        caps = [[p, p + 1, p + 2], [p, p + 2, p + 3], [q, q + 2, q + 1], [q, q + 3, q + 2]]
        triangles = np.vstack((triangles, np.array(caps)))
    triangles = name[triangles]
    i, j, k = triangles.T
    triangles = triangles[(i != j) & (j != k) & (k != i)]
    kept, triangles = np.unique(triangles, return_inverse=True)
    wall = 0.5 * thickness + np.concatenate(heights)
    joined = int((name != np.arange(len(name))).sum())
    return Solid(points[kept], triangles.reshape(-1, 3), joined, float(wall.min()), float(wall.max()))


def printed(record: StateRecord, size: float, thickness: float) -> Solid:
    """The solid in millimetres, its vertices rounded as STL files hold them.

    `size` is the length of the midline and `thickness` the wall's, both in millimetres. Raises UsageError as
    `solid` does, and for a size that is not positive.
    """
    if not (np.isfinite(size) and size > 0):
        raise UsageError(f"a size must be a positive number of millimetres, got {size:g}")
    scale = size / record.length
    body = solid(record, thickness / scale)
    points = (body.points * scale).astype(np.float32).astype(float)
    return replace(body, points=points, thinnest=body.thinnest * scale, thickest=body.thickest * scale)


@dataclass(frozen=True)
class Facts:
    """Numbers on a printed solid: corners joined, the wall's thickness in mm, and how many pairs of triangles
    pass through each other.
    """

    joined_corners: int
    wall_min: float
    wall_max: float
    crossing_triangles: int


def remarks(record: StateRecord, body: Solid) -> tuple[Facts, list[str]]:
    """What has to be said of a printed solid: as numbers, and in words."""
    crossing = len(crossing_pairs(body.points, body.triangles))
    facts = Facts(body.joined, body.thinnest, body.thickest, crossing)
    words = []
    if body.joined:
        wall = f"{body.thinnest:.3g} to {body.thickest:.3g} mm"
        words.append(f"{body.joined} corners joined where rulings run together; the wall there: {wall}")
    if crossing:
        why = "parts of the band are nearer to each other than the wall is thick, take a smaller --thickness"
        if record.self_contact:
            why = "the band passes through itself"
            if record.contacts is not None and len(record.contacts):
                why = "the band rests on itself, and its walls need room on both sides"
        words.append(f"warning: {crossing} pairs of triangles of the solid pass through each other: {why}")
    return facts, words


def _chains(record: StateRecord, rulings: Strip, following: Indices) -> Iterator[_Chain]:
    """The edges of the skin: corner k of ruling r is number 4 r + k, `following` (N, 4) are the next."""
    n = record.segments
    normals = facet_normals(record)
    after = np.concatenate((np.arange(n), rulings.last)).astype(np.int64)
    successor = np.full(4 * len(rulings.low), -1)
    successor[: 4 * n] = following.ravel()
    high = np.array([True, False, False, True])
    side = np.array([1.0, 1.0, -1.0, -1.0])
    ruling = rulings.high - rulings.low
    ruling /= np.linalg.norm(ruling, axis=1)[:, None]
    starts = sorted(set(range(4)) | {4 * r + k for r in rulings.first for k in range(4)})
    seen: set[int] = set()
    for start in starts:
        corners, corner = [], start
        while corner >= 0 and corner not in seen:
            seen.add(corner)
            corners.append(corner)
            corner = int(successor[corner])
        if not corners:
            continue
        numbers = np.array(corners)
        row, kind = np.divmod(numbers, 4)
        forward = side[kind][:, None] * normals[after[row]]
        backward = np.roll(forward, 1, axis=0)
        if corner < 0:
            backward[0] = forward[0]
        yield _Chain(
            numbers,
            np.where(high[kind][:, None], rulings.high[row], rulings.low[row]),
            ruling[row],
            backward,
            forward,
            record.u[after[row]],
            corner >= 0,
        )


def _offset(chain: _Chain, half: float, shortest: float) -> tuple[Array, Indices]:
    """Offset corners (m, 3) of a chain, and for each the place in it of the first one joined with it.

    Raises UsageError for folds of more than 120 degrees.
    """
    if np.einsum("ij,ij->i", chain.before, chain.after).min() < -0.5:
        raise UsageError(
            "two facets are folded by more than 120 degrees: refine the state before thickening it"
        )
    size = len(chain.corners)
    if chain.closed:
        # Cut where corners are farthest apart, so that no joined ones lie across.
        corners = _corners(chain, np.arange(size), np.arange(size), half)
        turn = (int(np.argmax(_steps(chain, corners, np.arange(size), np.arange(size)))) + 1) % size
        order = (np.arange(size) + turn) % size
    else:
        order = np.arange(size)
    first = last = order
    while True:
        corners = _corners(chain, first, last, half)
        short = _steps(chain, corners, first, last)[:-1] < shortest
        if not short.any():
            break
        first = first[np.concatenate(([True], ~short))]
        last = last[np.concatenate((~short, [True]))]
    members = (last - first) % size + 1
    points, leader = np.empty((size, 3)), np.empty(size, dtype=np.int64)
    points[order], leader[order] = np.repeat(corners, members, axis=0), np.repeat(first, members)
    return points, leader


def _corners(chain: _Chain, first: Indices, last: Indices, half: float) -> Array:
    """Corners (k, 3) in place of `first` to `last` of the chain, at `half` from the facets around them.

    The offset planes of the facet before the first and of that after the last meet in a line; the corner is
    on it, across from the middle of what is joined.
    """
    before, after = chain.before[first], chain.after[last]
    cosine = np.maximum(np.einsum("ij,ij->i", before, after), SHARPEST)
    size = len(chain.corners)
    sums = np.vstack((np.zeros(3), np.cumsum(np.vstack((chain.places, chain.places)), axis=0)))
    count = (last - first) % size + 1
    middle = (sums[first + count] - sums[first]) / count[:, None]
    low = half - np.einsum("ij,ij->i", before, middle - chain.places[first])
    high = half - np.einsum("ij,ij->i", after, middle - chain.places[last])
    up = (0.5 * (low + high) / (1.0 + cosine))[:, None] * (before + after)
    # Along the band the meeting of two planes that are nearly one is nowhere: stay between the corners.
    across = np.linalg.norm(after - before, axis=1)
    reach = np.linalg.norm(chain.places[last] - chain.places[first], axis=1)
    wanted = (high - low) / np.maximum(across, 1e-12)
    shift = np.clip(wanted, -reach, reach) / np.maximum(across, 1e-12)
    corners: Array = middle + up + shift[:, None] * (after - before)
    return corners


def _steps(chain: _Chain, corners: Array, first: Indices, last: Indices) -> Array:
    """How far (k,) the next corner is ahead of each, across either ruling of the facet between them."""
    ahead = np.roll(first, -1)
    move = np.roll(corners, -1, axis=0) - corners
    normal, along = chain.after[last], chain.along[last]
    steps = []
    for ruling in (chain.rulings[last], chain.rulings[ahead]):
        across = np.cross(normal, ruling)
        across *= np.sign(np.einsum("ij,ij->i", across, along))[:, None]
        steps.append(np.einsum("ij,ij->i", move, across))
    least: Array = np.minimum(*steps)
    return least
