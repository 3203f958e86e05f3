"""The multipliers as functions of the shape, Koldaev (2022), (1.70)-(1.78) as corrected in docs/errata.md.

With kappa = kappa_s, |g|^2 = 1 + eta^2, F of (1.56) and W = |g|^4 F'(xi) cosh^2 xi:

    lambda_5 = -(b/2) kappa^2 W                                                   (1.70)
    lambda_4 = -(b lambda_5' + Z eta) / kappa,   Z = 2 b kappa^2 |g|^2 F          (1.76)
    lambda_3 = b lambda_5 - lambda_4' / kappa                                     (1.77)
    lambda_2 = (Z |g|^2 + b lambda_5' eta) / 2                                    (1.75)
    lambda_1 = (m kappa + (lambda_3 eta)' + 2 lambda_2 eta^2 - b lambda_5 eta' - gamma.u) / 2      (1.78)

with m = b kappa |g|^4 F, zeta_d'' = m n. What is left of (1.61) across the tangent determines gamma:

    gamma.n = -m' - lambda_4 eta',    gamma.e = lambda_3' + 2 lambda_2 eta - m kappa eta.

All of it is evaluated on the discrete u, g and xi by central differences, independently of the discrete
multipliers, and differs from them at second order in h at any fixed distance from an inflection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .band import Array, Multipliers, State
from .constraints import sech_squared
from .energy import coth_factor
from .folding import facet_frames
from .geometry import geometry
from .staggered import (
    at_facets,
    at_nodes,
    distance_to,
    facets,
    far_half,
    inflections,
    nodes,
    slope_at_facets,
)

_XI_CAP = 300.0
"""Largest xi of which cosh^2 is taken: more overflows, and happens on states that went wrong alone."""


@dataclass(frozen=True)
class MultiplierCurve:
    """A multiplier along the band: `name`; `alpha` (N,) arclength; `computed` and `theory` (N,).

    `computed` is the discrete multiplier as an approximation of the field (`fields_of`), `theory` the
    explicit formula on the same shape, not-a-number where the curvature is zero. `distance` (N,) is the
    arclength to the nearest inflection (inf without any), and `far` (N,) the half of the band that is
    farther from them.
    """

    name: str
    alpha: Array
    computed: Array
    theory: Array
    distance: Array
    far: NDArray[np.bool_]


def fields_of(state: State, multipliers: Multipliers) -> Multipliers:
    """The discrete multipliers as approximations of the fields of (1.58), of second order in h.

    All are as stored but lambda_3, from which h lambda_2 eta is taken: the constraint of (2.18) has g.u_i
    where g.(u_i + u_{i-1})/2 would be centred (docs/errata.md).
    """
    eta = np.einsum("ij,ij->i", state.u, state.g)
    symmetric = multipliers.lambda_3 - state.band.h * multipliers.lambda_2 * eta
    return replace(multipliers, lambda_3=symmetric)


def theoretical_multipliers(state: State, gamma: Array | None = None) -> Multipliers:
    """lambda_1..lambda_5 (N,) and gamma (3,) by the formulas above, at the places of (2.48).

    `gamma` is used in lambda_1 where it is given; else it is found from the shape, by least squares over the
    half of the band that is farther from the inflections. What divides by the curvature is not-a-number
    beside a node at which that is zero.
    """
    band = state.band
    b, h, sigma = band.half_width, band.h, band.sigma
    shape = geometry(state)
    kappa, eta = shape.kappa_s, shape.eta
    size2 = 1.0 + eta**2
    xi = at_nodes(state.xi, sigma)
    f, f1, _ = coth_factor(xi)
    stiffness = 2.0 * b * kappa**2 * size2 * f
    moment = b * kappa * size2**2 * f

    five = -0.5 * b * kappa**2 * size2**2 * f1 / sech_squared(np.clip(xi, -_XI_CAP, _XI_CAP))
    rate = at_nodes(slope_at_facets(five, sigma, h), sigma)
    two = 0.5 * (stiffness * size2 + b * rate * eta)
    inverse = np.divide(1.0, kappa, out=np.full_like(kappa, np.nan), where=kappa != 0)
    four = -(b * rate + stiffness * eta) * inverse
    three = b * five - at_nodes(slope_at_facets(four, 1, h), 1) * inverse

    four_facet, five_facet = at_facets(four, 1), at_facets(five, sigma)
    slant, turn = at_facets(eta, sigma), at_facets(two * eta, sigma)
    if gamma is None:
        across = -slope_at_facets(moment, sigma, h) - four_facet * shape.eta_prime
        upwards = slope_at_facets(three, sigma, h) + 2.0 * turn - at_facets(moment * kappa * eta, sigma)
        gamma = _closure_force(
            state,
            across,
            upwards,
            distance_to(band, inflections(kappa, band.length, band.sigma), facets(band)),
        )
    pull = at_facets(moment * kappa, 1) + slope_at_facets(three * eta, 1, h)
    one = 0.5 * (pull + 2.0 * turn * slant - b * five_facet * shape.eta_prime - state.u @ gamma)
    return Multipliers(one, two, three, four_facet, five_facet, gamma)


def _closure_force(state: State, across: Array, upwards: Array, distance: Array) -> Array:
    """gamma (3,) from its components (N,) along n and e of the facets, where inflections are far.

    Facets without numbers are left out; not-a-number if all are.
    """
    frame = facet_frames(state)
    used = far_half(distance) & np.isfinite(across) & np.isfinite(upwards)
    if not used.any():
        return np.full(3, np.nan)
    directions = np.concatenate((frame[used, :, 1], frame[used, :, 2]))
    return np.asarray(
        np.linalg.lstsq(directions, np.concatenate((across[used], upwards[used])), rcond=None)[0]
    )


def multiplier_curves(state: State, multipliers: Multipliers) -> tuple[MultiplierCurve, ...]:
    """lambda_1..lambda_5 of an equilibrium beside their formulas, for plots and for orders."""
    band = state.band
    computed, theory = fields_of(state, multipliers), theoretical_multipliers(state)
    turns = inflections(geometry(state).kappa_s, band.length, band.sigma)
    curves = []
    for k in range(1, 6):
        name = f"lambda_{k}"
        alpha = nodes(band) if k in (2, 3) else facets(band)
        distance = distance_to(band, turns, alpha)
        values = getattr(computed, name), getattr(theory, name)
        curves.append(MultiplierCurve(name, alpha, *values, distance, far_half(distance)))
    return tuple(curves)
