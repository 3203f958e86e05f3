"""Block Lanczos with full orthogonalisation for the largest eigenvalues of a pencil's inverse.

Blocks, since eigenvalues of symmetric bands are double, and a single vector sees one direction of each
eigenspace only. Starts are fixed: runs repeat bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from scipy.sparse._sparsetools import csr_matvec

from ..model.band import Array
from ..model.metrics import lengths
from .kkt import FactorisationError

BLOCK_SIZE = 4
"""Vectors in a block: eigenvalues of symmetric bands are double, and four solutions at once take little
longer than two, since both wait for the factors."""
LARGEST_BASIS = 400
EXHAUSTED = 1e-10
"""Length, relative to before orthogonalisation, at which a direction is taken to lie in the basis."""


def fixed_block(size: int, columns: int, seed: int = 0) -> Array:
    """A fixed block (n, k) without symmetry, another one for each seed."""
    index = np.arange(size, dtype=np.float64)[:, None]
    return np.cos(1.0 + 7.0 * seed + (1.0 + 0.1 * np.arange(columns)) * index**1.5)


class _Basis:
    """Vectors orthonormal in a metric, kept as rows."""

    def __init__(self, mass: scipy.sparse.csr_matrix, limit: int) -> None:
        self.mass, self.count = mass, 0
        self.rows = np.empty((limit, mass.shape[0]))

    def add(self, block: Array, near: int = 0) -> Array:
        """Append what a block (n, p) adds, orthonormalised; coefficients (count, p) of what it had before.

        It is orthogonalised twice: first against the rows from `near` on, which it has most of, then against
        all. A direction of which next to nothing is left lies in the basis, and adds none.
        """
        before = lengths(self.mass, block)
        total = np.zeros((self.count, block.shape[1]))
        for start in (near, 0):  # twice is enough
            known = self.rows[start : self.count]
            along = known @ (self.mass @ block)
            block = block - known.T @ along
            total[start:] += along
        first = self.count
        for column, size in zip(np.ascontiguousarray(block.T), before, strict=True):
            own = self.rows[first : self.count]
            for _ in range(2):
                column = column - own.T @ (own @ self._weighed(column))
            length = float(np.sqrt(max(column @ self._weighed(column), 0.0)))
            if length > EXHAUSTED * size and self.count < self.rows.shape[0]:
                self.rows[self.count] = column / length
                self.count += 1
        self.left = lengths(self.mass, block)
        return total

    def _weighed(self, v: Array) -> Array:
        """M v for v (n,): what `@` ends with, on the way to which there is more than this at N = 400."""
        mass, out = self.mass, np.zeros(v.size)
        csr_matvec(v.size, v.size, mass.indptr, mass.indices, mass.data, v, out)
        return out


def largest_eigenpairs(
    apply: Callable[[Array], Array],
    mass: scipy.sparse.csr_matrix,
    count: int,
    *,
    dimension: int,
    known: Array | None = None,
    seed: int = 0,
    tolerance: float = 1e-9,
) -> tuple[Array, Array]:
    """The `count` largest eigenpairs of B = apply(M .), self-adjoint and positive in the metric M.

    Returns values (k,) descending and vectors (n, k), M-orthonormal; k < count where the space of
    `dimension` is exhausted. Eigenvectors `known` (n, j) are kept out. `tolerance` bounds residuals relative
    to their eigenvalues. Raises FactorisationError if they do not converge.
    """
    n = mass.shape[0]
    limit = min(dimension, LARGEST_BASIS)
    held = 0 if known is None else known.shape[1]
    basis = _Basis(mass, limit + BLOCK_SIZE + held)
    if known is not None:
        basis.add(known)
    projected = np.zeros((basis.rows.shape[0],) * 2)
    basis.add(apply(mass @ fixed_block(n, BLOCK_SIZE, seed)))
    before = first = held
    for _ in range(limit):
        new = slice(first, basis.count)
        last = basis.count
        if new.start == last:
            break
        # Its image has next to nothing of older blocks than the one before, as the operator is symmetric.
        along = basis.add(apply(mass @ basis.rows[new].T), before)
        projected[:last, new] = along
        projected[new, :last] = along.T
        exhausted = last - held >= dimension or basis.count == last
        if exhausted or last - held > count:
            inner = slice(held, last)
            values, y = scipy.linalg.eigh(projected[inner, inner])
            values, y = values[::-1][:count], y[:, ::-1][:, :count]
            # What leaves the span couples to the newest vectors alone, and bounds the Ritz pairs' residuals.
            residuals = basis.left @ np.abs(y[first - last :])
            if exhausted or (residuals <= tolerance * np.abs(values)).all():
                return values, basis.rows[inner].T @ y
        if last - held > limit:
            break
        before, first = first, last
    raise FactorisationError(f"Lanczos did not converge within {limit} vectors")
