"""The eversion: half of a cylinder turned inside out, Koldaev (2022), 3.2.1.

Two opposite rulings turn about v_1 in equal steps, (3.6)-(3.8), until they are antiparallel. The midline's
chord between them then lies along v_2, as both rulings do. Cut there, the second half is turned by pi about
v_1, through the chord's middle, which brings each of its ends to where the other was. Joined again it is
run through the other way, so that its curvature has changed sign: two inflections, at the joints, and still
Lk = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from ..doors import Later
from ..keys import SEGMENTS
from .cylinder import cylinder
from .recipe import Made, Making, Recipe, Settings, Turn, Turning, Way, steps_key, turn_name

if TYPE_CHECKING:
    import numpy as np

    from ..model import band as bands
    from ..model import folding, geometry, problem, topology
    from ..model.band import Array, Band, State
else:
    np, bands = Later("numpy"), Later("ribbon_cli.model.band")
    folding, geometry, problem, topology = (
        Later(f"ribbon_cli.model.{name}") for name in ("folding", "geometry", "problem", "topology")
    )

WORD = "eversion"
INFLECTIONS = 2
QUARTERS = 4
"""Steps of the half-turn that are kept, the first being the band cut, the last rejoined."""
HALF_TURN = (
    "cut along both rulings",
    *(f"half turned {k}/{QUARTERS}" for k in range(1, QUARTERS)),
    "halves rejoined",
)
"""The stages of the half-turn, in order."""


def eversion_stage(segments: int, steps: int, index: float) -> Turn:
    """The auxiliary problem after `index` steps, whole or not, of so many, (3.6)-(3.8); 0 is the cylinder.

    Raises ValueError if `segments` is odd, so that no ruling is opposite the first, or steps is not positive.
    """
    if segments % 2 or steps < 1:
        raise ValueError("an eversion needs an even number of segments and at least one step")
    angle = 0.5 * math.pi * index / steps
    # Exact at the end, so that the halves fit when one is turned.
    sine, cosine = (1.0, 0.0) if index == steps else (math.sin(angle), math.cos(angle))
    prescribed = {0: np.array([0.0, sine, cosine]), segments // 2: np.array([0.0, -sine, cosine])}
    return Turn(WORD, index, steps, problem.Prescription(prescribed), _guard)


def _guard(state: State) -> str | None:
    """Complain about states that have another linking number than the cylinder's."""
    try:
        lk = topology.linking_number(state.u, state.g, state.band.sigma, state.band.h).linking_number
    except ValueError:
        return None  # not closed yet: between iterates sum u is not zero
    return f"(Lk = {lk:.3f} in place of 0.)" if abs(lk) > 0.25 else None


def rejoined(state: State) -> State:
    """The band cut along both prescribed rulings, its second half turned by pi about v_1, and joined again.

    `state` is that of the last auxiliary problem. Facet N/2 + j of the result is the turned facet N + 1 - j
    run through the other way: u = -R u, while rulings only turn and xi stays.
    """
    pieces = turned(state, math.pi)
    return bands.State(state.band, pieces.u, pieces.g, pieces.xi)


@dataclass(frozen=True)
class Pieces:
    """A band cut along two rulings, its second half turned about v_1; see `turned`.

    `u` (N,3), `g` (N,3), `xi` (N,) and `midline` (N+1,3) are in the order in which the halves will be joined,
    node N/2 + 1 being the second piece's first. `end` is that piece's last ruling (3,), `cut` the first's.
    """

    u: Array
    g: Array
    xi: Array
    midline: Array
    end: Array
    cut: Array


def turned(state: State, angle: float) -> Pieces:
    """The last auxiliary problem's band in two pieces, the second turned by an angle from 0 to pi.

    The axis is v_1 through the middle of the chord between the cuts; `rejoined` is what the angle pi makes.
    """
    half, h = state.band.segments // 2, state.band.h
    turn = half_turn(angle)
    last = state.next_rulings()[half:][::-1] @ turn.T
    u = np.vstack((state.u[:half], -(state.u[half:][::-1] @ turn.T)))
    walk = np.vstack((np.zeros(3), np.cumsum(h * u, axis=0)))
    middle = 0.5 * walk[half]
    walk[half:] += middle - turn @ middle - walk[half]
    g = np.vstack((state.g[:half], last))
    xi = np.concatenate((state.xi[:half], state.xi[half:][::-1]))
    return Pieces(u, g, xi, walk, turn @ state.g[half], state.g[half])


