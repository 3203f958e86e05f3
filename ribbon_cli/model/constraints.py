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
from .stencil import G1, SIZE, U0, G, U, X, diagonal

PER_NODE = 5


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

    def fill_jacobian(self, out: Array) -> None:
        """Put d c / d local, unweighted, into zeros (5,14,N)."""
        local, k, gu = self.local, self.ratio, self._tangent
        u, g = local[U], local[G]
        np.multiply(2.0, u, out=out[0, U])
        np.multiply(-2.0 * gu, g, out=out[1, U])
        np.multiply(2.0, g - gu * u, out=out[1, G])
        out[2, U] = g
        np.negative(g, out=out[2, U0])
        out[2, G] = self.fold
        out[3, U.start : G1.stop] = self._turned
        np.multiply(k, self._along, out=out[4, U])
        np.multiply(k, u, out=out[4, G1])
        np.negative(out[4, G1], out=out[4, G])
        np.negative(self._sech_squared, out=out[4, X])

    def add_hessian(self, weight: Array, hessian: Array) -> None:
        """Add sum_k weight_k d2 c_k to the upper triangle of hessian (14,14,N) in place; weight (5,N)."""
        ug = self.local[U.start : G.stop]
        gu = np.concatenate((ug[3:], ug[:3]))
        w2, kw5 = 2.0 * weight[1], self.ratio * weight[4]
        # The products g g, u u on the diagonal and g u beside it; below it, where nothing is read, u g.
        both = hessian[U.start : G.stop, U.start : G.stop]
        both -= (w2 * gu)[:, None] * gu
        on_diagonal = diagonal(hessian, U.start, U.start)
        on_diagonal += 2.0 * weight[0]
        on_diagonal = diagonal(hessian, G.start, G.start)
        on_diagonal += w2
        on_diagonal = diagonal(hessian, U.start, G.start)
        on_diagonal += weight[2] - kw5 - w2 * self._tangent
        on_diagonal = diagonal(hessian, U0.start, G.start)
        on_diagonal -= weight[2]
        on_diagonal = diagonal(hessian, U.start, G1.start)
        on_diagonal += kw5
        # Of weight_4 (u x g).g_{i+1}: [v]x of -g_{i+1}, g and -u.
        turned = (weight[3] * self.local[U.start : G1.stop])[_CROSS_OF]
        turned *= _CROSS_SIGNS
        hessian.reshape(SIZE * SIZE, -1)[_CROSS_AT] += turned
        hessian[X, X] += 2.0 * weight[4] * self._tanh * self._sech_squared


def _crossed() -> NDArray[np.intp]:
    """The components (36,) of the local vector in the products of g_i x g_{i+1}, g_{i+1} x u_i, u_i x g_i."""
    first, second = np.array([1, 2, 0]), np.array([2, 0, 1])
    pairs = ((G, G1), (G1, U), (U, G))
    rows = ((first, second), (second, first))
    return np.concatenate(
        [np.concatenate([(a, b)[k].start + row[k] for a, b in pairs]) for row in rows for k in (0, 1)]
    )


def _crosses() -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Where (18,) the entries of -[g_{i+1}]x, [g_i]x and -[u_i]x stand in the flat Hessian, of which
    components of (u_i, g_i, g_{i+1}) they are, and their signs (18,1)."""
    at, of, signs = [], [], []
    for row, column, vector, sign in ((U, G, G1, -1.0), (U, G1, G, 1.0), (G, G1, U, -1.0)):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # [v]x has -v_k at (i, j) and v_k at (j, i)
            at += [SIZE * (row.start + i) + column.start + j, SIZE * (row.start + j) + column.start + i]
            of += [vector.start - U.start + k] * 2
            signs += [-sign, sign]
    return np.array(at), np.array(of), np.array(signs)[:, None]


# What scalar products are taken of: the local vector, u_i - u_{i-1}, g_{i+1} - g_i, and the gradient (9,N) of
# (u_i x g_i).g_{i+1}, that is g_i x g_{i+1}, g_{i+1} x u_i and u_i x g_i.
_FOLD, _ALONG, _TURNED = slice(SIZE, SIZE + 3), slice(SIZE + 3, SIZE + 6), slice(SIZE + 6, SIZE + 15)
_ACROSS = slice(_TURNED.stop - 3, _TURNED.stop)
_DOTS = ((_FOLD, _FOLD), (G, G), (G, U), (U, U), (_FOLD, G), (_ACROSS, G1), (U, _ALONG))
_FACTORS = [np.concatenate([np.arange(pair[k].start, pair[k].stop) for pair in _DOTS]) for k in (0, 1)]
_CROSSED = _crossed()
_CROSS_AT, _CROSS_OF, _CROSS_SIGNS = _crosses()
