"""A sparsity pattern that is built once and filled many times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from .band import Array


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
        key = columns.astype(np.int64) * shape[0] + rows
        unique, slot = np.unique(key, return_inverse=True)
        indptr = np.searchsorted(unique, np.arange(shape[1] + 1, dtype=np.int64) * shape[0])
        return cls(shape, indptr.astype(np.int32), (unique % shape[0]).astype(np.int32), slot.ravel())

    def data(self, values: Array) -> Array:
        """Summed values in CSC order, (nnz,)."""
        return np.bincount(self.slot, weights=values, minlength=self.indices.size).astype(
            np.float64, copy=False
        )

    def matrix(self, values: Array) -> scipy.sparse.csc_matrix:
        """Return the CSC matrix of the entries' values (E,)."""
        return scipy.sparse.csc_matrix((self.data(values), self.indices, self.indptr), shape=self.shape)
