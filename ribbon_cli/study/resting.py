"""A step with contact forces: free where nothing touches, and at rest on itself where something does.

A step of a band that rests on itself keeps its contacts, if it can, else finds others; see
`solver.resting_set`. What touches nothing is solved for as without contact, and then it is looked at over
all pairs of features: the end, and the straight way to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ..facts import Event, event
from ..model.band import Band, State
from ..model.touching import Shape
from ..model.touching_audit import audit
from ..model.touching_gaps import Pairs
from ..solver.kkt import FactorisationError
from ..solver.newton import Options, solve
from ..solver.resting import RestingProblem
from ..solver.resting_barrier import BarrierProblem
from ..solver.resting_exchange import GapLostError, NoRestError
from ..solver.resting_refine import resting_refined
from ..solver.resting_set import (
    BARRIER_GOAL,
    DEPTH,
    MOST_SADDLES,
    Guess,
    Rest,
    Slopes,
    exchanged,
    let_down,
    moved,
    rest_at,
    slopes,
    way_between,
)
from ..solver.status import Result, Status
from ..solver.tracking import Way
from ..store import Contacts, StateRecord
from .failure import Failure, way_facts
from .plan import place_name
from .progress import Step
from .records import pairs_of, rest_of
from .walk import Ended, Walk

FAR = 3e-3
"""Reach, as part of l, of the barrier by which a shape that is far from rest is let down first."""
MOST_DESCENTS = 400
MISFIT = 0.05
"""Error of the energy by the slopes at both ends of a step, relative to the larger, from which it is told."""


def again(state: State, contacts: Contacts, gap: float) -> Rest:
    """A state that rests on itself, solved for anew with its contacts. Raises NoRestError."""
    pairs = pairs_of(contacts)
    problem = RestingProblem(state.band, pairs, gap)
    near = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(near.multipliers)
    rest = rest_at(near.state, own, pairs, forces, gap)
    nowhere = Slopes(np.zeros(problem.size), np.zeros(problem.rows), 0.0)
    return moved(rest, rest.band, 0.0, nowhere)


def at_rest(free: Ended, gap: float) -> Ended:
    """A solve's end as one with contact forces on, of which there are none."""
    return replace(free, problem=RestingProblem(free.problem.band, Pairs.none(), gap))


def crosses(state: State, gap: float) -> bool:
    """Whether features cross or are nearer than the gap."""
    shape, depth = Shape.of(state, gap), DEPTH * state.band.length
    return audit(shape, gap + depth).lacks(gap) > depth


def let_down_from(walk: Walk, state: State, stage: str, method: str) -> Ended | Failure:
    """The shape at rest below one that does not cross itself and is no minimum, with contact forces on all
    the way: a barrier of a wide reach leads there, however far it is.
    """
    assert walk.gap is not None
    band, gap = state.band, walk.gap
    barrier = BarrierProblem(band, FAR * band.length, gap)
    options = Options(
        way=barrier.allows,
        leave_saddles=MOST_SADDLES,
        max_steps=MOST_DESCENTS,
        goal=BARRIER_GOAL,
        tolerance=BARRIER_GOAL,
    )
    low = solve(barrier, state.vector(), None, options)
    walk.progress(Step(low.steps, low.energy, max(low.kkt_residual, low.constraint_residual)))
    try:
        end = let_down(Guess(low.state, band, low.x, low.multipliers, Pairs.none(), np.empty(0), gap))
    except NoRestError as error:
        return failed(error, stage)
    result = replace(walk.checked(end.result), steps=low.steps + end.steps)
    walk.progress(Step(end.steps, result.energy, max(result.kkt_residual, result.constraint_residual)))
    left = (event("saddle-left", index=s.index, energy=s.energy) for s in low.saddles)
    return Ended(end.problem, result, method, tuple(left))


def passes(end: Ended | Failure, before: State, gap: float) -> bool:
    """Whether a free solve's end, or the straight way to it, passes through itself."""
    if isinstance(end, Failure):
        return end.status is Status.LEFT_TOPOLOGY
    state, length = end.result.state, end.problem.band.length
    if crosses(state, gap):
        return True
    motion = way_between(before, state, gap)
    met = motion.passages()
    return len(met) > 0 and motion.depth(met) > 10.0 * DEPTH * length


def step(
    walk: Walk, start: StateRecord, band: Band, target: Mapping[str, float], before: tuple[Event, ...] = ()
) -> Ended | Failure:
    """The shape at rest on itself at other parameters, those of a band; `target` names the ones that move."""
    assert walk.gap is not None
    rest = rest_of(start, walk.gap)
    ends: list[tuple[Rest, Result, str]] = []
    whys: list[NoRestError] = []
    for word, way in _ways(rest, band):
        try:
            end = way()
        except NoRestError as error:
            whys.append(error)
            continue
        result = replace(walk.checked(end.result), steps=end.steps)
        walk.progress(Step(end.steps, result.energy, max(result.kkt_residual, result.constraint_residual)))
        ends.append((end, result, word))
        if result.certified or result.status.value == start.status == Status.UNDECIDED.value:
            break
    return _chosen(rest, ends, whys, target, before)


