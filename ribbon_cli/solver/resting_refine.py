"""A strip that rests on itself, on a finer grid.

The shape is prolonged as free ones are. Where it touches itself it then crosses itself a little, or stands
off, and other vertices touch: so it is opened there, and let down by a barrier onto the gaps that the finer
grid keeps. The way from the coarse shape, whose facets are cut without moving them, is looked at for
passages over all pairs, so that the linking number and the contacts stay.
"""

from __future__ import annotations

import numpy as np

from ..model.band import State
from ..model.folding import ClosureError
from ..model.topology import linking_number
from ..model.touching import Shape
from ..model.touching_barrier import Neighbourhood, candidates, nearest
from ..model.touching_gaps import Pairs
from .prolongation import Phase, phase_of, smooth
from .resting_set import REACHES, SLIP, NoRestError, Rest, let_down, united, way_between

SAME_LINKING = 1e-6


def resting_refined(rest: Rest, segments: int) -> Rest:
    """A resting shape on another grid, at rest with the gaps that it keeps there.

    The grid phase is the coarse shape's; where no certified minimum comes of it, the other phase is tried.
    Raises NoRestError where neither leads to a shape at rest.
    """
    phases = [phase_of(rest.state)]
    if rest.band.closed:
        phases.append(Phase.NODE if phases[0] is Phase.FACET else Phase.FACET)
    ends: list[Rest] = []
    failures: list[str] = []
    for phase in phases:
        try:
            end = _refined(rest, smooth(rest.state, segments, phase).state)
        except (ClosureError, NoRestError) as failure:
            failures.append(
                f"inflections on a {phase.value}: {failure}" if rest.band.closed else str(failure)
            )
            continue
        if end.result.certified:
            return end
        ends.append(end)
    if not ends:
        raise NoRestError("; ".join(failures))
    return ends[0]


def _refined(rest: Rest, start: State) -> Rest:
    """The shape at rest next to a prolonged one. Raises NoRestError."""
    pairs = _near(rest.state, start, rest.gap)
    end = let_down(rest.state, start.band, start.vector(), None, pairs, rest.gap, SLIP)
    if abs(_linking(end.state) - _linking(rest.state)) > SAME_LINKING:
        raise NoRestError("the linking number changed")
    return end


def _near(coarse: State, start: State, gap: float) -> Pairs:
    """The gaps to open in a prolonged shape, on the sides on which they were in the coarse one: those of what
    passes through itself on the way, and of what is nearer than the barrier's first reach."""
    motion = way_between(coarse, start, gap)
    same = motion.after.segments == start.band.segments
    met = motion.passages().pairs.unique() if same else Pairs.none()
    shape, reach = Shape.of(start, gap), gap + REACHES[0] * start.band.length
    close = nearest(shape, Neighbourhood.of(shape, reach, 0.0).features, reach)
    return united(met, candidates(shape, close, np.zeros(len(close)))[0])


def _linking(state: State) -> float:
    """The linking number of a closed band; strips have none."""
    band = state.band
    return linking_number(state.u, state.g, band.sigma, band.h).linking_number if band.closed else 0.0
