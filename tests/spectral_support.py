"""States of known stability that tests of spectra share: rings, rings covered several times, grid saddles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numeric_support import E3, Array, load, with_rule

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.problem import LocalDerivatives, Problem
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, estimate_multipliers, solve
from ribbon_cli.solver.prolongation import Phase, smooth
from ribbon_cli.solver.saddle_free import newton_step
from ribbon_cli.solver.status import Result

RULES = tuple(Discretisation)


@dataclass(frozen=True)
class Place:
    """A stationary point with its derivatives."""

    problem: Problem
    result: Result

    @property
    def x(self) -> Array:
        return self.result.x

    @property
    def local(self) -> LocalDerivatives:
        return self.problem.local_derivatives(self.result.x, self.result.multipliers)


def settled(state: State) -> Place:
    """The nearest stationary point, a saddle or not: plain Newton steps, then the solver's judgement."""
    problem, x = Problem(state.band), state.vector()
    multipliers = estimate_multipliers(problem, x)
    for _ in range(12):
        local = problem.local_derivatives(x, multipliers)
        factor = Factor(KKTMatrix(problem, local, problem.rotations(x)))
        step, multipliers = newton_step(problem, local, multipliers, factor)
        x = x + step
        if np.abs(step).max() < 1e-12:
            break
    return Place(problem, solve(problem, x, multipliers, Options(leave_saddles=0)))


def covered_ring(segments: int, times: int, half_width: float, rule: Discretisation) -> Place:
    """A circle gone round several times: narrow bands have index 2 for four and five times."""
    band = Band(segments, half_width, discretisation=rule)
    angle = math.tau * times * (np.arange(segments) + 0.5) / segments
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(segments)))
    return settled(State(band, u, np.tile(E3, (segments, 1)), np.zeros(segments)))


@cache
def pi_band(segments: int, rule: Discretisation, phase: Phase = Phase.FACET) -> Place:
    """The pi band at b = 0.5: the minimum, or the grid's saddle with the inflection on a node."""
    if segments > 50:
        coarse = pi_band(max(50, segments // 2), rule).result.state
    else:
        coarse = with_rule(load("pi-b0.5-N50")[0], rule)
    return settled(smooth(coarse, segments, phase).state)


def ring_place(segments: int, half_width: float, rule: Discretisation, length: float = math.tau) -> Place:
    return settled(cylinder(Band(segments, half_width, length, discretisation=rule)))


def ring_values(half_width: float, length: float, times: int = 1, most: int = 24) -> Array:
    """Eigenvalues of the linearised ring in the physical metric, ascending; docs/stability.md derives them.

    Waves m = j/times; those that belong to rotations or break closure (m = 0, 1) are left out.
    """
    k = math.tau * times / length
    waves = np.array([j / times for j in range(1, most * times) if j != times])
    inside = half_width * k**2 * waves**2
    n = waves**2 - 1.0
    across = half_width * k**2 * n * (1.0 + n * (2.0 + (half_width * k * waves) ** 2 / 3.0))
    across /= 1.0 + waves**2 + waves**4
    return np.sort(np.repeat(np.concatenate((inside, across)), 2))
