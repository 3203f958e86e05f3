"""What a Newton step costs where a band rests on itself, beside one without contact, and a way along b."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from ribbon_cli.model.band import Array, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.touching_gaps import Pairs
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, iterate_at, solve
from ribbon_cli.solver.resting_barrier import BarrierProblem
from ribbon_cli.solver.resting_kkt import kkt_matrix
from ribbon_cli.solver.resting_set import (
    BARRIER_GOAL,
    MOST_SADDLES,
    REACHES,
    Guess,
    found,
    opened,
    rest_at,
    slopes,
)
from ribbon_cli.solver.saddle_free import newton_step

from .ours import refined, solve_options, table

ROOT = Path(__file__).parents[1]
WAY = ROOT / "configs" / "contact" / "pi-200.yaml"
WIDTHS = (0.5, 1.0, 1.3, 1.5)
TOUCHES_NOTHING = WIDTHS[-1]
BY = 0.03
"""Half-widths on the way to a band that touches nothing yet, and by how much that is widened to rest."""
NOT_CERTIFIED = 3
"""Exit code where a target has no certificate."""
LIMIT = 1e-6
"""Relative residual to which steps are solved, as Newton's method does on its way."""
PARTS = ("collisions", "derivatives", "matrix", "factors", "solution")
MOST_BARRIER, MOST_POLISH, MOST_SECONDS = 4.0, 2.0, 60.0


@dataclass(frozen=True)
class Steps:
    """Seconds of the processor of the parts of Newton steps along a way, step by step; the largest border of
    their matrices, and how many patterns these have."""

    parts: dict[str, list[float]]
    border: int
    patterns: int

    @property
    def count(self) -> int:
        """The number of steps."""
        return len(self.all)

    @property
    def all(self) -> list[float]:
        """All of each step."""
        return [sum(each) for each in zip(*self.parts.values(), strict=True)]

    def part(self, name: str) -> float:
        """The median of a part."""
        return statistics.median(self.parts[name])

    @property
    def seconds(self) -> float:
        """The median step."""
        return statistics.median(self.all)

    @property
    def mean(self) -> float:
        """The mean step: lists of pairs, patterns and symbolic factors that are made now and then count."""
        return statistics.fmean(self.all)


@dataclass(frozen=True)
class ContactCost:
    """Steps at one N: without contact, along a barrier's descent, and to the shape at rest."""

    segments: int
    free: Steps
    barrier: Steps
    polish: Steps


@dataclass(frozen=True)
class Contact:
    """All that is measured of contact; seconds of the way by the clock, None where it is left out."""

    costs: list[ContactCost]
    seconds: float | None


def measure_contact(guess: State, levels: Sequence[int], way: bool, say: Callable[[str], None]) -> Contact:
    """From the twisted guess, widened to where it touches nothing yet and refined; with the whole `way` or
    without."""
    say(f"a band of b = {TOUCHES_NOTHING:g}")
    start, costs = table(guess, (guess.band.half_width, *WIDTHS), (guess.band.segments,)), []
    state = start[TOUCHES_NOTHING, guess.band.segments].state
    for n in levels:
        if n > state.band.segments:
            state = refined(state, n, solve_options()).state
        say(f"Newton steps with contact at N = {n}")
        costs.append(_cost(state))
    seconds = None
    if way:
        say("a band followed with contact")
        seconds = _followed(WAY)
    return Contact(costs, seconds)


def _cost(state: State) -> ContactCost:
    free = Problem(state.band)
    start = rest_at(state, solve(free, state.vector()).multipliers)
    along, band = slopes(start), state.band.with_half_width(state.band.half_width + BY)
    rest = found(start, band, BY, along)
    x = start.result.x + BY * along.x
    guess = Guess(
        state, band, x, start.multipliers + BY * along.multipliers[: free.rows], Pairs.none(), start.forces
    )
    places = _descent(guess)
    own = rest.multipliers
    # The same places for all; the last ones lie on the way to the shape at rest.
    last = [places[-1] + part * (rest.result.x - places[-1]) for part in (0.0, 0.5, 0.9, 0.99, 0.999)]
    closing = [x for _ in range(4) for x in last]
    barrier = BarrierProblem(band, REACHES[0] * band.length)
    plain = Problem(band)
    _timed(plain, places, own)
    return ContactCost(
        band.segments,
        _timed(plain, places, own),
        _timed(barrier, places, own),
        _timed(rest.problem, closing, rest.result.multipliers),
    )


def _descent(guess: Guess) -> list[Array]:
    """The places (7N,) of a barrier's descent, from gaps opened by half of the reach."""
    start = opened(guess, 0.5 * REACHES[0] * guess.band.length)
    problem = BarrierProblem(guess.band, REACHES[0] * guess.band.length)
    places: list[Array] = []

    def way(x: Array, y: Array) -> bool:
        if not places or places[-1] is not x:
            places.append(x)
        return problem.allows(x, y)

    options = Options(
        way=way, leave_saddles=MOST_SADDLES, max_steps=200, goal=BARRIER_GOAL, tolerance=BARRIER_GOAL
    )
    result = solve(problem, start.vector(), guess.multipliers, options)
    return [*places, result.x]


def _timed(problem: Problem, places: list[Array], multipliers: Array) -> Steps:
    """Newton steps at places one after the other, as on the way along them."""
    seconds: dict[str, list[float]] = {name: [] for name in PARTS}
    patterns, border = set(), 0
    for before, x in zip([places[0], *places], places, strict=False):
        marks = [time.process_time()]
        if isinstance(problem, BarrierProblem):
            problem.allows(before, x)
        marks.append(time.process_time())
        point = iterate_at(problem, x, multipliers)
        marks.append(time.process_time())
        matrix = kkt_matrix(problem, point.local, problem.rotations(x))
        marks.append(time.process_time())
        factor = Factor(matrix)
        marks.append(time.process_time())
        newton_step(problem, point.local, multipliers, factor, LIMIT)
        marks.append(time.process_time())
        for name, (start, end) in zip(PARTS, pairwise(marks), strict=True):
            seconds[name].append(end - start)
        patterns.add(matrix.pattern)
        border = max(border, matrix.border)
    return Steps(seconds, border, len(patterns))


def _followed(config: Path) -> float:
    """Seconds by the clock that the command takes; a target without a certificate is no failure here."""
    with tempfile.TemporaryDirectory() as runs:
        command = [sys.executable, "-m", "ribbon_cli", "-q", "solve", str(config), "--runs", runs]
        began = time.perf_counter()
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=False)
        if done.returncode not in (0, NOT_CERTIFIED):
            done.check_returncode()
        return time.perf_counter() - began
