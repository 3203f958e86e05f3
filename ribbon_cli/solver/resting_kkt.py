"""The KKT matrix of a strip that rests on itself.

A gap depends on a few node positions, rulings and tangents anywhere on the strip. Copies z of these (q numbers)
are unknowns besides x, with rows that say so, and the rows of gaps that are to be kept stand on z alone:

    [ W    0    A^T  Z  C^T  0   ]       unknowns x, z; rows of constraints, gauge, copies C x + B z = 0,
    [ 0    S    0    0  B^T  D^T ]       gaps D z; S = -f.g'' on z.
    [ A    0    0    0  0    0   ]
    [ Z^T  0    0    0  0    0   ]
    [ C    B    0    0  0    0   ]
    [ 0    D    0    0  0    0   ]

The position of a touched node differs from that of the touched node before it by h times the sum of the tangents
between them, so that all copies together add at most N entries a component: the matrix stays sparse. Its first
block and its order of pivots are the base matrix's, z with its rows and those of gaps join the border of the
block reduction, and negative eigenvalues beyond one for each row are, by Haynsworth's additivity, those of the
projected Hessian on the null space of constraints and gaps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from ..model.band import Array
from ..model.problem import Problem
from ..model.sparsity import Scatter
from ..model.touching_gaps import NODE, RULING, TANGENT, Arguments
from .kkt import BLOCK, KKTMatrix, NodeBlocks, Pattern, filled, pattern_of

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Copies:
    """Which vectors are copied: `kind` and `number` (c,), sorted; `slot` (k,6) is the copy of each of a gap's
    six. Nodes come first, in their order."""

    kind: IntArray
    number: IntArray
    slot: IntArray

    @classmethod
    def of(cls, what: Arguments) -> Copies:
        """The copies that gaps need."""
        key = what.kind * (1 << 40) + what.number
        unique, slot = np.unique(key, return_inverse=True)
        return cls(unique >> 40, unique & ((1 << 40) - 1), slot.reshape(key.shape))

    @property
    def size(self) -> int:
        """q, three for each."""
        return 3 * len(self.kind)

    def key(self) -> tuple[bytes, ...]:
        """What patterns depend on."""
        return self.kind.tobytes(), self.number.tobytes(), self.slot.tobytes()


def copy_columns(problem: Problem, copies: Copies) -> tuple[IntArray, IntArray, Array]:
    """Rows, columns of x and values of C, (e,) each: rows as copies are numbered, component by component."""
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
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


def pulled_back(problem: Problem, copies: Copies, forces: Array) -> Array:
    """C^T-like: what forces (c,3) on copies are on x (7N,), copies of positions summed along the strip."""
    h, n, strip = problem.band.h, problem.band.segments, problem.stencil.seam.strip
    out = np.zeros((n, 7))
    on_nodes = np.zeros((n + 2, 3))
    nodes = copies.kind == NODE
    np.add.at(on_nodes, copies.number[nodes], forces[nodes])
    later = np.cumsum(on_nodes[::-1], axis=0)[::-1]
    out[:, :3] += h * later[1 : n + 1]
    tangents = copies.kind == TANGENT
    np.add.at(out[:, :3], copies.number[tangents], forces[tangents])
    rulings = (copies.kind == RULING) & ~((copies.number == 0) & strip)
    np.add.at(out[:, 3:6], copies.number[rulings] % n, forces[rulings])
    flat = out.ravel()
    flat[problem.fixed] = 0.0
    return flat


@dataclass(frozen=True, eq=False)
class _Layout:
    """A pattern and where its entries come from: base entries first, then C, B, D, S in this order."""

    pattern: Pattern
    diagonal_only: int
    chained: IntArray
    s_rows: IntArray
    s_columns: IntArray
    upper_half: NDArray[np.bool_]


_layouts: dict[tuple[object, ...], _Layout] = {}
"""Patterns made lately, by what they depend on."""


def _layout(base: KKTMatrix, copies: Copies, gaps: int, rows: IntArray, columns: IntArray) -> _Layout:
    key = (base.pattern, gaps, *copies.key())
    known = _layouts.get(key)
    if known is None:
        if len(_layouts) >= 16:
            _layouts.pop(next(iter(_layouts)))
        known = _layouts[key] = _build(base, copies, gaps, rows, columns)
    return known


def _build(base: KKTMatrix, copies: Copies, gaps: int, rows: IntArray, columns: IntArray) -> _Layout:
    size, q = base.size, copies.size
    first_copy = size + q + base.border
    first_gap = first_copy + q
    total = first_gap + gaps
    upper = base.pattern.upper
    old_columns = np.repeat(np.arange(upper.shape[1]), np.diff(upper.indptr))
    old_rows = upper.indices.astype(np.int64)

    def moved(index: IntArray) -> IntArray:
        return np.where(index < size, index, index + q)

    z = size + np.arange(q)
    nodes = np.flatnonzero(copies.kind == NODE)
    chained = nodes[1:]
    links = (3 * chained[:, None] + np.arange(3)).ravel()
    six = (3 * copies.slot[:, :, None] + np.arange(3)).reshape(gaps, 18)
    s_rows = np.repeat(six, 18, axis=1).ravel()
    s_columns = np.tile(six, (1, 18)).ravel()
    half = s_rows <= s_columns
    gap_columns = np.repeat(first_gap + np.arange(gaps), 18)
    every = np.arange(total)
    all_rows = (moved(old_rows), columns, z, z[links - 3], size + six.ravel(), size + s_rows[half], every)
    all_columns = (
        moved(old_columns),
        first_copy + rows,
        first_copy + np.arange(q),
        first_copy + links,
        gap_columns,
        size + s_columns[half],
        every,
    )
    scatter = Scatter.build(np.concatenate(all_rows), np.concatenate(all_columns), (total, total))
    return _Layout(pattern_of(scatter), total, links, s_rows, s_columns, half)


class RestingMatrix(KKTMatrix):
    """The matrix above, scaled; it serves wherever a `KKTMatrix` does.

    `size` counts x and z, `border` all rows. `base` is the matrix without gaps.
    """

    def __init__(
        self, problem: Problem, base: KKTMatrix, copies: Copies, jacobian: Array, hessian: Array
    ) -> None:
        """`jacobian` (k,6,3) of gaps in their six vectors, `hessian` (k,18,18) of -f.g."""
        gaps, q = len(jacobian), copies.size
        self.base, self.copies, self.gaps = base, copies, gaps
        self.size, self.unknowns = base.size + q, base.size
        self.rotations, self.gauge = base.rotations, base.gauge
        self.border = base.border + q + gaps
        self.fixed = np.concatenate((base.fixed, np.zeros(q, dtype=bool)))
        rows, columns, values = copy_columns(problem, copies)
        free = ~problem.fixed[columns]
        rows, columns, values = rows[free], columns[free], values[free]
        layout = _layout(base, copies, gaps, rows, columns)
        self.pattern = layout.pattern
        sx = float(np.sqrt(problem.band.h / problem.band.half_width))
        at_z, at_rows = np.full(q, sx), np.full(q + gaps, 1.0 / sx)
        self.scale = np.concatenate((base.scale[: base.size], at_z, base.scale[base.size :], at_rows))
        self.metric = np.concatenate((base.metric, np.zeros(q)))
        self._z = hessian.reshape(-1)[layout.upper_half] * sx**2
        self._c = values * base.scale[columns] / sx
        self._rows, self._columns = rows, columns
        self._d = jacobian.reshape(gaps, 18)
        self._links = layout.chained
        self._s = (layout.s_rows[layout.upper_half], layout.s_columns[layout.upper_half])
        data = self.pattern.upper.data(
            np.concatenate(
                (
                    base.upper.data,
                    self._c,
                    np.full(q, -1.0),
                    np.ones(self._links.size),
                    self._d.ravel(),
                    self._z,
                    np.zeros(self.size + self.border),
                )
            )
        )
        self._fill(data)

    @cached_property
    def node_blocks(self) -> NodeBlocks:
        """The base's blocks with z, its rows and those of gaps in the border."""
        inner, q, gaps = self.base.node_blocks, self.copies.size, self.gaps
        n, _, width = inner.border.shape
        beyond = np.zeros((n * BLOCK, 2 * q + gaps))
        beyond[BLOCK * (self._columns // 7) + self._columns % 7, q + self._rows] = self._c
        corner = np.zeros((width + 2 * q + gaps,) * 2)
        z, copy, gap = width, width + q, width + 2 * q
        at = np.arange(q)
        corner[z + at, copy + at] = -1.0
        corner[z + self._links - 3, copy + self._links] = 1.0
        six = (3 * self.copies.slot[:, :, None] + np.arange(3)).reshape(gaps, 18)
        np.add.at(corner, (z + six.ravel(), np.repeat(gap + np.arange(gaps), 18)), self._d.ravel())
        np.add.at(corner, (z + self._s[0], z + self._s[1]), self._z)
        corner = np.triu(corner) + np.triu(corner, 1).T
        last = BLOCK * n + width
        position = np.concatenate(
            (
                inner.position[: self.unknowns],
                last + at,
                inner.position[self.unknowns :],
                last + q + np.arange(q + gaps),
            )
        )
        border = np.concatenate((inner.border, beyond.reshape(n, BLOCK, -1)), axis=2)
        return NodeBlocks(position, inner.diagonal, inner.coupling, border, inner.held, corner)
