"""Block cyclic reduction of the KKT matrix: the certificate's inertia, and solutions of last resort.

Ordered node by node (7 unknowns and 5 rows each) the KKT matrix is cyclic block-tridiagonal with a
narrow border (closure, gauge). Every second node is eliminated at once, log2 N times, with 12 x 12
blocks as pivots; by Haynsworth's additivity the inertia is the sum of the pivots' inertias. No
regularisation enters. Whether roundoff may have changed a sign is measured, not assumed.

Beyond `CHUNK` nodes the band is cut into chains of so many, which are reduced to their ends one after the
other: their blocks stay in the processor's cache, and are never all there at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from ..model.band import Array
from ..model.entries import PER_NODE
from .kkt import BLOCK, FactorisationError, KKTMatrix
from .threads import mapped

CHUNK = 1024
"""Nodes from one node that is kept to the next: blocks of half as many are 0.6 MB."""
PROBES = 6
CLEAR = 1e-3
CONTRACTION = 0.5
"""Power iterations, the rate at which the third of them ends, and the rate below which signs hold."""

Metric = tuple[Array, Array]
Blocks = tuple[Array, Array, Array, NDArray[np.bool_]]
_Places = NDArray[np.int64] | slice


@dataclass(frozen=True)
class Inertia:
    """Negative eigenvalues of the projected Hessian, rotations left out.

    `roundoff` is what decides: the spectral radius of X^-1 (K - X), X being the matrix whose factors were
    found. No eigenvalue passes zero on the way from X to K while it is below 1. `gap` is the smallest pivot
    eigenvalue relative to its block's scale, a measure of how far the count is from changing.
    """

    negative: int
    gap: float
    roundoff: float

    @property
    def trusted(self) -> bool:
        """Whether roundoff is measured too small to have changed a sign."""
        return self.roundoff < CONTRACTION


@lru_cache(maxsize=8)
def start_of_probes(size: int) -> Array:
    """A fixed vector (size,) with a part along everything; four grids have two sizes each."""
    out: Array = np.cos(1.0 + np.arange(size, dtype=np.float64) ** 1.5)
    out.flags.writeable = False
    return out


def radius(image: Callable[[Array], Array], size: int) -> float:
    """Spectral radius of a linear map of vectors (size,), by a few power iterations; infinite where it is
    not finite."""
    v = start_of_probes(size)
    rate, length = np.inf, math.sqrt(v @ v)
    for probe in range(PROBES):
        v = image(v)
        before, length = length, math.sqrt(v @ v)
        rate = length / before
        if not np.isfinite(rate):
            return np.inf
        if length == 0.0 or (probe >= 2 and rate < CLEAR):
            break
    return rate


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
    """One sweep, with one matrix a node that is read once each way.

    `factors` (n,36+c,12) are the pivot's inverse, and what a node's right-hand side gives to its left
    neighbour, to its right one and to the border.
    """

    gone: _Places
    left: _Places
    right: _Places
    factors: Array

    def forward(self, b: Array) -> Array:
        """Take right-hand sides b (n,12,k) to the nodes that are left; what the way back needs stays at the
        others. Returns what is taken from the border's (c,k)."""
        given = self.factors @ b[self.gone]
        b[self.gone] = given[:, :BLOCK]
        b[self.left] -= given[:, BLOCK : 2 * BLOCK]
        b[self.right] -= given[:, 2 * BLOCK : 3 * BLOCK]
        taken: Array = given[:, 3 * BLOCK :].sum(axis=0)
        return taken

    def backward(self, x: Array, edge: Array) -> None:
        """From solutions at the nodes that are left, and at the border, to those of the others."""
        count, width, _ = self.factors.shape
        others = np.empty((count, width - BLOCK, x.shape[2]))
        others[:, :BLOCK], others[:, BLOCK : 2 * BLOCK] = x[self.left], x[self.right]
        others[:, 2 * BLOCK :] = edge
        x[self.gone] -= np.swapaxes(self.factors[:, BLOCK:], 1, 2) @ others


class NodeMetric:
    """A metric M (7N, 7N) node by node: `diagonal` (N,7,7) and `coupling` to the next node (N,7,7).

    Raises ValueError for a matrix that couples nodes farther apart.
    """

    def __init__(self, mass: scipy.sparse.spmatrix) -> None:
        self.mass = mass
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

    def scaled(self, scale: Array, first: int, last: int) -> Metric:
        """Both blocks of nodes `first` to `last` - 1 in scaled unknowns, `scale` (N,7)."""
        here, ahead = scale[first:last], np.roll(scale, -1, axis=0)[first:last]
        diagonal = here[:, :, None] * self.diagonal[first:last] * here[:, None, :]
        return diagonal, here[:, :, None] * self.coupling[first:last] * ahead[:, None, :]


