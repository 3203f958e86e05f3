"""Pseudo-arclength continuation in a parameter: points of a branch, their tangents, one step along it.

A branch is a curve of stationary points z = (x, lambda, p). Its length is measured by

    ds^2 = (h / l) sum_i (|du_i|^2 + |dg_i|^2) + (w dp)^2,      w = 2 pi / l for the half-width,

the mean square change of tangents and rulings along the band and that of the parameter as a pure number
(`parts.Parameter.weight`): independent of the mesh and of the unit of length; xi and the multipliers, which
u, g and p determine, have no weight, nor has what is held. A step predicts along the unit
tangent t and corrects on the hyperplane <t, z - z_0> = ds (Keller 1977), by Newton's method without any
regard for minima: points of a branch may be saddles, and their index is counted, not changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..model.band import Array, Band, State
from ..model.contact import self_contact
from ..model.problem import Problem
from ..model.rates import Rates, rates
from ..model.touching import Shape
from ..model.touching_audit import audit
from ..parts import HALF_WIDTH, PARAMETERS
from .bordered import BorderedSystem
from .inertia import inertia
from .kkt import FactorisationError, KKTMatrix
from .linear import Factor
from .newton import SETTLED, Guard, estimate_multipliers, iterate_at
from .resting import RestingProblem, resting_rates
from .resting_certificate import PENETRATION, certified
from .resting_kkt import kkt_matrix
from .saddle_free import newton_step
from .status import Iterate, Result, Status
from .steps import change, inverted_facets

TOLERANCE = 1e-9
GOAL = 1e-11
"""Both residuals of an accepted point, and those at which Newton's method stops while they can still fall."""
MOST_CORRECTIONS = 8
CONTRACTION = 0.5
"""Newton steps of a corrector, and the largest ratio of one to the one before."""
ROUNDOFF_STEP = 1e-7
"""Change below which the ratio of Newton steps says nothing any more."""
LONGEST_CORRECTION = 0.25
"""Largest change in one Newton step of a corrector: a longer one may lead to another branch."""

Place = tuple[Array, Array, float]
"""x (7N,), multipliers (5N+3,) and the parameter, or changes of them."""


class CorrectorError(ArithmeticError):
    """The corrector did not find a point of the branch; the message says why, as the end of a sentence."""


@dataclass(frozen=True)
class Tangent:
    """A direction in (x, lambda, p): x (7N,), multipliers (5N+3,) and the parameter's change."""

    x: Array
    multipliers: Array
    value: float


def shape_weights(band: Band) -> Array:
    """The weights (7N,) of x in the metric of arclength."""
    out = np.full((band.segments, 7), 1.0 / band.segments)
    out[:, 6] = 0.0
    return out.ravel()


@dataclass(frozen=True, eq=False)
class Point(Iterate):
    """A stationary point on a branch in a parameter, the half-width if nothing else is said.

    `steps` Newton steps found it, and `contraction` is the ratio of the second to the first (0 where one was
    enough), `correction` the size of the first.
    """

    steps: int = 0
    contraction: float = 0.0
    correction: float = 0.0
    parameter: str = HALF_WIDTH

    @property
    def value(self) -> float:
        """The parameter's value."""
        return self.problem.band.parameter(self.parameter)

    @property
    def symbol(self) -> str:
        """The parameter's name in sentences."""
        return PARAMETERS[self.parameter].symbol

    @property
    def weight(self) -> float:
        """The weight of the parameter in the metric of arclength."""
        return PARAMETERS[self.parameter].weight(self.problem.band.length) ** 2

    def product(self, one: Tangent, other: Tangent) -> float:
        """The scalar product of two directions; multipliers have no weight."""
        shapes = float(one.x @ (shape_weights(self.problem.band) * other.x))
        return shapes + self.weight * one.value * other.value

    @cached_property
    def rates(self) -> Rates:
        """Derivatives by the parameter."""
        if isinstance(self.problem, RestingProblem):
            return resting_rates(self.problem, self.x, self.multipliers, self.parameter)
        return rates(self.problem, self.x, self.multipliers, self.local.gradient, self.parameter)

    @cached_property
    def matrix(self) -> KKTMatrix:
        """The KKT matrix, rotations held."""
        return kkt_matrix(self.problem, self.local, self.problem.rotations(self.x))

    @cached_property
    def negative(self) -> int | None:
        """Negative eigenvalues of the projected Hessian, rotations left out; None where not sure."""
        try:
            if Factor(self.matrix).proves_minimum():
                return 0
            count = inertia(self.matrix)
        except FactorisationError:
            return None
        return count.negative if count.trusted else None

    @cached_property
    def unsettled(self) -> float:
        """Change in the next Newton step at this parameter, infinite where there is none."""
        try:
            step, _ = newton_step(self.problem, self.local, self.multipliers, Factor(self.matrix))
        except FactorisationError:
            return math.inf
        return change(self.x, step)

    @cached_property
    def contact(self) -> bool:
        """Whether the band touches itself; with contact forces, whether it rests on itself."""
        if isinstance(self.problem, RestingProblem):
            return len(self.problem.pairs) > 0
        band, state = self.problem.band, self.state
        return self_contact(
            state.u, state.g, self.problem.end_ruling(self.x), band.half_width, band.h
        ).contact

    def result(self, singular: str = "") -> Result:
        """The point as the result of a solve; `singular` says what it is where its index is not
        defined.

        A point at which the Hessian is singular is neither certified nor counted. Nor is one whose next
        Newton step is long, as in `newton`: the stationary point may lie where the index is another.
        """
        negative = None if singular else self.negative
        detail = singular
        if negative is not None and not self.unsettled <= SETTLED:
            negative, detail = None, f"(The next Newton step would be a change of {self.unsettled:.1e}.)"
        status = Status.UNDECIDED
        if negative is not None:
            status = Status.MINIMUM if negative == 0 else Status.SADDLE
        result = self.ended(status, negative, steps=self.steps, detail=detail)
        if not isinstance(self.problem, RestingProblem):
            return result
        gap, depth = self.problem.gap, PENETRATION * self.problem.band.length
        return certified(self.problem, result, audit(Shape.of(self.state, gap), gap + depth))


