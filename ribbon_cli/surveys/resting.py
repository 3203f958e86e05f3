"""Surveys with contact forces: ways that lead down without passing through, to bands that rest on themselves.

A start that crosses itself is drawn again. A barrier with collision detection leads down from it, and the
gaps that push are found where it ends: see `solver.resting_set`. On finer meshes a shape keeps its contacts
as `solver.resting_refine` does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..model.band import Array, Band, State
from ..model.problem import Problem
from ..model.random_shapes import random_start
from ..model.touching_gaps import Pairs
from ..solver.kkt import FactorisationError
from ..solver.newton import estimate_multipliers
from ..solver.resting_exchange import GapLostError, NoRestError
from ..solver.resting_refine import resting_refined
from ..solver.resting_set import Guess, Rest, let_down, rest_at
from ..solver.status import Result
from ..study.acceptance import checked
from ..study.resting import crosses

DRAWS = 20
"""Most draws of a start that does not cross itself."""
GAP_LOST, NO_REST = "gap-lost", "no-rest"
"""Words for a way that passed through itself, and for one that led to no shape at rest."""


@dataclass(frozen=True)
class Kept:
    """What goes with a shape: multipliers (5N+3,), the gaps kept with their forces (k,), and the gap."""

    multipliers: Array
    pairs: Pairs
    forces: Array
    gap: float


def open_start(band: Band, half_twists: int, rng: np.random.Generator, gap: float) -> State | None:
    """A random start whose features neither cross nor are nearer than the gap, None where none was drawn."""
    for _ in range(DRAWS):
        state = random_start(band, half_twists, rng)
        if state is None:
            return None
        if not crosses(state, gap):
            return state
    return None


def descend(state: State, half_twists: int, gap: float) -> tuple[str, Rest | None, Result | None]:
    """The word for where a way down from a shape ended, and the shape at rest there, with its result."""
    x = state.vector()
    try:
        own = estimate_multipliers(Problem(state.band), x)
        rest = let_down(Guess(state, state.band, x, own, Pairs.none(), np.empty(0), gap))
    except GapLostError:
        return GAP_LOST, None, None
    except (NoRestError, FactorisationError):
        return NO_REST, None, None
    result = replace(checked(rest.result, half_twists), saddles=())
    return result.status.value, rest, result


def refined(state: State, kept: Kept, segments: int, half_twists: int) -> tuple[Rest, Result]:
    """A shape at rest on a finer mesh. Raises NoRestError."""
    rest = resting_refined(rest_at(state, kept.multipliers, kept.pairs, kept.forces, kept.gap), segments)
    return rest, replace(checked(rest.result, half_twists), saddles=())
