"""The KKT matrix of a strip that rests on itself.

A gap depends on a few node positions, rulings and tangents anywhere on the strip. Copies z of these (q
numbers) are unknowns besides x, with rows that say so, and the rows of gaps that are to be kept stand on z
alone:

    [ W    A^T  0    Z  C^T  0   ]       x,
    [ A    0    0    0  0    0   ]       constraints,
    [ 0    0    0    0  0    D   ]       gaps,
    [ Z^T  0    0    0  0    0   ]       gauge,
    [ C    0    0    0  0    B   ]       copies, C x + B z = 0,
    [ 0    0    D^T  0  B^T  S   ]       z, with S = -f.g'' for forces f.

The position of a touched node differs from that of the touched node before it by h times the sum of the
tangents between them, so that all copies together add at most N entries a component: the matrix stays
sparse. Its first block and its order of pivots are the base matrix's, z with its rows and those of gaps
join the border of the block reduction, and negative eigenvalues beyond one for each row are, by
Haynsworth's additivity, those of the projected Hessian on the null space of constraints and gaps.

The regularisation delta is subtracted from copies as well, so that no pivot is zero where S is. That makes
W_c less, never more: where no pivot is surplus all the same, W_c is positive definite.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..model.band import Array
from ..model.problem import LocalDerivatives, Problem
from ..model.sparsity import Scatter
from ..model.touching_gaps import NODE, RULING, TANGENT, Arguments
from .kkt import BLOCK, KKTMatrix, NodeBlocks, Pattern, pattern_of

IntArray = NDArray[np.int64]

KINDS = 1 << 40
"""Numbers of vectors are less."""


@dataclass(frozen=True)
class Copies:
    """Which vectors are copied: `kind` and `number` (c,), sorted; `slot` (k,6) is the copy of each of a gap's
    six, and `coupled` (m,2) are the copies, the lower first, that share an entry of S. Nodes come first, in
    their order."""

    kind: IntArray
    number: IntArray
    slot: IntArray
    coupled: IntArray

    @classmethod
    def of(cls, what: Arguments, spare: Copies | None = None) -> Copies:
        """The copies that gaps need, and those of a reserve, which keeps the pattern of the matrix the same
        while gaps come and go."""
        key = what.kind * KINDS + what.number
        known = np.empty(0, dtype=np.int64) if spare is None else spare.kind * KINDS + spare.number
        every = np.union1d(key, known)
        slot, count = np.searchsorted(every, key), len(every)
        one, other = slot[:, :, None], slot[:, None, :]
        coupled = np.unique((one * count + other)[one <= other])
        if spare is not None:
            again = np.searchsorted(every, known)[spare.coupled]
            coupled = np.union1d(coupled, again[:, 0] * count + again[:, 1])
        couples = np.stack(np.divmod(coupled, count), axis=-1) if count else np.empty((0, 2), np.int64)
        return cls(every // KINDS, every % KINDS, slot, couples)

    @property
    def size(self) -> int:
        """q, three for each."""
        return 3 * len(self.kind)

    @property
    def extent(self) -> tuple[int, int]:
        """How many copies there are, and how many share an entry: neither grows while a reserve serves."""
        return len(self.kind), len(self.coupled)

    def key(self, gaps: int) -> tuple[bytes, ...]:
        """What patterns depend on, with rows for the first gaps."""
        return tuple(a.tobytes() for a in (self.kind, self.number, self.coupled, self.slot[:gaps]))

    def summed(self, hessian: Array) -> Array:
        """The blocks (m,3,3) of S at `coupled`, from Hessians (k,18,18) of gaps."""
        count = len(self.kind)
        one, other = np.broadcast_arrays(self.slot[:, :, None], self.slot[:, None, :])
        upper = one <= other
        where = np.searchsorted(
            self.coupled[:, 0] * count + self.coupled[:, 1], one[upper] * count + other[upper]
        )
        blocks = hessian.reshape(-1, 6, 3, 6, 3).swapaxes(2, 3)[upper].reshape(-1, 9)
        places = 9 * where[:, None] + np.arange(9)
        size = 9 * len(self.coupled)
        out = np.bincount(places.ravel(), weights=blocks.ravel(), minlength=size)
        return out.astype(np.float64, copy=False).reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False)
class Touched:
    """What gaps bring into the matrix: their `jacobian` (k,6,3) in their six vectors, one row for each
    that is kept, and the Hessian (m,18,18) in z of all that push, those that are kept first."""

    copies: Copies
    jacobian: Array
    hessian: Array


@dataclass(frozen=True)
class RestingDerivatives(LocalDerivatives):
    """Derivatives with gaps: energy, gradient and constraints are complete, the local ones those of `free`,
    of the problem `base` without gaps."""

    base: Problem
    free: LocalDerivatives
    touched: Touched | None

    def keeping(self, count: int) -> RestingDerivatives:
        """The same with the rows of the first gaps only: what forces add to the Hessian stays."""
        if self.touched is None:
            return self
        return replace(self, touched=replace(self.touched, jacobian=self.touched.jacobian[:count]))

    def convex(self) -> RestingDerivatives:
        """The same without what makes the Hessian of any gap, as it enters that of the energy, negative."""
        if self.touched is None:
            return self
        values, axes = np.linalg.eigh(self.touched.hessian)
        positive = (axes * np.maximum(values, 0.0)[:, None, :]) @ axes.transpose(0, 2, 1)
        return replace(self, touched=replace(self.touched, hessian=positive))


def copy_columns(problem: Problem, copies: Copies) -> tuple[IntArray, IntArray, Array]:
    """Rows, columns of x and values of C, (e,) each: rows as copies are numbered, component by component.
    What is held is left out."""
    h, n, strip = problem.band.h, problem.band.segments, problem.stencil.seam.strip
    rows, columns, values = [], [], []
    before = 0
    for j, (kind, number) in enumerate(zip(copies.kind.tolist(), copies.number.tolist(), strict=True)):
        if kind == NODE:
            between = np.arange(before, number)
            first, weight, before = 7 * between, h, number
        elif kind == TANGENT:
            first, weight = np.array([7 * number]), 1.0
        elif strip and number == 0:
            first, weight = np.empty(0, dtype=np.int64), 1.0  # held: g_1 of a strip is no unknown
        else:
            first, weight = np.array([7 * (number % n) + 3]), 1.0
        for i in range(3):
            rows.append(np.full(first.size, 3 * j + i))
            columns.append(first + i)
            values.append(np.full(first.size, weight))
    at = np.concatenate(columns)
    free = ~problem.fixed[at]
    return np.concatenate(rows)[free], at[free], np.concatenate(values)[free]


def on_copies(copies: Copies, local: Array) -> Array:
    """Gradients (k,6,3) in gaps' six vectors, summed on copies (c,3)."""
    out = np.zeros((len(copies.kind), 3))
    np.add.at(out, copies.slot.ravel(), local.reshape(-1, 3))
    return out