def point_at(problem: Problem, x: Array, multipliers: Array, parameter: str = HALF_WIDTH) -> Point:
    """Evaluate a place x (7N,) with multipliers (5N+3,), stationary or not; held components are imposed."""
    here = iterate_at(problem, problem.impose(x), multipliers)
    residuals = (here.kkt_residual, here.constraint_residual)
    return Point(problem, here.x, multipliers, here.local, here.gradient, *residuals, parameter=parameter)


def point_of(state: State, multipliers: Array, parameter: str = HALF_WIDTH) -> Point:
    """The point of a state with its multipliers (5N+3,)."""
    return point_at(Problem(state.band), state.vector(), multipliers, parameter)


def nearest(state: State, guard: Guard | None = None) -> Result:
    """The stationary point next to a state by plain Newton steps at its half-width, of whatever index.

    `STALLED` where they do not contract to one, with the reason in `detail`.
    """
    problem, x = Problem(state.band), state.vector()
    multipliers = np.zeros(problem.rows)
    try:
        multipliers = estimate_multipliers(problem, x)
        here = point_at(problem, x, multipliers)
        return correct_at(here, (x, multipliers, here.value), guard).result()
    except (CorrectorError, FactorisationError) as error:
        detail = f"(No stationary point is next to the state: {error}.)"
        return iterate_at(problem, x, multipliers).ended(Status.STALLED, None, steps=0, detail=detail)


# --- tangents ---


def tangent_from(point: Point, near: Tangent) -> Tangent:
    """The unit tangent of the branch at a point, on the side of `near`.

    Raises FactorisationError where there is no single tangent, at a bifurcation.
    """
    inner = shape_weights(point.problem.band)
    system = _bordered(point, inner * near.x, point.weight * near.value)
    found = Tangent(*system.solve(np.zeros(point.problem.size), np.zeros(point.problem.rows), 1.0))
    return unit(point, found)


def _bordered(point: Point, covector: Array, weight: float) -> BorderedSystem:
    return BorderedSystem(point.problem, point.x, point.local, point.rates, covector, weight)


def unit(point: Point, t: Tangent) -> Tangent:
    """The direction with length one."""
    size = math.sqrt(point.product(t, t))
    return Tangent(t.x / size, t.multipliers / size, t.value / size)


def initial_tangent(point: Point, sign: int) -> Tangent:
    """The unit tangent at a point that is no fold, with p growing for `sign` = 1, falling for -1.

    Raises FactorisationError where the Hessian is singular.
    """
    problem = point.problem
    rhs = np.concatenate((-point.rates.gradient, -point.rates.constraints, np.zeros(point.matrix.tail)))
    z = Factor(point.matrix).solve(rhs)
    n = problem.size
    first = unit(point, Tangent(z[:n], -z[n : n + problem.rows], 1.0))
    if sign < 0:
        first = Tangent(-first.x, -first.multipliers, -first.value)
    return tangent_from(point, first)


