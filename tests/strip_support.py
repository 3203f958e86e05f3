"""Open strips that the tests of model and solver share: made, solved, and walked through parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.reactions import Reactions, reactions
from ribbon_cli.parts import Ends, Loads, Material, Parts
from ribbon_cli.recipes.strip import CARD
from ribbon_cli.solver.continuation import to_band, to_segments
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.status import Result

Array = NDArray[np.float64]
HALF_WIDTH = 0.05
LENGTH = 1.0


def band(
    segments: int,
    ends: Ends,
    *,
    half_width: float = HALF_WIDTH,
    loads: Loads | None = None,
    material: Material | None = None,
    rule: Discretisation = Discretisation.THESIS,
) -> Band:
    """A strip of length 1."""
    parts = Parts(ends, material or Material(), loads or Loads())
    return Band(segments, half_width, LENGTH, 0, rule, parts)


def planar(strip: Band) -> Result:
    """The minimum next to the recipe's guess."""
    guess = CARD.way(strip, 0, {}).ready
    assert guess is not None
    return minimum(guess)


def minimum(guess: State) -> Result:
    """The minimum next to a state."""
    found = solve(Problem(guess.band), guess.vector(), None, Options())
    assert found.certified, found.message
    return found


def walked(start: Result, steps: int = 1, **targets: float) -> Result:
    """The minimum at other parameters, in equal steps."""
    first, found = start.state.band.parameters, start
    for k in range(1, steps + 1):
        there = found.state.band
        for name, value in targets.items():
            there = there.with_parameter(
                name, value if k == steps else first[name] + (value - first[name]) * k / steps
            )
        found = to_band(found.state, found.multipliers, there, Options()).result
        assert found.certified, found.message
    return found


def refined(start: Result, segments: int) -> Result:
    """The minimum on another number of segments."""
    found = to_segments(start.state, segments, Options()).result
    assert found.certified, found.message
    return found


def reactions_of(found: Result) -> Reactions:
    """The reactions of a solved strip."""
    return reactions(Problem(found.state.band), found.x, found.multipliers)


def orders(errors: list[float] | Array) -> Array:
    """Observed orders of errors, N doubling."""
    sizes = np.abs(np.asarray(errors))
    out: Array = np.log2(sizes[:-1] / sizes[1:])
    return out
