"""The strip between its ends: a planar elastica, under its loads, buckled to +y.

In the plane the facets' tangents are (cos phi_i, sin phi_i, 0), all rulings are e_z, and the strip's energy
is a function of the N angles alone: b/h times (1 - cos) of each fold, twice that at a clamp, with natural
curvature and loads as in `model`. It is minimised with the end held at its place, on a coarse mesh. The plane
is a symmetry of the strip, so that what is stationary within it is stationary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..doors import Later
from ..parts import CLAMPED, FREE, Ends
from .recipe import NotMadeError, Recipe, Settings, Way

if TYPE_CHECKING:
    import numpy as np
    import scipy

    from ..model import band as bands
    from ..model import bending, folding, staggered, terms
    from ..model import strip_folding as strips
    from ..model.band import Array, Band, State
else:
    np, scipy = Later("numpy"), Later("scipy")
    bands, bending, folding, staggered, terms, strips = (
        Later(f"ribbon_cli.model.{name}")
        for name in ("band", "bending", "folding", "staggered", "terms", "strip_folding")
    )

COARSE = 24
"""Segments of the mesh on which the elastica is looked for; on finer ones Newton's method goes on from
there."""
STEPS, TOLERANCE = 300, 1e-9
LARGEST_MISFIT = 1e-6
"""How far, by the length, the end may be from its place."""
SLACK = 0.1
"""Weight of a change of eta beside one of theta where the ends' rulings are turned out of the plane's
normal."""
_WIDEST_BUMP = 3.8317
"""Amplitude of phi = A sin(2 pi s / l) at which its span, l J_0(A), is least."""


def elastica(band: Band) -> State:
    """The planar state of least energy, by direct minimisation. Raises NotMadeError where none is found."""
    ends = band.parts.ends
    assert ends is not None
    coarse = band.with_segments(min(band.segments, COARSE))
    angles = _Plane(coarse, ends).minimum(_bump(coarse, ends))
    if coarse.segments < band.segments:
        middles, own = (staggered.facets(each) for each in (coarse, band))
        angles = scipy.interpolate.CubicSpline(middles, angles)(own)
    return _state(band, angles)


def _state(band: Band, angles: Array) -> State:
    n = band.segments
    u = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(n)))
    g = np.tile(np.array([0.0, 0.0, 1.0]), (n, 1))
    return bands.State(band, u, g, np.zeros(n), g[0].copy()).on(band)


def _bump(band: Band, ends: Ends) -> Array:
    """Angles (N,) to begin at: a bump to +y whose span is about right, or straight on where the end is
    free."""
    part = staggered.facets(band) / band.length
    if ends.end == FREE:
        return np.zeros(band.segments)
    chord = math.hypot(ends.span, ends.lift) / band.length
    towards = math.atan2(ends.lift, ends.span)
    least = float(scipy.special.j0(_WIDEST_BUMP))
    if ends.span < 0.0 and abs(ends.lift) < -ends.span:
        chord, towards = -chord, math.atan2(-ends.lift, -ends.span)
    wide = min(max(chord, 0.999 * least), 1.0 - 1e-9)
    size = float(scipy.optimize.brentq(lambda a: scipy.special.j0(a) - wide, 0.0, _WIDEST_BUMP))
    if CLAMPED not in (ends.start, ends.end):
        return size * np.cos(math.pi * part) + towards
    return size * np.sin(2.0 * math.pi * part) + np.sin(math.pi * part) * towards + ends.tilt * part**2


@dataclass
class _Plane:
    """The energy of planar states of a strip in the angles (N,), by the half-width."""

    band: Band
    ends: Ends

    def __post_init__(self) -> None:
        band, n = self.band, self.band.segments
        self.stiffness = bending.cells(band) / band.h
        self.natural = bending.folds(band) * band.parts.material.natural_curvature
        # Loads are linear in the tangents of a planar state: what they pull at each of them.
        flat = np.zeros((14, n + 1))
        pulls = (term.gradient(flat) for term in terms.terms_of(band) if term.load)
        self.pull = sum(pulls, np.zeros((14, n + 1)))[3:6, :n] / band.half_width

    def minimum(self, angles: Array) -> Array:
        """The angles of least energy next to some. Raises NotMadeError."""
        places = (math.nan,) * 2 if self.ends.end == FREE else (self.ends.span, self.ends.lift)
        held = [] if self.ends.end == FREE else [{"type": "eq", "fun": self._misfit, "jac": self._turned}]
        found = scipy.optimize.minimize(
            lambda x: self._energy(x)[0],
            angles,
            jac=lambda x: self._energy(x)[1],
            method="SLSQP",
            constraints=held,
            options={"maxiter": STEPS, "ftol": TOLERANCE},
        )
        if not np.isfinite(found.x).all() or (held and np.abs(self._misfit(found.x)).max() > LARGEST_MISFIT):
            raise NotMadeError(f"no planar elastica ends at span {places[0]:g}, lift {places[1]:g}")
        return np.asarray(found.x)

    def _energy(self, angles: Array) -> tuple[float, Array]:
        """The energy by b, and its gradient (N,)."""
        folds = np.diff(np.concatenate(([0.0], angles, [self.ends.tilt])))
        c, s = np.cos(angles), np.sin(angles)
        value = float((self.stiffness * (1.0 - np.cos(folds)) - self.natural * np.sin(folds)).sum())
        value += float((self.pull[0] * c + self.pull[1] * s).sum())
        slope = self.stiffness * np.sin(folds) - self.natural * np.cos(folds)
        return value, slope[:-1] - slope[1:] - self.pull[0] * s + self.pull[1] * c

    def _misfit(self, angles: Array) -> Array:
        """How far the end is from its place (2,), by the length."""
        middle = np.array([np.cos(angles).mean(), np.sin(angles).mean()])
        return middle - np.array([self.ends.span, self.ends.lift]) / self.band.length

    def _turned(self, angles: Array) -> Array:
        """Its Jacobian (2, N)."""
        return np.vstack((-np.sin(angles), np.cos(angles))) / angles.size


def _way(band: Band, _half_twists: int, _settings: Settings) -> Way:
    ends = band.parts.ends
    assert ends is not None
    flat = replace(ends, start_eta=0.0, end_eta=0.0)
    planar = elastica(replace(band, parts=replace(band.parts, ends=flat)))
    if flat == ends:
        return Way("planar elastica", ready=planar)
    return Way("planar elastica, its rulings turned at the ends", ready=_slanted(planar, band))


def _slanted(planar: State, band: Band) -> State:
    """A planar state with other rulings at its ends: eta goes from one end's to the other's."""
    folded, ends = strips.from_state(planar), band.parts.ends
    assert ends is not None
    eta = np.linspace(ends.start_eta, ends.end_eta, band.segments + 1)
    kappa = strips.curvature(folded, planar.band)
    theta = strips.angles(kappa, eta, band, float(folded.theta[0]))
    return strips.to_state(band, strips.hold(folding.Folding(theta, eta), band, SLACK))


CARD = Recipe(
    name="strip",
    about="the planar elastica between the ends of an open strip, under its loads, buckled to +y",
    half_twists="open",
    fits=lambda _: False,
    passes="nothing",
    freed="strip",
    way=_way,
    open=True,
)
