"""The scaled, sparse KKT matrix of a problem, Koldaev (2022), (2.57), with rotations held.

K = [[W, A^T, Z], [A, -delta, 0], [Z^T, 0, -delta]] in the order x (7N), constraints (5N+3), gauge (r),
where Z holds the tangents of the rigid rotations (exact zero modes of a free band). Rows and columns
are scaled by fixed powers of h and b, so that entries are of order one at every N.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ..model.band import Array, Band
from ..model.constraints import PER_NODE
from ..model.problem import CLOSURE, HESSIAN_ENTRIES, LocalDerivatives, Problem
from ..model.sparsity import Scatter
from ..model.stencil import SIZE, stencil

BLOCK = 7 + PER_NODE


@dataclass(frozen=True)
class _Pattern:
    scatter: Scatter
    keep: np.ndarray  # which of the listed Hessian entries lie in the upper triangle


@lru_cache(maxsize=64)
def _pattern(segments: int, open_seam: bool, rotations: int) -> _Pattern:
    """Upper-triangular pattern, built once per N."""
    n, size = segments, 7 * segments
    index = stencil(Band(n, 1.0), open_seam=open_seam).index
    index = np.minimum(index, size - 1)  # the open seam's extra slots carry zeros only
    rows = index[:, HESSIAN_ENTRIES // SIZE].ravel()
    columns = index[:, HESSIAN_ENTRIES % SIZE].ravel()
    keep = np.flatnonzero(rows <= columns)
    jac_rows = np.repeat(index[:, None, :], PER_NODE, axis=1).ravel()
    jac_columns = np.repeat(size + np.arange(PER_NODE * n), SIZE)
    tangents = (7 * np.arange(n)[:, None] + np.arange(3)).ravel()
    close_columns = size + PER_NODE * n + np.tile(np.arange(CLOSURE), n)
    moving = (7 * np.arange(n)[:, None] + np.arange(6)).ravel()
    first_gauge = size + PER_NODE * n + CLOSURE
    total = first_gauge + rotations
    diagonal = np.arange(total)
    return _Pattern(
        Scatter.build(
            np.concatenate((rows[keep], jac_rows, tangents, np.tile(moving, rotations), diagonal)),
            np.concatenate(
                (
                    columns[keep],
                    jac_columns,
                    close_columns,
                    first_gauge + np.repeat(np.arange(rotations), moving.size),
                    diagonal,
                )
            ),
            (total, total),
        ),
        keep,
    )


def scaling(problem: Problem, rotations: int) -> Array:
    """Symmetric scaling s (7N+5N+3+r,) that makes the entries of diag(s) K diag(s) of order one.

    From the sizes of the blocks: W_uu ~ b/h; weighted constraint rows ~ h, h, 1, 1, b; W_xixi ~ b h,
    with the xi column of the last row ~ h.
    """
    band = problem.band
    n, h, b = band.segments, band.h, band.half_width
    sx = np.sqrt(h / b)
    x = np.full((n, 7), sx)
    x[:, 6] = 1.0 / sx
    rows = np.tile(np.array([1.0 / h, 1.0 / h, 1.0, 1.0, 1.0 / b]) / sx, n)
    return np.concatenate(
        (x.ravel(), rows, np.full(CLOSURE, 1.0 / (h * sx)), np.full(rotations, np.sqrt(n) / sx))
    )


@dataclass(frozen=True)
class NodeBlocks:
    """K node by node: `diagonal` (N,12,12), `coupling` to the next node (N,12,12), `border` (N,12,c),
    and the nodes whose ruling is `held` (N,).

    `position` is the place of every row of K in this order, border (closure, gauge) last.
    """

    position: NDArray[np.int64]
    diagonal: Array
    coupling: Array
    border: Array
    held: NDArray[np.bool_]


class KKTMatrix:
    """The KKT matrix at one point; `upper` is the scaled upper triangle without regularisation.

    `scale` is s above; `size` is 7N, `border` the number of multiplier and gauge rows; `metric` (7N,) is the
    scaled diagonal that shifts multiply, Euclidean unless `with_metric` says otherwise.
    """

    def __init__(self, problem: Problem, local: LocalDerivatives, rotations: Array) -> None:
        n = problem.band.segments
        self.size = problem.size
        self.rotations = rotations
        self.gauge = rotations.shape[1]
        self.border = problem.rows + self.gauge
        self.fixed = problem.fixed
        self.scale = scaling(problem, self.gauge)
        self.metric = self.scale[: self.size] ** 2
        self.pattern = _pattern(n, problem.prescription.seam is not None, self.gauge)
        moving = rotations.reshape(n, 7, -1)[:, :6].reshape(6 * n, -1)
        diagonal = np.zeros(self.size + self.border)
        diagonal[: self.size][problem.fixed] = 1.0 / self.scale[: self.size][problem.fixed] ** 2
        hessian = local.hessian.reshape(n, SIZE * SIZE)[:, HESSIAN_ENTRIES].ravel()
        values = np.concatenate(
            (
                hessian[self.pattern.keep],
                local.jacobian.ravel(),
                np.full(CLOSURE * n, problem.band.h),
                moving.T.ravel(),
                diagonal,
            )
        )
        scatter = self.pattern.scatter
        data = scatter.data(values)
        columns = np.repeat(np.arange(scatter.shape[1]), np.diff(scatter.indptr))
        data *= self.scale[scatter.indices] * self.scale[columns]
        self.upper = sparse.csc_matrix((data, scatter.indices, scatter.indptr), shape=scatter.shape)
        self._strict = self.upper - sparse.diags(self.upper.diagonal())

    @cached_property
    def node_blocks(self) -> NodeBlocks:
        """The matrix as a cyclic block-tridiagonal one with a border."""
        return _node_blocks(self)

    def with_metric(self, weights: Array) -> KKTMatrix:
        """The same matrix with shifts measured in the metric of diagonal weights (7N,)."""
        out = copy(self)
        out.metric = self.scale[: self.size] ** 2 * weights
        return out

    def with_unit_metric(self, *, scaled: bool = True) -> KKTMatrix:
        """The same matrix with the identity, on the scaled unknowns or on x itself, for the Hessian."""
        out = copy(self)
        out.__dict__.pop("node_blocks", None)
        out.upper = self.upper.copy()
        out.upper.data[: out.upper.indptr[self.size]] = 0.0
        identity = 1.0 if scaled else self.scale[: self.size] ** 2
        out.upper.data[out.upper.indptr[1 : self.size + 1] - 1] = identity
        out._strict = out.upper - sparse.diags(out.upper.diagonal())
        return out

    def product(self, v: Array) -> Array:
        """Scaled K v, for v (n+m+r,) or (n+m+r, k)."""
        out: Array = self.upper @ v + self._strict.T @ v
        return out

    def regularised(self, shift: float, delta: float) -> sparse.csc_matrix:
        """Upper triangle of K - shift (on x, unscaled metric) - delta (on multipliers, scaled)."""
        diagonal = np.concatenate((-shift * self.metric, np.full(self.border, -delta)))
        out = self.upper.copy()
        last = out.indptr[1:] - 1  # sorted columns of an upper triangle end on the diagonal
        out.data[last] += diagonal
        return out


def _positions(matrix: KKTMatrix) -> NDArray[np.int64]:
    """Place of every row of K in the order node by node, border last."""
    n = matrix.size // 7
    node = np.arange(n)[:, None]
    return np.concatenate(
        (
            (BLOCK * node + np.arange(7)).ravel(),
            (BLOCK * node + 7 + np.arange(PER_NODE)).ravel(),
            np.arange(BLOCK * n, matrix.size + matrix.border),
        )
    )


def _node_blocks(matrix: KKTMatrix) -> NodeBlocks:
    position = _positions(matrix)
    n = matrix.size // 7
    tail, total = BLOCK * n, matrix.size + matrix.border
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
    held: NDArray[np.bool_] = np.any(matrix.fixed.reshape(n, 7), axis=1)
    return NodeBlocks(position, diagonal, coupling, border, held)
