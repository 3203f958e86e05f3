"""Derivatives with respect to a parameter p, at fixed unknowns and multipliers.

Of L = E - lambda . c, (2.47) and (2.55), the half-width b enters in the energy's terms, of which bending is b
times something without b, and in the fifth constraint of (2.19), weighted by h: b u_i.(g_{i+1} - g_i) - h
tanh xi_i. Loads and natural curvature enter in their own terms. Span, lift and shear enter in h sum u =
displacement, twist and tilt by the end's tangent and ruling, which are data D of every local vector: L_p =
L_D.D', and so on, with the columns of the local derivatives that belong to data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parts import HALF_WIDTH
from .band import Array
from .ends import PLACES, TURNS, displacement_rate, finish_rate
from .entries import PER_NODE
from .problem import Problem
from .stencil import Seam
from .terms import terms_of

FIFTH = PER_NODE - 1


@dataclass(frozen=True)
class Rates:
    """Derivatives by a parameter: of L, of its gradient in x (7N,), of the weighted constraints (5N+3,), and
    the second derivative of L.

    Along a branch of stationary points `lagrangian` is dE/dp, since L is stationary in x and lambda and
    equals E there. The gradient is zero at held components.
    """

    lagrangian: float
    gradient: Array
    constraints: Array
    second: float


def rates(problem: Problem, x: Array, multipliers: Array, gradient: Array, name: str) -> Rates:
    """The derivatives by a parameter of the problem at x (7N,) with multipliers (5N+3,).

    `gradient` (7N,) is that of the energy. Raises KeyError for a parameter that the problem does not have.
    """
    if name not in problem.band.parts.names(problem.band.sigma):
        raise KeyError(name)
    if name in TURNS:
        return _turning(problem, x, multipliers, name)
    constraints = np.zeros(problem.rows)
    if name in PLACES:
        constraints[-problem.closing :] = -displacement_rate(name)
    energy, force, second = _of_terms(problem, x, gradient, name)
    if name == HALF_WIDTH:
        constraints[: PER_NODE * problem.band.segments].reshape(-1, PER_NODE)[:, FIFTH] = _rise(problem, x)
        force = force - _pull_of_fifth(problem, x, multipliers)
    return Rates(energy - float(multipliers @ constraints), force, constraints, second)


def end_rate(problem: Problem, name: str) -> Array:
    """How the held components of x (7N,) change with a parameter: g_{N+1} of a strip, in the place of g_1."""
    out = np.zeros(problem.size)
    ends = problem.band.parts.ends
    if ends is not None and problem.stencil.seam is Seam.HELD:
        out[3:6] = finish_rate(ends, name).ruling
    return out


def _of_terms(problem: Problem, x: Array, gradient: Array, name: str) -> tuple[float, Array, float]:
    """The derivative of the energy, of its gradient (7N,), and the energy's second derivative."""
    band = problem.band
    if not problem.terms and name == HALF_WIDTH:
        return problem.energy(x) / band.half_width, gradient / band.half_width, 0.0
    local, energy, second = problem.local(x), 0.0, 0.0
    pulled = np.zeros_like(local)
    for term in (problem.bending, *terms_of(band)):
        rate, by_local = term.rate(name, local)
        energy, second = energy + rate, second + term.second_rate(name, local)
        pulled += by_local
    if band.parts.ends is not None:
        problem.stencil.fold_back(pulled)
    problem.stencil.apply_signs(pulled)
    return energy, np.where(problem.fixed, 0.0, problem.gathered(pulled)), second


def _rise(problem: Problem, x: Array) -> Array:
    """u_i.(g_{i+1} - g_i) (N,)."""
    u = x.reshape(-1, 7)[:, :3]
    out: Array = np.einsum("ij,ij->i", u, problem.next_rulings(x) - problem.rulings(x))
    return out


def _pull_of_fifth(problem: Problem, x: Array, multipliers: Array) -> Array:
    """Gradient (7N,) of sum_i lambda_5i u_i.(g_{i+1} - g_i); zero at held components."""
    n, seam = problem.band.segments, problem.stencil.seam
    u = x.reshape(-1, 7)[:, :3]
    fifth = multipliers[: PER_NODE * n].reshape(-1, PER_NODE)[:, FIFTH, None]
    force = np.zeros((n, 7))
    force[:, :3] = fifth * (problem.next_rulings(x) - problem.rulings(x))
    force[:, 3:6] = -fifth * u
    force[1:, 3:6] += (fifth * u)[:-1]
    if seam is Seam.CLOSED:
        force[0, 3:6] += problem.band.sigma * (fifth * u)[-1]
    elif seam is Seam.FREE:
        force[0, 3:6] = (fifth * u)[-1]
    return np.where(problem.fixed, 0.0, force.ravel())


def _turning(problem: Problem, x: Array, multipliers: Array, name: str) -> Rates:
    """By an angle of the end's frame, through the data and the held ruling that it turns."""
    ends, stencil = problem.band.parts.ends, problem.stencil
    assert ends is not None
    moved = []
    for order in (1, 2):
        rate = finish_rate(ends, name, order)
        full = np.zeros(problem.size + stencil.seam.data)
        full[3:6], full[-3:] = rate.ruling, rate.tangent
        moved.append(stencil.gather(full))
    local = problem.local(x)
    _, gradient, jacobian, hessian = problem.unmasked(local, multipliers)
    pull = gradient - np.einsum("kji,ki->ji", jacobian, problem.local_multipliers(multipliers))
    first, second = moved
    pushed = _product(hessian, first)
    constraints = np.zeros(problem.rows)
    np.add.at(constraints, problem.layout.row_places(), np.einsum("kji,ji->ki", jacobian, first))
    return Rates(
        float((pull * first).sum()),
        np.where(problem.fixed, 0.0, problem.gathered(pushed)),
        constraints,
        float((pushed * first).sum() + (pull * second).sum()),
    )


def _product(hessian: Array, moves: Array) -> Array:
    """Local Hessians, of which entries on and above the diagonal count, times moves (14,M)."""
    upper = np.triu(hessian.transpose(2, 0, 1))
    whole = upper + np.triu(upper, 1).transpose(0, 2, 1)
    out: Array = np.einsum("ijk,ki->ji", whole, moves)
    return out
