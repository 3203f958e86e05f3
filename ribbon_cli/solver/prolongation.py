"""From a coarse state to a start on a finer grid: smooth prolongation, and the thesis's splitting.

Smooth prolongation interpolates curvature (fold angle per length) and eta along the band by cubic
splines, periodic on two-sided bands and antiperiodic on one-sided ones, samples them on the new grid
and restores closure in folding coordinates. The start is exactly isometric. Splitting, Koldaev (2022),
section 3.1, halves facets and makes a kinked start that costs many more steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np
import scipy

from ..model import folding, strip_folding
from ..model.band import Array, Band, State
from ..model.folding import Folding
from ..model.splines import PeriodicSpline, seam_spline

NEAR_LIMIT = 0.9
STEEPENING = 2.7
"""The gap 1 - max |b eta'| at an inflection falls like this power of h (measured on pi bands at b = 0.2
to 1.0, N = 50 to 400: 2.5 to 2.8). It shapes starts only, never results."""


CLEARLY = 0.7
"""Cosine of an inflection's phase on the grid from which it counts as at a node or a facet's middle."""


class Phase(Enum):
    """Where the first inflection is put on the new grid; see `grid_shift`."""

    FACET = "facet"
    NODE = "node"


@dataclass(frozen=True)
class Start:
    """A start on the new grid; `state` is isometric if it comes from smooth prolongation."""

    state: State
    method: str


def closed_spline(values: Array, length: float, first: float, sign: int) -> PeriodicSpline:
    """Cubic spline through (N,) values at first, first + h, ... with f(s + length) = sign f(s)."""
    n = values.size
    return seam_spline(values, first + length * np.arange((n if sign > 0 else 2 * n) + 1) / n, sign)


def inflections(kappa: Array, band: Band) -> Array:
    """Arclengths in [0, l) at which the curvature changes sign, from node values (N,)."""
    threshold = 1e-9 * float(np.abs(kappa).max())
    if float(np.abs(kappa).min()) > 0 and (np.sign(kappa) == np.sign(kappa[0])).all() and band.sigma > 0:
        return np.empty(0)
    spline = _curvature_spline(kappa, band)
    roots = spline.roots()
    slopes = np.abs(spline(roots, 1)) > threshold
    return np.unique(np.round(roots[slopes & (roots < band.length * (1 - 1e-12))], 14))


def _curvature_spline(kappa: Array, band: Band) -> PeriodicSpline:
    """The spline through curvatures (N,) at the nodes; inflections and new nodes are looked up on it."""
    return _known_spline(kappa.tobytes(), band.length, band.sigma)


@lru_cache(maxsize=2)
def _known_spline(kappa: bytes, length: float, sigma: int) -> PeriodicSpline:
    return closed_spline(np.frombuffer(kappa), length, 0.0, sigma)


@lru_cache(maxsize=2)
def _folding_of(state: State) -> Folding:
    return folding.from_state(state)


@lru_cache(maxsize=4)
def inflections_of(state: State) -> Array:
    """Arclengths (k,) of a state's inflections; see `inflections`. Asked for more than once."""
    return inflections(_folding_of(state).curvature(state.band.h), state.band)


def grid_shift(roots: Array, h: float, phase: Phase) -> float:
    """Shift in [-h/2, h/2] of a grid of step h that puts inflections on facets' middles or on nodes.

    Sliding is a mode of the continuum but not of the grid: which phase is the minimum and which the
    saddle of index 1 depends on the band. Several inflections, at arclengths `roots` (k,), share the circular
    mean of their phases.
    """
    if roots.size == 0:
        return 0.0
    offset = 0.5 if phase is Phase.FACET else 0.0
    turns = np.exp(2j * np.pi * (roots / h - offset))
    return float(np.angle(turns.sum()) / (2 * np.pi) * h)


