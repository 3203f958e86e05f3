"""The initial guess of a config: made by its recipe, or given, then freed."""

from __future__ import annotations

from dataclasses import replace

from ..config import Config
from ..facts import event
from ..model.band import Band, Discretisation, State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..recipes import RECIPES
from ..recipes.recipe import Making, NotMadeError, Way
from ..solver.arclength import nearest
from ..solver.newton import solve
from ..solver.status import Result
from ..store import Summary
from .acceptance import converged
from .auxiliary import Turner, make
from .failure import Failure
from .given import Given
from .plan import start_kind, start_name, start_width
from .records import saddle_result, state_of
from .walk import Ended, Stage, Walk


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
    try:
        way = RECIPES[guess.recipe].way(band, config.half_twists, guess.settings)
    except (NotMadeError, ClosureError) as error:
        return Failure("construction", None, str(error), {"stage": start_name(config)})
    if way.ready is not None:
        return _freed(walk, config, way.ready, None, way.method)
    end = _walked(walk, way, band)
    if isinstance(end, Failure):
        return end
    return _freed(walk, config, state_of(walk.journal.load(end)), end.label, way.method)


def _walked(walk: Walk, way: Way, band: Band) -> Summary | Failure:
    """The end of a recipe's way, part by part."""
    end: Summary | None = None
    for part in way.parts:
        reached = make(walk, part, band, end) if isinstance(part, Making) else Turner(walk, part).run()
        if isinstance(reached, Failure):
            return reached
        end = reached
    assert end is not None
    return end


def _freed(
    walk: Walk,
    config: Config,
    state: State,
    parent: int | None,
    method: str,
    given: Given | None = None,
) -> Summary | Failure:
    """The equilibrium next to a guess, saddles on the way left."""
    band = state.band
    stage = Stage(
        start_name(config),
        band.half_width,
        band.segments,
        start_kind(config, band.half_width),
        parent,
        None if given is None else given.name,
    )

    def freed() -> Ended | Failure:
        problem, options = Problem(band), walk.options_from(state)
        if config.guess.keep_saddle:
            result = walk.checked(nearest(state, options.guard))
        else:
            result = walk.checked(solve(problem, state.vector(), None, options))
        if not converged(result):
            result = _saddle_left_in_vain(walk, problem, result)
        if not converged(result):
            return Failure(
                "solve", result.status, result.detail, {"stage": stage.name}, "`steps` of the recipe"
            )
        closing = () if given is None or given.closing is None else (given.closing,)
        left = (event("saddle-left", index=s.index, energy=s.energy) for s in result.saddles)
        return Ended(problem, result, method, (*closing, *left))

    return walk.reach(stage, freed)


def _saddle_left_in_vain(walk: Walk, problem: Problem, result: Result) -> Result:
    """The last saddle that was met, where leaving it led to no band of this kind; else the result."""
    if not result.saddles:
        return result
    saddle = walk.checked(saddle_result(problem, result.saddles[-1]))
    if not converged(saddle):
        return result
    detail = f"(Index {saddle.negative}; the way down from it ends in: {result.message})"
    return replace(saddle, saddles=result.saddles[:-1], steps=result.steps, detail=detail)
