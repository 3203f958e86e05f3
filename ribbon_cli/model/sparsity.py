"""A sparsity pattern that is built once and filled many times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from .band import Array

IntArray = NDArray[np.int64] | NDArray[np.int32]


COMPACT_FROM = 1 << 20
"""Entries from which places are kept in 4 bytes: then memory counts for more than a conversion's time."""
PART = 1 << 16
"""Places in 4 bytes that are taken at once."""
MOST_ROUNDS = 3
"""Further entries of one place up to which they are taken in turn, which is quicker than to count through."""


def sorted_by(key: IntArray, count: int, before: IntArray | None = None) -> IntArray:
    """Indices that sort a key (E,) of numbers from 0 to `count` - 1, equal ones in an order `before` (E,).

    A matrix with one entry a column, in the row of its key, is sorted by counting where it is transposed.
    """
    sorted_key = key if before is None else key[before]
    pointer = np.arange(key.size + 1, dtype=np.int32)
    entries = np.zeros(key.size, dtype=np.int8)
    columns = scipy.sparse.csc_matrix((entries, sorted_key, pointer), shape=(count, key.size))
    again: IntArray = columns.tocsr().indices
    return again if before is None else before[again]


def taken(values: Array, places: IntArray) -> Array:
    """values[places]; a part after the other where places have 4 bytes.

    numpy makes them 8 bytes wide first. All at once that would take as much memory again as the result, and
    getting fresh memory longer than the rest.
    """
    if places.itemsize == np.intp(0).itemsize:
        return values.take(places)
    out = np.empty(places.size)
    for first in range(0, places.size, PART):
        part = slice(first, first + PART)
        values.take(places[part], out=out[part], mode="clip")
    return out


def stretched(one: IntArray, other: IntArray, more: int, nodes: int) -> IntArray:
    """A run of whole numbers for `nodes` + `more` nodes, from `one` for `nodes` and `other` for one more.

    Away from both ends each node has as many numbers, w, which grow from node to node and with the number of
    nodes by the same steps; the run grows by w with a node. A run that does not grow may still change.
    """
    width = other.size - one.size
    head = one.size - width * (nodes // 3)
    out = np.empty(one.size + width * more, dtype=one.dtype)
    first, last = out[:head], out[head + width * more :]
    np.add(one[:head], more * (other[:head] - one[:head]), out=first)
    np.add(one[head:], more * (other[head + width :] - one[head:]), out=last)
    if width:
        between = out[head : head + width * more].reshape(more, width)
        step = first[-width:] - first[-2 * width : -width]
        np.multiply(np.arange(1, more + 1, dtype=out.dtype)[:, None], step, out=between)
        between += first[-width:]
    return out


@dataclass(frozen=True)
class Scatter:
    """Sums entries given in a fixed order of (row, column) into a CSC matrix.

    `slot` maps each entry to its place in the matrix's data; entries that share a place add up. The last
    `zeros` entries are always zero, and one value stands for all of them.
    """

    shape: tuple[int, int]
    indptr: NDArray[np.int32]
    indices: IntArray
    slot: IntArray
    zeros: int = 0

    @classmethod
    def build(
        cls, rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int], zeros: int = 0
    ) -> Scatter:
        """Build the pattern from the entries' rows and columns, both (E,)."""
        below, beside = rows.astype(np.int32), columns.astype(np.int32)
        order = sorted_by(beside, shape[1], sorted_by(below, shape[0]))
        row, column = below[order], beside[order]
        first = np.ones(order.size, dtype=bool)
        first[1:] = (row[1:] != row[:-1]) | (column[1:] != column[:-1])
        slot: IntArray = np.empty(order.size, dtype=np.int32)
        slot[order] = np.cumsum(first, dtype=np.int32) - 1
        if slot.size <= COMPACT_FROM:
            slot = slot.astype(np.int64)
        indptr = np.zeros(shape[1] + 1, dtype=np.int32)
        np.cumsum(np.bincount(column[first], minlength=shape[1]), out=indptr[1:])
        return cls(shape, indptr, row[first], slot, zeros)

    @cached_property
    def _rounds(self) -> tuple[IntArray, list[tuple[IntArray, IntArray]]] | None:
        """The first entry of each place, and places with the second ones of those that have more, and so on;
        None where many entries share a place."""
        known = self.slot.size - self.zeros
        order = sorted_by(self.slot[:known].astype(np.int32, copy=False), self.indices.size)
        order = order if self.slot.itemsize == order.itemsize else order.astype(np.int64)
        place = self.slot[order]
        begins = np.flatnonzero(np.diff(place, prepend=-1))
        number = np.arange(known) - np.repeat(begins, np.diff(begins, append=known))
        # Where nothing comes first there is the value that stands for zeros.
        first: IntArray = np.full(self.indices.size, known, dtype=order.dtype)
        first[place[begins]] = order[begins]
        more = [number == k for k in range(1, int(number.max(initial=0)) + 1)]
        if len(more) > MOST_ROUNDS:
            return None
        return first, [(place[k], order[k]) for k in more]

    def data(self, values: Array) -> Array:
        """Summed values in CSC order, (nnz,)."""
        rounds = self._rounds
        if rounds is None:
            slot = self.slot[: values.size]
            return np.bincount(slot, weights=values, minlength=self.indices.size).astype(
                np.float64, copy=False
            )
        first, more = rounds
        out = taken(values, first)
        for places, entries in more:
            out[places] += values.take(entries)
        return out

    def matrix(self, values: Array) -> scipy.sparse.csc_matrix:
        """Return the CSC matrix of the entries' values (E,)."""
        return scipy.sparse.csc_matrix((self.data(values), self.indices, self.indptr), shape=self.shape)
