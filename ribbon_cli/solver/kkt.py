"""The scaled, sparse KKT matrix of a problem, Koldaev (2022), (2.57), with rotations held.

K = [[W, A^T, Z], [A, -delta, 0], [Z^T, 0, -delta]] in the order x (7N), constraints (5N+3), gauge (r),
where Z holds the tangents of the rigid rotations (exact zero modes of a free band). Rows and columns
are scaled by fixed powers of h and b, so that entries are of order one at every N.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse._sparsetools import csc_matvec, csc_matvecs, csr_matvec, csr_matvecs

from ..model.band import Array, Band
from ..model.entries import JACOBIAN_COLUMNS, JACOBIAN_ROWS, PER_NODE, hessian_places
from ..model.problem import END_ROW, Layout, LocalDerivatives, Problem
from ..model.sparsity import COMPACT_FROM, IntArray, Scatter, stretched, taken
from ..model.stencil import Seam, indices
from .ldl import Ldl, Symbolic

BLOCK = 7 + PER_NODE
FINE = 3200
"""Segments beyond which memory counts: patterns and factors that could serve again are not all kept."""
TEMPLATE = 20
"""Segments of the small grid from which patterns are stretched, of which half are clear of the seam."""
DIRECTLY = 1000
"""Segments up to which stretching takes as long as sorting."""
_ZERO = np.zeros(1)
ROWS_AT_ONCE = 1 << 16
"""Rows of the matrix that are in extended precision at one time."""


Places = list[tuple[IntArray, IntArray]]
"""For each array of blocks the data that it takes, and where in it they go."""


class FactorisationError(ArithmeticError):
    """The KKT matrix is singular or not finite."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """The upper triangle's pattern and the way to the whole symmetric matrix; one for each N.

    `diagonal` are the places of the diagonal in the upper triangle's data, which becomes the whole matrix's
    by data[whole_source]; the matrices are empty ones to fill. `idle` factors share this pattern's `symbolic`
    part. `chains` are places of nodes in a row by their first node and their number, `scales` the scaling of
    a band.
    """

    upper: Scatter
    diagonal: NDArray[np.int64]
    upper_matrix: scipy.sparse.csc_matrix
    whole_matrix: scipy.sparse.csr_matrix
    whole_source: IntArray
    symbolic: list[Symbolic] = field(default_factory=list)
    idle: list[Ldl] = field(default_factory=list)
    chains: dict[tuple[int, int], list[Places]] = field(default_factory=dict)
    scales: dict[Band, tuple[Array, Array]] = field(default_factory=dict)

    def forget(self) -> None:
        """Let symbolic factorisations go."""
        self.symbolic.clear()
        self.idle.clear()


def _pattern(layout: Layout, rotations: int) -> Pattern:
    """The pattern of a layout; of fine grids the last alone is kept."""
    return (_last_pattern if layout.segments > FINE else _kept_pattern)(layout, rotations)


def _built_pattern(layout: Layout, rotations: int) -> Pattern:
    """Build the pattern: that of a small grid, or one stretched from two of these."""
    if layout.segments <= DIRECTLY:
        return pattern_of(_upper(layout, rotations))
    return _stretched_pattern(layout, rotations)


def _upper(layout: Layout, rotations: int) -> Scatter:
    """The upper triangle, in the order of entries of `KKTMatrix`."""
    n, size, closing = layout.segments, 7 * layout.segments, layout.seam.closing
    # What is not an unknown carries zeros only.
    index = indices(n, layout.seam)[1].astype(np.int32)
    one, other = (index[place] for place in hessian_places(layout.couplings))
    jac_columns = size + layout.row_places()[JACOBIAN_ROWS]
    tangents = (7 * np.arange(n)[:, None] + np.arange(closing)).ravel()
    close_columns = size + PER_NODE * n + np.tile(np.arange(closing), n)
    moving = (7 * np.arange(n)[:, None] + np.arange(6)).ravel()
    first_gauge = size + layout.rows
    total = first_gauge + rotations
    gauge_columns = first_gauge + np.repeat(np.arange(rotations), moving.size)
    every = np.arange(total)
    rows = (np.minimum(one, other), index[JACOBIAN_COLUMNS], tangents, np.tile(moving, rotations), every)
    columns = (np.maximum(one, other), jac_columns, close_columns, gauge_columns, every)
    return Scatter.build(
        np.concatenate([r.ravel().astype(np.int32, copy=False) for r in rows]),
        np.concatenate([c.ravel().astype(np.int32, copy=False) for c in columns]),
        (total, total),
        zeros=total,
    )


def _stretched_pattern(layout: Layout, rotations: int) -> Pattern:
    """The pattern of many nodes from those of `TEMPLATE` and of one more.

    All nodes but those near the seam are alike. So each array is a row of runs with a few numbers a node: the
    entries of one kind, the unknowns' columns, the constraints', and each column of closure and gauge.
    """
    few = [replace(layout, segments=TEMPLATE + k) for k in (0, 1)]
    pair = [pattern_of(_upper(each, rotations)) for each in few]
    more, n = layout.segments - TEMPLATE, layout.segments
    tail = layout.seam.closing + rotations
    total = BLOCK * n + tail

    def joined(arrays: list[IntArray], cuts: list[list[int]], *, compact: bool) -> IntArray:
        """The arrays of both, cut into runs, for `n` nodes."""
        kind = np.int32 if compact else np.int64
        runs = zip(*(np.split(a.astype(kind), cut) for a, cut in zip(arrays, cuts, strict=True)), strict=True)
        return np.concatenate([stretched(one, other, more, TEMPLATE) for one, other in runs])

    def of_columns(pointers: list[NDArray[np.int32]]) -> list[list[int]]:
        """Where the columns of unknowns and of constraints end, and each that comes after them."""
        ends = [[7 * m, *range(BLOCK * m, BLOCK * m + tail)] for m in (TEMPLATE, TEMPLATE + 1)]
        return [p[end].tolist() for p, end in zip(pointers, ends, strict=True)]

    def pointer(pointers: list[NDArray[np.int32]]) -> NDArray[np.int32]:
        cuts = [[7 * m, BLOCK * m] for m in (TEMPLATE, TEMPLATE + 1)]
        return joined(list(pointers), cuts, compact=True).astype(np.int32, copy=False)

    uppers, wholes = [p.upper for p in pair], [p.whole_matrix for p in pair]
    above, beside = [u.indptr for u in uppers], [w.indptr for w in wholes]
    kinds = [_kinds(each, rotations) for each in few]
    slots = sum(kinds[0]) + more * (sum(kinds[1]) - sum(kinds[0]))
    starts = [np.cumsum(sizes)[:-1].tolist() for sizes in kinds]
    slot = joined([u.slot for u in uppers], starts, compact=slots > COMPACT_FROM)
    rows = joined([u.indices for u in uppers], of_columns(above), compact=True)
    upper = Scatter((total, total), pointer(above), rows, slot, total)
    columns = joined([w.indices for w in wholes], of_columns(beside), compact=True)
    sources = [p.whole_source for p in pair]
    source = joined(sources, of_columns(beside), compact=columns.size > COMPACT_FROM)
    return _empty_pattern(upper, pointer(beside), columns, source)


def _kinds(layout: Layout, rotations: int) -> list[int]:
    """How many entries of each kind there are, in their order."""
    n, closing = layout.segments, layout.seam.closing
    nodes = n + 1 if layout.seam.strip else n
    local = hessian_places(layout.couplings)[0].size + JACOBIAN_ROWS.size
    return [*[nodes] * local, closing * n, *[6 * n] * rotations, 7 * n, PER_NODE * n, closing + rotations]


_kept_pattern = lru_cache(maxsize=64)(_built_pattern)


@lru_cache(maxsize=1)
def _last_pattern(layout: Layout, rotations: int) -> Pattern:
    """Build the pattern of a fine grid; that of the one before goes first."""
    _last_pattern.cache_clear()
    return _built_pattern(layout, rotations)


def let_go() -> None:
    """Let the pattern of the last fine grid go, and the factors that wait there for another matrix."""
    _last_pattern.cache_clear()


def pattern_of(upper: Scatter) -> Pattern:
    """The pattern of a symmetric matrix from that of its upper triangle, whose diagonal is full."""
    # Sorted columns of an upper triangle end on the diagonal.
    diagonal = upper.indptr[1:].astype(np.int64) - 1
    places = np.arange(1, upper.indices.size + 1, dtype=np.int32)  # not zero, which a sum would leave out
    above = scipy.sparse.csc_matrix((places, upper.indices, upper.indptr), shape=upper.shape)
    below = above.T.copy()
    below.data[diagonal] = 0
    whole = below + above.tocsr()
    source = whole.data - 1
    source = source if source.size > COMPACT_FROM else source.astype(np.int64)
    return _empty_pattern(upper, whole.indptr, whole.indices, source)


def _empty_pattern(upper: Scatter, indptr: NDArray[np.int32], indices: IntArray, source: IntArray) -> Pattern:
    """The pattern with its empty matrices; `indptr` and `indices` are the whole matrix's."""
    shape, diagonal = upper.shape, upper.indptr[1:].astype(np.int64) - 1
    empty = scipy.sparse.csc_matrix((_no_data(upper.indices.size), upper.indices, upper.indptr), shape=shape)
    whole = scipy.sparse.csr_matrix((_no_data(indices.size), indices, indptr), shape=shape)
    return Pattern(upper, diagonal, empty, whole, source)


