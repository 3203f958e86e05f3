"""The local stencil of node i and how its 14 numbers are gathered from the unknowns.

Local vector: (u_{i-1}, u_i, g_i, g_{i+1}, xi_{i-1}, xi_i). The seam enters only here: with a closed
seam g_{N+1} = sigma g_1 and xi_0 = sigma xi_N, so that every formula elsewhere is the same at all
nodes. With an open seam (auxiliary problems) g_{N+1} is data, kept in three extra slots after the
7N unknowns.

A strip with ends has one node more, N+1, where its far end is held or free. Its end ruling g_{N+1} takes the
place of g_1 among the unknowns (held, or free at a free end), so that nodes are coupled round the circle as
in a band; g_1 and the tangents of the two clamps are data, nine slots after the unknowns. At both ends a fold
spans half a cell and has one facet, whose xi stands for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..parts import FREE
from .band import Array, Band

IntArray = NDArray[np.int64]

# Slices of the local vector.
U0, U, G, G1 = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
X0, X = 12, 13
SIZE = 14
OF_XI, OF_G = np.ones(SIZE), np.ones(SIZE)
"""Signs of the local vector's components where xi_0 has another, and where g_{N+1} has."""
OF_XI[X0], OF_G[G1] = -1.0, -1.0


class Seam(Enum):
    """How the nodes at both ends of the strip are joined: what patterns depend on besides N."""

    CLOSED = "closed"
    OPEN = "open"
    """An auxiliary problem: a closed midline with g_{N+1} prescribed."""
    HELD = "held"
    """A strip whose end is clamped or hinged."""
    FREE = "free"
    """A strip whose end is free."""

    @property
    def strip(self) -> bool:
        """Whether the strip has ends."""
        return self in (Seam.HELD, Seam.FREE)

    @property
    def data(self) -> int:
        """Number of slots after the unknowns: g_{N+1}, or t_A, g_1, t_B of a strip."""
        return 9 if self.strip else 3

    @property
    def closing(self) -> int:
        """Number of rows that say where the end is."""
        return 0 if self is Seam.FREE else 3


def seam_of(band: Band, *, open_seam: bool = False) -> Seam:
    """The seam of a band, or of a strip."""
    if band.parts.ends is not None:
        return Seam.FREE if band.parts.ends.end == FREE else Seam.HELD
    return Seam.OPEN if open_seam else Seam.CLOSED


@dataclass(frozen=True)
class Stencil:
    """Gather map of the unknowns, `index` (14, M); M is N, and N+1 on a strip with ends.

    Nodes come last in all local arrays: every operation then runs along the band. `unknowns` (14, M) is the
    index with data replaced by an unknown of the same node, which sparsity patterns need.
    """

    index: IntArray
    unknowns: IntArray
    sigma: int
    seam: Seam

    def gather(self, full: Array) -> Array:
        """Return the local vectors (14, M) of a full vector, unknowns and data."""
        local: Array = full.take(self.index)
        self.apply_signs(local)
        return local

    def apply_signs(self, values: Array, of_xi: Array | None = OF_XI, of_g: Array = OF_G) -> None:
        """Multiply values (k, M) by the seam's signs in place: with sigma = -1 by `of_xi` (k,) at the first
        node, -1 where values change with the sign of xi_0, and by `of_g` (k,) at the last, where they change
        with that of g_{N+1}. A product with all rows is faster than one with some."""
        if self.sigma < 0:
            if of_xi is not None:
                values[:, 0] *= of_xi
            if self.seam is Seam.CLOSED:
                values[:, -1] *= of_g

    def fold_back(self, values: Array) -> None:
        """Add what belongs to xi_{i-1} to xi_i at both ends, where they are one, (14, M) in place."""
        for end in (0, -1):
            values[X, end] += values[X0, end]
            values[X0, end] = 0.0

    def fold_back_hessian(self, hessian: Array) -> None:
        """The same for a Hessian's upper triangle (14, 14, M)."""
        for end in (0, -1):
            block = hessian[:, :, end]
            block[X, X] += block[X0, X0] + 2.0 * block[X0, X]
            block[:X0, X] += block[:X0, X0]
            block[:, X0] = 0.0
            block[X0, :] = 0.0


@lru_cache(maxsize=64)
def indices(segments: int, seam: Seam) -> tuple[IntArray, IntArray]:
    """`index` and `unknowns` of a stencil, (14, M) each."""
    n, size = segments, 7 * segments
    node = np.arange(n + 1 if seam.strip else n)
    previous, here, following = (node - 1) % n, node % n, (node + 1) % n
    xyz = np.arange(3)[:, None]
    index = np.empty((SIZE, node.size), dtype=np.int64)
    index[U0] = 7 * previous + xyz
    index[U] = 7 * here + xyz
    index[G] = 7 * here + 3 + xyz
    index[G1] = 7 * following + 3 + xyz
    index[X0] = 7 * previous + 6
    index[X] = 7 * here + 6
    data = size + np.arange(seam.data)
    if seam is Seam.OPEN:
        index[G1, -1] = data
    if not seam.strip:
        return index, np.minimum(index, size - 1)
    index[U0, 0], index[G, 0], index[X0, 0] = data[:3], data[3:6], index[X, 0]
    # At the end node G is g_{N+1}, in the slots of node 1; nothing comes after it.
    index[U, -1] = data[6:9] if seam is Seam.HELD else index[U0, -1]
    index[G1, -1], index[X, -1] = index[G, -1], index[X0, -1]
    unknowns = index.copy()
    unknowns[U0, 0] = unknowns[G, 0] = index[X, 0]
    if seam is Seam.HELD:
        unknowns[U, -1] = index[X, -1]
    return index, unknowns


def stencil(band: Band, *, open_seam: bool = False) -> Stencil:
    """The gather map of a band or strip; `open_seam` makes g_{N+1} the slots 7N..7N+2."""
    seam = seam_of(band, open_seam=open_seam)
    return Stencil(*indices(band.segments, seam), band.sigma, seam)


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


def cross_rows(a: Array, b: Array) -> Array:
    """Vector products (N, 3), row by row; numpy's own takes several times as long on a few hundred rows."""
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    out = np.empty_like(a)
    out[:, 0] = a1 * b2 - a2 * b1
    out[:, 1] = a2 * b0 - a0 * b2
    out[:, 2] = a0 * b1 - a1 * b0
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