def pulled_back(problem: Problem, copies: Copies, forces: Array) -> Array:
    """C^T-like: what forces (...,c,3) on copies are on x (...,7N), copies of positions summed along the
    strip."""
    flat = pulled_with_data(problem, copies, forces)[..., : problem.size]
    flat[..., problem.fixed] = 0.0
    return flat


def pulled_with_data(problem: Problem, copies: Copies, forces: Array) -> Array:
    """The same on what is held as well, and on data: t_A, g_1 and t_B of a strip."""
    h, n, strip = problem.band.h, problem.band.segments, problem.stencil.seam.strip
    each = forces.shape[:-2]
    out, data = np.zeros((*each, n, 7)), np.zeros((*each, problem.stencil.seam.data))
    on_nodes = np.zeros((*each, n + 2, 3))
    nodes = copies.kind == NODE
    on_nodes[..., copies.number[nodes], :] = forces[..., nodes, :]
    later = np.cumsum(on_nodes[..., ::-1, :], axis=-2)[..., ::-1, :]
    out[..., :3] += h * later[..., 1 : n + 1, :]
    tangents = copies.kind == TANGENT
    out[..., copies.number[tangents], :3] += forces[..., tangents, :]
    start = (copies.kind == RULING) & (copies.number == 0) & strip
    rulings = (copies.kind == RULING) & ~start
    by_node = np.moveaxis(out[..., 3:6], -2, 0)  # a closed band's node N is node 0
    np.add.at(by_node, copies.number[rulings] % n, np.moveaxis(forces[..., rulings, :], -2, 0))
    if start.any():
        data[..., 3:6] = forces[..., start, :].sum(axis=-2)
    return np.concatenate((out.reshape(*each, 7 * n), data), axis=-1)


