"""Block cyclic reduction of the KKT matrix: the certificate's inertia, and solutions of last resort.

Ordered node by node (7 unknowns and 5 rows each) the KKT matrix is cyclic block-tridiagonal with a
narrow border (closure, gauge). Every second node is eliminated at once, log2 N times, with 12 x 12
blocks as pivots; by Haynsworth's additivity the inertia is the sum of the pivots' inertias. No
regularisation enters. Whether roundoff may have changed a sign is measured, not assumed.

Beyond `CHUNK` nodes the band is cut into chains of so many, which are reduced to their ends one after the
other: their blocks stay in the processor's cache, and are never all there at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from ..model.band import Array
from .kkt import BLOCK, FactorisationError, KKTMatrix

CHUNK = 1024
"""Nodes from one node that is kept to the next: blocks of half as many are 0.6 MB."""
PROBES = 6
CLEAR = 1e-3
CONTRACTION = 0.5
"""Power iterations, the rate at which the third of them ends, and the rate below which signs hold."""

Metric = tuple[Array, Array]


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


@lru_cache(maxsize=4)
def start_of_probes(size: int) -> Array:
    """A fixed vector (size,) with a part along everything."""
    out: Array = np.cos(1.0 + np.arange(size, dtype=np.float64) ** 1.5)
    out.flags.writeable = False
    return out


def radius(image: Callable[[Array], Array], size: int) -> float:
    """Spectral radius of a linear map of vectors (size,), by a few power iterations; infinite where it is
    not finite."""
    v = start_of_probes(size)
    rate, length = np.inf, float(np.linalg.norm(v))
    for probe in range(PROBES):
        v = image(v)
        before, length = length, float(np.linalg.norm(v))
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
    """One sweep: the nodes eliminated, their neighbours, and what is needed to solve."""

    gone: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    kept: NDArray[np.int64]
    vectors: Array
    inverse: Array
    into: Array
    """What a node gives to its left neighbour (12 rows), to its right one (12), and to the border."""

    @property
    def into_left(self) -> Array:
        """The rows of the left neighbour."""
        return self.into[:, :BLOCK]

    @property
    def into_right(self) -> Array:
        """The rows of the right neighbour."""
        return self.into[:, BLOCK : 2 * BLOCK]

    @property
    def into_border(self) -> Array:
        """The rows of the border."""
        return self.into[:, 2 * BLOCK :]


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
    """Nodes in a row, or in a ring, as they are eliminated: blocks as in `NodeBlocks`, those that are left.

    `corner` is added to, and shared.
    """

    def __init__(
        self,
        diagonal: Array,
        coupling: Array,
        border: Array,
        held: NDArray[np.bool_],
        corner: Array,
        *,
        ring: bool,
    ) -> None:
        self.diagonal, self.coupling, self.border, self.held = diagonal, coupling, border, held
        self.corner, self.ring = corner, ring
        self.levels: list[_Level] = []
        self.negative, self.gap = 0, np.inf

    def reduce(self, *, keep: bool) -> None:
        """Eliminate all nodes but two, the ends of a row; `keep` what is needed to solve."""
        while self.diagonal.shape[0] > 2:
            level = self._sweep()
            if keep:
                self.levels.append(level)

    def _sweep(self) -> _Level:
        diagonal, coupling, border, held = self.diagonal, self.coupling, self.border, self.held
        n = diagonal.shape[0]
        # A node with a held ruling has more rows than free unknowns: no pivot before a neighbour is gone.
        gone = np.arange(1, n if self.ring and n % 2 == 0 else n - 1, 2)
        if not held[gone].all():
            gone = gone[~held[gone]]
        left, right = gone - 1, (gone + 1) % n
        vectors, inverse, count, narrow = _pivot(diagonal[gone])
        self.negative += count
        self.gap = min(self.gap, narrow)
        eliminate = self._in_parts if self.ring else self._at_once
        into = eliminate(gone, left, right, vectors, inverse)
        stays = np.ones(n, dtype=bool)
        stays[gone] = False
        kept = np.flatnonzero(stays)
        held[left] = held[right] = False
        self.diagonal, self.coupling = diagonal[kept], coupling[kept]
        self.border, self.held = border[kept], held[kept]
        return _Level(gone, left, right, kept, vectors, inverse, into)

    def _in_parts(
        self,
        gone: NDArray[np.int64],
        left: NDArray[np.int64],
        right: NDArray[np.int64],
        vectors: Array,
        inverse: Array,
    ) -> Array:
        """Take nodes out of a ring, product by product, which decides the last bits of stored spectra."""
        diagonal, coupling, border = self.diagonal, self.coupling, self.border
        into_left = coupling[left] @ vectors
        into_right = np.swapaxes(coupling[gone], 1, 2) @ vectors
        into_border = np.swapaxes(border[gone], 1, 2) @ vectors
        scaled_left, scaled_right = into_left * inverse[:, None, :], into_right * inverse[:, None, :]
        t_right, t_border = np.swapaxes(into_right, 1, 2), np.swapaxes(into_border, 1, 2)
        diagonal[left] -= scaled_left @ np.swapaxes(into_left, 1, 2)
        diagonal[right] -= scaled_right @ t_right
        border[left] -= scaled_left @ t_border
        border[right] -= scaled_right @ t_border
        self.corner -= ((into_border * inverse[:, None, :]) @ t_border).sum(axis=0)
        coupling[left] = -scaled_left @ t_right
        return np.concatenate((into_left, into_right, into_border), axis=1)

    def _at_once(
        self,
        gone: NDArray[np.int64],
        left: NDArray[np.int64],
        right: NDArray[np.int64],
        vectors: Array,
        inverse: Array,
    ) -> Array:
        """Take nodes out of a row in two products, each of which takes as long as one of those above."""
        diagonal, coupling, border = self.diagonal, self.coupling, self.border
        beside = (coupling[left], np.swapaxes(coupling[gone], 1, 2), np.swapaxes(border[gone], 1, 2))
        into: Array = np.concatenate(beside, axis=1) @ vectors
        lost = (into * inverse[:, None, :]) @ np.swapaxes(into, 1, 2)
        one, other, edge = slice(0, BLOCK), slice(BLOCK, 2 * BLOCK), slice(2 * BLOCK, None)
        diagonal[left] -= lost[:, one, one]
        diagonal[right] -= lost[:, other, other]
        border[left] -= lost[:, one, edge]
        border[right] -= lost[:, other, edge]
        self.corner -= lost[:, edge, edge].sum(axis=0)
        coupling[left] = -lost[:, one, other]
        return into


def _forward_at_once(levels: list[_Level], b: Array, edge: Array) -> tuple[Array, list[Array]]:
    """`_forward` in a row, with what a node gives to others in one product."""
    stack = []
    for level in levels:
        y = np.swapaxes(level.vectors, 1, 2) @ b[level.gone]
        given = level.into @ (level.inverse[:, :, None] * y)
        b[level.left] -= given[:, :BLOCK]
        b[level.right] -= given[:, BLOCK : 2 * BLOCK]
        edge -= given[:, 2 * BLOCK :].sum(axis=0)
        stack.append(y)
        b = b[level.kept]
    return b, stack


def _backward_at_once(levels: list[_Level], stack: list[Array], x: Array, edge: Array) -> Array:
    """`_backward` in a row, with what a node has of others in one product."""
    for level, y in zip(reversed(levels), reversed(stack), strict=True):
        full = np.empty((level.gone.size + level.kept.size, *x.shape[1:]))
        full[level.kept] = x
        beyond = np.broadcast_to(edge, (level.gone.size, *edge.shape))
        others = np.concatenate((full[level.left], full[level.right], beyond), axis=1)
        known = np.swapaxes(level.into, 1, 2) @ others
        full[level.gone] = level.vectors @ (level.inverse[:, :, None] * (y - known))
        x = full
    return x


def _forward(levels: list[_Level], b: Array, edge: Array) -> tuple[Array, list[Array]]:
    """Take right-hand sides b (n,12,k) to the nodes that are left, and to the border's `edge` in place; also
    what the way back needs."""
    stack = []
    for level in levels:
        y = np.swapaxes(level.vectors, 1, 2) @ b[level.gone]
        w = level.inverse[:, :, None] * y
        b[level.left] -= level.into_left @ w
        b[level.right] -= level.into_right @ w
        edge -= (level.into_border @ w).sum(axis=0)
        stack.append(y)
        b = b[level.kept]
    return b, stack


def _backward(levels: list[_Level], stack: list[Array], x: Array, edge: Array) -> Array:
    """From solutions x at the nodes that are left, and at the border, to those at all nodes."""
    for level, y in zip(reversed(levels), reversed(stack), strict=True):
        full = np.empty((level.gone.size + level.kept.size, *x.shape[1:]))
        full[level.kept] = x
        known = np.swapaxes(level.into_left, 1, 2) @ full[level.left]
        known += np.swapaxes(level.into_right, 1, 2) @ full[level.right]
        known += np.swapaxes(level.into_border, 1, 2) @ edge
        full[level.gone] = level.vectors @ (level.inverse[:, :, None] * (y - known))
        x = full
    return x


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
            ring = _Chain(*self._blocks(0, n), corner, ring=True)
        else:
            c = len(self._bounds)
            ring = _Chain(
                np.zeros((c, BLOCK, BLOCK)),
                np.zeros((c, BLOCK, BLOCK)),
                np.zeros((c, BLOCK, width)),
                np.zeros(c, dtype=bool),
                corner,
                ring=True,
            )
            for k in range(c):
                self._join_chain(ring, k, keep=keep)
        ring.reduce(keep=keep)
        self._ring, self._width = ring, width
        parts = _pivot(_join(ring.diagonal, ring.coupling, ring.border, corner)[None])
        self._last = (parts[0][0], parts[1][0])
        # Held components stand in K as ones on the diagonal, whatever the metric: no eigenvalues of W_c.
        ones = int((matrix.metric[matrix.fixed] * shift > 1.0).sum()) if metric is None else 0
        self.negative: int = ring.negative + parts[2] - matrix.duals - ones
        self.gap = min(ring.gap, parts[3])

    def _blocks(self, first: int, last: int) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
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

    def _join_chain(self, ring: _Chain, k: int, *, keep: bool) -> None:
        """Reduce chain k to its first node and the next chain's; add what is left to their ring."""
        after = (k + 1) % len(self._bounds)
        diagonal, coupling, border, held = self._blocks(*self._bounds[k])
        ring.diagonal[k] += diagonal[0]
        ring.border[k] += border[0]
        diagonal[0], border[0] = 0.0, 0.0
        end = np.zeros((1, BLOCK, BLOCK))
        chain = _Chain(
            np.concatenate((diagonal, end)),
            np.concatenate((coupling, end)),
            np.concatenate((border, np.zeros((1, *border.shape[1:])))),
            np.append(held, False),
            ring.corner,
            ring=False,
        )
        chain.reduce(keep=keep)
        ring.diagonal[k] += chain.diagonal[0]
        ring.border[k] += chain.border[0]
        ring.diagonal[after] += chain.diagonal[1]
        ring.border[after] += chain.border[1]
        ring.coupling[k] = chain.coupling[0]
        ring.held[k] = chain.held[0]
        ring.negative += chain.negative
        ring.gap = min(ring.gap, chain.gap)
        chain.diagonal = chain.coupling = chain.border = np.empty(0)
        self._chains.append(chain)

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
        position = self.matrix.positions
        ordered = np.empty_like(columns)
        ordered[position] = columns
        inner, count = ordered.shape[0] - self._width, ordered.shape[1]
        b, edge = ordered[:inner].reshape(-1, BLOCK, count), ordered[inner:].copy()
        stacks = []
        if self._chains:
            on_ring = b[[first for first, _ in self._bounds]]
            for k, (first, last) in enumerate(self._bounds):
                inside = np.zeros((last - first + 1, BLOCK, count))
                inside[1:-1] = b[first + 1 : last]
                ends, stack = _forward_at_once(self._chains[k].levels, inside, edge)
                on_ring[k] += ends[0]
                on_ring[(k + 1) % len(self._bounds)] += ends[1]
                stacks.append(stack)
        else:
            on_ring = b
        rest, ring_stack = _forward(self._ring.levels, on_ring, edge)
        vectors, inverse = self._last
        rest = vectors @ (inverse[:, None] * (vectors.T @ np.concatenate((rest.reshape(-1, count), edge))))
        inside_size = rest.shape[0] - self._width
        x, edge = rest[:inside_size].reshape(-1, BLOCK, count), rest[inside_size:]
        x = _backward(self._ring.levels, ring_stack, x, edge)
        if self._chains:
            for k, (first, last) in enumerate(self._bounds):
                ends = x[[k, (k + 1) % len(self._bounds)]]
                b[first:last] = _backward_at_once(self._chains[k].levels, stacks[k], ends, edge)[:-1]
            x = b
        out: Array = np.concatenate((x.reshape(-1, count), edge))[position]
        return out.reshape(rhs.shape)


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
