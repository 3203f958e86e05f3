"""Block cyclic reduction of the KKT matrix: the certificate's inertia, and solutions of last resort.

Ordered node by node (7 unknowns and 5 rows each) the KKT matrix is cyclic block-tridiagonal with a
narrow border (closure, gauge). Every second node is eliminated at once, log2 N times, with 12 x 12
blocks as pivots; by Haynsworth's additivity the inertia is the sum of the pivots' inertias. No
regularisation enters, and a pivot too close to singular is reported, not trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ..model.band import Array
from .kkt import BLOCK, FactorisationError, KKTMatrix

TRUSTED_GAP = 1e-11
"""Smallest pivot eigenvalue, relative to its block's largest entry before elimination, whose sign is
trusted: four orders above roundoff of one elimination step."""


@dataclass(frozen=True)
class Inertia:
    """Negative eigenvalues of the projected Hessian, rotations left out.

    `gap` is the smallest pivot eigenvalue relative to its block's scale, a measure of how far the count
    is from changing; `trusted` says that it is above roundoff.
    """

    negative: int
    gap: float

    @property
    def trusted(self) -> bool:
        """Whether every pivot's sign stands clear of roundoff."""
        return self.gap > TRUSTED_GAP


def _pivot(blocks: Array) -> tuple[Array, Array, int, float]:
    """Congruence V^T D V = diag(1/inverse) of symmetric blocks: V, inverse, negatives and relative gap.

    Blocks are equilibrated first: after some eliminations stiffnesses and compliances in one block are
    many orders apart, which says nothing about signs. Raises FactorisationError for blocks that are not
    finite, as they are after a pivot that is exactly singular.
    """
    if not np.isfinite(blocks).all():
        raise FactorisationError("a pivot of the block reduction is singular")
    entries = np.abs(blocks)
    scale = np.ones(blocks.shape[:-1])
    for _ in range(3):
        largest = scale * (entries * scale[..., None, :]).max(axis=-1)
        largest[largest == 0.0] = 1.0
        scale = scale / np.sqrt(largest)
    values, vectors = np.linalg.eigh(blocks * scale[..., :, None] * scale[..., None, :])
    size = np.abs(values)
    gap = float((size.min(axis=-1) / size.max(axis=-1)).min())
    floor = np.finfo(float).tiny
    inverse = 1.0 / np.where(size < floor, floor, values)
    return vectors * scale[..., :, None], inverse, int((values < 0).sum()), gap


@dataclass(frozen=True)
class _Level:
    """One sweep: the nodes eliminated, their neighbours, and what is needed to solve."""

    gone: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    kept: NDArray[np.int64]
    vectors: Array
    inverse: Array
    into_left: Array
    into_right: Array
    into_border: Array


class NodeMetric:
    """A metric M (7N, 7N) node by node: `diagonal` (N,7,7) and `coupling` to the next node (N,7,7).

    Raises ValueError for a matrix that couples nodes farther apart.
    """

    def __init__(self, mass: scipy.sparse.spmatrix) -> None:
        entries = mass.tocoo()
        n = mass.shape[0] // 7
        row, column = np.divmod(entries.row, 7), np.divmod(entries.col, 7)
        here, ahead, behind = (row[0] == (column[0] - k) % n for k in (0, 1, -1))
        if not (here | ahead | behind).all():
            raise ValueError("a metric must couple neighbouring nodes alone")
        self.diagonal, self.coupling = np.zeros((n, 7, 7)), np.zeros((n, 7, 7))
        for blocks, chosen in ((self.diagonal, here), (self.coupling, ahead)):
            places = (row[0][chosen], row[1][chosen], column[1][chosen])
            np.add.at(blocks, places, entries.data[chosen])

    def scaled(self, scale: Array) -> tuple[Array, Array]:
        """Both blocks in scaled unknowns, `scale` (N,7)."""
        diagonal = scale[:, :, None] * self.diagonal * scale[:, None, :]
        return diagonal, scale[:, :, None] * self.coupling * np.roll(scale, -1, axis=0)[:, None, :]


