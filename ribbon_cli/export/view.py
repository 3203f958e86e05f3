"""Looking at a band: orthographic projection, and a direction from which much of it is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]

DIRECTIONS = 160
"""Directions tried by `automatic_view`."""
_FACETS, _ACROSS, _PIXELS = 120, 9, 56


@dataclass(frozen=True)
class View:
    """An orthographic view: rows of `axes` (3, 3) are right, up and towards the eye."""

    axes: Array

    @property
    def eye(self) -> Array:
        """Unit vector towards the eye (3,)."""
        eye: Array = self.axes[2]
        return eye

    @property
    def light(self) -> Array:
        """Unit vector towards the light, over the eye's left shoulder (3,)."""
        light = self.axes.T @ np.array([-0.35, 0.5, 0.8])
        unit: Array = light / np.linalg.norm(light)
        return unit

    def project(self, points: Array) -> Array:
        """Right, up and depth (..., 3) of points; what has more depth is nearer to the eye."""
        projected: Array = points @ self.axes.T
        return projected


def view_along(eye: Array, up: Array) -> View:
    """The view from a direction with `up` as nearly upright as it can be. Raises ValueError for a null
    vector.
    """
    eye = np.asarray(eye, dtype=np.float64)
    if not (np.isfinite(eye).all() and np.linalg.norm(eye) > 0):
        raise ValueError("a view needs a direction that is not zero")
    eye = eye / np.linalg.norm(eye)
    right = np.cross(up, eye)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(eye)))], eye)
    right = right / np.linalg.norm(right)
    return View(np.stack((right, np.cross(eye, right), eye)))


def principal_axes(points: Array) -> Array:
    """Right-handed axes (3, 3) as rows, from the longest extent of points (n, 3) to the shortest."""
    centred = points - points.mean(axis=0)
    axes: Array = np.linalg.svd(centred, full_matrices=False)[2]
    # The two axes along which third moments are largest get positive ones, the other completes a right-handed
    # frame: what is left to rounding is then a half-turn that the shape itself has.
    moments = ((centred @ axes.T) ** 3).sum(axis=0)
    chosen = np.argsort(-np.abs(moments), kind="stable")
    axes[chosen[:2]] *= np.where(moments[chosen[:2]] < 0, -1.0, 1.0)[:, None]
    axes[chosen[2]] *= np.sign(np.linalg.det(axes))
    return axes


def view_in_axes(corners: Array, azimuth: float, elevation: float) -> View:
    """The view at an azimuth and an elevation, in degrees, in the band's principal axes."""
    return view_at(principal_axes(corners.reshape(-1, 3)), azimuth, elevation)


def view_at(axes: Array, azimuth: float, elevation: float) -> View:
    """The same in axes (3, 3) as rows: level, up and towards the eye."""
    a, e = math.radians(azimuth), math.radians(elevation)
    eye = np.array([math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)])
    return view_along(eye @ axes, axes[1])


STRIP_ANGLES = (19.0, 30.0)
"""Azimuth and elevation from which a strip is seen: its start's tangent leads to the right."""


def strip_axes(record: StateRecord) -> Array | None:
    """The axes (3, 3) in which a strip with ends is seen, None of a closed band: its weight pulls down.

    They are those of the start's frame, x, y and z, where the weight acts along -y, as it does unless a
    config says otherwise; turned with it by the least angle else, about the tangent x where it acts along +y.
    """
    if record.parts.ends is None:
        return None
    up = -np.asarray(record.parts.loads.gravity_direction)
    x, y, z = up / np.linalg.norm(up)
    if 1.0 + y < 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula for the turn about y x up, whose columns are the new axes.
    spin = np.array([[0.0, x, 0.0], [-x, 0.0, -z], [0.0, z, 0.0]])
    axes: Array = (np.eye(3) + spin + spin @ spin / (1.0 + y)).T
    return axes


