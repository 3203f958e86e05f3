"""Linking number, twist and writhe of a discrete folded band: Lk = Tw + Wr.

The midline is the closed polygon with edges h u_i, and facet i carries the frame (u_i, b_i), where b_i is the
unit part of its ruling g_i perpendicular to u_i. Lk is the linking number of the midline with its push-off
along b: an integer where sigma = +1, and a half-integer where sigma = -1 (half the linking number of the
midline with the band's edge). It changes only where the band passes through itself. Right-handed is positive
throughout.

References:
    G. Calugareanu (1959), Rev. Math. Pures Appl. 4, 5-20; J. H. White (1969), Amer. J. Math. 91, 693-728.
    K. Klenin, J. Langowski (2000), Biopolymers 54, 307-317: writhe of polygons, methods 1 and 2.
    A. van Oosterom, J. Strackee (1983), IEEE Trans. Biomed. Eng. 30, 125-126: solid angle of a triangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..parts import CLAMPED, Ends
from .band import Array, State
from .ends import finish_frame, start_frame
from .stencil import cross_rows, dot

IntArray = NDArray[np.intp]

# Edges of an open midline beyond which its writhe is that of a polygon through some of the vertices, and how
# many of them are taken against all others at once.
OPEN_EDGES = 800
OPEN_ROWS = 100
# How far from a whole (half) number Tw + Wr may be: rounding is about 1e-12 at N = 3200.
EXACT_TOLERANCE = 1e-6
# The midline counts as closed when its ends are nearer than this part of an edge.
CLOSURE_TOLERANCE = 1e-3
# A projection is given up when a tangent is nearer to it than this angle (each framing angle loses a factor
# 1/angle in precision), when a framing angle is this near to a half-turn, ...
POLE_TOLERANCE = 1e-4
HALF_TURN_TOLERANCE = 1e-6
# ... or when an orientation or a height at a crossing is below this part of its natural scale.
CROSSING_TOLERANCE = 1e-9
# 1 + cos of the fold between two facets below which the minimal rotation is not determined.
ANTIPARALLEL_TOLERANCE = 1e-12
# Directions tried one after the other; each fails for a set of curves of measure about POLE_TOLERANCE.
DIRECTION_COUNT = 24


@dataclass(frozen=True)
class Linking:
    """Linking number of a band, with its parts in full turns: linking_number = twist + writhe."""

    linking_number: float
    twist: float
    writhe: float
    sigma: int

    @property
    def exact(self) -> bool:
        """Whether Lk is an integer (sigma = +1) or a half-integer (sigma = -1) within EXACT_TOLERANCE."""
        shifted = self.linking_number if self.sigma == 1 else self.linking_number - 0.5
        return abs(shifted - round(shifted)) <= EXACT_TOLERANCE


def linking_number(u: Array, g: Array, sigma: int, h: float) -> Linking:
    """Linking number of a closed band by Lk = Tw + Wr (Calugareanu, White).

    Args:
        u: facet tangents (N, 3), unit vectors that sum to zero.
        g: rulings at the nodes (N, 3); facet i lies between nodes i and i+1.
        sigma: +1 for an orientable band, -1 for a non-orientable one (g_{N+1} = sigma g_1).
        h: length of a facet along the midline.

    Raises:
        ValueError: as `twist` and `writhe` do.
    """
    turns, writhing = twist(u, g, sigma), writhe(u, h)
    return Linking(turns + writhing, turns, writhing, sigma)


def open_turn(u: Array, g: Array, h: float) -> float:
    """Tw + Wr in turns for a closed midline whose seam is open: the jump of the frame at node 1 is left out.

    It equals phi / (2 pi), phi being the angle about u_1 through which the last facet's frame, carried over
    to facet 1 by minimal rotation, is turned against the first's, whole turns counted. Arguments and errors
    as for `linking_number`.
    """
    return float(np.sum(twist_angles(u, g, 1)[1:])) / math.tau + writhe(u, h)


def turn_of(state: State) -> tuple[float, float]:
    """Tw and Wr, in turns, of a strip with ends.

    Tw is that of the rulings from one clamp's to the other's, or to the last facets where an end is no clamp,
    Wr the Gauss integral over the open midline, of a polygon through every so many vertices where there are
    more than `OPEN_EDGES`. Their sum is no invariant; it jumps by 2 where the strip passes through itself.
    Raises ValueError as `twist`.
    """
    ends = state.band.parts.ends
    assert ends is not None
    return _turn(state.u.tobytes(), state.g.tobytes(), ends, state.band.h)


@lru_cache(maxsize=2)
def _turn(u_bytes: bytes, g_bytes: bytes, ends: Ends, h: float) -> tuple[float, float]:
    """The turns of what was seen last: the end of one step is where the next begins, and what is stored."""
    u, g = (np.frombuffer(held).reshape(-1, 3) for held in (u_bytes, g_bytes))
    first = [start_frame(ends)] if ends.start == CLAMPED else []
    last = [finish_frame(ends)] if ends.end == CLAMPED else []
    tangents = np.vstack([*(c.tangent for c in first), _checked(u), *(c.tangent for c in last)])
    t = _normalised(tangents, "facet tangent")
    rulings = np.vstack([*(c.ruling for c in first), _checked(g), *(c.ruling for c in last)])
    across = _normalised(_across(rulings, t), "ruling's part across the midline")
    vertices = np.vstack((np.zeros(3), np.cumsum(h * u, axis=0)))
    return float(np.sum(_frame_angles(t, across, 1)[1:])) / math.tau, open_writhe(vertices)


def open_writhe(vertices: Array) -> float:
    """The Gauss integral Wr of an open polygon with these vertices (M+1, 3), thinned to `OPEN_EDGES`
    edges."""
    count = len(vertices) - 1
    if count > OPEN_EDGES:
        vertices = vertices[np.round(np.linspace(0, count, OPEN_EDGES + 1)).astype(int)]
    total, edges = 0.0, np.diff(vertices, axis=0).T
    for first in range(0, edges.shape[1] - 2, OPEN_ROWS):
        total += float(np.sum(np.triu(_areas(vertices.T, edges, first))))
    return -total / math.tau


def _areas(vertices: Array, edges: Array, first: int) -> Array:
    """Signed areas of the directions between edges, from `first` on, with those from the next but one on.

    Both triangles of a quadrilateral have the volume r13 . (e_i x e_j), as r14 = r13 + e_j and so on.
    """
    last = min(first + OPEN_ROWS, edges.shape[1] - 2)
    apart = vertices[:, None, first + 2 :] - vertices[:, first : last + 1, None]
    far = np.sqrt(dot(apart, apart))
    one, other = edges[:, first:last, None], edges[:, None, first + 2 :]
    r13, r14, r23, r24 = apart[:, :-1, :-1], apart[:, :-1, 1:], apart[:, 1:, :-1], apart[:, 1:, 1:]
    n13, n14, n23, n24 = far[:-1, :-1], far[:-1, 1:], far[1:, :-1], far[1:, 1:]
    volume = (
        r13[0] * (one[1] * other[2] - one[2] * other[1])
        + r13[1] * (one[2] * other[0] - one[0] * other[2])
        + r13[2] * (one[0] * other[1] - one[1] * other[0])
    )
    across = n13 * n24 + dot(r13, r24)
    before = n14 * across + dot(r13, r14) * n24 + dot(r14, r24) * n13
    after = n23 * across + dot(r24, r23) * n13 + dot(r23, r13) * n24
    area: Array = 2.0 * (np.arctan2(volume, before) + np.arctan2(volume, after))
    return area


def twist(u: Array, g: Array, sigma: int) -> float:
    """Twist Tw of the closed band in turns: the sum of `twist_angles` over 2 pi."""
    return float(np.sum(twist_angles(u, g, sigma))) / math.tau


def twist_angles(u: Array, g: Array, sigma: int) -> Array:
    """Angles (N,), in (-pi, pi], by which the facet frame turns about the midline at each node.

    A facet is flat, so nothing turns within it. At node i the frame of facet i-1 is carried to facet i by the
    minimal rotation u_{i-1} -> u_i; the angle about u_i from there to b_i counts, right-handed positive. At
    node 1 it goes from facet N to sigma b_1. A facet that is inverted shows as an angle near pi, whose sign
    is then arbitrary.

    Raises:
        ValueError: sigma is not +1 or -1, a value is not finite, a ruling is along its facet's tangent, or a
            facet is folded back flat upon its neighbour (u_i = -u_{i-1}).
    """
    if sigma not in (1, -1):
        raise ValueError(f"sigma is {sigma}; it must be +1 or -1")
    tangents = _normalised(_checked(u), "facet tangent")
    rulings = _checked(g)
    if rulings.shape != tangents.shape:
        raise ValueError(f"rulings have shape {rulings.shape}, tangents {tangents.shape}; they must agree")
    return _frame_angles(
        tangents, _normalised(_across(rulings, tangents), "ruling's part across the midline"), sigma
    )


def writhe(u: Array, h: float) -> float:
    """Writhe Wr of the closed polygon with edges h u_i, in O(N log N) time and O(N) memory.

    The framing of the curve by a fixed direction z has the linking number Lk_z, the sum of the signed
    self-crossings in the projection along z, and the twist Tw_z, a sum of angles; Wr = Lk_z - Tw_z for every
    z (cf. Klenin & Langowski (2000), method 2). The first generic direction of a fixed list is taken.

    Args:
        u: unit tangents (N, 3), N >= 3, with sum zero.
        h: edge length; Wr does not depend on it.

    Raises:
        ValueError: the polygon is not closed, a value is not finite, or no direction is generic, as when the
            curve meets itself and Wr is not defined.
    """
    return _writhe(_checked(u).tobytes(), h)


@lru_cache(maxsize=4)
def _writhe(u: bytes, h: float) -> float:
    """The same of the bytes of u: a guard, a check and a record ask for it one after the other."""
    tangents, vertices = _polygon(np.frombuffer(u).reshape(-1, 3), h)
    for direction, plane in _views():
        value = _writhe_along(tangents, vertices, h, direction, plane)
        if value is not None:
            return value
    raise ValueError("the writhe is not defined: the midline meets itself or folds back upon itself")


def _writhe_along(u: Array, p: Array, h: float, z: Array, basis: Array) -> float | None:
    """Lk_z - Tw_z for one of `_views`, or None where the projection along z is not generic."""
    across = z - (u @ z)[:, None] * u
    size = _length(across)
    if size.min() < POLE_TOLERANCE:
        return None
    angles = _frame_angles(u, across / size[:, None], 1)
    if np.abs(angles).max() > math.pi - HALF_TURN_TOLERANCE:
        return None
    crossings = _signed_crossings(u, p, h, z, basis)
    return None if crossings is None else crossings - float(np.sum(angles)) / math.tau


def _signed_crossings(u: Array, p: Array, h: float, z: Array, basis: Array) -> int | None:
    """Sum of the signs of the self-crossings seen along z, or None where one is not clear.

    Segments p1 + s a and p2 + t b cross if the ends of each lie on different sides of the other.
    """
    q, e = p @ basis, h * (u @ basis)
    i, j = _near_pairs(q, e)
    a, b, r = e[i], e[j], q[j] - q[i]
    # Sides of b's ends seen from a, and of a's ends seen from b, in units of length.
    la, lb = _length(a), _length(b)
    b_start, b_stop = _cross2(a, r) / la, _cross2(a, r + b) / la
    a_start, a_stop = _cross2(b, -r) / lb, _cross2(b, a - r) / lb
    tolerance = CROSSING_TOLERANCE * h
    apart = _same_side(b_start, b_stop, tolerance) | _same_side(a_start, a_stop, tolerance)
    # Edges in one line, one after the other, are apart as well: their middles tell.
    apart |= _length(r + (b - a) / 2) > (la + lb) / 2 + tolerance
    meet = ~apart
    sides = np.stack((b_start, b_stop, a_start, a_stop))[:, meet]
    if np.any(np.abs(sides) <= tolerance):
        return None
    s = sides[2] / (sides[2] - sides[3])
    t = sides[0] / (sides[0] - sides[1])
    height = (p[i[meet]] + (h * s)[:, None] * u[i[meet]] - p[j[meet]] - (h * t)[:, None] * u[j[meet]]) @ z
    if np.any(np.abs(height) <= tolerance):
        return None
    return int(np.sum(np.sign(_cross2(a[meet], b[meet])) * np.sign(height)))


def _near_pairs(q: Array, e: Array) -> tuple[IntArray, IntArray]:
    """Pairs i < j of plane segments q + [0, 1] e (N, 2) that can meet, neighbours on the curve left out.

    Two segments that meet have their middles no farther apart than half the sum of their lengths. So these
    are put into squares with the longest as side, and each is paired with those that come after it in its own
    square and the next one up, and with those in the three squares to the right.
    """
    reach = float(_length(e).max()) * (1 + CROSSING_TOLERANCE)
    middles = q + e / 2
    column, row = np.floor((middles - middles.min(axis=0)) / reach).astype(np.int64).T
    high = int(row.max()) + 2  # one row stays empty, so that no square is above the last of a column
    square = column * high + row
    order = np.argsort(square, kind="stable")
    squares, count = square[order], len(q)
    own = np.arange(count)
    starts = np.concatenate((own + 1, squares.searchsorted(squares + high - 1)))
    sizes = squares.searchsorted(np.concatenate((squares + 1, squares + high + 1)), side="right") - starts
    first = np.repeat(np.concatenate((own, own)), sizes)
    second = np.arange(first.size) + np.repeat(starts - np.cumsum(sizes) + sizes, sizes)
    one, other = order[first], order[second]
    i, j = np.minimum(one, other), np.maximum(one, other)
    apart = (j - i > 1) & (j - i < count - 1)
    return i[apart], j[apart]


def _same_side(x: Array, y: Array, tolerance: float) -> NDArray[np.bool_]:
    """Where x and y lie clearly on one side of zero."""
    return (np.minimum(x, y) > tolerance) | (np.maximum(x, y) < -tolerance)


def _frame_angles(u: Array, b: Array, sigma: int) -> Array:
    """Angles (N,) about u_i from the carried b_{i-1} to b_i; see `twist_angles`.

    The minimal rotation u_{i-1} -> u_i takes b, perpendicular to u_{i-1}, to
    b - (u_{i-1} + u_i) (u_i.b) / (1 + u_{i-1}.u_i).
    """
    u_before, b_before = np.roll(u, 1, axis=0), np.roll(b, 1, axis=0)
    b_before[0] *= sigma
    fold = 1 + _dot(u_before, u)
    if fold.min() < ANTIPARALLEL_TOLERANCE:
        node = int(fold.argmin()) + 1
        raise ValueError(
            f"the facets at node {node} are folded back flat upon each other: no twist is defined"
        )
    carried = b_before - (_dot(u, b_before) / fold)[:, None] * (u_before + u)
    angles: Array = np.arctan2(_dot(u, cross_rows(carried, b)), _dot(carried, b))
    return angles


def _polygon(u: Array, h: float) -> tuple[Array, Array]:
    """Unit tangents and vertices P_i (N, 3) of the closed polygon with edges h u_i, P_1 at the origin."""
    tangents = _checked(u)
    if not h > 0:
        raise ValueError(f"the edge length is {h}; it must be positive")
    gap = float(np.linalg.norm(np.sum(tangents, axis=0)))
    if gap > CLOSURE_TOLERANCE:
        raise ValueError(
            f"the midline is open: its ends are {gap:.3g} facets apart, and the writhe needs it closed"
        )
    vertices = np.zeros_like(tangents)
    np.cumsum(h * tangents[:-1], axis=0, out=vertices[1:])
    return _normalised(tangents, "facet tangent"), vertices


def _checked(vectors: Array) -> Array:
    """The same values as a float array, known to be (N, 3) with N >= 3 and finite."""
    array = np.asarray(vectors, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) < 3:
        raise ValueError(f"expected an array of shape (N, 3) with N >= 3, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("the band holds values that are not finite")
    return array


def _normalised(vectors: Array, what: str) -> Array:
    size = _length(vectors)
    if size.min() == 0:
        raise ValueError(f"the {what} at node {int(size.argmin()) + 1} is zero: no frame is defined there")
    result: Array = vectors / size[:, None]
    return result


def _across(v: Array, u: Array) -> Array:
    """Parts of v perpendicular to the unit vectors u, row by row."""
    return v - _dot(v, u)[:, None] * u


@lru_cache(maxsize=1)
def _views() -> tuple[tuple[Array, Array], ...]:
    """Fixed directions z (3,) in golden-angle steps over the half-sphere, and planes (3,2) across them.

    The columns x, y of a plane and z are right-handed; x is across the axis that z is farthest from.
    """
    k = np.arange(DIRECTION_COUNT)
    azimuth = math.pi * (3 - math.sqrt(5)) * k + math.sqrt(2)
    height = 1 - (k + math.exp(-1)) / DIRECTION_COUNT
    radius = np.sqrt(1 - height**2)
    z = np.column_stack((radius * np.cos(azimuth), radius * np.sin(azimuth), height))
    x = _normalised(cross_rows(np.eye(3)[np.abs(z).argmin(axis=1)], z), "axis")
    return tuple(zip(z, np.stack((x, cross_rows(z, x)), axis=2), strict=True))


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("ij,ij->i", a, b)
    return result


def _length(v: Array) -> Array:
    result: Array = np.sqrt(np.einsum("ij,ij->i", v, v))
    return result


def _cross2(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
