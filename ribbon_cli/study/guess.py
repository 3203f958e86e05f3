"""The initial guess of a config: made by its recipe, or given, then freed.

With contact forces, a guess that would cross itself is made narrower, freed there without contact and looked
at over all pairs of features. From there it is widened with contact. A guess that is a saddle, and that of a
recipe whose bands rest on themselves from the beginning, is let down with contact.
"""

from __future__ import annotations

from dataclasses import replace

from ..config import Config
from ..facts import event
from ..model.band import Band, Discretisation, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..parts import HALF_WIDTH
from ..recipes import RECIPES
from ..recipes.recipe import Making, NotMadeError, Turn, Turning, Way
from ..solver.arclength import nearest
from ..solver.newton import solve
from ..solver.resting_exchange import NoRestError
from ..solver.status import Result, Status
from ..store import Summary
from . import resting
from .acceptance import converged
from .auxiliary import Turner, make
from .failure import Failure
from .given import Given
from .plan import Goal, start_kind, start_name, start_width, steps_of
from .records import saddle_result, state_of
from .stepping import all_the_way
from .walk import Ended, Stage, Walk

MOST_NARROWINGS = 4
"""How often a guess that crosses itself is made half as wide."""


def freed_guess(walk: Walk, config: Config, given: Given | None) -> Summary | Failure:
    """Run or load the stages up to the freed guess, certified or not; why it is not reached.

    `given` is the state that the config starts from.
    """
    if given is not None:
        return _freed(walk, config, given.state, None, f"from {given.name}", given)
    guess = config.guess
    assert guess.segments is not None
    assert guess.half_width is not None
    band = Band(
        guess.segments,
        start_width(config, guess.half_width),
        config.length,
        config.sigma,
        Discretisation(config.discretisation),
        config.parts,
    )
    end = _made(walk, config, band)
    if walk.gap is None or isinstance(end, Summary):
        return end
    narrow = band
    for _ in range(MOST_NARROWINGS):
        narrow = narrow.with_half_width(0.5 * narrow.half_width)
        found = _made(walk, config, narrow, f" at b = {narrow.half_width:.12g}")
        if isinstance(found, Summary) and walk.goes_on(found):
            kind = start_kind(config, band.half_width)
            goal = Goal({HALF_WIDTH: band.half_width}, stage=start_name(config), kind=kind)
            return all_the_way(walk, found, goal)
    return end


def _made(walk: Walk, config: Config, band: Band, suffix: str = "") -> Summary | Failure:
    """The guess of a recipe, freed; `suffix` ends the names of its stages."""
    name = start_name(config) + suffix
    try:
        way = RECIPES[config.guess.recipe].way(band, config.half_twists, config.guess.settings)
    except (NotMadeError, ClosureError) as error:
        return Failure("construction", None, str(error), {"stage": name})
    if way.ready is not None:
        return _freed(walk, config, way.ready, None, way.method, suffix=suffix)
    end = _walked(walk, way, band, suffix)
    if isinstance(end, Failure):
        return end
    return _freed(walk, config, state_of(walk.journal.load(end)), end.label, way.method, suffix=suffix)


def _walked(walk: Walk, way: Way, band: Band, suffix: str) -> Summary | Failure:
    """The end of a recipe's way, part by part."""
    end: Summary | None = None
    for part in way.parts:
        if isinstance(part, Making):
            named = replace(part, stages=tuple(stage + suffix for stage in part.stages))
            reached = make(walk, named, band, end)
        else:
            reached = Turner(walk, _renamed(part, suffix) if suffix else part).run()
        if isinstance(reached, Failure):
            return reached
        end = reached
    assert end is not None
    return end


def _renamed(part: Turning, suffix: str) -> Turning:
    """Auxiliary problems under other names."""

    def turn(k: float) -> Turn:
        made = part.turn(k)
        return replace(made, word=made.word + suffix)

    return replace(part, turn=turn)


def _freed(
    walk: Walk,
    config: Config,
    state: State,
    parent: int | None,
    method: str,
    given: Given | None = None,
    *,
    suffix: str = "",
) -> Summary | Failure:
    """The equilibrium next to a guess, saddles on the way left."""
    band = state.band
    stage = Stage(
        start_name(config) + suffix,
        band.half_width,
        band.segments,
        "intermediate" if suffix else start_kind(config, band.half_width),
        parent,
        None if given is None else given.name,
    )

    def rested() -> Ended | Failure:
        assert given is not None
        assert given.contacts is not None
        assert walk.gap is not None
        try:
            end = resting.again(state, given.contacts, walk.gap)
        except NoRestError as error:
            return resting.failed(error, stage.name)
        return Ended(end.problem, walk.checked(end.result), method)

    def freed() -> Ended | Failure:
        if walk.gap is not None and given is None and RECIPES[config.guess.recipe].resting:
            return resting.let_down_from(walk, state, stage.name, method)
        problem, options = Problem(band), walk.options_from(state)
        if config.guess.keep_saddle:
            result = walk.checked(nearest(state, options.guard))
        else:
            result = walk.checked(solve(problem, state.vector(), None, options))
        if not converged(result):
            result = _saddle_left_in_vain(walk, problem, result)
        if not converged(result):
            if (
                result.status is Status.LEFT_TOPOLOGY
                and walk.gap is not None
                and not resting.crosses(state, walk.gap)
            ):
                # On its way down without contact the guess passes through itself.
                return resting.let_down_from(walk, state, stage.name, method)
            return Failure("solve", result.status, result.detail, {"stage": stage.name}, steps_of(config))
        closing = () if given is None or given.closing is None else (given.closing,)
        left = (event("saddle-left", index=s.index, energy=s.energy) for s in result.saddles)
        end = Ended(problem, result, method, (*closing, *left))
        if walk.gap is None:
            return end
        if resting.crosses(result.state, walk.gap):
            return Failure("solve", Status.GAP_LOST, "", {"stage": stage.name}, "a narrower guess")
        if result.status is Status.SADDLE and not config.guess.keep_saddle:
            # Without contact its way down leads through the band; with contact it ends where the band rests.
            below = resting.let_down_from(walk, result.state, stage.name, method)
            if isinstance(below, Ended):
                return below
        return resting.at_rest(end, walk.gap)

    return walk.reach(stage, freed if given is None or given.contacts is None else rested)


def _saddle_left_in_vain(walk: Walk, problem: Problem, result: Result) -> Result:
    """The last saddle that was met, where leaving it led to no band of this kind; else the result."""
    if not result.saddles:
        return result
    saddle = walk.checked(saddle_result(problem, result.saddles[-1]))
    if not converged(saddle):
        return result
    detail = f"(Index {saddle.negative}; the way down from it ends in: {result.message})"
    return replace(saddle, saddles=result.saddles[:-1], steps=result.steps, detail=detail)
