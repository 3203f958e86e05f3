"""Two half-twists: Euler's figure-eight, lifted at its crossing so that one sheet lies above the other.

The planar figure-eight elastica has the tangent's angle 2 arcsin(k sn(w s, k)) and the curvature
2 k w cn(w s, k) with w = 4 K(k) / l; it closes where 2 E(k) = K(k). A band along it stands on its edge, and passes
through itself at the crossing, at the two inflections. With rulings aslant, eta = a cn(w s), torsion kappa eta
of one sign lowers one lobe and raises the other: the sheets at the crossing part by a height that grows with a.
Lk = +-1 is the writhe of the crossing. The height is `LIFT` times the band's width.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..doors import Later
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
STEEPEST = 1.0
"""Largest a that is tried: rulings at 45 degrees."""


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
    eta = slant * scipy.special.ellipj(4.0 * quarter * s, m)[1]
    folded = folding.Folding(theta * np.sqrt(1.0 + eta * eta), eta)
    return folding.to_state(band, folding.close(folded, band.sigma, tolerance=1e-14))