@lru_cache(maxsize=2)
def smooth(state: State, segments: int, phase: Phase = Phase.FACET) -> Start:
    """Smooth prolongation to any number of segments. Who solves from it may ask for it again to compare.

    Raises ClosureError where the interpolated rulings meet inside the strip or it cannot be closed.
    """
    if not state.band.closed:
        return smooth_strip(state, segments)
    old, new = state.band, state.band.with_segments(segments)
    fold = _folding_of(state)
    kappa = fold.curvature(old.h)
    shift = grid_shift(inflections_of(state), new.h, phase)
    nodes: Array = shift + new.h * np.arange(segments, dtype=np.float64)
    eta = _sampled_eta(state, fold.eta, new, nodes)
    theta = _sampled(_curvature_spline(kappa, old), 0.0, old, nodes) * new.h * np.sqrt(1.0 + eta**2)
    closed = folding.close(Folding(theta, eta), old.sigma)
    fine = _placed_like(state, folding.to_state(new, closed), shift)
    return Start(fine, f"smooth prolongation, inflection on a {phase.value}")


def smooth_strip(state: State, segments: int) -> Start:
    """The same for a strip with ends, between which nothing slides: its end is brought to its place again."""
    old, new = state.band, state.band.with_segments(segments)
    fold = strip_folding.from_state(state)
    coarse, fine = (band.h * np.arange(band.segments + 1) for band in (old, new))
    eta = _sampled_strip_eta(state, scipy.interpolate.CubicSpline(coarse, fold.eta)(fine), new)
    kappa = scipy.interpolate.CubicSpline(coarse, strip_folding.curvature(fold, old))(fine)
    folded = Folding(strip_folding.angles(kappa, eta, new, float(fold.theta[0])), eta)
    return Start(strip_folding.to_state(new, strip_folding.hold(folded, new)), "smooth prolongation")


def phase_of(state: State) -> Phase:
    """The grid phase of a state: whether its inflections lie nearer to nodes or to facets' middles."""
    roots = inflections_of(state) if state.band.closed else np.empty(0)
    if roots.size == 0:
        return Phase.FACET
    return Phase.NODE if float(np.cos(2 * np.pi * roots / state.band.h).sum()) > 0 else Phase.FACET


def clear_phase(state: State) -> Phase | None:
    """The grid phase where all inflections sit alike on the grid and near a node or a facet's middle."""
    roots = inflections_of(state) if state.band.closed else np.empty(0)
    if roots.size == 0:
        return None
    alike = np.cos(2 * np.pi * roots / state.band.h)
    if float(np.abs(alike).min()) < CLEARLY or (np.sign(alike) != np.sign(alike[0])).any():
        return None
    return Phase.NODE if alike[0] > 0 else Phase.FACET


def _sample(values: Array, first: float, band: Band, s: Array) -> Array:
    """Values (N,) at first, first + h, ... of a band, interpolated at arclengths s."""
    return _sampled(closed_spline(values, band.length, first, band.sigma), first, band, s)


def _sampled(spline: PeriodicSpline, first: float, band: Band, s: Array) -> Array:
    period = band.length if band.sigma > 0 else 2.0 * band.length
    out: Array = spline(first + (s - first) % period)
    return out


def _sampled_eta(state: State, eta: Array, fine: Band, nodes: Array) -> Array:
    """Eta on the new nodes with |b eta'| < 1 on every facet.

    At an inflection |b eta'| touches 1 in the continuum, so a spline through eta can overshoot it: rulings
    would cross. Slopes are capped by the coarse grid's steepest facet, whose distance from 1 is carried
    over by its power of h; what the caps take off is spread over the other facets, by their slack.
    """
    old = state.band
    direct = _sample(eta, 0.0, old, nodes)
    following = np.append(direct[1:], old.sigma * direct[0])

    def xi() -> Array:
        return _sample(state.xi, 0.5 * old.h, old, nodes + 0.5 * fine.h)

    rise = _capped_rise(state, following - direct, fine, xi)
    if rise is None:
        return direct
    summed = np.concatenate(([0.0], np.cumsum(rise)[:-1]))
    # With an antiperiodic eta the sum fixes the constant; a periodic one keeps its mean.
    return summed + (direct[0] if old.sigma < 0 else float(np.mean(direct - summed)))