def _ways(rest: Rest, band: Band) -> Iterator[tuple[str, Callable[[], Rest]]]:
    """Ways to the next shape at rest, in words, in the order tried."""
    along, by = _ahead(rest, band)
    x, multipliers = rest.result.x, rest.result.multipliers
    if along is not None:
        if len(rest.pairs):
            yield "with the same contacts", partial(moved, rest, band, by, along)
        x, multipliers = x + by * along.x, multipliers + by * along.multipliers
    own, forces = rest.problem.split(multipliers)
    guess = Guess(rest.state, band, x, own, rest.pairs, forces, rest.gap)
    yield "with other contacts", partial(exchanged, guess)
    yield "by a barrier", partial(let_down, guess)


def _chosen(
    rest: Rest,
    ends: list[tuple[Rest, Result, str]],
    whys: list[NoRestError],
    target: Mapping[str, float],
    before: tuple[Event, ...],
) -> Ended | Failure:
    """The end of the step: a minimum, or else what may be one; why there is none."""
    good = [end for end in ends if end[1].certified] or [
        end for end in ends if end[1].status is Status.UNDECIDED
    ]
    facts = way_facts(rest.band.parameters, target)
    if good:
        return _ended(rest, *good[0], target, before)
    if ends:
        end, result, word = ends[-1]
        attempt = _ended(rest, end, result, word, target)
        return Failure("step", result.status, result.detail, facts, attempt=attempt)
    return Failure("step", status_of(whys[-1]), f"({whys[-1]}.)", facts)


def _ended(
    rest: Rest,
    end: Rest,
    result: Result,
    word: str,
    target: Mapping[str, float],
    before: tuple[Event, ...] = (),
) -> Ended:
    names = ", ".join("width" if name == "half_width" else name for name in target)
    method = f"continuation in {names}, {word}" if len(end.pairs) else f"continuation in {names}"
    told = (*changes(rest, end, target), *_doubts(rest, end))
    return Ended(end.problem, result, method, told, before)


def _doubts(rest: Rest, end: Rest) -> tuple[Event, ...]:
    """Whether energies and their slopes say that the step may have left its branch.

    Where contacts change slopes jump, and nothing proves that a branch was followed; without contact a step
    is not taken where they disagree.
    """
    (here, by), (there, _) = _ahead(rest, end.band), _ahead(end, rest.band)
    if here is None or there is None:
        return ()
    # The way back is counted from the end: of several parameters its rates have the other sign.
    rise = -there.rise if len(Way.between(rest.band, end.band).rates) > 1 else there.rise
    change, expected = end.result.energy - rest.result.energy, 0.5 * by * (here.rise + rise)
    if abs(change - expected) <= MISFIT * abs(by) * max(abs(here.rise), abs(rise)):
        return ()
    return (event("slopes-disagree", change=change, expected=expected),)


def refined(walk: Walk, start: StateRecord, segments: int, stage: str) -> Ended | Failure:
    """A shape at rest on itself on another grid."""
    assert walk.gap is not None
    try:
        end = resting_refined(rest_of(start, walk.gap), segments)
    except NoRestError as error:
        return failed(error, stage)
    result = replace(walk.checked(end.result), steps=end.steps)
    walk.progress(Step(end.steps, result.energy, max(result.kkt_residual, result.constraint_residual)))
    return Ended(end.problem, result, "smooth prolongation with contact")


def changes(rest: Rest, end: Rest, target: Mapping[str, float]) -> tuple[Event, ...]:
    """What became of contacts on a step between two shapes that both have some."""
    old, new = set(rest.pairs.names()), set(end.pairs.names())
    if not (old and new) or old == new:
        return ()
    here = place_name({name: rest.band.parameter(name) for name in target})
    facts = {"before": len(old), "after": len(new), "gone": len(old - new), "new": len(new - old)}
    return (event("contacts-change", here=here, there=place_name(target), **facts),)


def failed(why: NoRestError, stage: str) -> Failure:
    """A stage in which no shape at rest was found."""
    return Failure("solve", status_of(why), f"({why}.)", {"stage": stage})


def status_of(why: NoRestError) -> Status:
    """How the search for a shape at rest ended."""
    return Status.GAP_LOST if isinstance(why, GapLostError) else Status.NO_REST


def _ahead(rest: Rest, band: Band) -> tuple[Slopes | None, float]:
    """The slopes along the way to other parameters, and how far it is; none at a fold."""
    way = Way.between(rest.band, band)
    by = way.position(band) - way.position(rest.band)
    try:
        each = [(rate, slopes(rest, name)) for name, rate in way.rates]
    except FactorisationError:
        return None, by
    along = Slopes(
        np.sum([rate * found.x for rate, found in each], axis=0),
        np.sum([rate * found.multipliers for rate, found in each], axis=0),
        float(sum(rate * found.rise for rate, found in each)),
    )
    return along, by
