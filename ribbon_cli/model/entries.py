"""The structural entries of a node's Hessian and Jacobian, and the order in which they are kept.

A node's Lagrangian has a Hessian (14,14) of which 72 entries on and above the diagonal are not always zero,
and its five constraints a Jacobian (5,14) with 37. Only these are computed. Blocks that are filled together
stand side by side.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from . import stencil
from .band import Array
from .stencil import G1, OF_G, OF_XI, SIZE, U0, X0, G, U, X
from .term import Couplings

PER_NODE = 5
"""Constraints of a node."""

_UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_SQUARE = tuple((i, j) for i in range(3) for j in range(3))
_DIAGONAL = tuple((i, i) for i in range(3))
_OFF = tuple((i, j) for i, j in _SQUARE if i != j)
_BLOCKS = (
    (U0, U0, _DIAGONAL),
    (U0, U, _DIAGONAL),
    (U, U, _UPPER),
    (U, G, _SQUARE),
    (G, G, _UPPER),
    (U0, G, _SQUARE),
    (U, G1, _SQUARE),
    (G, G1, _OFF),
    *((block, slice(x, x + 1), ((0, 0), (1, 0), (2, 0))) for x in (X0, X) for block in (U0, U, G)),
    (slice(X0, X + 1), slice(X0, X + 1), ((0, 0), (0, 1), (1, 1))),
)
_PLACES = np.array([(a.start + i, b.start + j) for a, b, pairs in _BLOCKS for i, j in pairs])
_BEGINS = np.cumsum([0, *(len(pairs) for *_, pairs in _BLOCKS)]).tolist()


def _rows(first: int, last: int | None = None) -> slice:
    """Where the entries of a block are, or of all from one to another."""
    return slice(_BEGINS[first], _BEGINS[(first if last is None else last) + 1])


# Entries (72,N) of the Hessian by blocks: diagonals and upper triangles begin with the diagonal.
U0_U0, U0_U, U_U, U_G, G_G, U0_G, U_G1, G_G1 = map(_rows, range(8))
OF_SQUARES = _rows(2, 4)
"""The upper triangle of (u_i, g_i) with itself, in the order of `SQUARES`."""
TO_G1 = _rows(6, 7)
TO_X0, TO_X, X_X = _rows(8, 10), _rows(11, 13), _rows(14)
"""Columns of xi_{i-1} and of xi_i in the rows of (u_{i-1}, u_i, g_i), and the three entries of both xi."""
ON_DIAGONAL = slice(0, 3)
"""Of a diagonal or of an upper triangle the entries on the diagonal, and `IN_SQUARE` of a square's nine."""
IN_SQUARE = slice(0, 9, 4)
HESSIAN_ENTRIES = len(_PLACES)
UPPER = tuple(np.array(_UPPER).T)
"""Rows and columns of an upper triangle, (6,) each."""
SQUARES = tuple(_PLACES[OF_SQUARES].T - U.start)
"""Rows and columns in (u_i, g_i) of `OF_SQUARES`, (21,) each."""


def _jacobian_structure() -> NDArray[np.bool_]:
    """Structural nonzeros (5,14) of a node's constraint rows, those of auxiliary problems included."""
    full = np.zeros((PER_NODE, SIZE), dtype=bool)
    for row, blocks in enumerate(((U,), (U, G), (U0, U, G), (U, G, G1), (U, G, G1, X))):
        for block in blocks:
            full[row, block] = True
    return full


JACOBIAN_ROWS, JACOBIAN_COLUMNS = np.nonzero(_jacobian_structure())
JACOBIAN = tuple(slice(*np.searchsorted(JACOBIAN_ROWS, (row, row + 1)).tolist()) for row in range(PER_NODE))
"""Where the entries (37,N) of each constraint's Jacobian are."""
JACOBIAN_PIECES = tuple(
    (slice(piece[0], piece[-1] + 1), slice(JACOBIAN_COLUMNS[piece[0]], JACOBIAN_COLUMNS[piece[-1]] + 1))
    for piece in np.split(np.arange(JACOBIAN_ROWS.size), np.flatnonzero(np.diff(JACOBIAN_COLUMNS) != 1) + 1)
)
"""Entries of one constraint in columns that follow each other, and these columns."""


@lru_cache(maxsize=32)
def hessian_places(couplings: Couplings) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the entries of a node's Hessian, those that terms add before the others."""
    added = np.zeros((SIZE, SIZE), dtype=bool)
    for one, other in couplings:
        added[getattr(stencil, one), getattr(stencil, other)] = True
    added[tuple(_PLACES.T)] = False
    rows, columns = np.concatenate((np.argwhere(np.triu(added)), _PLACES)).T
    return rows, columns


@lru_cache(maxsize=32)
def signed_hessian(couplings: Couplings) -> tuple[Array, Array]:
    """Signs (E,) of the Hessian's entries where xi_{i-1} has another: -1 for those in a row or a column, but
    not both, of it; and where g_{i+1} has."""
    rows, columns = hessian_places(couplings)
    return OF_XI[rows] * OF_XI[columns], OF_G[rows] * OF_G[columns]


@lru_cache(maxsize=1)
def signed_jacobian() -> tuple[None, Array]:
    """The same of the Jacobian's entries (37,), of which none is in the column of xi_{i-1}."""
    return None, OF_G[JACOBIAN_COLUMNS]
