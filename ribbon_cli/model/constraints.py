"""The five constraints of a node, Koldaev (2022), (2.19), with derivatives.

c1 |u_i|^2 - 1;  c2 |g_i|^2 - (g_i.u_i)^2 - 1;  c3 (u_i - u_{i-1}).g_i;  c4 (u_i x g_i).g_{i+1};
c5 (b/h) u_i.(g_{i+1} - g_i) - tanh xi_i.
The Lagrangian is Q_h - sum_k w_k lambda_k c_k - h gamma . sum u with weights w = (h, h, 1, 1, h), (2.47),
so that the multipliers approximate the fields of (1.58).
"""

from __future__ import annotations

import numpy as np

from .band import Array, Band
from .stencil import G1, SIZE, U0, G, U, X

PER_NODE = 5


def row_weights(band: Band) -> Array:
    """The quadrature weights (5,) of (2.47) that make multipliers mesh-independent."""
    h = band.h
    return np.array([h, h, 1.0, 1.0, h])


def cross_matrix(v: Array) -> Array:
    """[v]x (N,3,3) with [v]x w = v x w."""
    out = np.zeros((v.shape[0], 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out


def _dot(a: Array, b: Array) -> Array:
    out: Array = np.einsum("ij,ij->i", a, b)
    return out


def sech_squared(xi: Array) -> Array:
    """1 / cosh^2 without overflow and without the cancellation of 1 - tanh^2."""
    e = np.exp(-2.0 * np.abs(xi))
    out: Array = 4.0 * e / (1.0 + e) ** 2
    return out


def constraint_values(band: Band, local: Array) -> Array:
    """The constraints (N,5), unweighted as written above; dimensionless."""
    u0, u, g, g1 = local[:, U0], local[:, U], local[:, G], local[:, G1]
    out = np.empty((local.shape[0], PER_NODE))
    out[:, 0] = _dot(u, u) - 1.0
    out[:, 1] = _dot(g, g) - _dot(g, u) ** 2 - 1.0
    out[:, 2] = _dot(u - u0, g)
    out[:, 3] = _dot(np.cross(u, g), g1)
    out[:, 4] = (band.half_width / band.h) * _dot(u, g1 - g) - np.tanh(local[:, X])
    return out


def constraint_jacobian(band: Band, local: Array) -> Array:
    """d c / d local, (N,5,14), unweighted."""
    u0, u, g, g1 = local[:, U0], local[:, U], local[:, G], local[:, G1]
    k = band.half_width / band.h
    gu = _dot(g, u)[:, None]
    out = np.zeros((local.shape[0], PER_NODE, SIZE))
    out[:, 0, U] = 2.0 * u
    out[:, 1, U] = -2.0 * gu * g
    out[:, 1, G] = 2.0 * (g - gu * u)
    out[:, 2, U], out[:, 2, U0], out[:, 2, G] = g, -g, u - u0
    out[:, 3, U] = np.cross(g, g1)
    out[:, 3, G] = np.cross(g1, u)
    out[:, 3, G1] = np.cross(u, g)
    out[:, 4, U] = k * (g1 - g)
    out[:, 4, G1], out[:, 4, G] = k * u, -k * u
    out[:, 4, X] = -sech_squared(local[:, X])
    return out


def add_constraint_hessian(band: Band, local: Array, weight: Array, hessian: Array) -> None:
    """Add sum_k weight_k d2 c_k to hessian (N,14,14) in place; weight (N,5)."""
    u, g, g1 = local[:, U], local[:, G], local[:, G1]
    k = band.half_width / band.h
    w = weight[:, :, None, None]
    eye = np.eye(3)
    uu_t, gg_t = u[:, :, None] * u[:, None, :], g[:, :, None] * g[:, None, :]
    hessian[:, U, U] += 2.0 * w[:, 0] * eye - 2.0 * w[:, 1] * gg_t
    hessian[:, G, G] += 2.0 * w[:, 1] * (eye - uu_t)
    ug = -2.0 * w[:, 1] * (g[:, :, None] * u[:, None, :] + _dot(g, u)[:, None, None] * eye)
    ug += (w[:, 2] - k * w[:, 4]) * eye - w[:, 3] * cross_matrix(g1)
    ug1 = w[:, 3] * cross_matrix(g) + k * w[:, 4] * eye
    gg1 = -w[:, 3] * cross_matrix(u)
    hessian[:, U, G] += ug
    hessian[:, G, U] += ug.transpose(0, 2, 1)
    hessian[:, U0, G] -= w[:, 2] * eye
    hessian[:, G, U0] -= w[:, 2] * eye
    hessian[:, U, G1] += ug1
    hessian[:, G1, U] += ug1.transpose(0, 2, 1)
    hessian[:, G, G1] += gg1
    hessian[:, G1, G] += gg1.transpose(0, 2, 1)
    hessian[:, X, X] += weight[:, 4] * 2.0 * np.tanh(local[:, X]) * sech_squared(local[:, X])
