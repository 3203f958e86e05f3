"""Metrics in which the modes of a band are measured.

A second variation has no eigenvalues of its own: they are those of the pencil (W_c, M_c) with a metric M,
a positive semidefinite quadratic form on moves (du, dg, dxi) that is definite on those that keep the
constraints, rotations apart. Signs, and hence stability, do not depend on it (Sylvester); sizes, limits and
what "converges as N grows" means do. A further metric is a row of `METRICS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ..parts import CLAMPED, FREE
from .band import Array, Band, State
from .ends import finish_frame, start_frame


@dataclass(frozen=True)
class Metric:
    """A metric by name: `formula` in words, `matrix` M (7N, 7N) at a state, sparse and symmetric.

    M couples neighbouring nodes at most. `unit` is the natural size of the low eigenvalues on a band, where
    searches for a shift begin.
    """

    name: str
    formula: str
    matrix: Callable[[State], scipy.sparse.csr_matrix]
    unit: Callable[[Band], float]


def _bending(band: Band) -> float:
    """b k^2 with k = 2 pi / l: the lowest eigenvalues of a ring are a little more."""
    return band.half_width * (2.0 * math.pi / band.length) ** 2


def _euclidean(state: State) -> scipy.sparse.csr_matrix:
    return scipy.sparse.identity(7 * state.band.segments, format="csr")


def _physical(state: State) -> scipy.sparse.csr_matrix:
    weights = np.full((state.band.segments, 7), state.band.h)
    weights[:, 6] = 0.0
    return scipy.sparse.diags(weights.ravel()).tocsr()


def folding_differential(state: State) -> scipy.sparse.csr_matrix:
    """Derivative (2N, 7N) of kappa_1..kappa_N, eta_1..eta_N in (u, g, xi).

    kappa_i = g_i.(u_{i-1} x u_i) / h is (3.1) with the fold angle's sine for the angle; eta_i = u_i.g_i.
    """
    n, h = state.band.segments, state.band.h
    u, g = state.u, state.g
    before = np.roll(u, 1, axis=0)
    node = np.arange(n)
    xyz = np.arange(3)
    last = (node - 1) % n
    parts = [
        (node, 7 * last, np.cross(u, g) / h),
        (node, 7 * node, np.cross(g, before) / h),
        (node, 7 * node + 3, np.cross(before, u) / h),
        (n + node, 7 * node, g),
        (n + node, 7 * node + 3, u),
    ]
    size = 2 * n
    if state.g_end is not None:
        parts = [*((row[1:], column[1:], values[1:]) for row, column, values in parts), *_at_ends(state)]
        size += 2
    rows = np.concatenate([np.repeat(row, 3) for row, _, _ in parts])
    columns = np.concatenate([(column[:, None] + xyz).ravel() for _, column, _ in parts])
    values = np.concatenate([value.ravel() for _, _, value in parts])
    return scipy.sparse.csr_matrix((values, (rows, columns)), shape=(size, 7 * n))


def _at_ends(state: State) -> list[tuple[NDArray[np.int64], NDArray[np.int64], Array]]:
    """Rows, columns and values of a strip's ends: the folds at clamps, of half a cell, and a free end's
    eta."""
    n, h, ends = state.band.segments, state.band.h, state.band.parts.ends
    assert ends is not None
    assert state.g_end is not None
    place, last, out = np.array([0]), np.array([7 * (n - 1)]), []
    if ends.start == CLAMPED:
        start = start_frame(ends)
        out.append((place, place, 2.0 / h * np.cross(start.ruling, start.tangent)[None]))
    if ends.end == CLAMPED:
        finish = finish_frame(ends)
        out.append((place + 2 * n, last, 2.0 / h * np.cross(finish.tangent, finish.ruling)[None]))
    if ends.end == FREE:
        out += [(place + 2 * n, last, state.g_end[None]), (place + 2 * n, place + 3, state.u[-1:])]
    return out


def _folding(state: State) -> scipy.sparse.csr_matrix:
    derivative = folding_differential(state)
    return (state.band.h * (derivative.T @ derivative)).tocsr()


METRICS = {
    metric.name: metric
    for metric in (
        Metric(
            "euclidean",
            "|du|^2 + |dg|^2 + |dxi|^2, summed over nodes",
            _euclidean,
            lambda band: band.h * _bending(band),
        ),
        Metric("physical", "h (|du|^2 + |dg|^2), summed over nodes", _physical, _bending),
        Metric(
            "folding",
            "h (|dkappa|^2 + |deta|^2), summed over nodes",
            _folding,
            lambda band: band.half_width,
        ),
    )
}
"""Every metric by its name: `euclidean` is that of Koldaev (2022), (2.58) and Figure 3.14."""


def metric_named(name: str) -> Metric:
    """The metric of a name. Raises ValueError, naming those there are, for an unknown one."""
    if name not in METRICS:
        raise ValueError(f"unknown metric {name!r}; known are {', '.join(METRICS)}")
    return METRICS[name]


def lengths(mass: scipy.sparse.csr_matrix, vectors: Array) -> Array:
    """Lengths (k,) of moves (7N, k) in the metric `mass` (7N, 7N)."""
    out: Array = np.sqrt(np.maximum(np.einsum("ij,ij->j", vectors, mass @ vectors), 0.0))
    return out
