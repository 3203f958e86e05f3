"""Whether two minima on different grids are one band's: does the finer one lead back to the coarser?

A coarse grid has minima that finer ones do not have. Refined, such a state ends in the minimum of another
shape, certified like any other, and a difference of the two energies says nothing of convergence.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..facts import Event, event
from ..model.band import State
from ..model.folding import ClosureError
from ..model.problem import Problem
from .continuation import to_segments
from .newton import Options
from .prolongation import phase_of, smooth
from .steps import change

NEAR_CHANGE = 0.25
NEAR_MEAN = 0.03
"""Largest change and root mean square of (u, g) between the prolonged coarse state and the finer one up to
which they are kin without further proof. Pi bands have 0.22 and 0.022 at most over all of Table 3.1, and the
second minimum at b = 0.1, N = 50 is 1.3 and 0.4 away from what it becomes on any finer grid."""
SAME_ENERGY = 1e-9
"""Relative difference of energies up to which two minima on one grid are the same."""


def another_minimum(coarse: State, fine: State, options: Options) -> Event | None:
    """Why a minimum is not that of another grid refined; None if it is.

    It is where it lies near the other's smooth prolongation. Elsewhere it is taken back to the other's grid,
    prolonged and solved there: one band's minima return to the same energy to all digits.
    """
    if _near(coarse, fine):
        return None
    n, energy = coarse.band.segments, Problem(coarse.band).energy(coarse.vector())
    try:
        back = to_segments(fine, n, replace(options, watch=None)).result
    except ClosureError as error:
        return event("another-minimum-unproved", segments=n, why=error)
    if not back.certified:
        return event("another-minimum-perhaps", segments=n, status=back.status.value)
    if abs(back.energy - energy) <= SAME_ENERGY * abs(energy):
        return None
    return event("another-minimum", segments=n, energy=back.energy, expected=energy)


def _near(coarse: State, fine: State) -> bool:
    """Whether the finer state is the coarse one prolonged, to within what a grid changes."""
    try:
        start = smooth(coarse, fine.band.segments, phase_of(fine)).state.vector()
    except ClosureError:
        return False
    step = fine.vector() - start
    mean = np.sqrt((step.reshape(-1, 7)[:, :6] ** 2).sum() / fine.band.segments)
    return change(start, step) <= NEAR_CHANGE and bool(mean <= NEAR_MEAN)
