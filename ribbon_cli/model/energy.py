"""Wunderlich's bending energy of a folded strip, Koldaev (2022), (2.14)-(2.15), with derivatives.

Q_h = sum_i q_i |g_i|^4 b F_i / h with q_i = |u_i - u_{i-1}|^2 / 2 and F(x) = x / tanh x. The form of
q matters: 1 - u_i . u_{i-1} equals it on the constraint set but is unbounded below off it.
All functions work on local vectors (14, N) of `stencil`, nodes last.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .band import Array, Band, Discretisation
from .entries import (
    G_G,
    ON_DIAGONAL,
    TO_G1,
    TO_X,
    TO_X0,
    U0_G,
    U0_U,
    U0_U0,
    U_G,
    U_U,
    UPPER,
    X_X,
)
from .stencil import G1, SIZE, U0, X0, G, U, X, dot

# x coth x = sum 2^(2n) B_2n x^(2n) / (2n)!, Abramowitz & Stegun 4.5.67; fourteen terms give F, F' and F''
# to full double precision for |x| < SERIES_BELOW, where the closed forms would cancel.
_COEFFICIENTS = (
    1.0,
    1 / 3,
    -1 / 45,
    2 / 945,
    -1 / 4725,
    2 / 93555,
    -1382 / 638512875,
    4 / 18243225,
    -3617 / 162820783125,
    87734 / 38979295480125,
    -349222 / 1531329465290625,
    310732 / 13447856940643125,
    -472728182 / 201919571963756521875,
    2631724 / 11094481976030578125,
)
# Rows: coefficients of F in t = x^2, of F'/x and of F''.
_TERMS = np.arange(len(_COEFFICIENTS))
_SERIES = np.array(_COEFFICIENTS) * [_TERMS**0, 2 * _TERMS, 2 * _TERMS * (2 * _TERMS - 1)]
_SERIES[1:] = np.roll(_SERIES[1:], -1, axis=1)
_COLUMNS = np.ascontiguousarray(_SERIES.T[::-1])
SERIES_BELOW = 0.5
REPEATED_UP_TO = 1024
"""Arguments up to which coefficients are repeated: sums and products of arrays of one shape take half as long
as others, as long as numpy's calls take longer than the numbers."""
_ARGUMENT_CAP = 350.0  # sinh overflows at 710; beyond this its square is infinite and F' = sign x


def coth_factor(x: Array) -> Array:
    """F(x) = x / tanh x with F' and F'', (3, ...) of any shape, Koldaev (2022), (1.56)."""
    x = np.asarray(x, dtype=np.float64)
    small = np.abs(x) < SERIES_BELOW
    if not small.any():
        return _closed_forms(x)
    if small.all():
        return _series(x, x)
    out = _closed_forms(np.where(small, 1.0, x))
    np.copyto(out, _series(x, np.where(small, x, 0.0)), where=small)
    return out


def _series(x: Array, y: Array) -> Array:
    """The same where x is small, and y is x there and 0 elsewhere."""
    t = y * y
    columns = _COLUMNS.reshape(-1, 3, *[1] * x.ndim)
    if t.ndim == 1 and t.size <= REPEATED_UP_TO:
        columns, t = _repeated(t.size), np.concatenate((t, t, t))
    series = columns[0] * t
    for column in columns[1:-1]:
        series += column
        series *= t
    series += columns[-1]
    series = series.reshape(3, *x.shape)
    series[1] *= x
    out: Array = series
    return out


@lru_cache(maxsize=4)
def _repeated(count: int) -> Array:
    """The coefficients (14, 3 count), each as often as there are arguments."""
    return np.repeat(_COLUMNS, count, axis=1)


def _closed_forms(x: Array) -> Array:
    """The same where x is not small."""
    out = np.empty((3, *x.shape))
    y = np.minimum(np.maximum(x, -_ARGUMENT_CAP), _ARGUMENT_CAP)
    coth = 1.0 / np.tanh(y)
    sinh = np.sinh(y)
    inverse_sinh2 = 1.0 / (sinh * sinh)
    out[0] = x * coth
    out[1] = coth - y * inverse_sinh2
    out[2] = 2.0 * (y * coth - 1.0) * inverse_sinh2
    return out


