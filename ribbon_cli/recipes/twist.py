"""The twist: the cylinder's seam ruling turned until the band is twisted, Koldaev (2022), 3.3.1.

g_1 stays along v_3 and g_{N+1} = -sin(phi) v_2 + cos(phi) v_3 turns in equal steps, (3.9)-(3.10) with the
misprinted index N/2+1 read as N+1. With + sin(phi), as (3.10) has it, the turn is left-handed; here a
positive phi is right-handed, Lk > 0. Both ends are prescribed, each with its g.u = 0; while the seam is open,
Tw + Wr = phi / (2 pi), and a departure by more than a quarter means that the band went through itself.

Beyond phi = pi there is a second way out. At pi the end rulings are antiparallel and the band may turn freely
about v_3; a little further its energy is least with its tangents at the seam along -v_1, seen from where the
angle is 2 pi - phi. Turning on then untwists it, and a twist by 3 pi ends as the band of -pi. The guard holds
u_1.v_1 > 0 against this.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from ..doors import Later
from .cylinder import cylinder
from .recipe import Recipe, Settings, Turn, Turning, Way, steps_key, turn_name

if TYPE_CHECKING:
    import numpy as np

    from ..model import problem, topology
    from ..model.band import Array, Band, State
else:
    np, problem, topology = map(Later, ("numpy", "ribbon_cli.model.problem", "ribbon_cli.model.topology"))

WORD = "twist"
FIRST = (0.0, 0.0, 1.0)
HANDEDNESS = -1.0
"""The sense about v_1 in which a positive angle is right-handed: u_1 points along v_1."""
TURNED_OVER = "(Beyond half a turn it turns over at the seam, and turned on it would untwist to another Lk.)"


def twist_stage(half_twists: int, steps: int, index: float) -> Turn:
    """The auxiliary problem after `index` steps, whole or not, of a turn of the seam by half_twists * pi.

    Positive is right-handed, Lk > 0. Raises ValueError if half_twists is zero or steps is not positive.
    """
    if half_twists == 0 or steps < 1:
        raise ValueError("a twist needs at least one half-twist and one step")
    angle = math.pi * half_twists * index / steps
    ruling = seam_ruling(angle, index == steps, half_twists)
    held = problem.Prescription({0: np.array(FIRST)}, ruling)
    return Turn(WORD, index, steps, held, _guard(angle))


def seam_ruling(angle: float, last: bool, half_twists: int) -> Array:
    """g_{N+1} at an angle; exactly +-v_3 at the end, so that the seam can close."""
    if last:
        return np.array(FIRST) * (-1.0) ** half_twists
    return np.array([0.0, HANDEDNESS * math.sin(angle), math.cos(angle)])


def _guard(angle: float) -> Callable[[State], str | None]:
    """Complain about states that turned by something else than an angle, or turned over at the seam."""

    def check(state: State) -> str | None:
        if abs(angle) > math.pi and state.u[0, 0] <= 0.0:
            return TURNED_OVER
        try:
            turn = topology.open_turn(state.u, state.g, state.band.h)
        except ValueError:
            return None  # not closed yet: between iterates sum u is not zero
        if abs(turn - angle / (2 * math.pi)) > 0.25:
            return f"Tw + Wr is {turn:.3f} where the seam was turned by {angle / (2 * math.pi):.3f}."
        return None

    return check


def _way(band: Band, half_twists: int, settings: Settings) -> Way:
    count = settings["steps"]
    turn = partial(twist_stage, half_twists, count)
    return Way("seam closed and freed", (Turning("twist, prescribed rulings", cylinder(band), count, turn),))


CARD = Recipe(
    name="twist",
    about="a cylinder cut open, one end turned by half a turn, and closed again",
    half_twists="1 or -1",
    fits=lambda n: abs(n) == 1,  # beyond half a turn the band turns over at the seam
    passes="`twist 1/K` to `twist K/K`",
    freed="twisted band freed",
    way=_way,
    stages=lambda settings: tuple(
        turn_name(WORD, k, settings["steps"]) for k in range(1, settings["steps"] + 1)
    ),
    keys=(steps_key(50),),
)
