"""Inertia of the KKT matrix by block cyclic reduction: the certificate's count.

Ordered node by node (7 unknowns and 5 rows each) the KKT matrix is cyclic block-tridiagonal with a
narrow border (closure, gauge). Every second node is eliminated at once, log2 N times, with 12 x 12
blocks as pivots; by Haynsworth's additivity the inertia is the sum of the pivots' inertias. No
regularisation enters, and a pivot too close to singular is reported, not trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.band import Array
from ..model.constraints import PER_NODE
from .kkt import KKTMatrix

BLOCK = 7 + PER_NODE
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


def _blocks(matrix: KKTMatrix) -> tuple[Array, Array, Array, Array]:
    """Diagonal (N,12,12), coupling to the next node (N,12,12), border (N,12,c) and corner (c,c)."""
    n = matrix.size // 7
    total = matrix.size + matrix.border
    position = np.empty(total, dtype=np.int64)
    node = np.arange(n)[:, None]
    position[: matrix.size] = (BLOCK * node + np.arange(7)).ravel()
    position[matrix.size : matrix.size + PER_NODE * n] = (BLOCK * node + 7 + np.arange(PER_NODE)).ravel()
    tail = BLOCK * n
    position[matrix.size + PER_NODE * n :] = np.arange(tail, total)
    upper = matrix.upper.tocoo()
    row, column, value = position[upper.row], position[upper.col], upper.data
    off = row != column
    row, column = np.concatenate((row, column[off])), np.concatenate((column, row[off]))
    value = np.concatenate((value, value[off]))
    inside = (row < tail) & (column < tail)
    edge = (row < tail) & (column >= tail)
    width = total - tail
    border = np.zeros((n, BLOCK, width))
    border[row[edge] // BLOCK, row[edge] % BLOCK, column[edge] - tail] = value[edge]
    row, column, value = row[inside], column[inside], value[inside]
    owner, other = row // BLOCK, column // BLOCK
    diagonal, coupling = np.zeros((n, BLOCK, BLOCK)), np.zeros((n, BLOCK, BLOCK))
    here = owner == other
    diagonal[owner[here], row[here] % BLOCK, column[here] % BLOCK] = value[here]
    forward = ~here & (other == (owner + 1) % n)
    coupling[owner[forward], row[forward] % BLOCK, column[forward] % BLOCK] = value[forward]
    return diagonal, coupling, border, np.zeros((width, width))


def _pivot(blocks: Array) -> tuple[Array, Array, int, float]:
    """Congruence V^T D V = diag(1/inverse) of symmetric blocks: V, inverse, negatives and relative gap.

    Blocks are equilibrated first: after some eliminations stiffnesses and compliances in one block are
    many orders apart, which says nothing about signs.
    """
    scale = np.ones(blocks.shape[:-1])
    for _ in range(3):
        scaled = np.abs(blocks) * scale[..., :, None] * scale[..., None, :]
        largest = scaled.max(axis=-1)
        scale = scale / np.sqrt(np.where(largest > 0, largest, 1.0))
    values, vectors = np.linalg.eigh(blocks * scale[..., :, None] * scale[..., None, :])
    size = np.abs(values)
    gap = float((size.min(axis=-1) / size.max(axis=-1)).min())
    floor = np.finfo(float).tiny
    inverse = 1.0 / np.where(size < floor, floor, values)
    return vectors * scale[..., :, None], inverse, int((values < 0).sum()), gap


def inertia(matrix: KKTMatrix, shift: float = 0.0) -> Inertia:
    """Count the eigenvalues of the projected Hessian below `shift` by block cyclic reduction."""
    diagonal, coupling, border, corner = _blocks(matrix)
    if shift:
        unknowns = np.arange(7)
        diagonal[:, unknowns, unknowns] -= shift * (matrix.scale[: matrix.size] ** 2).reshape(-1, 7)
    negative, gap = 0, np.inf
    while diagonal.shape[0] > 2:
        n = diagonal.shape[0]
        gone = np.arange(1, n - 1 if n % 2 else n, 2)
        left, right = gone - 1, (gone + 1) % n
        vectors, inverse, count, narrow = _pivot(diagonal[gone])
        negative += count
        gap = min(gap, narrow)
        into_left = coupling[left] @ vectors  # rows of the left neighbour
        into_right = np.swapaxes(coupling[gone], 1, 2) @ vectors
        into_border = np.swapaxes(border[gone], 1, 2) @ vectors
        scaled_left, scaled_right = into_left * inverse[:, None, :], into_right * inverse[:, None, :]
        t_left, t_right = np.swapaxes(into_left, 1, 2), np.swapaxes(into_right, 1, 2)
        t_border = np.swapaxes(into_border, 1, 2)
        diagonal[left] -= scaled_left @ t_left
        diagonal[right] -= scaled_right @ t_right
        border[left] -= scaled_left @ t_border
        border[right] -= scaled_right @ t_border
        corner -= ((into_border * inverse[:, None, :]) @ t_border).sum(axis=0)
        coupling[left] = -scaled_left @ t_right
        kept = np.setdiff1d(np.arange(n), gone, assume_unique=True)
        diagonal, coupling, border = diagonal[kept], coupling[kept], border[kept]
    rest = _join(diagonal, coupling, border, corner)
    _, _, count, narrow = _pivot(rest[None])
    return Inertia(negative + count - matrix.border, min(gap, narrow))


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

