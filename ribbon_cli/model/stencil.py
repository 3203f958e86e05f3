"""The local stencil of node i and how its 14 numbers are gathered from the unknowns.

Local vector: (u_{i-1}, u_i, g_i, g_{i+1}, xi_{i-1}, xi_i). The seam enters only here: with a closed
seam g_{N+1} = sigma g_1 and xi_0 = sigma xi_N, so that every formula elsewhere is the same at all
nodes. With an open seam (auxiliary problems) g_{N+1} is data, kept in three extra slots after the
7N unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .band import Array, Band

IntArray = NDArray[np.int64]

# Slices of the local vector.
U0, U, G, G1 = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
X0, X = 12, 13
SIZE = 14


@dataclass(frozen=True)
class Stencil:
    """Gather map of the unknowns, `index` (14, N).

    Nodes come last in all local arrays: every operation then runs along the band.
    """

    index: IntArray
    sigma: int
    open_seam: bool

    def gather(self, full: Array) -> Array:
        """Return the local vectors (14, N) of a full vector (7N + 3,)."""
        local: Array = full[self.index]
        self.apply_signs(local)
        return local

    def apply_signs(self, values: Array) -> None:
        """Multiply local values (..., 14, N) by the seam's signs, those of xi_0 and of g_{N+1}, in place."""
        if self.sigma < 0:
            values[..., X0, 0] *= -1.0
            if not self.open_seam:
                values[..., G1, -1] *= -1.0


def stencil(band: Band, *, open_seam: bool = False) -> Stencil:
    """Build the gather map of a band; `open_seam` makes g_{N+1} the slots 7N..7N+2."""
    n = band.segments
    node = np.arange(n)
    previous = (node - 1) % n
    following = (node + 1) % n
    xyz = np.arange(3)[:, None]
    index = np.empty((SIZE, n), dtype=np.int64)
    index[U0] = 7 * previous + xyz
    index[U] = 7 * node + xyz
    index[G] = 7 * node + 3 + xyz
    index[G1] = 7 * following + 3 + xyz
    index[X0] = 7 * previous + 6
    index[X] = 7 * node + 6
    if open_seam:
        index[G1, -1] = 7 * n + np.arange(3)
    return Stencil(index, band.sigma, open_seam)


def dot(a: Array, b: Array) -> Array:
    """Scalar products over the first axis, which holds the three components: (N,) of vectors (3, N)."""
    out: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return out


def cross(a: Array, b: Array) -> Array:
    """Vector products (3, N) of vectors (3, N)."""
    out = np.empty_like(a)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def add_diagonal(block: Array, value: Array) -> None:
    """Add value (N,) times the identity to a block (3, 3, N) in place."""
    for i in range(3):
        block[i, i] += value


def add_cross(block: Array, v: Array) -> None:
    """Add [v]x, for which [v]x w = v x w, of v (3, N) to a block (3, 3, N) in place."""
    block[0, 1] -= v[2]
    block[0, 2] += v[1]
    block[1, 0] += v[2]
    block[1, 2] -= v[0]
    block[2, 0] -= v[1]
    block[2, 1] += v[0]
