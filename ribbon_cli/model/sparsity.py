"""A sparsity pattern that is built once and filled many times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from .band import Array


def _order(key: NDArray[np.int64], before: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """Indices that sort a key (E,) of numbers not below zero, equal ones in an order `before` (E,).

    Digit by digit: NumPy sorts 16 bits by counting, in a tenth of the time that it takes for longer numbers.
    """
    order, rest = before, int(key.max(initial=0))
    shift = 0
    while rest or not shift:
        digits = (key >> shift).astype(np.uint16)
        again = np.argsort(digits if order is None else digits[order], kind="stable")
        order = again if order is None else order[again]
        shift, rest = shift + 16, rest >> 16
    assert order is not None
    return order


@dataclass(frozen=True)
class Scatter:
    """Sums entries given in a fixed order of (row, column) into a CSC matrix.

    `slot` maps each entry to its place in the matrix's data; entries that share a place add up.
    """

    shape: tuple[int, int]
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    slot: NDArray[np.int64]

    @classmethod
    def build(cls, rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Scatter:
        """Build the pattern from the entries' rows and columns, both (E,)."""
        order = _order(columns, _order(rows, None))
        row, column = rows[order], columns[order]
        first = np.ones(order.size, dtype=bool)
        first[1:] = (np.diff(row) != 0) | (np.diff(column) != 0)
        slot = np.empty(order.size, dtype=np.int64)
        slot[order] = np.cumsum(first) - 1
        indptr = np.zeros(shape[1] + 1, dtype=np.int32)
        np.cumsum(np.bincount(column[first], minlength=shape[1]), out=indptr[1:])
        return cls(shape, indptr, row[first].astype(np.int32), slot)

    def data(self, values: Array) -> Array:
        """Summed values in CSC order, (nnz,)."""
        return np.bincount(self.slot, weights=values, minlength=self.indices.size).astype(
            np.float64, copy=False
        )

    def matrix(self, values: Array) -> scipy.sparse.csc_matrix:
        """Return the CSC matrix of the entries' values (E,)."""
        return scipy.sparse.csc_matrix((self.data(values), self.indices, self.indptr), shape=self.shape)
