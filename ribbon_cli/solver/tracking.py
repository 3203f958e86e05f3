"""Whether a step in a parameter stayed on its branch.

Newton's method converges to some stationary point at the new value; past a fold it can only be one of
another branch. On a branch x(p) the slopes dx/dp and dE/dp are known at both ends, and the step must agree
with them: to fourth order E_1 - E_0 is the corrected trapezoid dp/2 (E'_0 + E'_1) + dp^2/12 (E''_0 - E''_1),
and to second x_1 - x_0 is dp/2 (x'_0 + x'_1). Where a step moves several parameters at once, p is the way
gone, from 0 to 1. Where it does not agree, points in between decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..model.band import Array, Band, State
from ..model.problem import Problem
from ..model.rates import Rates, end_rate, rates
from ..parts import HALF_WIDTH
from .kkt import FactorisationError, KKTMatrix
from .linear import Factor
from .prolongation import Phase, clear_phase
from .steps import change

ENERGY_MISFIT = 2e-3
"""Largest error of the corrected trapezoid, relative to the energy that the step covers: 5e-4 on pi bands
over b = 0.5 to 0.8, 6e-2 and more where a step of that length fell off its branch."""
STATE_MISFIT = 0.1
"""Largest change that is left when the step by the slopes is taken off: 0.09 on pi bands over b = 0.2 to
0.5, about 1 where a step fell off."""
PARTS = 5
"""How often a doubtful step is halved to see whether its parts agree."""
DIFFERENCE = 1e-4
"""Part of a way in several parameters over which its second derivative is taken as a difference."""


@dataclass(frozen=True)
class Way:
    """A straight way through the parameters: how fast each of them changes, by name.

    One parameter is its own measure; of several the measure is the part of the way.
    """

    rates: tuple[tuple[str, float], ...]

    @classmethod
    def between(cls, a: Band, b: Band) -> Way:
        """The way from one band's parameters to another's."""
        apart = [(n, b.parameter(n) - v) for n, v in a.parameters.items() if b.parameter(n) != v]
        return cls(((apart[0][0], 1.0),) if len(apart) == 1 else tuple(apart) or ((HALF_WIDTH, 1.0),))

    def position(self, band: Band) -> float:
        """Where a band is on the way, up to a constant."""
        name, rate = self.rates[0]
        value = band.parameter(name)
        return value if len(self.rates) == 1 else value / rate

    def middle(self, a: Band, b: Band) -> Band:
        """The first band with the parameters half-way to the second's."""
        out = a
        for name, _ in self.rates:
            out = out.with_parameter(name, 0.5 * (a.parameter(name) + b.parameter(name)))
        return out

    def ahead(self, band: Band, by: float) -> Band:
        """The band with its parameters further along the way."""
        for name, rate in self.rates:
            band = band.with_parameter(name, band.parameter(name) + by * rate)
        return band


IN_WIDTH = Way(((HALF_WIDTH, 1.0),))


@dataclass(frozen=True)
class BranchPoint:
    """A stationary point with its slopes along the branch.

    `slope` (7N,) and `multiplier_slope` (5N+3,) are dx/dp and dlambda/dp without rigid rotation; `rise` is
    dE/dp and `bend` d2E/dp2.
    """

    state: State
    multipliers: Array
    energy: float
    slope: Array
    multiplier_slope: Array
    rise: float
    bend: float
    phase: Phase | None
    way: Way = IN_WIDTH

    @classmethod
    def at(cls, state: State, multipliers: Array, way: Way = IN_WIDTH) -> BranchPoint:
        """The slopes at a stationary point with multipliers (5N+3,).

        They solve Newton's system (2.57) with the derivatives of its right-hand side with respect to p.
        Raises FactorisationError where it is singular: at a fold.
        """
        problem, x = Problem(state.band), state.vector()
        local = problem.local_derivatives(x, multipliers)
        matrix = KKTMatrix(problem, local, problem.rotations(x))
        along = _rates_along(problem, x, multipliers, local.gradient, way)
        z = Factor(matrix).solve(
            np.concatenate((-along.gradient, -along.constraints, np.zeros(matrix.gauge)))
        )
        slope, change_of_multipliers = z[: problem.size], -z[problem.size : problem.size + problem.rows]
        bend = float(along.gradient @ slope - along.constraints @ change_of_multipliers) + along.second
        for name, rate in way.rates:
            if not state.band.closed:
                slope = slope + rate * end_rate(problem, name)
        rise, phase = along.lagrangian, clear_phase(state)
        return cls(state, multipliers, local.energy, slope, change_of_multipliers, rise, bend, phase, way)