class BlockReduction:
    """K - shift M eliminated node by node; `inertia` counts eigenvalues of W_c below `shift`.

    M is `metric`, else the Euclidean one.
    """

    def __init__(self, matrix: KKTMatrix, shift: float = 0.0, metric: NodeMetric | None = None) -> None:
        blocks = matrix.node_blocks
        self._position = blocks.position
        diagonal, coupling, border = blocks.diagonal.copy(), blocks.coupling.copy(), blocks.border.copy()
        corner = (
            np.zeros((border.shape[2], border.shape[2])) if blocks.corner is None else blocks.corner.copy()
        )
        if shift and metric is None:
            unknowns = np.arange(7)
            diagonal[:, unknowns, unknowns] -= shift * matrix.metric.reshape(-1, 7)
        elif shift and metric is not None:
            here, ahead = metric.scaled(matrix.scale[: matrix.size].reshape(-1, 7))
            diagonal[:, :7, :7] -= shift * here
            coupling[:, :7, :7] -= shift * ahead
        self._levels: list[_Level] = []
        negative, gap = 0, np.inf
        # A node with a held ruling has more rows than free unknowns: no pivot before a neighbour is gone.
        held = blocks.held.copy()
        while diagonal.shape[0] > 2:
            n = diagonal.shape[0]
            gone = np.arange(1, n - 1 if n % 2 else n, 2)
            if not held[gone].all():
                gone = gone[~held[gone]]
            left, right = gone - 1, (gone + 1) % n
            vectors, inverse, count, narrow = _pivot(diagonal[gone])
            negative += count
            gap = min(gap, narrow)
            into_left = coupling[left] @ vectors
            into_right = np.swapaxes(coupling[gone], 1, 2) @ vectors
            into_border = np.swapaxes(border[gone], 1, 2) @ vectors
            scaled_left, scaled_right = into_left * inverse[:, None, :], into_right * inverse[:, None, :]
            t_right, t_border = np.swapaxes(into_right, 1, 2), np.swapaxes(into_border, 1, 2)
            diagonal[left] -= scaled_left @ np.swapaxes(into_left, 1, 2)
            diagonal[right] -= scaled_right @ t_right
            border[left] -= scaled_left @ t_border
            border[right] -= scaled_right @ t_border
            corner -= ((into_border * inverse[:, None, :]) @ t_border).sum(axis=0)
            coupling[left] = -scaled_left @ t_right
            stays = np.ones(n, dtype=bool)
            stays[gone] = False
            kept = np.flatnonzero(stays)
            self._levels.append(
                _Level(gone, left, right, kept, vectors, inverse, into_left, into_right, into_border)
            )
            held[left] = held[right] = False
            diagonal, coupling, border, held = diagonal[kept], coupling[kept], border[kept], held[kept]
        self._width = corner.shape[0]
        vectors, inverse, count, narrow = _pivot(_join(diagonal, coupling, border, corner)[None])
        self._last = (vectors[0], inverse[0])
        # Held components stand in K as ones on the diagonal, whatever the metric: no eigenvalues of W_c.
        ones = int((matrix.metric[matrix.fixed] * shift > 1.0).sum()) if metric is None else 0
        self.inertia = Inertia(negative + count - matrix.duals - ones, min(gap, narrow))

    def solve(self, rhs: Array) -> Array:
        """Solve the scaled system for rhs (n+m+r,) or (n+m+r, k)."""
        columns = rhs.reshape(rhs.shape[0], -1)
        ordered = np.empty_like(columns)
        ordered[self._position] = columns
        inner, count = ordered.shape[0] - self._width, ordered.shape[1]
        b, edge = ordered[:inner].reshape(-1, BLOCK, count), ordered[inner:].copy()
        stack = []
        for level in self._levels:
            y = np.swapaxes(level.vectors, 1, 2) @ b[level.gone]
            w = level.inverse[:, :, None] * y
            b[level.left] -= level.into_left @ w
            b[level.right] -= level.into_right @ w
            edge -= (level.into_border @ w).sum(axis=0)
            stack.append(y)
            b = b[level.kept]
        vectors, inverse = self._last
        rest = vectors @ (inverse[:, None] * (vectors.T @ np.concatenate((b.reshape(-1, count), edge))))
        inside = rest.shape[0] - self._width
        x, edge = rest[:inside].reshape(-1, BLOCK, count), rest[inside:]
        for level, y in zip(reversed(self._levels), reversed(stack), strict=True):
            full = np.empty((level.gone.size + level.kept.size, BLOCK, count))
            full[level.kept] = x
            known = np.swapaxes(level.into_left, 1, 2) @ full[level.left]
            known += np.swapaxes(level.into_right, 1, 2) @ full[level.right]
            known += np.swapaxes(level.into_border, 1, 2) @ edge
            full[level.gone] = level.vectors @ (level.inverse[:, :, None] * (y - known))
            x = full
        out: Array = np.concatenate((x.reshape(-1, count), edge))[self._position]
        return out.reshape(rhs.shape)


def inertia(matrix: KKTMatrix, shift: float = 0.0) -> Inertia:
    """Count the eigenvalues of the projected Hessian below `shift` by block cyclic reduction."""
    return BlockReduction(matrix, shift).inertia


def _join(diagonal: Array, coupling: Array, border: Array, corner: Array) -> Array:
    """The dense matrix of the last one or two nodes with the border."""
    n, width = diagonal.shape[0], corner.shape[0]
    size = BLOCK * n
    out = np.zeros((size + width, size + width))
    for i in range(n):
        here = slice(BLOCK * i, BLOCK * (i + 1))
        out[here, here] += diagonal[i]
        out[here, size:], out[size:, here] = border[i], border[i].T
        other = slice(BLOCK * ((i + 1) % n), BLOCK * ((i + 1) % n + 1))
        out[here, other] += coupling[i]
        out[other, here] += coupling[i].T
    out[size:, size:] = corner
    return out
