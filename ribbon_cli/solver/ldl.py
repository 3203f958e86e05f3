"""LDL^T of matrices of one pattern by qdldl: a symbolic part that is done once, and factors of numbers.

qdldl's own objects tell the signs of pivots only with a copy of all of L, which takes a tenth of a Newton
step. The C functions behind them do so by themselves. They are called where the version is one of `KNOWN`,
and where they give the bits of qdldl's own object for a first matrix of the pattern; elsewhere that does
it all.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from importlib.metadata import version
from typing import Protocol

import numpy as np
import qdldl
import scipy

from ..model.band import Array
from ..model.sparsity import IntArray, sorted_by

KNOWN = ("0.1.7.post5", "0.1.9.post1")
"""Versions of qdldl that were tried: their functions take whole numbers of 8 bytes, and booleans of 8 at
most."""


Factored = tuple[scipy.sparse.csc_matrix, Array, IntArray]


class Ldl(Protocol):
    """The factors L D L^T of one matrix after the other."""

    def update(self, upper: scipy.sparse.csc_matrix) -> None:
        """Factor another matrix of the pattern, given by its upper triangle."""

    def positive(self) -> int | None:
        """The number of positive pivots; None if one is zero, which means that there are no factors."""

    def solve(self, rhs: Array) -> Array:
        """Apply the inverse of the matrix factored."""


class Objects:
    """Factors by qdldl's own object. Raises RuntimeError where the first matrix has a zero pivot."""

    def __init__(self, upper: scipy.sparse.csc_matrix) -> None:
        self.solver = qdldl.Solver(upper, upper=True)
        self._pivots: Array | None = None

    def update(self, upper: scipy.sparse.csc_matrix) -> None:
        """As `Ldl` says. qdldl 0.1.9 ends at a zero pivot in silence, where a new solver raises."""
        self.solver.update(upper, upper=True)
        self._pivots = None

    def positive(self) -> int | None:
        """As `Ldl` says; it takes a copy of the factors."""
        if self._pivots is None:
            self._pivots = np.asarray(self.solver.factors()[1])
        return int((self._pivots > 0).sum()) if self._pivots.all() else None

    def solve(self, rhs: Array) -> Array:
        """As `Ldl` says."""
        return np.asarray(self.solver.solve(rhs))


class Symbolic:
    """The symbolic part of a pattern for the C functions, in the order that a solver of qdldl's chose.

    `factored` is what that solver found for a matrix: L, the pivots and the order. `first` are the factors of
    the same matrix by the functions, None where these do not give that solver's, to the last bit.
    """

    def __init__(self, upper: scipy.sparse.csc_matrix, factored: Factored) -> None:
        below, pivots, order = factored
        size = upper.shape[0]
        self.order = np.asarray(order, dtype=np.int64)
        self.place = np.empty(size, dtype=np.int64)
        self.place[self.order] = np.arange(size)
        one = self.place[upper.indices]
        other = self.place[np.repeat(np.arange(size), np.diff(upper.indptr))]
        column = np.maximum(one, other)
        self.source = sorted_by(column.astype(np.int32), size).astype(np.int64)
        self.rows = np.minimum(one, other)[self.source]
        self.starts = np.zeros(size + 1, dtype=np.int64)
        np.cumsum(np.bincount(column, minlength=size), out=self.starts[1:])
        self.lengths, self.tree, work = (np.zeros(size, dtype=np.int64) for _ in range(3))
        self.first: Functions | None = None
        self.known = False
        library = _library()
        if library is None:
            return
        found = library.QDLDL_etree(size, *_pointers(self.starts, self.rows, work, self.lengths, self.tree))
        if found != below.nnz:
            return
        first = Functions(self)
        first.update(upper)
        mine, theirs = (first.first, first.below, first.values, first.pivots), (below.indptr, below.indices)
        self.known = all(map(np.array_equal, mine, (*theirs, below.data, np.asarray(pivots))))
        self.first = first if self.known else None

    def factors(self, upper: scipy.sparse.csc_matrix, *, same: bool) -> Functions:
        """Factors of a matrix; `same` says that it is the one that this was made from."""
        out, self.first = self.first, None
        if out is None or not same:
            out = Functions(self)
            out.update(upper)
        return out