def chosen_view(corners: Array, angles: tuple[float, float] | None, axes: Array | None = None) -> View:
    """The view of facets (N, 4, 3) at an azimuth and an elevation in degrees, or the automatic one.

    Angles are in the `axes` of a strip, which is seen from one side whatever its shape, else in principal
    ones.
    """
    if axes is not None:
        return view_at(axes, *(angles or STRIP_ANGLES))
    return automatic_view(corners) if angles is None else view_in_axes(corners, *angles)


def automatic_view(corners: Array) -> View:
    """A view of facets with corners (N, 4, 3) that hides little and shows large and steep parts alike.

    Directions spread over the sphere are scored on a coarse raster: by the share of the surface's samples
    that are seen, by the area of the outline, and by the share of the surface that faces neither edge-on.
    The widest extent of what is seen lies level.
    """
    samples, normals = _samples(corners)
    # In the band's own axes, so that the picture does not change when the band is turned in space.
    own = principal_axes(samples)
    samples, normals = samples @ own.T, normals @ own.T
    eyes = _sphere(DIRECTIONS)
    scores = [_score(samples, normals, eye) for eye in eyes]
    eye = eyes[int(np.argmax(scores))]
    return View(_level(samples, eye).axes @ own)


def _sphere(count: int) -> Array:
    """Directions (count, 3) spread evenly, after Fibonacci's spiral."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    phi = math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z**2)
    return np.stack((r * np.cos(phi), r * np.sin(phi), z), axis=1)


def _samples(corners: Array) -> tuple[Array, Array]:
    """Points (n, 3) over the surface about its centre, and normals (n, 3)."""
    chosen = corners[:: max(1, len(corners) // _FACETS)]
    chosen = chosen - chosen.reshape(-1, 3).mean(axis=0)
    along = 0.5 * (chosen[:, 0] + chosen[:, 3]), 0.5 * (chosen[:, 1] + chosen[:, 2])
    s = ((np.arange(_ACROSS) + 0.5) / _ACROSS)[None, :, None]
    points = along[0][:, None] * (1 - s) + along[1][:, None] * s
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 3] - chosen[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    return points.reshape(-1, 3), np.repeat(normals, _ACROSS, axis=0)


def _score(samples: Array, normals: Array, eye: Array) -> float:
    """How much of the surface a direction shows."""
    view = view_along(eye, np.array([0.0, 0.0, 1.0]) if abs(eye[2]) < 0.9 else np.array([1.0, 0.0, 0.0]))
    flat = view.project(samples)
    span = float(np.abs(samples).max()) * 2.0
    cell = np.floor((flat[:, :2] / span + 0.5) * (_PIXELS - 1)).astype(int)
    code = cell[:, 0] * _PIXELS + cell[:, 1]
    order = np.lexsort((flat[:, 2], code))
    last = np.flatnonzero(np.diff(code[order], append=-1))
    nearest = np.full(code.max() + 1, -np.inf)
    nearest[code[order[last]]] = flat[order[last], 2]
    # A sample is hidden only by something clearly in front of it, not by its neighbour on a slope.
    seen = flat[:, 2] > nearest[code] - 0.06 * span
    facing = np.abs(normals @ eye)
    area = len(last) / _PIXELS**2
    return float(seen.mean() ** 2 * (0.15 + area) * (0.25 + np.minimum(facing, 0.5).mean()))


def _level(samples: Array, eye: Array) -> View:
    """The view from a direction, turned so that the picture's longest extent lies level."""
    view = view_along(eye, np.array([0.0, 0.0, 1.0]))
    flat = view.project(samples)[:, :2]
    longest = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][0]
    if longest[0] < 0 or (longest[0] == 0 and longest[1] < 0):
        longest = -longest
    right = longest[0] * view.axes[0] + longest[1] * view.axes[1]
    return View(np.stack((right, np.cross(view.eye, right), view.eye)))
