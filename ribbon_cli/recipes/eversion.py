"""The eversion: half of a cylinder turned inside out, Koldaev (2022), 3.2.1.

Two opposite rulings turn about v_1 in equal steps, (3.6)-(3.8), until they are antiparallel. The midline's
chord between them then lies along v_2, as both rulings do. Cut there, the second half is turned by pi about
v_1, through the chord's middle, which brings each of its ends to where the other was. Joined again it is
run through the other way, so that its curvature has changed sign: two inflections, at the joints, and still
Lk = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..model.band import Array, State
from ..model.folding import from_state
from ..model.problem import Prescription
from ..model.topology import linking_number

INFLECTIONS = 2


@dataclass(frozen=True)
class EversionStage:
    """One auxiliary problem: stage `index` of `count`, both rulings turned by `angle` (radians).

    The index is not whole where a step that failed was halved.
    """

    index: float
    count: int
    angle: float
    prescription: Prescription

    @property
    def name(self) -> str:
        """The stage in words."""
        return f"eversion {self.index:.10g}/{self.count}"

    def guard(self) -> Callable[[State], str | None]:
        """Complain about states that have another linking number than the cylinder's."""

        def check(state: State) -> str | None:
            try:
                lk = linking_number(state.u, state.g, state.band.sigma, state.band.h).linking_number
            except ValueError:
                return None  # not closed yet: between iterates sum u is not zero
            return f"(Lk = {lk:.3f} in place of 0.)" if abs(lk) > 0.25 else None

        return check


def eversion_stages(segments: int, steps: int) -> Iterator[EversionStage]:
    """The auxiliary problems k = 0..steps, (3.6)-(3.8); k = 0 is the cylinder itself.

    Raises ValueError if `segments` is odd, so that no ruling is opposite the first, or steps is not positive.
    """
    if segments % 2 or steps < 1:
        raise ValueError("an eversion needs an even number of segments and at least one step")
    for k in range(steps + 1):
        yield eversion_stage(segments, k, steps)


def eversion_stage(segments: int, index: float, steps: int) -> EversionStage:
    """The auxiliary problem after `index` steps, whole or not, of so many."""
    angle = 0.5 * math.pi * index / steps
    # Exact at the end, so that the halves fit when one is turned.
    sine, cosine = (1.0, 0.0) if index == steps else (math.sin(angle), math.cos(angle))
    prescribed = {0: np.array([0.0, sine, cosine]), segments // 2: np.array([0.0, -sine, cosine])}
    return EversionStage(index, steps, angle, Prescription(prescribed))


def rejoined(state: State) -> State:
    """The band cut along both prescribed rulings, its second half turned by pi about v_1, and joined again.

    `state` is that of the last auxiliary problem. Facet N/2 + j of the result is the turned facet N + 1 - j
    run through the other way: u = -R u, while rulings only turn and xi stays.
    """
    pieces = turned(state, math.pi)
    return State(state.band, pieces.u, pieces.g, pieces.xi)


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
    theta = from_state(state).theta
    side = np.sign(theta[np.abs(theta) > 1e-9 * np.abs(theta).max()])
    changes = int((side != np.roll(side, 1)).sum())
    if changes == INFLECTIONS:
        return None
    what = "the ring" if changes == 0 else "another shape"
    return f"(It is {what}: kappa changes sign {changes} times, where an everted cylinder has {INFLECTIONS}.)"
