"""Wunderlich's bending energy of a folded strip, Koldaev (2022), (2.14)-(2.15), with derivatives.

Q_h = sum_i q_i |g_i|^4 b F_i / h with q_i = |u_i - u_{i-1}|^2 / 2 and F(x) = x / tanh x. The form of
q matters: 1 - u_i . u_{i-1} equals it on the constraint set but is unbounded below off it.
All functions work on local vectors (14, N) of `stencil`, nodes last.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .band import Array, Band, Discretisation
from .stencil import SIZE, U0, X0, G, U, X, diagonal, dot

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


def coth_factor(x: Array) -> tuple[Array, Array, Array]:
    """F(x) = x / tanh x with F' and F'', of any shape, Koldaev (2022), (1.56)."""
    x = np.asarray(x, dtype=np.float64)
    small = np.abs(x) < SERIES_BELOW
    if not small.any():
        return _closed_forms(x)
    if small.all():
        return _series(x, x)
    series = _series(x, np.where(small, x, 0.0))
    closed = _closed_forms(np.where(small, 1.0, x))
    f, f1, f2 = (np.where(small, a, b) for a, b in zip(series, closed, strict=True))
    return f, f1, f2


def _series(x: Array, y: Array) -> tuple[Array, Array, Array]:
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
    return series[0], series[1] * x, series[2]


@lru_cache(maxsize=4)
def _repeated(count: int) -> Array:
    """The coefficients (14, 3 count), each as often as there are arguments."""
    return np.repeat(_COLUMNS, count, axis=1)


def _closed_forms(x: Array) -> tuple[Array, Array, Array]:
    """The same where x is not small."""
    y = np.minimum(np.maximum(x, -_ARGUMENT_CAP), _ARGUMENT_CAP)
    coth = 1.0 / np.tanh(y)
    sinh = np.sinh(y)
    inverse_sinh2 = 1.0 / (sinh * sinh)
    return x * coth, coth - y * inverse_sinh2, 2.0 * (y * coth - 1.0) * inverse_sinh2


def _xi_factor(band: Band, local: Array) -> tuple[Array, Array, Array]:
    """F_i (N,), its gradient (2,N) and Hessian (2,2,N) in (xi_{i-1}, xi_i), where both are alike (1,N) and
    (1,1,N)."""
    if band.discretisation is Discretisation.THESIS:
        f, f1, f2 = coth_factor(0.5 * (local[X0] + local[X]))
        return f, (0.5 * f1)[None], (0.25 * f2)[None, None]
    f, f1, f2 = coth_factor(local[X0:])
    hessian = np.zeros((2, 2, local.shape[1]))
    hessian[0, 0] = 0.5 * f2[0]
    hessian[1, 1] = 0.5 * f2[1]
    return 0.5 * (f[0] + f[1]), 0.5 * f1, hessian


def energy_terms(band: Band, local: Array, cells: Array | float = 1.0) -> Array:
    """Per-node energies (N,) whose sum is Q_h; `cells` (N,) are factors on them, 2 for a fold of half a
    cell."""
    d = local[U] - local[U0]
    g2 = dot(local[G], local[G])
    f = _xi_factor(band, local)[0]
    terms: Array = (0.5 * band.half_width / band.h * cells) * dot(d, d) * g2**2 * f
    return terms


def energy_derivatives(
    band: Band, local: Array, *, with_hessian: bool = True, cells: Array | float = 1.0
) -> tuple[Array, Array, Array | None]:
    """Per-node energy (N,), gradient (14,N) and, if wanted, the Hessian (14,14,N).

    Of the Hessian only entries on and above the diagonal are given. `cells` as in `energy_terms`.
    """
    n = local.shape[1]
    gradient, hessian = np.zeros((SIZE, n)), np.zeros((SIZE, SIZE, n)) if with_hessian else None
    return fill_energy_derivatives(band, local, gradient, hessian, cells), gradient, hessian


def fill_energy_derivatives(
    band: Band,
    local: Array,
    gradient: Array,
    hessian: Array | None,
    cells: Array | float = 1.0,
    known: tuple[Array, Array, Array] | None = None,
) -> Array:
    """The same, put into a gradient and a Hessian of zeros; returns the energies (N,).

    `known` are u_i - u_{i-1} (3,N), its square (N,) and that of g_i (N,), where there are such.
    """
    k = band.half_width / band.h * cells
    ruling = local[G]
    if known is None:
        d = local[U] - local[U0]
        known = d, dot(d, d), dot(ruling, ruling)
    d, d2, g2 = known
    kq = 0.5 * k * d2
    r = g2 * g2
    f, f1, f2 = _xi_factor(band, local)
    kr = k * r
    stiff, kqf, kqr = kr * f, kq * f, kq * r
    r_g = 4.0 * g2 * ruling

    np.multiply(stiff, d, out=gradient[U])
    np.negative(gradient[U], out=gradient[U0])
    np.multiply(kqf, r_g, out=gradient[G])
    np.multiply(kqr, f1, out=gradient[X0:])
    terms: Array = kqf * r
    if hessian is None:
        return terms

    diagonal(hessian, 0, 0, 6)[:] = stiff  # of u_{i-1} and of u_i
    np.negative(stiff, out=diagonal(hessian, 0, 3))
    np.multiply(((k * f) * d)[:, None], r_g, out=hessian[U, G])
    np.multiply((kr * d)[:, None], f1, out=hessian[U, X0:])
    np.negative(hessian[U, G.start :], out=hessian[U0, G.start :])
    np.multiply(((8.0 * kqf) * ruling)[:, None], ruling, out=hessian[G, G])
    on_diagonal = diagonal(hessian, G.start, G.start)
    on_diagonal += 4.0 * kqf * g2
    np.multiply((kq * r_g)[:, None], f1, out=hessian[G, X0:])
    np.multiply(kqr, f2, out=hessian[X0:, X0:])
    return terms
