"""The five constraints of a node, Koldaev (2022), (2.19), with derivatives.

c1 |u_i|^2 - 1;  c2 |g_i|^2 - (g_i.u_i)^2 - 1;  c3 (u_i - u_{i-1}).g_i;  c4 (u_i x g_i).g_{i+1};
c5 (b/h) u_i.(g_{i+1} - g_i) - tanh xi_i.
The Lagrangian is Q_h - sum_k w_k lambda_k c_k - h gamma . sum u with weights w = (h, h, 1, 1, h), (2.47),
so that the multipliers approximate the fields of (1.58).
"""

from __future__ import annotations

import numpy as np

from .band import Array, Band
from .stencil import G1, SIZE, U0, G, U, X, add_cross, add_diagonal, cross, dot

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


def constraint_values(band: Band, local: Array) -> Array:
    """The constraints (5,N), unweighted as written above; dimensionless."""
    u0, u, g, g1 = local[U0], local[U], local[G], local[G1]
    out = np.empty((PER_NODE, local.shape[1]))
    out[0] = dot(u, u) - 1.0
    out[1] = dot(g, g) - dot(g, u) ** 2 - 1.0
    out[2] = dot(u - u0, g)
    out[3] = dot(cross(u, g), g1)
    out[4] = (band.half_width / band.h) * dot(u, g1 - g) - np.tanh(local[X])
    return out


def constraint_jacobian(band: Band, local: Array) -> Array:
    """d c / d local, (5,14,N), unweighted."""
    u0, u, g, g1 = local[U0], local[U], local[G], local[G1]
    k = band.half_width / band.h
    gu = dot(g, u)
    out = np.zeros((PER_NODE, SIZE, local.shape[1]))
    out[0, U] = 2.0 * u
    out[1, U] = -2.0 * gu * g
    out[1, G] = 2.0 * (g - gu * u)
    out[2, U], out[2, U0], out[2, G] = g, -g, u - u0
    out[3, U] = cross(g, g1)
    out[3, G] = cross(g1, u)
    out[3, G1] = cross(u, g)
    out[4, U] = k * (g1 - g)
    out[4, G1] = k * u
    out[4, G] = -out[4, G1]
    out[4, X] = -sech_squared(local[X])
    return out


def add_constraint_hessian(band: Band, local: Array, weight: Array, hessian: Array) -> None:
    """Add sum_k weight_k d2 c_k to the upper triangle of hessian (14,14,N) in place; weight (5,N)."""
    u, g, g1 = local[U], local[G], local[G1]
    w2, kw5 = 2.0 * weight[1], (band.half_width / band.h) * weight[4]
    hessian[U, U] -= (w2 * g)[:, None] * g
    add_diagonal(hessian[U, U], 2.0 * weight[0])
    hessian[G, G] -= (w2 * u)[:, None] * u
    add_diagonal(hessian[G, G], w2)
    hessian[U, G] -= (w2 * g)[:, None] * u
    add_diagonal(hessian[U, G], weight[2] - kw5 - w2 * dot(g, u))
    add_cross(hessian[U, G], -weight[3] * g1)
    add_diagonal(hessian[U0, G], -weight[2])
    add_diagonal(hessian[U, G1], kw5)
    add_cross(hessian[U, G1], weight[3] * g)
    add_cross(hessian[G, G1], -weight[3] * u)
    hessian[X, X] += 2.0 * weight[4] * np.tanh(local[X]) * sech_squared(local[X])
