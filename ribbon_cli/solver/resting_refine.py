"""A strip that rests on itself, on a finer grid.

The shape is prolonged as free ones are. Where it touches itself it then crosses itself a little, or stands
off, and other vertices touch: the gaps that push there are found by exchange, on the sides on which features
of the coarse shape are, whose facets are cut without moving them; or the shape is opened and let down by a
barrier. The way from the coarse shape is looked at for passages over all pairs, so that the linking number
and the contacts stay.
"""

from __future__ import annotations

import numpy as np

from ..model.band import Array, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..model.topology import linking_number
from ..model.touching import EDGE, FACET, VERTEX, IntArray, Shape
from ..model.touching_gaps import Pairs, places
from .kkt import FactorisationError
from .newton import estimate_multipliers
from .prolongation import Phase, phase_of, smooth
from .resting_exchange import NoRestError
from .resting_set import SLIP, Guess, Rest, exchanged, let_down

SAME_LINKING = 1e-6
FARTHEST = 2.0
"""Change from a prolonged shape beyond which a search for the gaps that push goes somewhere else."""


def resting_refined(rest: Rest, segments: int) -> Rest:
    """A resting shape on a grid of a multiple of its facets, at rest with the gaps that it keeps there.

    The grid phase is the coarse shape's first, then the other one; what is no certified minimum comes last.
    Raises NoRestError where nothing leads to a shape at rest, and for other grids.
    """
    if segments % rest.band.segments:
        raise NoRestError(f"N = {segments} is no multiple of {rest.band.segments}: double N instead")
    phases = [phase_of(rest.state)]
    if rest.band.closed:
        phases.append(Phase.NODE if phases[0] is Phase.FACET else Phase.FACET)
    ends, failures = [], []
    for search in (exchanged, let_down):
        for phase in phases:
            try:
                guess = _guess(rest, smooth(rest.state, segments, phase).state)
                end = search(guess)
                _same_linking(rest.state, end.state)
            except (ClosureError, FactorisationError, NoRestError) as failure:
                failures.append(f"inflections on a {phase.value}: {failure}")
                continue
            if end.result.certified:
                return end
            ends.append(end)
        if ends:
            return ends[0]
    raise NoRestError("; ".join(failures))


def _guess(rest: Rest, start: State) -> Guess:
    """The prolonged shape, with the coarse shape's gaps on the finer grid."""
    pairs = finer_pairs(Shape.of(rest.state, rest.gap), rest.pairs, start.band.segments // rest.band.segments)
    x = start.vector()
    own = estimate_multipliers(Problem(start.band), x)
    return Guess(rest.state, start.band, x, own, pairs, np.zeros(len(pairs)), rest.gap, SLIP)


def finer_pairs(shape: Shape, pairs: Pairs, parts: int) -> Pairs:
    """What touches, in the numbers of the same shape with every facet cut into equal parts."""
    at = places(shape, pairs)
    return Pairs(_finer(pairs.first, at[:, 0], parts), _finer(pairs.second, at[:, 2], parts), pairs.sign)


def _finer(features: IntArray, along: Array, parts: int) -> IntArray:
    """Features (k,2) and where they touch, along the strip, on the finer grid."""
    kind, number = features.T
    part = np.clip((parts * along).astype(np.int64), 0, parts - 1)
    track = np.where(kind == EDGE, number % 3, number % 2)
    vertex = 2 * parts * (number // 2) + track
    edge = 3 * (parts * (number // 3) + np.where(track > 0, part, 0)) + track
    facet = parts * number + part
    finer = np.select([kind == VERTEX, kind == EDGE, kind == FACET], [vertex, edge, facet])
    return np.column_stack((kind, finer))


def _same_linking(coarse: State, fine: State) -> None:
    """Raise NoRestError if a closed band's linking number changed."""
    if not coarse.band.closed:
        return
    one, other = (linking_number(s.u, s.g, s.band.sigma, s.band.h).linking_number for s in (coarse, fine))
    if abs(one - other) > SAME_LINKING:
        raise NoRestError(f"the linking number changed from {one:g} to {other:g}")
