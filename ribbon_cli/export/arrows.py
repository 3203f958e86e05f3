"""Forces at contacts as arrows: how long they are drawn, and as triangles for the viewer and for glTF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.contacts import touching
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

LONGEST = 0.08
"""Length of the longest arrow of a picture, as a part of l."""
SHAFT, HEAD, POINTED = 0.0025, 0.0075, 0.022
"""Radii of an arrow's shaft and head, and the length of its head, as parts of l."""
SIDES = 8
"""Sides of a shaft."""


def per_force(records: Sequence[StateRecord]) -> float:
    """The length of an arrow per unit of force, one for all of the states; 0 where none has a force."""
    most = max((float(touching(r).forces.max(initial=0.0)) / r.length for r in records), default=0.0)
    return LONGEST / most if most > 0.0 else 0.0


def arrow_triangles(places: Array, ways: Array, length: float) -> tuple[Array, Array]:
    """Corners (t, 3, 3), anticlockwise from outside, and unit normals (t, 3) of arrows from `places` (m, 3)
    along `ways` (m, 3), on a strip of a length. Arrows of no length are left out; short ones are slender."""
    sizes = np.linalg.norm(ways, axis=1)
    found = [
        _arrow(place, way / size, float(size), length)
        for place, way, size in zip(places, ways, sizes, strict=True)
        if size > 1e-9 * length
    ]
    corners = np.concatenate([np.empty((0, 3, 3)), *found])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
    return corners, normals


def _arrow(place: Array, way: Array, size: float, length: float) -> Array:
    """The triangles (t, 3, 3) of one arrow along a unit vector."""
    pointed = min(POINTED * length, 0.5 * size)
    slender = pointed / POINTED
    aside = np.cross(way, np.eye(3)[int(np.argmin(np.abs(way)))])
    aside /= np.linalg.norm(aside)
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = np.outer(np.cos(angles), aside) + np.outer(np.sin(angles), np.cross(way, aside))
    neck = place + (size - pointed) * way
    foot, collar, rim = (
        place + SHAFT * slender * ring,
        neck + SHAFT * slender * ring,
        neck + HEAD * slender * ring,
    )
    tip = np.broadcast_to(place + size * way, ring.shape)
    neck = np.broadcast_to(neck, ring.shape)

    def following(points: Array) -> Array:
        out: Array = np.roll(points, -1, axis=0)
        return out

    faces = (
        (foot, following(foot), following(collar)),
        (foot, following(collar), collar),
        (rim, following(rim), tip),
        (following(rim), rim, neck),
    )
    return np.concatenate([np.stack(face, axis=1) for face in faces])