class _Chain:
    """Nodes in a row, or in a ring, as they are eliminated: blocks as in `NodeBlocks`, changed in place.

    `nodes` are those that are left, `edges` what each sweep takes from the border's own block.
    """

    def __init__(
        self,
        diagonal: Array,
        coupling: Array,
        border: Array,
        held: NDArray[np.bool_],
        *,
        ring: bool,
    ) -> None:
        self.diagonal, self.coupling, self.border, self.held = diagonal, coupling, border, held
        self.ring = ring
        self.nodes = np.arange(diagonal.shape[0])
        self.levels: list[_Level] = []
        self.edges: list[Array] = []
        self.first: tuple[Array, ...] = ()
        self.negative, self.gap = 0, np.inf

    def leave_ends(self, *first: Array) -> None:
        """Keep the blocks of both ends alone, with those of the first node that were not its own."""
        self.first = first
        self.diagonal, self.border = self.diagonal[[0, -1]], self.border[[0, -1]]
        self.coupling = self.coupling[:1].copy()

    def reduce(self, *, keep: bool) -> None:
        """Eliminate all nodes but two, the ends of a row; `keep` what is needed to solve."""
        while self.nodes.size > 2:
            level = self._sweep(*self._next())
            if keep:
                self.levels.append(level)

    def _next(self) -> tuple[_Places, _Places, _Places]:
        """The nodes to eliminate now, and their neighbours on both sides."""
        nodes, held = self.nodes, self.held
        n = nodes.size
        # A node with a held ruling has more rows than free unknowns: no pivot before a neighbour is gone.
        chosen = np.arange(1, n if self.ring and n % 2 == 0 else n - 1, 2)
        if not held[nodes[chosen]].all():
            chosen = chosen[~held[nodes[chosen]]]
        gone, left, right = (_evenly(nodes[k]) for k in (chosen, chosen - 1, (chosen + 1) % n))
        held[left] = held[right] = False
        self.nodes = np.delete(nodes, chosen)
        return gone, left, right

    def _sweep(self, gone: _Places, left: _Places, right: _Places) -> _Level:
        """Take nodes out, in few products: with one for each neighbour they would take twice as long."""
        diagonal, coupling, border = self.diagonal, self.coupling, self.border
        beside = (coupling[left], np.swapaxes(coupling[gone], 1, 2), np.swapaxes(border[gone], 1, 2))
        vectors, inverse, count, narrow = _pivot(diagonal[gone])
        self.negative += count
        self.gap = min(self.gap, narrow)
        into = np.concatenate(beside, axis=1) @ vectors
        scaled = into * inverse[:, None, :]
        lost = scaled @ np.swapaxes(into, 1, 2)
        one, other, edge = slice(0, BLOCK), slice(BLOCK, 2 * BLOCK), slice(2 * BLOCK, None)
        diagonal[left] -= lost[:, one, one]
        diagonal[right] -= lost[:, other, other]
        border[left] -= lost[:, one, edge]
        border[right] -= lost[:, other, edge]
        self.edges.append(lost[:, edge, edge].sum(axis=0))
        coupling[left] = -lost[:, one, other]
        own = vectors * inverse[:, None, :]
        factors = np.concatenate((own, scaled), axis=1) @ np.swapaxes(vectors, 1, 2)
        return _Level(gone, left, right, factors)


def _evenly(places: NDArray[np.int64]) -> _Places:
    """Places as a slice where they are at even distances: what it takes is not copied."""
    steps = np.diff(places)
    step = int(steps[0]) if steps.size else 1
    if not places.size or step <= 0 or (steps != step).any():
        return places
    return slice(int(places[0]), int(places[-1]) + 1, step)


