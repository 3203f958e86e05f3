"""A strip that rests on itself, on a finer grid.

The shape is prolonged as free ones are. Where it touches itself it then crosses itself a little, or stands
off, and other vertices touch: the gaps that push there are found by exchange, on the sides on which features
of the coarse shape are, whose facets are cut without moving them; or the shape is opened and let down by a
barrier. The way from the coarse shape is looked at for passages over all pairs, so that the linking number
and the contacts stay.
"""

from __future__ import annotations

import numpy as np

from ..model.band import State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..model.topology import linking_number
from ..model.touching import FACET, VERTEX, Shape
from ..model.touching_distances import Distances, nearer
from ..model.touching_gaps import Pairs
from ..model.touching_sides import Sides
from .kkt import FactorisationError
from .newton import estimate_multipliers
from .prolongation import Phase, divided, phase_of, smooth
from .resting_exchange import Exchange, NoRestError
from .resting_set import (
    REACHES,
    SLIP,
    Guess,
    Rest,
    accepted,
    let_down,
    opened,
    united,
    way_between,
)
from .status import Status

SAME_LINKING = 1e-6

TOUCHES = 1e-9
"""Gap, as part of l, up to which features of the coarse shape touch."""
FARTHEST = 2.0
"""Change from a prolonged shape beyond which a search for the gaps that push goes somewhere else."""
NEAR_SADDLE = 10.0
"""Residual from which saddles are stepped onto: sliding, a symmetry but for the grid, has many of them."""


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
    for phase in phases:
        try:
            end = _settled(_guess(rest, smooth(rest.state, segments, phase).state))
            _same_linking(rest.state, end.state)
        except (ClosureError, FactorisationError, NoRestError) as failure:
            failures.append(f"inflections on a {phase.value}: {failure}")
            continue
        if end.result.certified:
            return end
        ends.append(end)
    if not ends:
        raise NoRestError("; ".join(failures))
    return ends[0]


def _settled(guess: Guess) -> Rest:
    """The shape at rest near a place: by exchange of gaps, else by a barrier, from a saddle that was met on
    the way or from the beginning. Raises NoRestError."""
    start = opened(guess, 0.5 * REACHES[0] * guess.band.length)
    sides = Distances() if guess.gap else Sides(Shape.of(start), Pairs.none())
    search = Exchange(guess.band, sides, FARTHEST, guess.gap, NEAR_SADDLE)
    x = start.vector()
    own = estimate_multipliers(Problem(guess.band), x)
    try:
        problem, result = search.rest(x, own, guess.pairs, guess.forces)
        if result.status is not Status.SADDLE:
            return accepted(guess.before, problem, result, SLIP, search.steps, ("exchange",))
    except NoRestError:
        if search.saddle is None:
            return let_down(guess)
    assert search.saddle is not None
    saddle = accepted(guess.before, *search.saddle, SLIP, search.steps, ("saddle",))
    x, own = saddle.result.x, saddle.multipliers
    return let_down(Guess(saddle.state, guess.band, x, own, saddle.pairs, saddle.forces, guess.gap))


def _guess(rest: Rest, start: State) -> Guess:
    """The prolonged shape, with the gaps to open in it, on the sides on which they were in the coarse one: of
    what touches there, and of what passes through itself on the way. A gap that is not zero has no sides."""
    gap, length, parts = rest.gap, start.band.length, start.band.segments // rest.band.segments
    if gap:
        pairs = nearer(Shape.of(start, gap), gap + REACHES[0] * length)
    else:
        # Of what touches, collision detection knows by rounding alone on which side it was.
        coarse, kept = Shape.of(divided(rest.state, parts)), _finer(rest.pairs, parts)
        pairs = united(kept, Sides(coarse, kept).near(coarse, TOUCHES * length)[0])
        pairs = united(pairs, way_between(rest.state, start).passages().pairs.unique())
    return Guess(rest.state, start.band, start.vector(), None, pairs, np.zeros(len(pairs)), gap, SLIP)


def _finer(pairs: Pairs, parts: int) -> Pairs:
    """What touches, in the numbers of the same shape with every facet cut into equal parts, each of them."""
    rows: list[tuple[int, int, int, int]] = []
    signs: list[float] = []
    for name, sign in zip(pairs.names(), pairs.sign.tolist(), strict=True):
        found = [(*a, *b) for a in _parts(*name[:2], parts) for b in _parts(*name[2:], parts)]
        rows += found
        signs += [sign] * len(found)
    table = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return Pairs(table[:, :2], table[:, 2:], np.array(signs))


def _parts(kind: int, number: int, parts: int) -> list[tuple[int, int]]:
    """A feature cut into parts."""
    if kind == VERTEX:
        return [(kind, 2 * parts * (number // 2) + number % 2)]
    if kind == FACET:
        return [(kind, parts * number + k) for k in range(parts)]
    k, track = divmod(number, 3)
    return [(kind, 3 * (parts * k + j) + track) for j in range(parts if track else 1)]


def _same_linking(coarse: State, fine: State) -> None:
    """Raise NoRestError if a closed band's linking number changed."""
    if not coarse.band.closed:
        return
    try:
        one, other = (linking_number(s.u, s.g, s.band.sigma, s.band.h).linking_number for s in (coarse, fine))
    except ValueError as error:
        raise NoRestError(str(error)) from error
    if abs(one - other) > SAME_LINKING:
        raise NoRestError(f"the linking number changed from {one:g} to {other:g}")
