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
    """Gather map: local = sign * full[index], both (N, 14)."""

    index: IntArray
    sign: Array

    def gather(self, full: Array) -> Array:
        """Return the local vectors (N, 14) of a full vector (7N + 3,)."""
        local: Array = full[self.index] * self.sign
        return local


def stencil(band: Band, *, open_seam: bool = False) -> Stencil:
    """Build the gather map of a band; `open_seam` makes g_{N+1} the slots 7N..7N+2."""
    n = band.segments
    node = np.arange(n)
    previous = (node - 1) % n
    following = (node + 1) % n
    xyz = np.arange(3)
    index = np.empty((n, SIZE), dtype=np.int64)
    index[:, U0] = 7 * previous[:, None] + xyz
    index[:, U] = 7 * node[:, None] + xyz
    index[:, G] = 7 * node[:, None] + 3 + xyz
    index[:, G1] = 7 * following[:, None] + 3 + xyz
    index[:, X0] = 7 * previous + 6
    index[:, X] = 7 * node + 6
    sign = np.ones((n, SIZE))
    sign[0, X0] = band.sigma
    if open_seam:
        index[-1, G1] = 7 * n + xyz
    else:
        sign[-1, G1] = band.sigma
    return Stencil(index, sign)