class BlockReduction:
    """K - shift M eliminated node by node; `inertia` counts eigenvalues of W_c below `shift`.

    M is `metric`, else the Euclidean one. Without `keep` it only counts: `negative` and `gap` are all that is
    there.
    """

    def __init__(
        self, matrix: KKTMatrix, shift: float = 0.0, metric: NodeMetric | None = None, *, keep: bool = True
    ) -> None:
        self.matrix, self.shift, self.metric = matrix, shift, metric
        n = matrix.size // 7
        width = matrix.size + matrix.border - BLOCK * n
        corner = matrix.corner.copy()
        step = CHUNK if n > CHUNK else n
        self._bounds = [(first, min(first + step, n)) for first in range(0, n, step)]
        self._chains: list[_Chain] = []
        if len(self._bounds) == 1:
            ring = _Chain(*self._blocks(0, n), ring=True)
        else:
            c = len(self._bounds)
            ring = _Chain(
                np.zeros((c, BLOCK, BLOCK)),
                np.zeros((c, BLOCK, BLOCK)),
                np.zeros((c, BLOCK, width)),
                np.zeros(c, dtype=bool),
                ring=True,
            )
            first = self._blocks(*self._bounds[0])  # what all need of the matrix is made by one
            self._chains = [self._chain(first, keep=keep)]
            self._chains += mapped(
                lambda bounds: self._chain(self._blocks(*bounds), keep=keep), self._bounds[1:]
            )
            for k, chain in enumerate(self._chains):
                self._join_chain(ring, k, chain)
        ring.reduce(keep=keep)
        for lost in ring.edges:
            corner -= lost
        self._ring, self._beyond = ring, matrix.positions[BLOCK * n :] - BLOCK * n
        last = ring.nodes
        parts = _pivot(_join(ring.diagonal[last], ring.coupling[last], ring.border[last], corner)[None])
        self._last = (parts[0][0], parts[1][0])
        ring.diagonal = ring.coupling = ring.border = np.empty(0)
        # Held components stand in K as ones on the diagonal, whatever the metric: no eigenvalues of W_c.
        ones = int((matrix.metric[matrix.fixed] * shift > 1.0).sum()) if metric is None else 0
        self.negative: int = ring.negative + parts[2] - matrix.duals - ones
        self.gap = min(ring.gap, parts[3])

    def _blocks(self, first: int, last: int) -> Blocks:
        """Blocks of nodes `first` to `last` - 1, shifted, to be changed in place."""
        matrix, shift = self.matrix, self.shift
        diagonal, coupling, border, held = matrix.blocks_between(first, last)
        if shift and self.metric is None:
            unknowns = np.arange(7)
            diagonal[:, unknowns, unknowns] -= shift * matrix.metric.reshape(-1, 7)[first:last]
        elif shift and self.metric is not None:
            here, ahead = self.metric.scaled(matrix.scale[: matrix.size].reshape(-1, 7), first, last)
            diagonal[:, :7, :7] -= shift * here
            coupling[:, :7, :7] -= shift * ahead
        return diagonal, coupling, border, held

    def _chain(self, blocks: Blocks, *, keep: bool) -> _Chain:
        """Reduce nodes in a row, with the node after them, to their first and that one.

        The blocks of the first node itself are left to the ring: they go to where the chain before ends, too.
        """
        diagonal, coupling, border, held = blocks
        first = diagonal[0].copy(), border[0].copy()
        diagonal[0], border[0] = 0.0, 0.0
        end = np.zeros((1, BLOCK, BLOCK))
        chain = _Chain(
            np.concatenate((diagonal, end)),
            np.concatenate((coupling, end)),
            np.concatenate((border, np.zeros((1, *border.shape[1:])))),
            np.append(held, False),
            ring=False,
        )
        chain.reduce(keep=keep)
        chain.leave_ends(*first)
        return chain

    def _join_chain(self, ring: _Chain, k: int, chain: _Chain) -> None:
        """Add what is left of chain k to the ring of the chains' first nodes."""
        after = (k + 1) % len(self._bounds)
        for one, first, ends in (
            (ring.diagonal, chain.first[0], chain.diagonal),
            (ring.border, chain.first[1], chain.border),
        ):
            one[k] += first
            one[k] += ends[0]
            one[after] += ends[1]
        ring.coupling[k] = chain.coupling[0]
        ring.held[k] = chain.held[0]
        ring.edges += chain.edges
        ring.negative += chain.negative
        ring.gap = min(ring.gap, chain.gap)

    @cached_property
    def inertia(self) -> Inertia:
        """The count, with its roundoff measured."""
        return self.measured(self.matrix)

    def measured(self, like: KKTMatrix) -> Inertia:
        """The count as that of another matrix of the same pattern, which is near enough if it is trusted."""
        size = like.size + like.border
        roundoff = radius(lambda v: self.solve(self._product(like, v)) - v, size)
        return Inertia(self.negative, self.gap, roundoff)

    def _product(self, matrix: KKTMatrix, v: Array) -> Array:
        """Scaled (K - shift M) v with the K of a matrix."""
        out, n = matrix.product(v), matrix.size
        if self.shift and self.metric is None:
            out[:n] -= self.shift * matrix.metric * v[:n]
        elif self.shift and self.metric is not None:
            scale = matrix.scale[:n]
            out[:n] -= self.shift * scale * (self.metric.mass @ (scale * v[:n]))
        return out

    def solve(self, rhs: Array) -> Array:
        """Solve the scaled system for rhs (n+m+r,) or (n+m+r, k)."""
        columns = rhs.reshape(rhs.shape[0], -1)
        out = np.empty_like(columns)
        tail = BLOCK * (self.matrix.size // 7)
        edge = np.empty((self._beyond.size, columns.shape[1]))
        edge[self._beyond] = columns[tail:]
        if self._chains:
            self._solve_chains(columns, edge, out)
        else:
            ring = self._by_node(columns, *self._bounds[0])
            self._solve_ring(ring, edge)
            self._put(ring, *self._bounds[0], out)
        out[tail:] = edge[self._beyond]
        return out.reshape(rhs.shape)

    def _by_node(self, columns: Array, first: int, last: int, more: int = 0) -> Array:
        """Right-hand sides (n,12,k) of nodes `first` to `last` - 1, and zeros for as many more."""
        size, count = self.matrix.size, last - first
        b = np.zeros((count + more, BLOCK, columns.shape[1]))
        b[:count, :7] = columns[7 * first : 7 * last].reshape(count, 7, -1)
        rows = slice(size + PER_NODE * first, size + PER_NODE * last)
        b[:count, 7:] = columns[rows].reshape(count, PER_NODE, -1)
        return b

    def _put(self, x: Array, first: int, last: int, out: Array) -> None:
        """Put what is known at nodes `first` to `last` - 1 to its place."""
        size, count = self.matrix.size, last - first
        out[7 * first : 7 * last].reshape(count, 7, -1)[:] = x[:, :7]
        rows = slice(size + PER_NODE * first, size + PER_NODE * last)
        out[rows].reshape(count, PER_NODE, -1)[:] = x[:, 7:]

    def _solve_chains(self, columns: Array, edge: Array, out: Array) -> None:
        """Solve for all nodes and for the border's `edge`, chain by chain: each takes to the first node of
        the next what that node adds up."""

        def forward(k: int) -> tuple[Array, list[Array]]:
            part = self._by_node(columns, *self._bounds[k], more=1)
            return part, [level.forward(part) for level in self._chains[k].levels]

        def backward(k: int) -> None:
            part = parts[k]
            part[0], part[-1] = ring[k], ring[(k + 1) % len(parts)]
            for level in reversed(self._chains[k].levels):
                level.backward(part, edge)
            self._put(part[:-1], *self._bounds[k], out)

        found = mapped(forward, range(len(self._chains)))
        parts = [part for part, _ in found]
        ring = np.array([part[0] for part in parts])
        ring += np.array([parts[k - 1][-1] for k in range(len(parts))])
        for _, taken in found:
            for each in taken:
                edge -= each
        self._solve_ring(ring, edge)
        mapped(backward, range(len(parts)))

    def _solve_ring(self, b: Array, edge: Array) -> None:
        """Solve for right-hand sides b (n,12,k) of a ring and for those of the border, in place."""
        for level in self._ring.levels:
            edge -= level.forward(b)
        left = self._ring.nodes
        vectors, inverse = self._last
        known = np.concatenate((b[left].reshape(-1, b.shape[2]), edge))
        rest = vectors @ (inverse[:, None] * (vectors.T @ known))
        b[left] = rest[: left.size * BLOCK].reshape(-1, *b.shape[1:])
        edge[:] = rest[left.size * BLOCK :]
        for level in reversed(self._ring.levels):
            level.backward(b, edge)


def inertia(matrix: KKTMatrix, shift: float = 0.0, like: KKTMatrix | None = None) -> Inertia:
    """Count the eigenvalues of the projected Hessian below `shift` by block cyclic reduction.

    The roundoff is measured against `like`, a matrix at a place that counts as the same one, else against
    the matrix itself.
    """
    return BlockReduction(matrix, shift).measured(like or matrix)


def count_below(matrix: KKTMatrix, shift: float) -> int:
    """The same count, of which nothing is known but that it is near."""
    return BlockReduction(matrix, shift, keep=False).negative


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
