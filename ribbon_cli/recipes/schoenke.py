"""Bands with n inflections from flat and cylindrical pieces, after Schoenke et al.; Koldaev (2022), 3.4.1.

n equal units, kappa and eta changing sign from one to the next. A unit is a flat piece of midline length a
on which eta grows from 0 to eta_0, an arc of a cylinder of curvature k whose rulings keep eta_0, turning
by Theta in all about them, and a flat piece on which eta falls back to 0. With c = eta_0 w and
w = 1/sqrt(1 + eta_0^2), a unit followed by a half-turn about its tangent is a rotation by 2 pi / n, and so
n units close, if

    sin(Theta/2) c = cos(pi/n),   a = -(w / 2k) (c^2 Theta + 2 w^2 tan(Theta/2)),   n (2 a + Theta w / k) = l.

Theta > pi stays free. Rulings on the flat pieces keep apart as long as b eta_0 < a. The energy
n (b/2) k Theta / w^3 falls as Theta grows, and so does a / eta_0: the band of least energy is the one whose
rulings come as near to each other as they may. As Theta falls to pi the band is folded flat, of half-width
(l / 2n) tan(pi/n) at most; for n = 3 that is the triangle folded from a strip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..doors import Later
from .recipe import Made, Making, NotMadeError, Recipe, Settings, Way

if TYPE_CHECKING:
    import numpy as np
    import scipy

    from ..model import folding, topology
    from ..model.band import Array, Band, State
else:
    np, scipy = Later("numpy"), Later("scipy")
    folding, topology = Later("ribbon_cli.model.folding"), Later("ribbon_cli.model.topology")

STAGE = "construction"

STEEPEST = 0.9
"""b |eta'| on the flat pieces of a narrow band; 1 is where rulings meet and xi is infinite."""


@dataclass(frozen=True)
class Unit:
    """One of the n units: `turn` Theta in radians, arc's `curvature` k, `flat` length a, `eta` eta_0."""

    turn: float
    curvature: float
    flat: float
    eta: float

    @property
    def width(self) -> float:
        """The half-width a / eta_0 at which this unit's rulings meet."""
        return self.flat / self.eta

    @property
    def arc(self) -> float:
        """Length of the arc along the midline, Theta w / k."""
        return self.turn / (self.curvature * math.sqrt(1.0 + self.eta**2))

    def energy(self, half_width: float) -> float:
        """Bending energy of one unit, (b/2) k^2 (1 + eta_0^2)^2 times the arc's length."""
        return 0.5 * half_width * self.curvature**2 * (1.0 + self.eta**2) ** 2 * self.arc


def unit(inflections: int, turn: float, length: float) -> Unit:
    """The unit with Theta = `turn`. Raises ValueError where there is none: eta_0 or a would be infinite."""
    c = math.cos(math.pi / inflections) / math.sin(0.5 * turn)
    if not (math.pi < turn < 2.0 * math.pi and c < 1.0):
        raise ValueError(f"no unit of {inflections} turns by {turn:g}")
    w = math.sqrt(1.0 - c * c)
    flat = -0.5 * w * (c * c * turn + 2.0 * w * w * math.tan(0.5 * turn))  # times k
    curvature = inflections * (2.0 * flat + turn * w) / length
    return Unit(turn, curvature, flat / curvature, c / w)


def widest(inflections: int, length: float) -> float:
    """The half-width (l / 2n) tan(pi/n) of the band folded flat: all of the construction are narrower."""
    return 0.5 * length / inflections * math.tan(math.pi / inflections)


def best_unit(inflections: int, half_width: float, length: float) -> Unit:
    """The unit of least energy among those whose rulings keep apart.

    They may come as near as b eta_0 / a = 0.9 on narrow bands, nearer on those that have to.
    Raises ValueError if the half-width is `widest` or more.
    """

    limit = widest(inflections, length)
    if not 0.0 < half_width < limit:
        raise ValueError(
            f"the rulings meet: {inflections} half-twists need a half-width below {limit:.6g}, "
            f"got {half_width:g}"
        )
    steepest = STEEPEST + (1.0 - STEEPEST) * half_width / limit
    # From where the band is folded flat (1e-7 short of it) to where its flat pieces vanish.
    low, high = math.pi + 1e-7, _last_turn(inflections)
    if half_width / unit(inflections, low, length).width >= steepest:
        return unit(inflections, low, length)

    def excess(turn: float) -> float:
        tried = unit(inflections, turn, length)
        return steepest * tried.flat - half_width * tried.eta

    return unit(inflections, float(scipy.optimize.brentq(excess, low, high, xtol=1e-14, rtol=1e-15)), length)


