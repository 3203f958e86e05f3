"""Distances and collisions by other means than the program's: enumeration, and roots of cubics as
eigenvalues."""

from __future__ import annotations

from itertools import combinations

import numpy as np


def quad_distance(p, q):
    """Distances (m,) of convex quadrilaterals p and q (m,4,3), and where they do not meet.

    The least point of the difference of two convex hulls lies on a face with at most three of its 16 corners:
    all corners, pairs and triples are tried. It is the least one if no corner is before its plane; where
    there is none, the origin is inside.
    """
    w = (p[:, :, None] - q[:, None]).reshape(len(p), 16, 3)
    best = w[np.arange(len(w)), np.linalg.norm(w, axis=2).argmin(axis=1)]
    for size in (2, 3):
        for face in combinations(range(16), size):
            corner = w[:, face]
            span = corner[:, 1:] - corner[:, :1]
            gram = span @ span.transpose(0, 2, 1)
            right = -np.einsum("mki,mi->mk", span, corner[:, 0])
            singular = np.linalg.det(gram) <= 1e-22 * np.trace(gram, axis1=1, axis2=2) ** (size - 1)
            gram[singular] = np.eye(size - 1)
            parts = np.linalg.solve(gram, right[..., None])[..., 0]
            inside = ~singular & (parts >= 0).all(axis=1) & (parts.sum(axis=1) <= 1)
            point = corner[:, 0] + np.einsum("mk,mki->mi", parts, span)
            nearer = inside & (np.linalg.norm(point, axis=1) < np.linalg.norm(best, axis=1))
            best[nearer] = point[nearer]
    size = np.linalg.norm(best, axis=1)
    apart = (np.einsum("mki,mi->mk", w, best) >= (size * size)[:, None] - 1e-9 * size[:, None]).all(axis=1)
    return np.where(apart, size, 0.0), apart


def cubic_roots(values):
    """Roots (k,3), complex, of cubics known at 0, 1/3, 2/3 and 1 (k,4)."""
    coefficients = values @ np.linalg.inv(np.vander(np.arange(4) / 3, 4, increasing=True)).T
    scale = np.abs(coefficients).max(axis=1, keepdims=True)
    c = coefficients / np.where(scale > 0, scale, 1.0)
    lead = np.where(np.abs(c[:, 3]) > 1e-14, c[:, 3], 1e-14)
    companion = np.zeros((len(c), 3, 3))
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    companion[:, :, 2] = -c[:, :3] / lead[:, None]
    return np.linalg.eigvals(companion)


def collisions(before, after):
    """Names of pairs of features of two shapes that meet while vertices move straight: every vertex with
    every triangle of every facet, every edge with every edge."""
    p, q = before.vertices, after.vertices
    n, corners = before.segments, before.corner_numbers
    found = set()
    v, f = (a.ravel() for a in np.meshgrid(np.arange(len(p)), np.arange(n), indexing="ij"))
    counted = _counted((before, after), lambda s: s.flat_distance(s.flat_of_vertices(v), s.flat_of_facets(f)))
    v, f = v[counted], f[counted]
    for triangle in ((0, 1, 2), (0, 2, 3)):
        four = np.column_stack((corners[f][:, triangle], v))
        for at in _meet(p, q, four, _in_triangle):
            found.add((0, int(v[at]), 2, int(f[at])))
    every = np.flatnonzero(~(before.slivers & after.slivers))
    a, b = (every[k] for k in np.triu_indices(len(every), 1))
    counted = _counted((before, after), lambda s: s.flat_distance(s.flat_of_edges(a), s.flat_of_edges(b)))
    a, b = a[counted], b[counted]
    four = np.column_stack((*before.edge_ends(a), *before.edge_ends(b)))
    for at in _meet(p, q, four, _on_both):
        found.add((1, int(a[at]), 1, int(b[at])))
    return found


def _counted(shapes, distance):
    return np.any([distance(shape) >= shape.excluded for shape in shapes], axis=0)


def _meet(p, q, four, inside):
    at_times = [(1 - t) * p[four] + t * q[four] for t in np.arange(4) / 3]
    # Only that of both boxes: the moving hull of one side does not reach the other's.
    count = 3 if inside is _in_triangle else 2
    both = np.stack((p[four], q[four]))
    low, high = both.min(axis=0), both.max(axis=0)
    one = low[:, :count].min(axis=1), high[:, :count].max(axis=1)
    other = low[:, count:].min(axis=1), high[:, count:].max(axis=1)
    near = np.flatnonzero(((one[0] <= other[1]) & (other[0] <= one[1])).all(axis=1))
    volumes = np.column_stack([np.linalg.det(x[near, 1:] - x[near, :1]) for x in at_times])
    met = set()
    for root in cubic_roots(volumes).T:
        real = np.flatnonzero((np.abs(root.imag) < 1e-9) & (root.real >= 0) & (root.real <= 1))
        t = root.real[real, None, None]
        place = (1 - t) * p[four[near[real]]] + t * q[four[near[real]]]
        met.update(near[real[inside(place)]].tolist())
    return sorted(met)


def _in_triangle(x):
    """Whether the fourth of coplanar points is in the triangle of the others, by areas."""
    whole = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    parts = [
        np.linalg.norm(np.cross(x[:, i] - x[:, 3], x[:, j] - x[:, 3]), axis=1)
        for i, j in ((0, 1), (1, 2), (2, 0))
    ]
    return sum(parts) <= (1 + 1e-8) * whole


def _on_both(x):
    """Whether coplanar segments meet, by least squares."""
    span = np.stack((x[:, 1] - x[:, 0], x[:, 2] - x[:, 3]), axis=2)
    parts = (np.linalg.pinv(span) @ (x[:, 2] - x[:, 0])[..., None])[..., 0]
    return ((parts >= -1e-9) & (parts <= 1 + 1e-9)).all(axis=1)