def half_turn(angle: float) -> Array:
    """Rotation (3,3) about v_1 by an angle, exact at pi."""
    c, s = (-1.0, 0.0) if angle == math.pi else (math.cos(angle), math.sin(angle))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def not_everted(state: State) -> str | None:
    """Why a band with Lk = 0 is no everted cylinder: its curvature must change sign twice. None if it does.

    The linking number does not tell the everted cylinder from the ring.
    """
    theta = folding.from_state(state).theta
    side = np.sign(theta[np.abs(theta) > 1e-9 * np.abs(theta).max()])
    changes = int((side != np.roll(side, 1)).sum())
    if changes == INFLECTIONS:
        return None
    what = "the ring" if changes == 0 else "another shape"
    return f"(It is {what}: kappa changes sign {changes} times, where an everted cylinder has {INFLECTIONS}.)"


@dataclass(frozen=True, eq=False)
class TwoPieces:
    """What the record of a band in two pieces has in place of the joined one's; see `in_two_pieces`."""

    u: Array
    g: Array
    g_end: Array
    cut_node: int
    g_cut: Array
    midline: Array
    kappa_s: Array
    tau: Array
    eta: Array
    energy: float
    linking_number: float = math.nan
    twist: float = math.nan
    writhe: float = math.nan
    self_contact: bool = False
    clearance: float = math.nan


def in_two_pieces(joined: State, pieces: Pieces) -> TwoPieces:
    """What the record of a band in two pieces has in place of the joined one's.

    Folds at the cuts do not exist: kappa_s, tau and eta are no numbers there, and their energy is left out.
    Neither linking number nor clearance is defined.
    """
    half = joined.band.segments // 2
    whole = problem.Problem(joined.band)
    shape = geometry.geometry(joined)
    kappa, tau, eta = shape.kappa_s.copy(), shape.tau.copy(), shape.eta.copy()
    kappa[[0, half]] = tau[[0, half]] = eta[[0, half]] = math.nan
    terms = whole.energy_terms(joined.vector())
    return TwoPieces(
        u=pieces.u,
        g=pieces.g,
        g_end=pieces.end,
        cut_node=half + 1,
        g_cut=pieces.cut,
        midline=pieces.midline,
        kappa_s=kappa,
        tau=tau,
        eta=eta,
        energy=float(terms.sum() - terms[0] - terms[half]),
    )


def _half_turned(k: int, state: State | None) -> Made:
    """The band cut, its second half turned by k quarters of a half-turn; after the last it is joined."""
    assert state is not None
    joined = rejoined(state)
    if k == QUARTERS:
        return Made(joined, "halves joined again")
    pieces = turned(state, math.pi * k / QUARTERS)
    return Made(joined, f"second half turned by {k}/{QUARTERS} of pi", in_two_pieces(joined, pieces))


def _way(band: Band, _half_twists: int, settings: Settings) -> Way:
    count = settings["steps"]
    turn = partial(eversion_stage, band.segments, count)
    turning = Turning("eversion, two prescribed rulings", cylinder(band), count, turn, first=0)
    return Way("rejoined band freed", (turning, Making(HALF_TURN, _half_turned)))


CARD = Recipe(
    name="eversion",
    about="a cylinder of which half is turned inside out",
    half_twists="0",
    fits=lambda n: n == 0,
    passes="`eversion 0/K` to `eversion K/K`, `cut along both rulings`, `half turned 1/4` to `3/4`, "
    "`halves rejoined`",
    freed="everted cylinder freed",
    way=_way,
    stages=lambda settings: (
        *(turn_name(WORD, k, settings["steps"]) for k in range(settings["steps"] + 1)),
        *HALF_TURN,
    ),
    keys=(steps_key(25),),
    segments=replace(SEGMENTS, even=True),
)