def _sampled_strip_eta(state: State, direct: Array, fine: Band) -> Array:
    """The same for a strip: eta (N+1,) on its new nodes, of which the first and the last keep theirs."""
    old = state.band

    def xi() -> Array:
        facets = scipy.interpolate.CubicSpline(old.h * (np.arange(old.segments) + 0.5), state.xi)
        return np.asarray(facets(fine.h * (np.arange(fine.segments) + 0.5)))

    rise = _capped_rise(state, np.diff(direct), fine, xi)
    return direct if rise is None else direct[0] + np.concatenate(([0.0], np.cumsum(rise)))


def _capped_rise(state: State, direct: Array, fine: Band, xi: Callable[[], Array]) -> Array | None:
    """Rises of eta (N,) over the new facets, their slopes capped; None if no cap was needed.

    `direct` are those of the spline through eta, and `xi` samples the state's xi at the facets.
    """
    old = state.band
    slope = direct * (fine.half_width / fine.h)
    gap = float(2.0 / (1.0 + np.exp(2.0 * np.abs(state.xi).max())))
    cap = 1.0 - gap * min(1.0, fine.h / old.h) ** STEEPENING
    steep = np.abs(slope) > cap
    if not steep.any():
        return None
    if np.abs(slope).max() >= 1.0:
        # Rulings would cross: near the limit take xi's own spline, whose increments h tanh(xi) / b cannot.
        steep = np.abs(slope) > NEAR_LIMIT
        capped = np.where(steep, np.tanh(xi()), slope)
    else:
        capped = np.clip(slope, -cap, cap)
    slack = np.where(steep, 0.0, 1.0 - np.minimum(slope**2, 1.0))
    capped += (slope.sum() - capped.sum()) * slack / slack.sum()
    out: Array = capped * (fine.h / fine.half_width)
    return out


def _placed_like(coarse: State, fine: State, shift: float) -> State:
    """Rotate the fine state so that it lies over the coarse one as well as it can (Kabsch)."""
    n, h = fine.band.segments, coarse.band.h
    middles = shift + fine.band.h * (np.arange(n) + 0.5)
    owner = np.floor(middles / h).astype(int) % coarse.band.segments
    u, _, vt = np.linalg.svd(fine.u.T @ coarse.u[owner])
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    g = fine.g @ turn
    # One-sided bands have two ways to name the side; take the one the coarse band has.
    if float(np.sum(g[0] * coarse.g[int(np.floor(shift / h + 0.5)) % coarse.band.segments])) < 0:
        g = -g
    return State(fine.band, fine.u @ turn, g, fine.xi)


def split(state: State) -> Start:
    """Split every facet in two, Koldaev (2022), section 3.1: u is kept, the middle ruling averages."""
    new = state.band.with_segments(2 * state.band.segments)
    u = np.repeat(state.u, 2, axis=0)
    g = np.stack((state.g, 0.5 * (state.g + state.next_rulings())), axis=1).reshape(-1, 3)
    return Start(State(new, u, g, np.repeat(state.xi, 2), state.g_end), "facets split in two")


def divided(state: State, parts: int) -> State:
    """The same surface with every facet cut into equal parts: rulings between two are their mixtures."""
    if parts == 1:
        return state
    new = state.band.with_segments(parts * state.band.segments)
    weights = (np.arange(parts) / parts)[:, None]
    g = (1.0 - weights) * state.g[:, None] + weights * state.next_rulings()[:, None]
    u, xi = np.repeat(state.u, parts, axis=0), np.repeat(state.xi, parts)
    return State(new, u, g.reshape(-1, 3), xi, state.g_end)
