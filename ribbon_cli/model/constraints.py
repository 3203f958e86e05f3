"""The five constraints of a node, Koldaev (2022), (2.19), with derivatives.

c1 |u_i|^2 - 1;  c2 |g_i|^2 - (g_i.u_i)^2 - 1;  c3 (u_i - u_{i-1}).g_i;  c4 (u_i x g_i).g_{i+1};
c5 (b/h) u_i.(g_{i+1} - g_i) - tanh xi_i.
The Lagrangian is Q_h - sum_k w_k lambda_k c_k - h gamma . sum u with weights w = (h, h, 1, 1, h), (2.47),
so that the multipliers approximate the fields of (1.58).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .band import Array, Band
from .entries import (
    G_G,
    G_G1,
    IN_SQUARE,
    JACOBIAN,
    JACOBIAN_ROWS,
    OF_SQUARES,
    ON_DIAGONAL,
    PER_NODE,
    SQUARES,
    TO_G1,
    U0_G,
    U_G,
    U_G1,
    U_U,
    X_X,
    hessian_places,
)
from .stencil import G1, SIZE, U0, G, U, X


def row_weights(band: Band) -> Array:
    """The quadrature weights (5,) of (2.47) that make multipliers mesh-independent."""
    h = band.h
    return np.array([h, h, 1.0, 1.0, h])


def sech_squared(xi: Array) -> Array:
    """1 / cosh^2 of any shape, without overflow and without the cancellation of 1 - tanh^2."""
    e = np.exp(-2.0 * np.abs(xi))
    out: Array = 4.0 * e / (1.0 + e) ** 2
    return out


class NodeConstraints:
    """The constraints at local vectors (14,N) and their derivatives, what they share computed once.

    The energy shares `fold` (3,N), u_i - u_{i-1}, its square `fold_square` (N,) and that of g_i,
    `ruling_square` (N,).
    """

    def __init__(self, band: Band, local: Array) -> None:
        self.local = local
        self.ratio = band.half_width / band.h
        vectors = np.empty((_TURNED.stop, local.shape[1]))
        vectors[:SIZE] = local
        self.fold = np.subtract(local[U], local[U0], out=vectors[_FOLD])
        self._along = np.subtract(local[G1], local[G], out=vectors[_ALONG])
        self._turned = vectors[_TURNED]
        a, b, c, d = local.take(_CROSSED, axis=0).reshape(4, 9, -1)
        np.multiply(a, b, out=self._turned)
        self._turned -= c * d
        # All scalar products at once: numpy's calls take longer than the numbers.
        products = vectors.take(_FACTORS[0], axis=0)
        products *= vectors.take(_FACTORS[1], axis=0)
        each = products.reshape(len(_DOTS), 3, -1)
        self._dots = each[:, 0] + each[:, 1]
        self._dots += each[:, 2]
        self.fold_square, self.ruling_square, self._tangent = self._dots[:3]

    @cached_property
    def _tanh(self) -> Array:
        out: Array = np.tanh(self.local[X])
        return out

    @cached_property
    def _sech_squared(self) -> Array:
        return sech_squared(self.local[X])

    def values(self) -> Array:
        """The constraints (5,N), unweighted as written above; dimensionless."""
        _, g2, gu, u2, fold, turned, along = self._dots
        out = np.empty((PER_NODE, g2.size))
        out[0] = u2
        np.subtract(g2, gu * gu, out=out[1])
        out[:2] -= 1.0
        out[2], out[3] = fold, turned
        np.subtract(self.ratio * along, self._tanh, out=out[4])
        return out

    def jacobian(self) -> Array:
        """The entries (37,N) of d c / d local, unweighted."""
        local, k, gu = self.local, self.ratio, self._tangent
        u, g = local[U], local[G]
        out = np.empty((JACOBIAN_ROWS.size, gu.size))
        unit, length, fold, turned, along = (out[rows] for rows in JACOBIAN)
        np.multiply(2.0, u, out=unit)
        np.multiply(-2.0 * gu, g, out=length[:3])
        np.multiply(2.0, g - gu * u, out=length[3:])
        np.negative(g, out=fold[:3])
        fold[3:6], fold[6:] = g, self.fold
        turned[:] = self._turned
        np.multiply(k, self._along, out=along[:3])
        np.multiply(k, u, out=along[6:9])
        np.negative(along[6:9], out=along[3:6])
        np.negative(self._sech_squared, out=along[9])
        return out

    def add_hessian(self, weight: Array, out: Array) -> None:
        """Add sum_k weight_k d2 c_k to entries (72,N) of `entries` in place; weight (5,N)."""
        local = self.local
        w2, kw5 = 2.0 * weight[1], self.ratio * weight[4]
        # Of -weight_2 (g.u)^2 the products g g, g u and u u.
        gu = local.take(_RULING_TANGENT, axis=0)
        products = (w2 * gu).take(SQUARES[0], axis=0)
        products *= gu.take(SQUARES[1], axis=0)
        out[OF_SQUARES] -= products
        out[U_U][ON_DIAGONAL] += 2.0 * weight[0]
        out[G_G][ON_DIAGONAL] += w2
        out[U_G][IN_SQUARE] += weight[2] - kw5 - w2 * self._tangent
        out[U0_G][IN_SQUARE] -= weight[2]
        out[U_G1][IN_SQUARE] += kw5
        # Of weight_4 (u x g).g_{i+1}: [v]x of -g_{i+1}, g and -u.
        turned = (weight[3] * local[U.start : G1.stop]).take(_CROSS_OF, axis=0)
        turned *= _CROSS_SIGNS
        out[U_G] += turned[:9]
        out[TO_G1] += turned[9:]
        out[X_X.stop - 1] += 2.0 * weight[4] * self._tanh * self._sech_squared


def _crossed() -> NDArray[np.intp]:
    """The components (36,) of the local vector in the products of g_i x g_{i+1}, g_{i+1} x u_i, u_i x g_i."""
    first, second = np.array([1, 2, 0]), np.array([2, 0, 1])
    pairs = ((G, G1), (G1, U), (U, G))
    rows = ((first, second), (second, first))
    return np.concatenate(
        [np.concatenate([(a, b)[k].start + row[k] for a, b in pairs]) for row in rows for k in (0, 1)]
    )


def _crosses() -> tuple[NDArray[np.intp], Array]:
    """For the entries of U_G, U_G1 and G_G1, those of -[g_{i+1}]x, [g_i]x and -[u_i]x, the components of
    (u_i, g_i, g_{i+1}) that they are, and their signs (24,1), zero on diagonals."""
    of, signs = [], []
    rows, columns = hessian_places(())
    for block, vector, sign in ((U_G, G1, -1.0), (U_G1, G, 1.0), (G_G1, U, -1.0)):
        for row, column in zip(rows[block] % 3, columns[block] % 3, strict=True):
            turn = (column - row) % 3  # [v]x has -v_k at (i, j) and v_k at (j, i) for i, j, k in turn
            of.append(vector.start - U.start + (-row - column) % 3)
            signs.append(sign * (0.0, -1.0, 1.0)[turn])
    return np.array(of), np.array(signs)[:, None]


# What scalar products are taken of: the local vector, u_i - u_{i-1}, g_{i+1} - g_i, and the gradient (9,N) of
# (u_i x g_i).g_{i+1}, that is g_i x g_{i+1}, g_{i+1} x u_i and u_i x g_i.
_FOLD, _ALONG, _TURNED = slice(SIZE, SIZE + 3), slice(SIZE + 3, SIZE + 6), slice(SIZE + 6, SIZE + 15)
_ACROSS = slice(_TURNED.stop - 3, _TURNED.stop)
_DOTS = ((_FOLD, _FOLD), (G, G), (G, U), (U, U), (_FOLD, G), (_ACROSS, G1), (U, _ALONG))
_FACTORS = [np.concatenate([np.arange(pair[k].start, pair[k].stop) for pair in _DOTS]) for k in (0, 1)]
_CROSSED = _crossed()
_CROSS_OF, _CROSS_SIGNS = _crosses()
_RULING_TANGENT = np.array([6, 7, 8, 3, 4, 5])