@dataclass(frozen=True, eq=False)
class _Layout:
    """A pattern and where its entries come from: base entries, then C, B, D, S in this order; `rows`,
    `columns` and `values` are those of C."""

    pattern: Pattern
    rows: IntArray
    columns: IntArray
    values: Array
    links: IntArray
    six: IntArray
    s_rows: IntArray
    s_columns: IntArray
    upper_half: NDArray[np.bool_]


_layouts: dict[tuple[object, ...], _Layout] = {}
"""Patterns made lately, by what they depend on."""
KEPT_LAYOUTS = 16


def _layout(problem: Problem, base: KKTMatrix, copies: Copies, gaps: int) -> _Layout:
    key = (base.pattern, gaps, problem.band.h, problem.fixed.tobytes(), *copies.key(gaps))
    known = _layouts.get(key)
    if known is None:
        if len(_layouts) >= KEPT_LAYOUTS:
            _layouts.pop(next(iter(_layouts)))
        known = _layouts[key] = _build(problem, base, copies, gaps)
    return known


def _build(problem: Problem, base: KKTMatrix, copies: Copies, gaps: int) -> _Layout:
    rows, columns, values = copy_columns(problem, copies)
    q, constraints = copies.size, base.size + base.border - base.gauge
    first_copy = base.size + base.border + gaps
    first_z = first_copy + q
    total = first_z + q
    upper = base.pattern.upper
    old_columns = np.repeat(np.arange(upper.shape[1]), np.diff(upper.indptr))
    old_rows = upper.indices.astype(np.int64)

    def moved(index: IntArray) -> IntArray:
        return np.where(index < constraints, index, index + gaps)

    z = first_z + np.arange(q)
    chained = np.flatnonzero(copies.kind == NODE)[1:]
    links = (3 * chained[:, None] + np.arange(3)).ravel()
    six = (3 * copies.slot[:gaps, :, None] + np.arange(3)).reshape(gaps, 18)
    one, other = 3 * copies.coupled[:, 0], 3 * copies.coupled[:, 1]
    i, j = np.divmod(np.arange(9), 3)
    s_rows, s_columns = (one[:, None] + i).ravel(), (other[:, None] + j).ravel()
    half = s_rows <= s_columns
    every = np.arange(total)
    all_rows = (
        moved(old_rows),
        columns,
        first_copy + np.arange(q),
        first_copy + links,
        np.repeat(constraints + np.arange(gaps), 18),
        first_z + s_rows[half],
        every,
    )
    all_columns = (
        moved(old_columns),
        first_copy + rows,
        z,
        z[links - 3],
        first_z + six.ravel(),
        first_z + s_columns[half],
        every,
    )
    scatter = Scatter.build(np.concatenate(all_rows), np.concatenate(all_columns), (total, total))
    return _Layout(
        pattern_of(scatter), rows, columns, values, links, six, s_rows[half], s_columns[half], half
    )