def _xi_factor(band: Band, local: Array) -> tuple[Array, Array, Array]:
    """F_i (N,), its gradient (2,N) and Hessian (3,N) in (xi_{i-1}, xi_i), on and above the diagonal; where
    all are alike, (1,N)."""
    if band.discretisation is Discretisation.THESIS:
        f, f1, f2 = coth_factor(0.5 * (local[X0] + local[X]))
        return f, (0.5 * f1)[None], (0.25 * f2)[None]
    f, f1, f2 = coth_factor(local[X0:])
    hessian = np.zeros((3, local.shape[1]))
    hessian[::2] = 0.5 * f2
    return 0.5 * (f[0] + f[1]), 0.5 * f1, hessian


def energy_terms(band: Band, local: Array, cells: Array | float = 1.0) -> Array:
    """Per-node energies (N,) whose sum is Q_h; `cells` (N,) are factors on them, 2 for a fold of half a
    cell."""
    d = local[U] - local[U0]
    g2 = dot(local[G], local[G])
    f = _xi_factor(band, local)[0]
    terms: Array = (0.5 * band.half_width / band.h * cells) * dot(d, d) * g2**2 * f
    return terms


def energy_derivatives(band: Band, local: Array, cells: Array | float = 1.0) -> tuple[Array, Array]:
    """Per-node energy (N,) and gradient (14,N); `cells` as in `energy_terms`."""
    d, ruling = local[U] - local[U0], local[G]
    energy = NodeEnergy(band, local, d, dot(d, d), dot(ruling, ruling), cells)
    return energy.values(), energy.gradient()


class NodeEnergy:
    """The energies at local vectors (14,N) and their derivatives, what they share computed once.

    `fold` (3,N) is u_i - u_{i-1}, `fold_square` (N,) its square and `ruling_square` (N,) that of g_i;
    `cells` as in `energy_terms`.
    """

    def __init__(
        self,
        band: Band,
        local: Array,
        fold: Array,
        fold_square: Array,
        ruling_square: Array,
        cells: Array | float = 1.0,
    ) -> None:
        self._k = band.half_width / band.h * cells
        self._fold, self._ruling, self._square = fold, local[G], ruling_square
        self._kq = 0.5 * self._k * fold_square
        self._r = ruling_square * ruling_square
        self._f, self._f1, self._f2 = _xi_factor(band, local)
        self._kr = self._k * self._r
        self._stiff, self._kqf, self._kqr = self._kr * self._f, self._kq * self._f, self._kq * self._r
        self._r_g = 4.0 * ruling_square * self._ruling

    def values(self) -> Array:
        """The energies (N,), whose sum is Q_h."""
        out: Array = self._kqf * self._r
        return out

    def gradient(self) -> Array:
        """Their gradients (14,N)."""
        out = np.empty((SIZE, self._r.size))
        np.multiply(self._stiff, self._fold, out=out[U])
        np.negative(out[U], out=out[U0])
        np.multiply(self._kqf, self._r_g, out=out[G])
        out[G1] = 0.0
        np.multiply(self._kqr, self._f1, out=out[X0:])
        return out

    def fill_hessian(self, out: Array) -> None:
        """Put their Hessians into entries (72,N) of `entries`, all of them."""
        kq, kr, kqf, r_g = self._kq, self._kr, self._kqf, self._r_g
        turned = (self._k * self._f) * self._fold
        out[U0_U0] = self._stiff
        out[U_U][ON_DIAGONAL] = self._stiff
        out[U_U][ON_DIAGONAL.stop :] = 0.0
        np.negative(self._stiff, out=out[U0_U])
        np.multiply(turned[:, None], r_g, out=out[U_G].reshape(3, 3, -1))
        np.negative(out[U_G], out=out[U0_G])
        stretched = (8.0 * kqf) * self._ruling
        np.multiply(stretched.take(UPPER[0], axis=0), self._ruling.take(UPPER[1], axis=0), out=out[G_G])
        out[G_G][ON_DIAGONAL] += 4.0 * kqf * self._square
        out[TO_G1] = 0.0
        beside = np.empty((9, kq.size))
        np.multiply(kr, self._fold, out=beside[3:6])
        np.negative(beside[3:6], out=beside[:3])
        np.multiply(kq, r_g, out=beside[6:])
        np.multiply(beside, self._f1[:, None], out=out[TO_X0.start : TO_X.stop].reshape(2, 9, -1))
        np.multiply(self._kqr, self._f2, out=out[X_X])
