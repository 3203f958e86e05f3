"""From one random start to equilibria: down to a minimum, and up to saddles of each index asked for.

A start's random numbers come from a generator of its own, seeded by the survey's seed and the start's number:
what it leads to does not depend on the other starts, nor on who computes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.band import Band, State
from ..model.problem import Problem
from ..model.random_shapes import random_start
from ..model.touching_gaps import Pairs
from ..solver.climbing import climb
from ..solver.newton import Options, solve
from ..solver.status import Result
from ..study.acceptance import checked, options_for, strip_guard
from .resting import descend, open_start

FEWEST, MOST = 3, 15
"""Steps down from a start, which take out the worst wrinkles; how many decides how far from a minimum a climb
begins."""
MOST_STEPS = 150
"""Most Newton steps down: ways at N = 48 take 10 to 60."""
NO_START = "no-start"
"""The word for a start of which no draw was closed, or had the linking number asked for; with contact forces
on, of which none was without a crossing as well."""


@dataclass(frozen=True)
class Task:
    """A start to explore, by its number; `climbs` are the numbers of modes to climb, 0 for a descent; `gap`
    is the least distance that contact forces keep, None where contact has no forces.
    """

    band: Band
    half_twists: int
    seed: int
    start: int
    climbs: tuple[int, ...]
    gap: float | None = None


@dataclass(frozen=True)
class End:
    """Where one way from a start ended: in a word, its status or why it has none, and its `result`.

    With contact forces on, `pairs` are the gaps that it keeps.
    """

    climb: int
    word: str
    result: Result | None = None
    pairs: Pairs | None = None


def explore(task: Task) -> Sequence[End]:
    """Every way from a start."""
    rng = np.random.default_rng([task.seed, task.start])
    with np.errstate(over="ignore", invalid="ignore"):  # draws that run away while they are closed
        if task.gap is None:
            state = random_start(task.band, task.half_twists, rng)
        else:
            state = open_start(task.band, task.half_twists, rng, task.gap)
    if state is None:
        return [End(modes, NO_START) for modes in task.climbs]
    if task.gap is not None:
        word, rest, result = descend(state, task.half_twists, task.gap)
        return [End(0, word, result, None if rest is None else rest.pairs)]
    problem, options = Problem(task.band), options_from(state, task.half_twists)
    few = replace(options, max_steps=int(rng.integers(FEWEST, MOST)), leave_saddles=0)
    smoothed = solve(problem, state.vector(), None, few)
    ends = [(modes, _way(problem, smoothed, modes, task.half_twists, options)) for modes in task.climbs]
    return [End(modes, result.status.value, result) for modes, result in ends]


def options_from(state: State, half_twists: int) -> Options:
    """Options of a solve that begins at a state, and whose end must not have passed through itself."""
    options = replace(options_for(half_twists), watch=None, max_steps=MOST_STEPS)
    return options if state.band.closed else replace(options, guard=strip_guard(state))


def _way(problem: Problem, smoothed: Result, modes: int, half_twists: int, options: Options) -> Result:
    if modes:
        found = climb(problem, smoothed.x, modes, options.guard)
    else:
        found = solve(problem, smoothed.x, None, options)
    return checked(replace(found, saddles=()), half_twists)