class RestingMatrix(KKTMatrix):
    """The matrix above, scaled; it serves wherever a `KKTMatrix` does. `base` is that without gaps."""

    def __init__(self, problem: Problem, base: KKTMatrix, touched: Touched) -> None:
        copies, gaps = touched.copies, len(touched.jacobian)
        q = copies.size
        self.base, self.copies = base, copies
        self.size, self.fixed, self.metric = base.size, base.fixed, base.metric
        self.rotations, self.gauge = base.rotations, base.gauge
        self.duals = base.border + gaps + q
        self.border = self.duals + q
        self.tail = base.gauge + 2 * q
        layout = self._layout = _layout(problem, base, copies, gaps)
        self.pattern = layout.pattern
        sx = float(np.sqrt(problem.band.h / problem.band.half_width))
        constraints = base.size + base.border - base.gauge
        self.scale = np.concatenate(
            (
                base.scale[:constraints],
                np.full(gaps, 1.0 / sx),
                base.scale[constraints:],
                np.full(q, 1.0 / sx),
                np.full(q, sx),
            )
        )
        self._c = layout.values * base.scale[layout.columns] / sx
        self._d = touched.jacobian.reshape(gaps, 18)
        self._s = copies.summed(touched.hessian).ravel()[layout.upper_half] * sx**2
        self._fill(
            self.pattern.upper.data(
                np.concatenate(
                    (
                        base.upper.data,
                        self._c,
                        np.full(q, -1.0),
                        np.ones(layout.links.size),
                        self._d.ravel(),
                        self._s,
                        np.zeros(self.size + self.border),
                    )
                )
            )
        )

    def _with_diagonal(self, diagonal: Array) -> RestingMatrix:
        """The same matrix with a diagonal one (7N,), in scaled unknowns, for the Hessian, and none on
        copies."""
        out = copy(self)
        out.__dict__.pop("node_blocks", None)
        out._s = np.zeros_like(self._s)
        out.base = self.base._with_diagonal(diagonal)
        data = self.upper.data.copy()
        data[: self.upper.indptr[self.size]] = 0.0
        data[self.pattern.diagonal[: self.size]] = diagonal
        row, first = self.upper.indices, self.size + self.duals
        z = slice(self.upper.indptr[first], None)
        data[z][row[z] >= first] = 0.0
        out._fill(data)
        return out

    @cached_property
    def node_blocks(self) -> NodeBlocks:
        """The base's blocks with gaps, copies' rows and copies in the border."""
        inner, q, gaps = self.base.node_blocks, self.copies.size, len(self._d)
        n, _, width = inner.border.shape
        beyond = np.zeros((n * BLOCK, gaps + 2 * q))
        columns = self._layout.columns
        beyond[BLOCK * (columns // 7) + columns % 7, gaps + self._layout.rows] = self._c
        corner = np.zeros((width + gaps + 2 * q,) * 2)
        gap, row, z = width, width + gaps, width + gaps + q
        at, links, layout = np.arange(q), self._layout.links, self._layout
        corner[row + at, z + at] = -1.0
        corner[row + links, z + links - 3] = 1.0
        places = (np.repeat(gap + np.arange(gaps), 18), z + layout.six.ravel())
        np.add.at(corner, places, self._d.ravel())
        np.add.at(corner, (z + layout.s_rows, z + layout.s_columns), self._s)
        corner = np.triu(corner) + np.triu(corner, 1).T
        last, constraints = BLOCK * n + width, self.base.size + self.base.border - self.gauge
        position = np.concatenate(
            (
                inner.position[:constraints],
                last + np.arange(gaps),
                inner.position[constraints:],
                last + gaps + np.arange(2 * q),
            )
        )
        border = np.concatenate((inner.border, beyond.reshape(n, BLOCK, -1)), axis=2)
        return NodeBlocks(position, inner.diagonal, inner.coupling, border, inner.held, corner)

    @property
    def positions(self) -> IntArray:
        """As in the base class."""
        return self.node_blocks.position

    @property
    def corner(self) -> Array:
        """As in the base class."""
        corner = self.node_blocks.corner
        assert corner is not None
        return corner

    def blocks_between(self, first: int, last: int) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """As in the base class, from the blocks of all nodes."""
        blocks, part = self.node_blocks, slice(first, last)
        return (
            blocks.diagonal[part].copy(),
            blocks.coupling[part].copy(),
            blocks.border[part].copy(),
            blocks.held[part].copy(),
        )


def kkt_matrix(problem: Problem, local: LocalDerivatives, rotations: Array) -> KKTMatrix:
    """The KKT matrix of a problem, with gaps and copies where its derivatives have some."""
    if not isinstance(local, RestingDerivatives):
        return KKTMatrix(problem, local, rotations)
    base = KKTMatrix(local.base, local.free, rotations)
    return base if local.touched is None else RestingMatrix(local.base, base, local.touched)