def _rates_along(problem: Problem, x: Array, multipliers: Array, gradient: Array, way: Way) -> Rates:
    """Derivatives along a way at x (7N,); `gradient` is the energy's."""
    found = [rates(problem, x, multipliers, gradient, name) for name, _ in way.rates]
    if len(found) == 1:
        return found[0]
    factors = [rate for _, rate in way.rates]

    def rise(by: float) -> float:
        moved = Problem(way.ahead(problem.band, by))
        y = moved.impose(x)
        each = (rates(moved, y, multipliers, moved.gradient(y), name).lagrangian for name, _ in way.rates)
        return sum(rate * value for rate, value in zip(factors, each, strict=True))

    # Of the second derivatives only those by one parameter are written out; this one judges steps, no more.
    second = (rise(DIFFERENCE) - rise(-DIFFERENCE)) / (2.0 * DIFFERENCE)
    return Rates(
        sum(f * each.lagrangian for f, each in zip(factors, found, strict=True)),
        np.sum([f * each.gradient for f, each in zip(factors, found, strict=True)], axis=0),
        np.sum([f * each.constraints for f, each in zip(factors, found, strict=True)], axis=0),
        second,
    )


def agree(a: BranchPoint, b: BranchPoint) -> bool:
    """Whether the slopes at two points account for the difference of their energies and of their states.

    Where the inflections went from nodes to facets' middles or back, the shape slid by half a facet, which
    costs next to nothing: then only energies are compared.
    """
    step = a.way.position(b.state.band) - a.way.position(a.state.band)
    expected = step * (0.5 * (a.rise + b.rise) + step / 12.0 * (a.bend - b.bend))
    scale = abs(step) * max(abs(a.rise), abs(b.rise))
    if not abs(b.energy - a.energy - expected) <= ENERGY_MISFIT * scale:
        return False
    if slid(a.phase, b.phase):
        return True
    x = a.state.vector()
    rest = b.state.vector() - x - 0.5 * step * (a.slope + b.slope)
    return change(x, rest) <= STATE_MISFIT


def slid(a: Phase | None, b: Phase | None) -> bool:
    """Whether two grid phases are known and differ."""
    return a is not None and b is not None and a is not b


Solver = Callable[[State, Array], tuple[State, Array] | None]
"""A stationary point near a state, from multipliers, or None."""


def follows(start: tuple[State, Array], end: tuple[State, Array], solve: Solver, parts: int) -> bool:
    """Whether a stationary point lies on the branch of another one, at other parameters.

    `start` and `end` are states with their multipliers (5N+3,). Where their slopes do not agree, the
    branch is followed from `start` by `solve` to the middle of the way, and both halves are looked at,
    `parts` times.
    """
    way = Way.between(start[0].band, end[0].band)
    try:
        return _follows(_known(*start, way), _known(*end, way), solve, parts)
    except FactorisationError:
        return False


def _known(state: State, multipliers: Array, way: Way) -> BranchPoint:
    """The slopes at a stationary point; where one step ends the next begins, with the same slopes."""
    return _slopes(state.band, state.vector().tobytes(), multipliers.tobytes(), way)


@lru_cache(maxsize=2)
def _slopes(band: Band, x: bytes, multipliers: bytes, way: Way) -> BranchPoint:
    return BranchPoint.at(State.from_vector(band, np.frombuffer(x)), np.frombuffer(multipliers), way)


def _follows(a: BranchPoint, b: BranchPoint, solve: Solver, parts: int) -> bool:
    if agree(a, b):
        return True
    if parts == 0:
        return False
    middle = a.way.middle(a.state.band, b.state.band)
    found = solve(a.state.on(middle), a.multipliers)
    if found is None:
        return False
    point = BranchPoint.at(*found, a.way)
    return _follows(a, point, solve, parts - 1) and _follows(point, b, solve, parts - 1)
