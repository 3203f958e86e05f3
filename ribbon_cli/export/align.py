"""Turning shapes onto each other, so that a branch is seen from one side throughout."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turned_alike(shapes: Sequence[Array]) -> list[Array]:
    """Turn each shape (N, 4, 3) so that it lies on the one before as nearly as it can, centres at 0."""
    out: list[Array] = []
    for corners in shapes:
        centred = corners - corners.reshape(-1, 3).mean(axis=0)
        if out:
            centred = centred @ best_rotation(_sampled(centred), _sampled(out[-1]))
        out.append(centred)
    return out


def _sampled(corners: Array, count: int = 64) -> Array:
    """Points (2 count, 3) on both edges at equal fractions of the length."""
    index = (np.arange(count) * len(corners) / count).astype(int)
    return corners[index, :2].reshape(-1, 3)


def best_rotation(points: Array, onto: Array) -> Array:
    """The rotation R (3, 3) for which points @ R is nearest to `onto`, after Kabsch (1976)."""
    u, _, vt = np.linalg.svd(points.T @ onto)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation: Array = u @ sign @ vt
    return rotation


def turn_between(corners: Array, placed: Array) -> Array:
    """The matrix A (3, 3) with which axes on `placed` become axes on `corners`."""
    centred = corners - corners.reshape(-1, 3).mean(axis=0)
    return best_rotation(centred.reshape(-1, 3), placed.reshape(-1, 3)).T
