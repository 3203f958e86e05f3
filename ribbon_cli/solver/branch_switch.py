"""Onto the other branch at a simple bifurcation.

Where the projected Hessian has a null vector v and the branch passes on, a second branch crosses it. Both
tangents lie in the plane of the branch's own tangent t and (v, dp = 0). The new branch is met on the
hyperplane at a small distance along that direction of the plane which is orthogonal to t (Keller's
perpendicular method): at a pitchfork that is the new branch's tangent, elsewhere the corrector has further
to go. One point is found on either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .arclength import CorrectorError, Point, Tangent, along, correct, tangent_from, unit
from .kkt import FactorisationError
from .newton import Guard

DISTANCES = (0.02, 0.005, 0.00125, 0.0003)
"""Distances from the bifurcation at which the new branch is looked for, in the order tried."""
SIDEWAYS = 3.0
"""Largest departure from the predictor, in units of its length: the new branch may leave the plane's
orthogonal direction by an angle of about 70 degrees."""


@dataclass(frozen=True)
class Switched:
    """A point on the new branch, its unit tangent away from the bifurcation, and how far off it is."""

    point: Point
    tangent: Tangent
    distance: float


def switch(base: Point, tangent: Tangent, mode: Tangent, side: int, guard: Guard | None = None) -> Switched:
    """The new branch at a bifurcation, to the side +1 or -1 of its mode.

    `tangent` is the unit tangent of the known branch, `mode` the null vector. Raises CorrectorError where no
    other branch is found: its message says why.
    """
    part = base.product(tangent, mode)
    across = unit(
        base,
        Tangent(
            side * (mode.x - part * tangent.x),
            side * (mode.multipliers - part * tangent.multipliers),
            side * (mode.value - part * tangent.value),
        ),
    )
    trouble = ""
    for distance in DISTANCES:
        try:
            point = correct(base, across, distance, along(base, across, distance), guard)
            onward = tangent_from(point, across)
        except (CorrectorError, FactorisationError) as error:
            trouble = str(error)
            continue
        chord = Tangent(point.x - base.x, point.multipliers - base.multipliers, point.value - base.value)
        far = math.sqrt(max(base.product(chord, chord) - distance**2, 0.0))
        if far <= SIDEWAYS * distance:
            return Switched(point, onward, distance)
        trouble = f"the point found lies {far:.2g} beside the direction looked along"
    raise CorrectorError(f"no other branch was found at {base.symbol} = {base.value:.12g}: {trouble}")