def _no_data(size: int) -> Array:
    """Data (size,) of a matrix to be filled, which take no memory."""
    return np.broadcast_to(np.zeros(1), size)


def _filled(like: scipy.sparse.spmatrix, data: Array) -> scipy.sparse.spmatrix:
    """A matrix of the same pattern, unchecked: scipy's constructors take longer than a product at N = 100."""
    out = like.__class__.__new__(like.__class__)
    out.__dict__.update(like.__dict__)
    out.data = data
    return out


def _scales(band: Band, seam: Seam, pattern: Pattern, rotations: int) -> tuple[Array, Array]:
    """The scaling of rows and columns, and its effect on the entries of the upper triangle; the pattern keeps
    the last."""
    if band not in pattern.scales:
        scale = scaling(band, seam, rotations)
        of_columns = np.repeat(scale, np.diff(pattern.upper.indptr))
        of_columns *= taken(scale, pattern.upper.indices)
        pattern.scales.clear()
        pattern.scales[band] = scale, of_columns
    return pattern.scales[band]


def scaling(band: Band, seam: Seam, rotations: int) -> Array:
    """Symmetric scaling s (7N+5N+3+r,) that makes the entries of diag(s) K diag(s) of order one.

    From the sizes of the blocks: W_uu ~ b/h; weighted constraint rows ~ h, h, 1, 1, b; W_xixi ~ b h,
    with the xi column of the last row ~ h.
    """
    n, h, b = band.segments, band.h, band.half_width
    sx = np.sqrt(h / b)
    x = np.full((n, 7), sx)
    x[:, 6] = 1.0 / sx
    rows = np.tile(np.array([1.0 / h, 1.0 / h, 1.0, 1.0, 1.0 / b]) / sx, n)
    if seam is Seam.HELD:
        rows[END_ROW] = 1.0 / sx
    return np.concatenate(
        (x.ravel(), rows, np.full(seam.closing, 1.0 / (h * sx)), np.full(rotations, np.sqrt(n) / sx))
    )


