"""Random isometric shapes: strips with random curvature and eta, closed in folding coordinates.

Any fold angles and etas make an isometric strip, so that a random start has to be closed, or brought to its
end's place, and nothing else. Sizes are those of bands with few inflections; what passes through itself on
the way to an equilibrium is found out there.
"""

from __future__ import annotations

import math

import numpy as np

from ..parts import FREE
from . import strip_folding
from .band import Array, Band, State
from .folding import ClosureError, Folding, close, to_state
from .topology import linking_number, turn_of

MOST_DRAWS = 400
"""Draws after which there is no start: closed bands of the right linking number take 3 to 30 at Lk = 1/2."""
WAVES = 4
"""Longest waves of a smooth start; bands with more half-twists than that have as many as these and one
more."""
STEEPEST = 0.85
"""Bound of b |eta'| at a start: from 1 on rulings meet inside the strip."""
SLACK = 0.1
"""Weight of the etas where the end of a strip is brought to its place."""
NEAREST_INFLECTIONS = 0.36
"""Least distance of neighbouring inflections of a start in units, in parts of their mean distance."""
MOST_TURN = 1.0
"""Turns by which Tw + Wr of a strip may differ from its twist: another shape is knotted, or passed through
itself."""


def random_start(band: Band, half_twists: int, rng: np.random.Generator) -> State | None:
    """A random shape of a band with Lk = `half_twists`/2, or of a strip; None where no draw comes to one.

    Of closed bands a draw with the opposite linking number is mirrored.
    """
    for _ in range(MOST_DRAWS):
        try:
            state = (_closed if band.closed else _held)(band, half_twists, rng)
        except (ClosureError, np.linalg.LinAlgError):
            continue
        if state is not None:
            return state
    return None


# --- closed bands ---


def _closed(band: Band, half_twists: int, rng: np.random.Generator) -> State | None:
    """A draw of a closed band; None of another linking number. Raises ClosureError."""
    draw = _waves if rng.uniform() < 0.5 else _units
    folded = close(_folded(band, *draw(band, half_twists, rng), rng), band.sigma)
    state = to_state(band, folded)
    try:
        found = linking_number(state.u, state.g, band.sigma, band.h)
    except ValueError:
        return None
    if not found.exact or abs(abs(found.linking_number) - abs(0.5 * half_twists)) > 1e-6:
        return None
    if found.linking_number * half_twists < 0:
        return to_state(band, Folding(-folded.theta, folded.eta))
    return state


def _waves(band: Band, half_twists: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Curvature and eta (N,) as sums of the longest waves, antiperiodic on one-sided bands."""
    s = (np.arange(band.segments) + 0.5) / band.segments
    kappa, eta = np.zeros(band.segments), np.zeros(band.segments)
    for m in range(max(WAVES, abs(half_twists) + 1)):
        turns = 2 * m + (band.sigma < 0)
        wave = np.stack((np.cos(turns * np.pi * s), np.sin(turns * np.pi * s)))
        kappa += rng.normal(size=2) @ wave
        eta += rng.normal(size=2) @ wave / (m + 1)
    return kappa, eta


def _units(band: Band, half_twists: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Curvatures of alternating sign between inflections anywhere, and any eta (N,): three inflections or
    five, one of which is the seam's, and an even number on two-sided bands."""
    count = (3 if band.sigma < 0 else 2) + 2 * (rng.uniform() < 0.25)
    ends = np.sort(rng.uniform(size=count))
    while min(*np.diff(ends), 1.0 - (ends[-1] - ends[0])) < NEAREST_INFLECTIONS / count:
        ends = np.sort(rng.uniform(size=count))
    bend, skew, turn = (
        rng.uniform(0.5, 1.5, count),
        0.8 * rng.normal(size=count),
        0.8 * rng.normal(size=count),
    )
    s = (np.arange(band.segments) + 0.5) / band.segments
    unit = np.searchsorted(ends, s) - 1
    # Before the first inflection is the last unit, on a one-sided band seen from its other side.
    side = np.where(unit < 0, float(band.sigma), 1.0)
    last = count - 1
    start = np.where(unit < 0, ends[last] - 1.0, ends[unit])
    stop = np.where(
        unit < 0, ends[0], np.where(unit == last, ends[0] + 1.0, ends[np.minimum(unit + 1, last)])
    )
    unit %= count
    t = np.pi * (s - start) / (stop - start)
    kappa = side * (-1.0) ** unit * bend[unit] * np.sin(t)
    return kappa, side * (skew[unit] * np.sin(t) + turn[unit] * np.sin(2 * t))


def _folded(band: Band, kappa: Array, eta: Array, rng: np.random.Generator) -> Folding:
    """Fold angles of a curvature and eta (N,) brought to random sizes, in units of 2 pi / length."""
    kappa, eta = _sized(band, kappa, eta, rng)
    return Folding(kappa * band.h * np.sqrt(1.0 + eta**2), eta)


def _sized(band: Band, kappa: Array, eta: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    kappa = kappa * (rng.uniform(1.2, 2.2) * math.tau / band.length / np.sqrt(np.mean(kappa**2)))
    eta = eta * (rng.uniform(0.2, 1.0) / np.sqrt(np.mean(eta**2)))
    steepest = float(np.abs(np.diff(eta)).max()) * band.half_width / band.h
    return kappa, eta * min(1.0, STEEPEST / max(steepest, 1e-300))


# --- strips with ends ---


def _held(band: Band, _half_twists: int, rng: np.random.Generator) -> State | None:
    """A draw of a strip between its ends; None of one that is knotted. Raises ClosureError."""
    ends = band.parts.ends
    assert ends is not None
    s = np.arange(band.segments + 1) / band.segments
    kappa = rng.normal(size=WAVES) @ np.cos(np.pi * np.outer(np.arange(WAVES), s))
    eta = rng.normal(size=WAVES) / np.arange(1, WAVES + 1) @ np.sin(np.pi * np.outer(1 + np.arange(WAVES), s))
    kappa, eta = _sized(band, kappa, eta, rng)
    eta += ends.start_eta + (ends.end_eta - ends.start_eta) * s
    theta = strip_folding.angles(kappa, eta, band, 0.5 * float(rng.normal()))
    state = strip_folding.to_state(band, strip_folding.hold(Folding(theta, eta), band, SLACK))
    return None if _knotted(state) else state


def _knotted(state: State) -> bool:
    """Whether a strip between ends that are held turns otherwise than its twist; a free end undoes
    everything."""
    ends = state.band.parts.ends
    assert ends is not None
    if ends.end == FREE:
        return False
    try:
        turn = sum(turn_of(state))
    except ValueError:
        return True
    return abs(turn - state.band.parts.value("twist") / math.tau) > MOST_TURN
