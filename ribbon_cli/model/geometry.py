"""Geometry of a discrete band, Koldaev (2022), (3.1) with g in place of the misprinted g'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import folding, strip_folding
from .band import Array, State


@dataclass(frozen=True)
class Geometry:
    """Shape functions: `midline` (N+1,3) vertices, in units of the length; the rest (N,).

    `kappa_s` signed curvature, `tau` = kappa_s eta torsion and `eta` = u.g sit at nodes, `eta_prime` at
    facets. kappa_s and eta refer to the side that the ruling names: on a one-sided band they change sign
    across the seam. Where the seam is open there is no fold 1: kappa_s, tau and eta of node 1 are not
    numbers.
    """

    midline: Array
    kappa_s: Array
    tau: Array
    eta: Array
    eta_prime: Array


def geometry(state: State, end_ruling: Array | None = None) -> Geometry:
    """Shape functions of a state; `end_ruling` (3,) is g_{N+1} where the seam is open.

    The curvature is that of the folds.
    """
    band = state.band
    if band.closed:
        fold = folding.from_state(state)
        kappa, eta = fold.curvature(band.h), fold.eta.copy()
    else:
        fold = strip_folding.from_state(state)
        kappa, eta = strip_folding.curvature(fold, band)[:-1], fold.eta[:-1]
    following = state.next_rulings()
    if end_ruling is not None:
        following[-1] = end_ruling
        kappa[0] = eta[0] = np.nan
    rise = np.einsum("ij,ij->i", state.u, following - state.g)
    midline = np.vstack((np.zeros(3), np.cumsum(state.u, axis=0) * band.h))
    return Geometry(midline, kappa, kappa * eta, eta, rise / band.h)
