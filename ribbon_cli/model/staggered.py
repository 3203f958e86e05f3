"""Fields along a closed band on its two grids: nodes at alpha = (i - 1) h, facets half a step on, i = 1..N.

A field that is odd in the rulings (g, xi, kappa_s, eta, eta', lambda_3, lambda_5) passes the seam with the
factor sigma, an even one (u, tau, lambda_1, lambda_2, lambda_4) with 1. Every function takes that factor as
`sign`, works along the first axis and is of second order in h for smooth fields.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .band import Array, Band


def nodes(band: Band) -> Array:
    """Arclength alpha (N,) of the nodes, in the unit of the length; the seam's node is at 0."""
    out: Array = band.h * np.arange(band.segments, dtype=np.float64)
    return out


def facets(band: Band) -> Array:
    """Arclength alpha (N,) of the middles of the facets, in the unit of the length."""
    out: Array = band.h * (np.arange(band.segments, dtype=np.float64) + 0.5)
    return out


def ahead(values: Array, sign: int) -> Array:
    """The field one place on, (N, ...)."""
    out: Array = np.roll(values, -1, axis=0)
    out[-1] *= sign
    return out


def behind(values: Array, sign: int) -> Array:
    """The field one place back, (N, ...)."""
    out: Array = np.roll(values, 1, axis=0)
    out[0] *= sign
    return out


def at_facets(nodal: Array, sign: int) -> Array:
    """A nodal field at the middles of the facets, (N, ...)."""
    out: Array = 0.5 * (nodal + ahead(nodal, sign))
    return out


def at_nodes(facet: Array, sign: int) -> Array:
    """A facets' field at the nodes, (N, ...)."""
    out: Array = 0.5 * (behind(facet, sign) + facet)
    return out


def slope_at_facets(nodal: Array, sign: int, h: float) -> Array:
    """Derivative of a nodal field along the band, at the middles of the facets, (N, ...)."""
    out: Array = (ahead(nodal, sign) - nodal) / h
    return out


FLAT = 1e-6
"""Curvature, relative to the ring's 2 pi / l, below which a sign is rounding."""


def inflections(kappa_s: Array, length: float, sigma: int) -> Array:
    """Arclengths (k,) in [0, l), ascending, where the signed curvature kappa_s (N,) at nodes changes sign.

    They are found by linear interpolation between nodes. On a one-sided band, sigma = -1, kappa_s of node 1
    as seen from facet N has the opposite sign. Nodes flatter than FLAT have no sign of their own: an
    inflection lies among them if the signs on their two sides differ.
    """
    at = np.flatnonzero(np.abs(kappa_s) > FLAT * 2.0 * np.pi / length)
    if at.size < 2:
        return np.empty(0)
    value = kappa_s[at]
    following = ahead(value, sigma)
    gap = np.append(at[1:], at[0] + kappa_s.size) - at
    turns = value * following < 0
    share = value[turns] / (value[turns] - following[turns])
    place: Array = np.sort(length / kappa_s.size * (at[turns] + gap[turns] * share) % length)
    return place


def distance_to(band: Band, places: Array, alpha: Array) -> Array:
    """Distance along the closed band from each alpha (n,) to the nearest of the places (k,); inf for none."""
    if not places.size:
        return np.full(alpha.shape, np.inf)
    wrapped = np.concatenate((places - band.length, places, places + band.length))
    wrapped.sort()
    k = np.clip(np.searchsorted(wrapped, alpha), 1, wrapped.size - 1)
    out: Array = np.minimum(np.abs(alpha - wrapped[k - 1]), np.abs(wrapped[k] - alpha))
    return out


def far_half(distance: Array) -> NDArray[np.bool_]:
    """Where a distance (n,) is at least its median: the half of the band farther from its inflections."""
    return at_least(distance, float(np.median(distance)))


def at_least(distance: Array, least: float) -> NDArray[np.bool_]:
    """Where a distance (n,) is `least` or more, or would be but for rounding: symmetric bands have ties."""
    out: NDArray[np.bool_] = distance >= least * (1.0 - 1e-6)
    return out