def _last_turn(inflections: int) -> float:
    """The Theta at which the flat pieces vanish, a = 0."""

    cosine = math.cos(math.pi / inflections)

    def flat(turn: float) -> float:
        c2 = (cosine / math.sin(0.5 * turn)) ** 2
        return c2 * turn + 2.0 * (1.0 - c2) * math.tan(0.5 * turn)

    # c = 1 at the upper end, where this is positive; just above pi the tangent makes it negative.
    last = 2.0 * (math.pi - math.asin(cosine))
    return float(scipy.optimize.brentq(flat, math.pi + 1e-9, last, xtol=1e-14, rtol=1e-15))


def schoenke(band: Band, half_twists: int) -> State:
    """The closed band with |half_twists| inflections; positive is right-handed, Lk = half_twists / 2.

    Inflections sit on facets' middles where half_twists divides N, the first on facet N's. Raises ValueError
    for fewer than 3 half-twists, a band of the other sigma or one too wide, ClosureError if the folds do not
    close on so few facets.
    """
    n = abs(half_twists)
    if n < 3:
        raise ValueError(f"the construction needs at least 3 half-twists, got {half_twists}")
    if band.sigma != (-1) ** n:
        raise ValueError(f"{half_twists} half-twists need sigma {(-1) ** n}")
    piece = best_unit(n, band.half_width, band.length)
    theta, eta = _folds(piece, n, band)
    hand = math.copysign(1.0, half_twists)  # torsion is kappa eta: right-handed where both have one sign
    folded = folding.close(folding.Folding(hand * theta, eta), band.sigma, tolerance=1e-14)
    return folding.to_state(band, folded)


def _folds(piece: Unit, inflections: int, band: Band) -> tuple[Array, Array]:
    """Fold angles (N,) and eta (N,) at the nodes (i - 1/2) h, units beginning at multiples of l/n.

    A node's fold is what the arc turns over the facet's length about it.
    """
    n, h = band.segments, band.h
    period = band.length / inflections
    s = (np.arange(n) + 0.5) * h
    number = np.floor(s / period)
    sign = np.where(number % 2 == 0, 1.0, -1.0)
    within = s - number * period
    ramp = np.minimum(within, period - within) / piece.flat
    eta = sign * piece.eta * np.minimum(ramp, 1.0)
    theta = np.zeros(n)
    for unit_number in range(inflections):
        start = unit_number * period + piece.flat
        covered = np.minimum(s + 0.5 * h, start + piece.arc) - np.maximum(s - 0.5 * h, start)
        theta += (-1.0) ** unit_number * np.maximum(covered, 0.0)
    return theta * piece.curvature * math.sqrt(1.0 + piece.eta**2), eta


def _made(band: Band, half_twists: int) -> Made:
    advice = "its arcs are too short for these facets: take more segments, or a narrower band"
    try:
        state = schoenke(band, half_twists)
    except folding.ClosureError as error:
        raise NotMadeError(f"{error}; {advice}") from error
    found = topology.linking_number(state.u, state.g, band.sigma, band.h).linking_number
    if abs(found - 0.5 * half_twists) > 1e-6:
        raise NotMadeError(f"closing it on this mesh makes Lk = {found:g}; {advice}")
    return Made(state, f"n-inflection construction, n = {abs(half_twists)}")


def _way(band: Band, half_twists: int, _settings: Settings) -> Way:
    return Way("construction freed", (Making((STAGE,), lambda _k, _state: _made(band, half_twists)),))


def _notes(half_twists: int, segments: int) -> tuple[str, ...]:
    n = abs(half_twists)
    found = []
    if segments % n:
        found.append(
            f"{segments} segments do not divide into {n} equal units: the {n} inflections sit unevenly on "
            f"the grid, and there may be several minima next to each other; multiples of {n} avoid it"
        )
    if n >= 4:
        found.append(
            f"without contact the known bands with {n} half-twists are saddles; `contact: forces` looks for "
            "a minimum at which the band rests on itself"
        )
    return tuple(found)


CARD = Recipe(
    name="schoenke",
    about="a construction of flat and cylindrical pieces, for 3 half-twists and more",
    half_twists="3 or more, or -3 or less",
    fits=lambda n: abs(n) >= 3,
    passes="`construction`",
    freed="construction freed",
    way=_way,
    stages=lambda _: (STAGE,),
    fewest=lambda n: 8 * abs(n),
    widest=lambda n: widest(abs(n), 1.0),
    notes=_notes,
)
