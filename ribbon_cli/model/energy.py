"""Wunderlich's bending energy of a folded strip, Koldaev (2022), (2.14)-(2.15), with derivatives.

Q_h = sum_i q_i |g_i|^4 b F_i / h with q_i = |u_i - u_{i-1}|^2 / 2 and F(x) = x / tanh x. The form of
q matters: 1 - u_i . u_{i-1} equals it on the constraint set but is unbounded below off it.
All functions work on local vectors (N, 14) of `stencil`.
"""

from __future__ import annotations

import numpy as np

from .band import Array, Band, Discretisation
from .stencil import SIZE, U0, X0, G, U, X

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
SERIES_BELOW = 0.5
_ARGUMENT_CAP = 350.0  # sinh overflows at 710; beyond this its square is infinite and F' = sign x


def coth_factor(x: Array) -> tuple[Array, Array, Array]:
    """F(x) = x / tanh x with F' and F'', of any shape, Koldaev (2022), (1.56)."""
    x = np.asarray(x, dtype=np.float64)
    small = np.abs(x) < SERIES_BELOW
    t = np.where(small, x, 0.0) ** 2
    f, f1, f2 = (np.zeros_like(x) for _ in range(3))
    for n in range(len(_COEFFICIENTS) - 1, -1, -1):
        c = _COEFFICIENTS[n]
        f = f * t + c
        if n > 0:
            f1 = f1 * t + 2 * n * c
            f2 = f2 * t + 2 * n * (2 * n - 1) * c
    f1 = f1 * x
    if small.all():
        return f, f1, f2
    y = np.clip(np.where(small, 1.0, x), -_ARGUMENT_CAP, _ARGUMENT_CAP)
    coth = 1.0 / np.tanh(y)
    inverse_sinh2 = 1.0 / np.sinh(y) ** 2
    big = np.where(small, 1.0, x)
    f = np.where(small, f, big * coth)
    f1 = np.where(small, f1, coth - y * inverse_sinh2)
    f2 = np.where(small, f2, 2.0 * (y * coth - 1.0) * inverse_sinh2)
    return f, f1, f2


def _xi_factor(band: Band, local: Array) -> tuple[Array, Array, Array]:
    """F_i (N,), its gradient (N,2) and Hessian (N,2,2) in (xi_{i-1}, xi_i)."""
    n = local.shape[0]
    hessian = np.zeros((n, 2, 2))
    if band.discretisation is Discretisation.THESIS:
        f, f1, f2 = coth_factor(0.5 * (local[:, X0] + local[:, X]))
        hessian[:] = 0.25 * f2[:, None, None]
        return f, np.repeat(0.5 * f1[:, None], 2, axis=1), hessian
    f, f1, f2 = coth_factor(local[:, [X0, X]])
    hessian[:, 0, 0] = 0.5 * f2[:, 0]
    hessian[:, 1, 1] = 0.5 * f2[:, 1]
    return 0.5 * f.sum(axis=1), 0.5 * f1, hessian


def energy_terms(band: Band, local: Array) -> Array:
    """Per-node energies (N,) whose sum is Q_h."""
    d = local[:, U] - local[:, U0]
    g2 = np.einsum("ij,ij->i", local[:, G], local[:, G])
    f = _xi_factor(band, local)[0]
    terms: Array = (0.5 * band.half_width / band.h) * np.einsum("ij,ij->i", d, d) * g2**2 * f
    return terms


def energy_derivatives(
    band: Band, local: Array, *, with_hessian: bool = True
) -> tuple[Array, Array, Array | None]:
    """Per-node energy (N,), gradient (N,14) and, if wanted, Hessian (N,14,14)."""
    n = local.shape[0]
    k = band.half_width / band.h
    d = local[:, U] - local[:, U0]
    ruling = local[:, G]
    g2 = np.einsum("ij,ij->i", ruling, ruling)
    q = 0.5 * np.einsum("ij,ij->i", d, d)
    r = g2**2
    f, f1, f2 = _xi_factor(band, local)
    r_g = 4.0 * g2[:, None] * ruling

    gradient = np.zeros((n, SIZE))
    e_u = (k * r * f)[:, None] * d
    gradient[:, U] = e_u
    gradient[:, U0] = -e_u
    gradient[:, G] = (k * q * f)[:, None] * r_g
    gradient[:, X0:] = (k * q * r)[:, None] * f1
    if not with_hessian:
        return k * q * r * f, gradient, None

    hessian = np.zeros((n, SIZE, SIZE))
    eye = np.eye(3)
    uu = (k * r * f)[:, None, None] * eye
    ug = (k * f)[:, None, None] * d[:, :, None] * r_g[:, None, :]
    ux = k * (r[:, None, None] * d[:, :, None]) * f1[:, None, :]
    hessian[:, U, U] = hessian[:, U0, U0] = uu
    hessian[:, U, U0] = hessian[:, U0, U] = -uu
    hessian[:, U, G], hessian[:, U0, G] = ug, -ug
    hessian[:, G, U] = ug.transpose(0, 2, 1)
    hessian[:, G, U0] = -hessian[:, G, U]
    hessian[:, U, X0:], hessian[:, U0, X0:] = ux, -ux
    hessian[:, X0:, U] = ux.transpose(0, 2, 1)
    hessian[:, X0:, U0] = -hessian[:, X0:, U]
    gg = g2[:, None, None] * eye + 2.0 * ruling[:, :, None] * ruling[:, None, :]
    hessian[:, G, G] = (4.0 * k * q * f)[:, None, None] * gg
    gx = (k * q)[:, None, None] * r_g[:, :, None] * f1[:, None, :]
    hessian[:, G, X0:] = gx
    hessian[:, X0:, G] = gx.transpose(0, 2, 1)
    hessian[:, X0:, X0:] = (k * q * r)[:, None, None] * f2
    return k * q * r * f, gradient, hessian
