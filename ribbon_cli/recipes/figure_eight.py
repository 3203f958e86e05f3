"""Two half-twists: Euler's figure-eight, lifted at its crossing so that one sheet lies above the other.

The planar figure-eight elastica has the tangent's angle 2 arcsin(k sn(w s, k)) and the curvature
2 k w cn(w s, k) with w = 4 K(k) / l; it closes where 2 E(k) = K(k). A band along it stands on its edge, and
passes through itself at the crossing, at the two inflections. With rulings aslant,

    eta = a cn (sn^2 - c),   c such that the integral of kappa eta cos(angle) over a lobe vanishes,

one lobe climbs from one sheet at the crossing to the other, the other lobe falls back, and neither tilts
about the line through both. The height at the crossing grows with a, and is to be `LIFT` times the band's
width. Fold angles close what is left of second order. Lk = +-1 is the writhe of the crossing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from ..doors import Later
from ..keys import SEGMENTS
from .recipe import Made, Making, NotMadeError, Recipe, Settings, Way

if TYPE_CHECKING:
    import numpy as np
    import scipy

    from ..model import folding, topology
    from ..model.band import Band, State
else:
    np, scipy = Later("numpy"), Later("scipy")
    folding, topology = Later("ribbon_cli.model.folding"), Later("ribbon_cli.model.topology")

STAGE = "construction"
LIFT = 1.2
"""Height at the crossing, in widths 2 b of the band: sheets above each other are apart from 1 on."""
STEEPEST = 1.5
"""Largest a that is tried: beyond, the height no longer grows with it."""


def modulus() -> float:
    """The parameter m = k^2 of the figure-eight elastica, 2 E(m) = K(m)."""

    def excess(m: float) -> float:
        return float(2.0 * scipy.special.ellipe(m) - scipy.special.ellipk(m))

    return float(scipy.optimize.brentq(excess, 0.5, 0.99, xtol=1e-15, rtol=1e-15))


def lifted(band: Band, slant: float) -> State:
    """The figure-eight with eta = `slant` cn(w s), closed up; inflections are on the middles of facets N and
    N/2. Raises ClosureError."""
    n, m = band.segments, modulus()
    quarter = scipy.special.ellipk(m)

    def turned(s: np.ndarray) -> np.ndarray:
        """The tangent's angle at parts s of the length, counted from a lobe's middle."""
        sn = scipy.special.ellipj(4.0 * quarter * s, m)[0]
        return np.asarray(2.0 * np.arcsin(math.sqrt(m) * sn))

    # Node i is at (i + 1/2) h from an inflection, which is a quarter before a lobe's middle.
    s = (np.arange(n) + 0.5) / n - 0.25
    theta = turned(s + 0.5 / n) - turned(s - 0.5 / n)
    sn, cn = scipy.special.ellipj(4.0 * quarter * s, m)[:2]
    tilting = theta * cn * np.cos(turned(s))
    eta = slant * cn * (sn**2 - (tilting @ sn**2) / tilting.sum())
    folded = folding.Folding(theta * np.sqrt(1.0 + eta * eta), eta)
    return folding.to_state(band, folding.close(folded, band.sigma, tolerance=1e-14))


def height(state: State) -> float:
    """The distance of the midline from itself at the crossing, between the middles of facets N and N/2."""
    n, h = state.band.segments, state.band.h
    first = -0.5 * h * state.u[-1]
    second = h * (state.u[: n // 2].sum(axis=0) - 0.5 * state.u[n // 2 - 1])
    return float(np.linalg.norm(second - first))


def figure_eight(band: Band, half_twists: int) -> State:
    """The lifted figure-eight; positive `half_twists` is right-handed, Lk = 1. Raises ValueError for other
    topologies and an odd number of segments, ClosureError where the band is too wide."""
    if abs(half_twists) != 2 or band.sigma != 1 or band.segments % 2:
        raise ValueError("a figure-eight has two half-twists, sigma 1 and an even number of segments")
    hand = math.copysign(1.0, half_twists)
    wanted = LIFT * 2.0 * band.half_width

    def excess(slant: float) -> float:
        return height(lifted(band, hand * slant)) - wanted

    if excess(STEEPEST) < 0.0:
        raise folding.ClosureError(
            f"the figure-eight cannot be lifted by {wanted:.3g} at its crossing: take a narrower band"
        )
    return lifted(band, hand * float(scipy.optimize.brentq(excess, 0.0, STEEPEST, xtol=1e-12)))


def _made(band: Band, half_twists: int) -> Made:
    try:
        state = figure_eight(band, half_twists)
    except folding.ClosureError as error:
        raise NotMadeError(str(error)) from error
    found = topology.linking_number(state.u, state.g, band.sigma, band.h).linking_number
    if abs(found - 0.5 * half_twists) > 1e-6:
        raise NotMadeError(f"closing it on this mesh makes Lk = {found:g}: take more segments")
    return Made(state, "figure-eight elastica, lifted at its crossing")


def _way(band: Band, half_twists: int, _settings: Settings) -> Way:
    return Way("figure-eight let down", (Making((STAGE,), lambda _k, _state: _made(band, half_twists)),))


CARD = Recipe(
    name="figure-eight",
    about="Euler's figure-eight, lifted at its crossing, where it rests on itself",
    half_twists="2 or -2",
    fits=lambda n: abs(n) == 2,
    passes="`construction`",
    freed="figure-eight let down",
    way=_way,
    stages=lambda _: (STAGE,),
    segments=replace(SEGMENTS, even=True),
    fewest=lambda _: 20,
    resting=True,
)
