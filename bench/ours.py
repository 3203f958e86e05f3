"""Our side of the comparisons: the table's states from the twisted guess, without any files.

The same calls as a study makes: continuation with halved steps, prolongation, and for every state its
certificate, that is residuals, inertia, linking number and facets.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from ribbon_cli.model.band import Array, Band, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.recipes.twist import twist_stage
from ribbon_cli.solver import threads
from ribbon_cli.solver.continuation import Move, to_segments, to_width
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.newton import Options, estimate_multipliers, solve
from ribbon_cli.solver.prolongation import Phase, phase_of, smooth
from ribbon_cli.solver.status import Result
from ribbon_cli.solver.steps import inverted_facets
from ribbon_cli.study.acceptance import checked, options_for

from .peer import PeerResult, Start

threads.use(1)  # one thread for each contestant

HALF_TWISTS = 1
SIGMA = -1
TWIST_STEPS = 50
SAME_ENERGY = 1e-6
"""Relative difference below which two stationary energies are one; neighbouring minima differ by far more."""

Table = dict[tuple[float, int], "Reached"]


@dataclass(frozen=True)
class Reached:
    """A certified state and what it cost: wall `seconds` with start and certificate, Newton `steps`.

    `start` is the one that led to it, on its own grid; `events` are the detours, saddles met among them.
    """

    result: Result
    start: State
    seconds: float
    steps: int
    events: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """The state itself."""
        return self.result.state


def solve_options() -> Options:
    """Options of a study's solves: the linking number is guarded."""
    return options_for(HALF_TWISTS)


def twisted_guess(segments: int, half_width: float) -> State:
    """The ring with its seam turned by pi, before it is freed: where both contestants begin.

    Raises RuntimeError if a stage of the twist fails.
    """
    band = Band(segments, half_width, sigma=SIGMA)
    state, multipliers = cylinder(band), None
    for k in range(1, TWIST_STEPS + 1):
        stage = twist_stage(HALF_TWISTS, TWIST_STEPS, k)
        problem = Problem(band, stage.prescription)
        found = solve(problem, state.vector(), multipliers, Options(guard=stage.guard))
        state, multipliers = certified(found, problem).state, found.multipliers
    return state


def certified(result: Result, problem: Problem) -> Result:
    """A result, if its whole certificate holds. Raises RuntimeError if it does not."""
    if problem.prescription.seam is None:
        result = checked(result, HALF_TWISTS)
    if not result.certified or (inverted_facets(problem, result.x) <= 0).any():
        raise RuntimeError(f"b = {problem.band.half_width:g}, N = {problem.band.segments}: {result.message}")
    return result


def table(guess: State, widths: tuple[float, ...], levels: tuple[int, ...]) -> Table:
    """Every state of the table from the guess: widths on the coarsest grid, then level by level at each."""
    options, out = solve_options(), {}
    for k, half_width in enumerate(widths):
        current = _widened(out[widths[k - 1], levels[0]], half_width, options) if k else solved(guess)
        out[half_width, levels[0]] = current
        for segments in levels[1:]:
            out[half_width, segments] = current = refined(current.state, segments, options)
    return out


def solved(start: State) -> Reached:
    """The certified solution from a start on its own grid and width, without multipliers."""
    began = time.perf_counter()
    problem = Problem(start.band)
    result = certified(solve(problem, start.vector(), None, solve_options()), problem)
    return Reached(result, start, time.perf_counter() - began, result.steps)


def _widened(before: Reached, half_width: float, options: Options) -> Reached:
    """Continuation to a width, a step that fails halved, as in a study."""
    began, steps = time.perf_counter(), 0
    result, reach = before.result, half_width
    while True:
        move = to_width(result.state, result.multipliers, reach, options)
        steps += move.steps
        if not move.result.certified:
            reach = (result.state.band.half_width + reach) / 2
            if abs(reach - result.state.band.half_width) < 1e-4 * reach:
                raise RuntimeError(f"b = {half_width:g}: {move.result.message}")
            continue
        result = certified(move.result, Problem(move.band))
        if reach == half_width:
            start = State(move.band, before.state.u, before.state.g, before.state.xi)
            return Reached(result, start, time.perf_counter() - began, steps, move.events)
        reach = half_width


def refined(state: State, segments: int, options: Options, *, splitting: bool = False) -> Reached:
    """The state on another grid; `seconds` hold the making of its start."""
    began = time.perf_counter()
    move = to_segments(state, segments, options, splitting=splitting)
    result = certified(move.result, Problem(move.band))
    seconds = time.perf_counter() - began
    return Reached(result, state if splitting else _start(state, move), seconds, move.steps, move.events)


def _start(state: State, move: Move) -> State:
    """The prolongation that a refinement ended from, made again."""
    named = [phase for phase in Phase if move.method.endswith(f"on a {phase.value}")]
    return smooth(state, move.band.segments, (named or [phase_of(state)])[0]).state


def start_of(state: State) -> Start:
    """A state as the peer takes it."""
    return Start(state.u, state.g, state.xi)


def surplus_at(state: State) -> int:
    """Negative eigenvalues of the projected Hessian at a start, with least-squares multipliers."""
    problem, x = Problem(state.band), state.vector()
    return inertia(_matrix(problem, x)).negative


def _matrix(problem: Problem, x: Array) -> KKTMatrix:
    local = problem.local_derivatives(x, estimate_multipliers(problem, x))
    return KKTMatrix(problem, local, problem.rotations(x))


def verdict(found: PeerResult, ours: Reached) -> str:
    """What the peer's solution is by our certificate: "minimum", or what it is instead."""
    band = ours.state.band
    x = State(band, found.u, found.g, found.xi).vector()
    count = inertia(_matrix(Problem(band), x))
    if not count.trusted:
        return "undecided"
    if count.negative:
        return f"saddle of index {count.negative}"
    same = abs(found.energy - ours.result.energy) <= SAME_ENERGY * ours.result.energy
    return "minimum" if same else "another minimum"


def residuals(found: PeerResult, band: Band) -> tuple[float, float]:
    """KKT and constraint residual of the peer's solution, measured as our own are.

    Multipliers are estimated, which takes the best for the peer.
    """
    problem = Problem(band)
    x = State(band, found.u, found.g, found.xi).vector()
    multipliers = estimate_multipliers(problem, x)
    local = problem.local_derivatives(x, multipliers)
    gradient = local.gradient - problem.jacobian_matrix(local).T @ multipliers
    return float(abs(gradient).max()), float(abs(problem.constraints(x)).max())
