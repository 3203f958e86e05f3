"""Derivatives with respect to the half-width b, at fixed unknowns and multipliers.

Of L = Q_h - lambda . c, (2.47) and (2.55), b enters in two places: Q_h is b times something without b, and
the fifth constraint of (2.19), weighted by h, is b u_i.(g_{i+1} - g_i) - h tanh xi_i. L is therefore linear
in b for either discretisation, and its derivative does not depend on b.
"""

from __future__ import annotations

import numpy as np

from .band import Array
from .constraints import PER_NODE
from .problem import CLOSURE, Problem

FIFTH = PER_NODE - 1


def constraints_by_width(problem: Problem, x: Array) -> Array:
    """dc/db (5N+3,) of the weighted constraints: u_i.(g_{i+1} - g_i) in each fifth row, else zero."""
    y = x.reshape(-1, 7)
    out = np.zeros(problem.rows)
    rise = problem.next_rulings(x) - y[:, 3:6]
    out[:-CLOSURE].reshape(-1, PER_NODE)[:, FIFTH] = np.einsum("ij,ij->i", y[:, :3], rise)
    return out


def energy_by_width(problem: Problem, x: Array, multipliers: Array) -> float:
    """dL/db for multipliers (5N+3,): Q_h/b - sum_i lambda_5i u_i.(g_{i+1} - g_i).

    Along a branch of stationary points it is dE/db, since L is stationary in x and lambda and equals E there.
    """
    return float(problem.energy(x) / problem.band.half_width - multipliers @ constraints_by_width(problem, x))


def gradient_by_width(problem: Problem, x: Array, multipliers: Array, gradient: Array) -> Array:
    """d/db of the gradient of L in x, (7N,); `gradient` is that of Q_h. Zero at prescribed components."""
    u, g = x.reshape(-1, 7)[:, :3], x.reshape(-1, 7)[:, 3:6]
    fifth = multipliers[:-CLOSURE].reshape(-1, PER_NODE)[:, FIFTH, None]
    force = np.zeros((problem.band.segments, 7))
    force[:, :3] = fifth * (problem.next_rulings(x) - g)
    force[:, 3:6] = -fifth * u
    force[1:, 3:6] += (fifth * u)[:-1]
    if problem.prescription.seam is None:
        force[0, 3:6] += problem.band.sigma * (fifth * u)[-1]
    out: Array = gradient / problem.band.half_width - np.where(problem.fixed, 0.0, force.ravel())
    return out