# --- correctors ---


def along(point: Point, t: Tangent, length: float) -> Place:
    """x, multipliers and p at a length along a direction from a point."""
    return (
        point.x + length * t.x,
        point.multipliers + length * t.multipliers,
        point.value + length * t.value,
    )


def correct(
    base: Point,
    t: Tangent,
    length: float,
    guess: Place,
    guard: Guard | None = None,
) -> Point:
    """The point of the branch with <t, z - base> = length near a guess (x, multipliers, p).

    Raises CorrectorError where Newton's method does not contract to one, or where the point is no band
    (an inverted facet, or what `guard` refuses).
    """
    covector, weight = shape_weights(base.problem.band) * t.x, base.weight * t.value
    level = float(covector @ base.x) + weight * base.value + length

    def step(point: Point) -> Place:
        system = _bordered(point, covector, weight)
        gradient = point.problem.lagrangian_gradient(point.local, point.multipliers)
        missing = level - float(covector @ point.x) - weight * point.value
        return system.solve(-gradient, -point.local.constraints, missing)

    return _newton(base, guess, step, guard)


def correct_at(near: Point, guess: Place, guard: Guard | None = None) -> Point:
    """The point of the branch of a point near it at exactly the guess's parameter. Raises as `correct`."""

    def step(point: Point) -> Place:
        p, new = newton_step(point.problem, point.local, point.multipliers, Factor(point.matrix))
        return p, new - point.multipliers, 0.0

    return _newton(near, guess, step, guard)


def _newton(base: Point, guess: Place, step: Callable[[Point], Place], guard: Guard | None) -> Point:
    """Newton's method from a guess, for the band and the parameter of a point."""
    x, multipliers, value = guess
    sizes: list[float] = []
    best: Point | None = None
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        while True:
            point = moved(base, x, multipliers, value)
            if not np.isfinite(point.worst):
                raise CorrectorError("derivatives are not finite")
            if best is not None and best.worst <= TOLERANCE and point.worst > 0.5 * best.worst:
                break  # as far as roundoff lets it
            best = point
            # One step at least: the hyperplane is met to roundoff only after it.
            if sizes and point.worst <= GOAL:
                break
            if len(sizes) >= MOST_CORRECTIONS:
                if point.worst <= TOLERANCE:
                    break
                raise CorrectorError(f"Newton's method has not converged in {MOST_CORRECTIONS} steps")
            try:
                p, change_of_multipliers, more = step(point)
            except FactorisationError as error:
                raise CorrectorError(str(error)) from error
            sizes.append(change(x, p))
            _check_contraction(sizes)
            x, multipliers, value = x + p, multipliers + change_of_multipliers, value + more
    if (inverted_facets(best.problem, best.x) <= 0).any():
        raise CorrectorError("a facet turns inside out")
    complaint = None if guard is None else guard(best.state)
    if complaint:
        raise CorrectorError(f"the band would pass through itself {complaint}")
    ratio = sizes[1] / sizes[0] if len(sizes) > 1 and sizes[0] > ROUNDOFF_STEP else 0.0
    return replace(best, steps=len(sizes), contraction=ratio, correction=sizes[0])


def moved(base: Point, x: Array, multipliers: Array, value: float) -> Point:
    """A place at another value of a point's parameter. Raises CorrectorError for one that is none."""
    if not math.isfinite(value) or (base.parameter == HALF_WIDTH and value <= 0.0):
        raise CorrectorError(f"it leads to a {base.parameter.replace('_', '-')} of {value:.6g}")
    band = base.problem.band.with_parameter(base.parameter, value)
    return point_at(like(base.problem, band), x, multipliers, base.parameter)


def like(problem: Problem, band: Band) -> Problem:
    """The problem of another band, with the same gaps if there are some."""
    if isinstance(problem, RestingProblem):
        return RestingProblem(band, problem.pairs, problem.gap)
    return Problem(band)


def _check_contraction(sizes: list[float]) -> None:
    """Raise CorrectorError where Newton steps are long or do not get shorter."""
    if not sizes[-1] <= LONGEST_CORRECTION:
        raise CorrectorError(f"Newton's method departs by {sizes[-1]:.2g}")
    if len(sizes) > 1 and sizes[-1] > max(CONTRACTION * sizes[-2], ROUNDOFF_STEP):
        raise CorrectorError(f"Newton's method does not contract ({sizes[-2]:.1e}, then {sizes[-1]:.1e})")