@dataclass(frozen=True)
class NodeBlocks:
    """K node by node: `diagonal` (N,12,12), `coupling` to the next node (N,12,12), `border` (N,12,c),
    and the nodes whose ruling is `held` (N,).

    `position` is the place of every row of K in this order, border (closure, gauge) last; unknowns and the
    rows of nodes come first in K as well. `corner` (c,c) is the border's own block where that is not zero.
    """

    position: NDArray[np.int64]
    diagonal: Array
    coupling: Array
    border: Array
    held: NDArray[np.bool_]
    corner: Array | None = None


class KKTMatrix:
    """The KKT matrix at one point; `upper` is the scaled upper triangle without regularisation.

    `scale` is s above; `size` is 7N, `border` what comes after x: first `duals` rows of multipliers and
    gauge, here all of it; `tail` is what comes after the constraints' rows. `metric` (7N,) is the
    Euclidean metric's diagonal in scaled unknowns, which shifts multiply.
    """

    def __init__(self, problem: Problem, local: LocalDerivatives, rotations: Array) -> None:
        n = problem.band.segments
        self.size = problem.size
        self.rotations = rotations
        self.gauge = rotations.shape[1]
        self.border = self.duals = problem.rows + self.gauge
        self.tail = self.gauge
        self.fixed = problem.fixed
        seam = problem.stencil.seam
        self.pattern = _pattern(problem.layout, self.gauge)
        self.scale, entry_scale = _scales(problem.band, seam, self.pattern, self.gauge)
        self.metric = self.scale[: self.size] ** 2
        values = np.concatenate(
            (
                local.hessian_entries.ravel(),
                local.jacobian_entries.ravel(),
                np.full(problem.closing * n, problem.band.h),
                rotations.reshape(n, 7, self.gauge)[:, :6].reshape(6 * n, self.gauge).T.ravel(),
                _ZERO,
            )
        )
        data = self.pattern.upper.data(values)
        data *= entry_scale
        if problem.any_fixed:
            data[self.pattern.diagonal[: self.size][problem.fixed]] = 1.0
        self._fill(data)

    def _fill(self, data: Array) -> None:
        """Take the upper triangle's data, in CSC order."""
        self.upper = _filled(self.pattern.upper_matrix, data)
        self.__dict__.pop("whole", None)

    @cached_property
    def whole(self) -> scipy.sparse.csr_matrix:
        """The whole symmetric matrix, made when it is first asked for: parts of other matrices do without."""
        return _filled(self.pattern.whole_matrix, taken(self.upper.data, self.pattern.whole_source))

    @cached_property
    def node_blocks(self) -> NodeBlocks:
        """The matrix as a cyclic block-tridiagonal one with a border."""
        return _node_blocks(self)

    @property
    def positions(self) -> NDArray[np.int64]:
        """The place of every row of K node by node, `NodeBlocks.position`."""
        return _positions(self.size, self.size + self.border)

    @property
    def corner(self) -> Array:
        """The border's own block (c,c)."""
        width = self.size + self.border - BLOCK * (self.size // 7)
        return np.zeros((width, width))

    def blocks_between(self, first: int, last: int) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Diagonal, coupling, border and held of nodes `first` to `last` - 1, for the caller to change.

        Those of a part of the band are made from its rows alone, and not kept.
        """
        if (first, last) != (0, self.size // 7):
            return _blocks_between(self, first, last)
        blocks = self.node_blocks
        return blocks.diagonal.copy(), blocks.coupling.copy(), blocks.border.copy(), blocks.held.copy()

    def with_unit_metric(self) -> KKTMatrix:
        """The same matrix with the identity on the scaled unknowns for the Hessian."""
        return self._with_diagonal(np.ones(self.size))

    def without_hessian(self) -> KKTMatrix:
        """The same matrix with zeros for the Hessian, but ones at held components, for shifts to fill."""
        return self._with_diagonal(self.fixed.astype(np.float64))

    def measured(self, weights: Array) -> KKTMatrix:
        """The same matrix with diag(weights) (7N,) for the metric that shifts multiply."""
        out = copy(self)
        out.metric = weights * self.scale[: self.size] ** 2
        return out

    def _with_diagonal(self, diagonal: Array) -> KKTMatrix:
        """The same matrix with a diagonal one (7N,), in scaled unknowns, for the Hessian."""
        out = copy(self)
        out.__dict__.pop("node_blocks", None)
        data = self.upper.data.copy()
        data[: self.upper.indptr[self.size]] = 0.0
        data[self.pattern.diagonal[: self.size]] = diagonal
        out._fill(data)
        return out

    def product(self, v: Array) -> Array:
        """Scaled K v, for v (n+m+r,) or (n+m+r, k)."""
        if self.size > 7 * FINE:
            return self._product_by_halves(v)
        if v.ndim == 2:
            return np.asarray(self.whole @ v)
        whole, out = self.whole, np.zeros(v.size)
        # What the line above ends with for a vector; on the way there is more to it than this at N = 100.
        csr_matvec(v.size, v.size, whole.indptr, whole.indices, whole.data, v, out)
        return out

    def _product_by_halves(self, v: Array) -> Array:
        """The same by the upper triangle, read twice: making the whole matrix would take three products."""
        upper, out = self.upper, np.zeros(v.shape)
        rows, pattern = v.shape[0], (upper.indptr, upper.indices, upper.data)
        if v.ndim == 2:
            csc_matvecs(rows, rows, v.shape[1], *pattern, v.ravel(), out.ravel())
            csr_matvecs(rows, rows, v.shape[1], *pattern, v.ravel(), out.ravel())
            out -= upper.data[self.pattern.diagonal][:, None] * v
        else:
            csc_matvec(rows, rows, *pattern, v, out)
            csr_matvec(rows, rows, *pattern, v, out)
            out -= upper.data[self.pattern.diagonal] * v
        return out

    def extended_product(self, v: Array) -> NDArray[np.longdouble]:
        """Scaled K v, for v (n+m+r,), in extended precision, a few columns of the upper triangle after the
        other."""
        upper, extended = self.upper, v.astype(np.longdouble)
        out: NDArray[np.longdouble] = -upper.data[self.pattern.diagonal] * extended
        for first in range(0, v.size, ROWS_AT_ONCE):
            last = min(first + ROWS_AT_ONCE, v.size)
            pointer = upper.indptr[first : last + 1]
            some = slice(pointer[0], pointer[-1])
            part = (pointer - pointer[0], upper.indices[some], upper.data[some].astype(np.longdouble))
            csr_matvec(last - first, v.size, *part, extended, out[first:last])
            csc_matvec(v.size, last - first, *part, extended[first:last], out)
        return out

    def regularised(self, shift: float, delta: float) -> scipy.sparse.csc_matrix:
        """Upper triangle of K - shift (on x, Euclidean metric) - delta (on multipliers, scaled)."""
        data = self.upper.data.copy()
        diagonal = self.pattern.diagonal
        if shift:
            data[diagonal[: self.size]] -= shift * self.metric
        data[diagonal[self.size :]] -= delta
        return _filled(self.upper, data)


def _positions(size: int, total: int) -> NDArray[np.int64]:
    """Place of every row of K in the order node by node, border last."""
    n = size // 7
    node = np.arange(n)[:, None]
    return np.concatenate(
        (
            (BLOCK * node + np.arange(7)).ravel(),
            (BLOCK * node + 7 + np.arange(PER_NODE)).ravel(),
            np.arange(BLOCK * n, total),
        )
    )


@lru_cache(maxsize=4)
def _block_places(pattern: Pattern, size: int) -> tuple[NDArray[np.int64], ...]:
    """Where the whole matrix's data goes in the arrays of `NodeBlocks`: sources and flat places of each."""
    n = size // 7
    total = pattern.upper.shape[0]
    position = _positions(size, total)
    rows = np.repeat(position, np.diff(pattern.whole_matrix.indptr))
    columns = position[pattern.whole_matrix.indices]
    tail, width = BLOCK * n, total - BLOCK * n
    owner, other = rows // BLOCK, columns // BLOCK
    within = BLOCK * (BLOCK * owner + rows % BLOCK) + columns % BLOCK
    inside = (rows < tail) & (columns < tail)
    here = np.flatnonzero(inside & (owner == other))
    ahead = np.flatnonzero(inside & (other == (owner + 1) % n))
    edge = np.flatnonzero((rows < tail) & (columns >= tail))
    return here, within[here], ahead, within[ahead], edge, rows[edge] * width + columns[edge] - tail


def _blocks_between(
    matrix: KKTMatrix, first: int, last: int
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """The blocks of `NodeBlocks` for nodes `first` to `last` - 1, of a band with more than two."""
    whole, n, m = matrix.whole, matrix.size // 7, last - first
    width = matrix.size + matrix.border - BLOCK * n
    # Chains of one length are alike but for those that meet the seam.
    like = m if first > 0 and last < n and 2 * m < n else first
    blocks = tuple(np.zeros(m * BLOCK * k) for k in (BLOCK, BLOCK, width))
    known = matrix.pattern.chains
    if (like, m) not in known:
        known[like, m] = _chain_places(matrix.pattern, matrix.size, like, like + m)
    for (start, each), found in zip(((0, 7), (matrix.size, PER_NODE)), known[like, m], strict=True):
        data = whole.data[whole.indptr[start + each * first] :]
        for block, (source, place) in zip(blocks, found, strict=True):
            block[place] = data[source]
    diagonal, coupling, border = blocks
    return (
        diagonal.reshape(m, BLOCK, BLOCK),
        coupling.reshape(m, BLOCK, BLOCK),
        border.reshape(m, BLOCK, width),
        np.any(matrix.fixed.reshape(n, 7)[first:last], axis=1),
    )


def _chain_places(pattern: Pattern, size: int, first: int, last: int) -> list[Places]:
    """Where the data of a chain's rows go, those of unknowns and those of constraints: for diagonal, coupling
    and border the data counted from the first row on, and their flat places."""
    whole, n, m = pattern.whole_matrix, size // 7, last - first
    tail, width = BLOCK * n, whole.shape[0] - BLOCK * n
    out: list[Places] = []
    for start, each, at in ((0, 7, 0), (size, PER_NODE, 7)):
        pointer = whole.indptr[start + each * first : start + each * last + 1]
        columns = whole.indices[pointer[0] : pointer[-1]]
        owner, within = np.divmod(np.repeat(np.arange(each * m), np.diff(pointer)), each)
        line = BLOCK * owner + at + within  # the row among those of the nodes asked for
        unknown = columns < size
        number = np.where(unknown, columns, columns - size)
        node, place = np.divmod(number, np.where(unknown, 7, PER_NODE))
        place += np.where(unknown, 0, 7)
        inside = columns < tail
        places: Places = []
        for here in (owner + first, (owner + first + 1) % n):
            source = np.flatnonzero(inside & (node == here))
            places.append((source, BLOCK * line[source] + place[source]))
        source = np.flatnonzero(~inside)
        places.append((source, width * line[source] + columns[source] - tail))
        out.append(places)
    return out


def _node_blocks(matrix: KKTMatrix) -> NodeBlocks:
    here, at, ahead, beside, edge, beyond = _block_places(matrix.pattern, matrix.size)
    data = matrix.whole.data
    n, total = matrix.size // 7, matrix.size + matrix.border
    width = total - BLOCK * n
    diagonal, coupling, border = (np.zeros(n * BLOCK * k) for k in (BLOCK, BLOCK, width))
    diagonal[at], coupling[beside], border[beyond] = data[here], data[ahead], data[edge]
    held: NDArray[np.bool_] = np.any(matrix.fixed.reshape(n, 7), axis=1)
    return NodeBlocks(
        _positions(matrix.size, total),
        diagonal.reshape(n, BLOCK, BLOCK),
        coupling.reshape(n, BLOCK, BLOCK),
        border.reshape(n, BLOCK, width),
        held,
    )
