"""The initial guess of a config: made by its recipe, or given, then freed."""

from __future__ import annotations

from dataclasses import replace

from ..config import Config
from ..model.band import Band, Discretisation, State
from ..model.problem import Problem
from ..recipes.cylinder import cylinder
from ..recipes.twist import twist_stage, twist_stages
from ..solver.arclength import nearest
from ..solver.newton import solve
from ..solver.status import Result
from ..store import Summary
from .acceptance import converged
from .auxiliary import Turning
from .constructions import construct, evert
from .given import Given
from .plan import start_kind, start_name, start_width
from .records import saddle_result, state_of
from .remedies import remedied
from .steps import Steps


def freed_guess(steps: Steps, config: Config, given: Given | None) -> Summary | str:
    """Run or load the stages up to the freed guess, certified or not; a sentence if it is not reached.

    `given` is the state that the config starts from.
    """
    if given is not None:
        return _freed(steps, config, given.state, None, f"from {given.name}", given)
    guess = config.guess
    assert guess.segments is not None
    assert guess.half_width is not None
    band = Band(
        guess.segments,
        start_width(config, guess.half_width),
        config.length,
        -1 if config.half_twists % 2 else 1,
        Discretisation(config.discretisation),
    )
    if guess.recipe == "schoenke":
        made, method = construct(steps, band, config.half_twists), "construction freed"
    else:
        ring = cylinder(band)
        if guess.recipe == "cylinder":
            return _freed(steps, config, ring, None, "discrete cylinder, (3.4)-(3.5)")
        count = guess.steps or 1
        if guess.recipe == "eversion":
            made, method = evert(steps, ring, count), "rejoined band freed"
        else:
            made, method = _twisted(steps, ring, config.half_twists, count), "seam closed and freed"
    return (
        made
        if isinstance(made, str)
        else _freed(steps, config, state_of(steps.journal.load(made)), made.label, method)
    )


def _twisted(steps: Steps, ring: State, half_twists: int, count: int) -> Summary | str:
    """The band twisted step by step, or a sentence why that failed."""
    turning = Turning(steps, ring, "twist", lambda index: twist_stage(half_twists, index, count))
    return turning.run(twist_stages(half_twists, count))


def _freed(
    steps: Steps,
    config: Config,
    state: State,
    parent: int | None,
    method: str,
    given: Given | None = None,
) -> Summary | str:
    """The equilibrium next to a guess, saddles on the way left; a sentence where the solve ends in none."""
    stage, band = start_name(config), state.band
    steps.begin(stage, band.half_width, band.segments)
    known = steps.journal.finished(stage)
    if known is not None:
        return known
    clock = steps.journal.clock()
    problem = Problem(band)
    if config.guess.keep_saddle:
        result = steps.checked(nearest(state, steps.options.guard))
    else:
        result = steps.checked(solve(problem, state.vector(), None, steps.options))
    if not converged(result):
        result = _saddle_left_in_vain(steps, problem, result)
    if not converged(result):
        return remedied(f"{stage}: {result.message}", result.status, "`steps` of the recipe")
    events = tuple(filter(None, (given.note if given is not None else "",)))
    events += tuple(
        f"met a saddle of index {s.index} at E = {s.energy:.12g}, left along its negative direction"
        for s in result.saddles
    )
    steps.tell(stage, events)
    return steps.store(
        problem,
        result,
        clock,
        kind=start_kind(config, band.half_width),
        stage=stage,
        method=method,
        parent=parent,
        parent_ref=None if given is None else given.name,
        events=events,
    )


def _saddle_left_in_vain(steps: Steps, problem: Problem, result: Result) -> Result:
    """The last saddle that was met, where leaving it led to no band of this kind; else the result."""
    if not result.saddles:
        return result
    saddle = steps.checked(saddle_result(problem, result.saddles[-1]))
    if not converged(saddle):
        return result
    detail = f"(Index {saddle.negative}; the way down from it ends in: {result.message})"
    return replace(saddle, saddles=result.saddles[:-1], steps=result.steps, detail=detail)