class Functions:
    """Factors by the C functions."""

    def __init__(self, symbolic: Symbolic) -> None:
        self._symbolic = symbolic
        size, filled = symbolic.order.size, int(symbolic.lengths.sum())
        self._data = np.empty(symbolic.source.size)
        self.first, self.below = np.zeros(size + 1, dtype=np.int64), np.zeros(filled, dtype=np.int64)
        self.values, self.pivots, self._inverse = np.zeros(filled), np.zeros(size), np.zeros(size)
        self._work = [np.zeros(n * size, dtype=np.int64) for n in (1, 3, 1)]
        library = _library()
        assert library is not None
        s, factors = symbolic, (self.first, self.below, self.values)
        given = (s.starts, s.rows, self._data, *factors, self.pivots, self._inverse, s.lengths, s.tree)
        self._factor, self._given = library.QDLDL_factor, (size, *_pointers(*given, *self._work))
        self._vector = np.empty(size)
        self._solve = library.QDLDL_solve
        self._kept = (size, *_pointers(*factors, self._inverse, self._vector))
        self._positive = -1

    def update(self, upper: scipy.sparse.csc_matrix) -> None:
        """As `Ldl` says."""
        upper.data.take(self._symbolic.source, out=self._data, mode="clip")
        self._positive = self._factor(*self._given)

    def positive(self) -> int | None:
        """As `Ldl` says."""
        return None if self._positive < 0 else self._positive

    def solve(self, rhs: Array) -> Array:
        """As `Ldl` says."""
        rhs.take(self._symbolic.order, out=self._vector, mode="clip")
        self._solve(*self._kept)
        out: Array = self._vector.take(self._symbolic.place)
        return out


def factors(upper: scipy.sparse.csc_matrix, symbolic: list[Symbolic], *, again: bool = False) -> Ldl:
    """Factors of a matrix while none of its pattern are free to be made anew.

    `symbolic` is the pattern's symbolic part, empty before it is made: with the second factors, since many
    patterns of contacts serve once, or at once where it is known that they serve `again`. Raises RuntimeError
    where the matrix has a zero pivot, unless the symbolic part is made.
    """
    if again and not symbolic and _library() is not None:
        symbolic.append(Symbolic(upper, Objects(upper).solver.factors()))  # the object itself is gone by then
        if symbolic[0].known:
            return symbolic[0].factors(upper, same=True)
    return symbolic[0].factors(upper, same=False) if _known(symbolic) else Objects(upper)


def factored_again(ldl: Ldl, upper: scipy.sparse.csc_matrix, symbolic: list[Symbolic]) -> Ldl:
    """The factors made anew for another matrix of the pattern, or others in their place."""
    ldl.update(upper)
    if not isinstance(ldl, Objects) or _library() is None:
        return ldl
    made = not symbolic and ldl.positive() is not None
    if made:
        symbolic.append(Symbolic(upper, ldl.solver.factors()))
    return symbolic[0].factors(upper, same=made) if _known(symbolic) else ldl


def _known(symbolic: list[Symbolic]) -> bool:
    return bool(symbolic) and symbolic[0].known


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL | None:
    """The library with qdldl's C functions; None where it is of another version, or hides them."""
    if version("qdldl") not in KNOWN:
        return None
    try:
        library = ctypes.CDLL(qdldl.__file__)
        whole, place = ctypes.c_int64, ctypes.c_void_p
        library.QDLDL_etree.argtypes, library.QDLDL_etree.restype = [whole, *[place] * 5], whole
        library.QDLDL_factor.argtypes, library.QDLDL_factor.restype = [whole, *[place] * 13], whole
        library.QDLDL_solve.argtypes, library.QDLDL_solve.restype = [whole, *[place] * 5], None
    except (OSError, AttributeError):
        return None
    return library


def _pointers(*arrays: Array | IntArray) -> list[int]:
    return [a.ctypes.data for a in arrays]
