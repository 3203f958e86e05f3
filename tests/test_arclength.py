"""Branches in the half-width: the bordered system, tangents, folds, branch points, against dense algebra."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dense_reference import DenseModel
from numeric_support import DATA, Array, load, ring, twist_prescription
from scipy.optimize import brentq, minimize_scalar

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.diagnostics import taylor_slopes
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.rates import rates
from ribbon_cli.solver.arclength import (
    CorrectorError,
    Point,
    Tangent,
    correct_at,
    initial_tangent,
    point_at,
    point_of,
    shape_weights,
    tangent_from,
)
from ribbon_cli.solver.bordered import BorderedSystem
from ribbon_cli.solver.branch import BranchOptions, End, Reason, advance
from ribbon_cli.solver.branch_events import Event
from ribbon_cli.solver.branch_switch import switch
from ribbon_cli.solver.newton import estimate_multipliers, solve
from ribbon_cli.solver.prolongation import smooth
from ribbon_cli.solver.status import Status


def follow(
    point: Point, sign: int, options: BranchOptions, most: int = 200
) -> tuple[list[Event], list[Point], End]:
    """A branch from a point on: its events, its points and its end."""
    tangent, length = initial_tangent(point, sign), options.first_step
    events: list[Event] = []
    points = [point]
    for _ in range(most):
        taken = advance(point, tangent, length, options)
        events += taken.events
        if taken.end is not None:
            return events, points, taken.end
        assert taken.point is not None
        assert taken.tangent is not None
        point, tangent, length = taken.point, taken.tangent, taken.following
        points.append(point)
    raise AssertionError("the branch has no end")


@cache
def second_minimum() -> Point:
    with np.load(DATA / "pi-b0.1-N50-second-minimum.npz") as z:
        state = State(Band(50, float(z["half_width"]), sigma=-1), z["u"], z["g"], z["xi"])
    result = solve(Problem(state.band), state.vector())
    assert result.status is Status.MINIMUM
    return point_of(result.state, result.multipliers)


@cache
def around_the_fold() -> tuple[list[Event], list[Point], End]:
    """The branch of the second minimum up to its fold near b = 0.1126 and back to 0.09, meeting 0.11."""
    return follow(second_minimum(), 1, BranchOptions(0.09, 0.2, (0.11,)))


@cache
def pi_band() -> tuple[list[Event], list[Point], End]:
    """The pi band at N = 50 from b = 0.5 through the sliding mode's branch point to 1.55, past contact."""
    state, multipliers = load("pi-b0.5-N50")
    point = point_of(state, multipliers.vector())
    return follow(point, 1, BranchOptions(0.4, 1.55, (1.0,), largest_step=0.2))


def one(events: list[Event], kind: str) -> Event:
    (found,) = [event for event in events if event.type == kind]
    return found


# --- the derivative by b ---


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("prescribed", [False, True])
def test_width_derivative_of_the_residual(rule: Discretisation, sigma: int, prescribed: bool) -> None:
    """(grad L, c) as a function of log b, in which it is not linear: Taylor slopes 1 and 2."""
    rng = np.random.default_rng(3)
    prescription = twist_prescription(0.7) if prescribed else None
    bands = Band(11, 0.4, sigma=sigma, discretisation=rule)

    def problem(b: float) -> Problem:
        band = bands.with_half_width(b)
        return Problem(band) if prescription is None else Problem(band, prescription)

    x = problem(0.4).impose(rng.standard_normal(77))
    y, probe = rng.standard_normal(58), rng.standard_normal(77 + 58)

    def value(log: Array) -> float:
        p = problem(0.4 * math.exp(float(log[0])))
        local = p.local_derivatives(x, y)
        return float(probe[:77] @ p.lagrangian_gradient(local, y) + probe[77:] @ local.constraints)

    p = problem(0.4)
    found = rates(p, x, y, p.local_derivatives(x, y).gradient, "half_width")
    slope = float(probe[:77] @ found.gradient + probe[77:] @ found.constraints)
    slopes = taylor_slopes(value, np.zeros(1), np.ones(1), [0.4 * slope])
    assert [each.slope for each in slopes] == pytest.approx([1.0, 2.0], abs=0.03)


# --- the bordered system ---


def dense_bordered(point: Point, covector: Array, weight: float) -> Array:
    """The whole bordered matrix in (x, lambda, gauge, b), written out."""
    problem = point.problem
    n, m = problem.size, problem.rows
    hessian = problem.hessian(point.x, point.multipliers).toarray()
    jacobian = problem.jacobian(point.x).toarray()
    rotations = problem.rotations(point.x)
    r = rotations.shape[1]
    matrix = np.zeros((n + m + r + 1, n + m + r + 1))
    matrix[:n, :n] = hessian
    matrix[:n, n : n + m] = -jacobian.T
    matrix[n : n + m, :n] = jacobian
    matrix[:n, n + m : n + m + r] = rotations
    matrix[n + m : n + m + r, :n] = rotations.T
    matrix[:n, -1], matrix[n : n + m, -1] = point.rates.gradient, point.rates.constraints
    matrix[-1, :n], matrix[-1, -1] = covector, weight
    return matrix


def compare_with_dense(point: Point, covector: Array, weight: float, seed: int, tolerance: float) -> None:
    """Solve with random right-hand sides, and by the matrix written out."""
    problem, rng = point.problem, np.random.default_rng(seed)
    rhs = rng.standard_normal(problem.size), rng.standard_normal(problem.rows), 0.3
    system = BorderedSystem(problem, point.x, point.local, point.rates, covector, weight)
    p, dlambda, db = system.solve(*rhs)
    expected, width = dense_solution(point, covector, weight, *rhs)
    size = max(np.abs(expected).max(), abs(width))
    assert np.abs(np.concatenate((p, dlambda)) - expected).max() <= tolerance * size
    assert db == pytest.approx(width, abs=tolerance * size)


def dense_solution(
    point: Point, covector: Array, weight: float, gradient: Array, constraints: Array, level: float
) -> tuple[Array, float]:
    """Changes of x and lambda in one vector, and that of b, by the matrix written out."""
    matrix = dense_bordered(point, covector, weight)
    n = point.problem.size + point.problem.rows
    gauge = np.zeros(matrix.shape[0] - 1 - n)
    found = np.linalg.solve(matrix, np.concatenate((gradient, constraints, gauge, [level])))
    return found[:n], float(found[-1])


@pytest.mark.parametrize("place", ["regular", "fold", "beyond"])
def test_bordered_solution_is_the_dense_one(place: str) -> None:
    """Also on the fold, where the KKT matrix itself is singular."""
    events, points, _ = around_the_fold()
    point = {"regular": points[0], "fold": one(events, "fold").point, "beyond": points[-1]}[place]
    tangent = one(events, "fold").tangent
    inner, outer = shape_weights(point.problem.band), point.weight
    compare_with_dense(point, inner * tangent.x, outer * tangent.value, seed=5, tolerance=1e-8)


def test_elimination_by_the_kkt_matrix_itself_serves_where_the_bordered_one_is_singular() -> None:
    """Beyond a fold the Hessian restricted to the border's complement may be singular; the whole is not.

    A border a with a' K^-1 a = 0 makes [[K, a], [a', 0]] singular.
    """
    point = around_the_fold()[1][-1]
    problem = point.problem
    model = DenseModel(problem, point.local, problem.rotations(point.x))
    values, vectors = model.values, model.vectors
    assert values[0] < 0 < values[1]
    outer = point.weight
    # The quadratic form's zero in the plane of two eigenvectors, drawn to the pattern of a border.
    a = math.sqrt(-values[0]) * vectors[:, 0] + math.sqrt(values[1]) * vectors[:, 1]
    a[6::7] = 0.0
    compare_with_dense(point, a, outer, seed=1, tolerance=1e-7)


# --- tangents and the metric ---


def test_the_ring_stays_a_ring() -> None:
    """The ring's shape and Q_h/b do not depend on b: its tangent is (0, lambda/b, 1) to roundoff."""
    state = ring(24, 0.3)
    problem = Problem(state.band)
    x = state.vector()
    point = point_at(problem, x, estimate_multipliers(problem, x))
    tangent = initial_tangent(point, 1)
    assert np.abs(tangent.x).max() <= 1e-12
    assert tangent.value == pytest.approx(1.0, abs=1e-13)
    assert tangent.multipliers == pytest.approx(point.multipliers / 0.3, abs=1e-10)
    events, points, end = follow(point, 1, BranchOptions(0.2, 1.7))
    assert (end.reason, end.value) == (Reason.RANGE, 1.7)
    assert [event.type for event in events] == ["width"]
    assert points[-1].energy / points[-1].value == pytest.approx(point.energy / 0.3, rel=1e-13)


def test_tangent_is_the_difference_quotient() -> None:
    state, multipliers = load("pi-b0.5-N50")
    point = point_of(state, multipliers.vector())
    tangent = initial_tangent(point, 1)
    db = 1e-4
    ahead, behind = (correct_at(point, (point.x, point.multipliers, 0.5 + s * db)) for s in (1.0, -1.0))
    assert (ahead.x - behind.x) / (2 * db) == pytest.approx(tangent.x / tangent.value, abs=1e-5)
    slope = (ahead.multipliers - behind.multipliers) / (2 * db)
    assert slope == pytest.approx(tangent.multipliers / tangent.value, abs=1e-3)


def test_arclength_does_not_depend_on_the_mesh() -> None:
    state, _ = load("pi-b0.5-N50")
    rates = []
    for n in (50, 100, 200):
        band = state if n == 50 else smooth(state, n).state
        result = solve(Problem(band.band), band.vector())
        rates.append(initial_tangent(point_of(result.state, result.multipliers), 1).value)
    assert rates == pytest.approx([rates[0]] * 3, rel=0.01)


@pytest.mark.parametrize("factor", [0.1, 7.0])
def test_arclength_does_not_depend_on_the_unit_of_length(factor: float) -> None:
    state, multipliers = load("pi-b0.5-N50")
    point = point_of(state, multipliers.vector())
    band = replace(state.band, half_width=factor * 0.5, length=factor * state.band.length)
    scaled = State(band, state.u, state.g, state.xi)
    other = point_of(scaled, estimate_multipliers(Problem(band), scaled.vector()))
    t, s = initial_tangent(point, 1), initial_tangent(other, 1)
    assert s.x == pytest.approx(t.x, abs=1e-8)
    assert s.value == pytest.approx(factor * t.value, rel=1e-8)
    assert other.product(s, s) == pytest.approx(1.0, abs=1e-14)


def test_a_tangent_keeps_its_side() -> None:
    point = second_minimum()
    up, down = initial_tangent(point, 1), initial_tangent(point, -1)
    assert up.value == pytest.approx(-down.value, rel=1e-9)
    assert tangent_from(point, down).value < 0 < tangent_from(point, up).value


# --- folds ---


def dense_width(point: Point, coordinate: int, value: float) -> float:
    """b on the branch where one coordinate of x has a value, by dense Newton steps from a point near by."""
    x, y, b = point.x.copy(), point.multipliers.copy(), point.value
    for _ in range(30):
        here = point_at(Problem(point.problem.band.with_half_width(b)), x, y)
        unit = np.zeros(x.size)
        unit[coordinate] = 1.0
        gradient = here.problem.lagrangian_gradient(here.local, y)
        residual = (-gradient, -here.local.constraints, float(value - x[coordinate]))
        step, wider = dense_solution(here, unit, 0.0, *residual)
        x, y, b = x + step[: x.size], y + step[x.size :], b + wider
        if np.abs(step[: x.size]).max() < 1e-13:
            break
    return float(b)


def test_fold_against_dense_algebra() -> None:
    """The largest b as a function of a coordinate that passes the fold at full speed."""
    events, _, end = around_the_fold()
    fold = one(events, "fold")
    tangent = fold.tangent
    x = np.abs(tangent.x)
    x[6::7] = 0.0
    coordinate = int(np.argmax(x))
    value = float(fold.point.x[coordinate])
    spread = 0.01 * abs(float(tangent.x[coordinate]))
    best = minimize_scalar(
        lambda v: -dense_width(fold.point, coordinate, v),
        bounds=(value - spread, value + spread),
        method="bounded",
        options={"xatol": 1e-7},
    )
    assert -best.fun == pytest.approx(fold.point.value, rel=1e-10)
    assert best.x == pytest.approx(value, abs=1e-2 * spread)
    assert (fold.before, fold.after) == (0, 1)
    assert fold.loses_stability
    assert abs(tangent.value) <= 1e-8
    assert end == End(Reason.RANGE, 0.09)


def test_both_sides_of_a_fold_are_reached() -> None:
    events, points, _ = around_the_fold()
    first, second, last = (event for event in events if event.type == "width")
    assert [first.point.value, second.point.value] == [0.11, 0.11]
    assert last.point.value == 0.09
    assert first.point.energy < second.point.energy
    assert (first.point.negative, second.point.negative) == (0, 1)
    assert {point.negative for point in points} == {0, 1}
    assert max(point.kkt_residual for point in points) <= 1e-9


def test_a_branch_followed_back_returns_to_its_start() -> None:
    """From the far end back around the fold, to the same state at b = 0.1."""
    events, _, _ = around_the_fold()
    far = events[-1].point
    back, _, _ = follow(far, 1, BranchOptions(0.085, 0.2, (0.1,)))
    fold = one(back, "fold")
    assert (fold.before, fold.after) == (1, 0)
    assert fold.point.value == pytest.approx(one(events, "fold").point.value, rel=1e-10)
    first, reached = (event.point for event in back if event.point.value == 0.1)
    assert first.negative == 1
    assert reached.energy == pytest.approx(second_minimum().energy, rel=1e-12)
    assert reached.negative == 0


def test_a_singular_point_is_no_minimum() -> None:
    fold = one(around_the_fold()[0], "fold")
    result = fold.point.result("on a fold")
    assert (result.status, result.negative, result.certified) == (Status.UNDECIDED, None, False)
    saddle = around_the_fold()[1][-1].result()
    assert (saddle.status, saddle.negative, saddle.certified) == (Status.SADDLE, 1, False)


# --- branch points ---


def test_branch_point_against_dense_algebra() -> None:
    """Where the lowest eigenvalue of the dense projected Hessian passes zero at constant b."""
    event = one(pi_band()[0], "branch-point")
    near = event.point

    def lowest(b: float) -> float:
        point = correct_at(near, (near.x, near.multipliers, b))
        model = DenseModel(point.problem, point.local, point.problem.rotations(point.x))
        return float(model.values[np.argmin(np.abs(model.values))])

    b = near.value
    # Not so near that the corrector is singular itself: the root of a line through two points beside it.
    beside = [(b + d, lowest(b + d)) for d in (-2e-4, 2e-4)]
    root = brentq(
        np.poly1d(np.polyfit(*zip(*beside, strict=True), 1)), beside[0][0], beside[1][0], xtol=1e-14
    )
    assert root == pytest.approx(b, rel=1e-6)
    assert (event.before, event.after) == (0, 1)
    assert event.mode is not None
    assert event.mode.word == "sliding"
    assert near.kkt_residual <= 1e-9
    # What is soft there: W v is a combination of constraint normals.
    model = DenseModel(near.problem, near.local, near.problem.rotations(near.x))
    v = event.mode.tangent.x
    assert np.abs(model.basis.T @ (model.hessian @ v)).max() <= 1e-7
    assert np.abs(model.normals @ v).max() <= 1e-9


def test_both_sides_of_a_pitchfork() -> None:
    """The pi band's half-turn maps one side to the other: same widths, same energies, on other states."""
    event = one(pi_band()[0], "branch-point")
    assert event.mode is not None
    sides = [switch(event.point, event.tangent, event.mode.tangent, side) for side in (1, -1)]
    plus, minus = (side.point for side in sides)
    assert plus.value == pytest.approx(minus.value, rel=1e-9)
    assert plus.energy == pytest.approx(minus.energy, rel=1e-10)
    assert np.abs(plus.x - minus.x).max() > 1e-3
    for side in sides:
        assert side.point.negative == plus.negative
        assert max(side.point.kkt_residual, side.point.constraint_residual) <= 1e-9
        taken = advance(side.point, side.tangent, 0.01, BranchOptions(0.5, 1.5))
        assert taken.point is not None
        apart = Tangent(taken.point.x - event.point.x, np.zeros(1), taken.point.value - event.point.value)
        assert event.point.product(apart, apart) > side.distance**2


def test_no_other_branch_at_a_regular_point() -> None:
    """Off the tangent of a branch that nothing crosses there is no second branch to be found near by."""
    events, points, _ = pi_band()
    event = one(events, "branch-point")
    assert event.mode is not None
    regular = points[0]
    with pytest.raises(CorrectorError, match="no other branch was found"):
        switch(regular, initial_tangent(regular, 1), event.mode.tangent, 1)


# --- widths, contact, ends ---


def test_a_width_asked_for_is_met_exactly() -> None:
    events, points, _ = pi_band()
    (event,) = [e for e in events if e.type == "width" and e.point.value == 1.0]
    natural = correct_at(points[0], (event.point.x, event.point.multipliers, 1.0))
    assert event.point.energy == pytest.approx(natural.energy, rel=1e-13)
    assert max(event.point.kkt_residual, event.point.constraint_residual) <= 1e-9


def test_contact_is_bracketed() -> None:
    events, _, _ = pi_band()
    event = one(events, "contact")
    assert event.begins
    assert event.point.contact
    assert event.bracket <= 1e-5
    before = correct_at(event.point, (event.point.x, event.point.multipliers, event.point.value - 1e-5))
    assert not before.contact


@pytest.mark.parametrize(
    ("stop", "b"), [(Reason.STABILITY_LOST, 1.2159), (Reason.CONTACT, 1.4933), (Reason.FOLD, 1.55)]
)
def test_a_branch_stops_where_it_is_asked_to(stop: Reason, b: float) -> None:
    state, multipliers = load("pi-b0.5-N50")
    start = point_of(state, multipliers.vector())
    options = BranchOptions(0.4, 1.55, largest_step=0.2, stop_at=frozenset({stop}))
    events, _, end = follow(start, 1, options)
    assert end.reason is (Reason.RANGE if stop is Reason.FOLD else stop)
    assert end.value == pytest.approx(b, abs=1e-4)
    assert events[-1].point.value == end.value


def test_a_fold_is_where_a_branch_stops_if_asked() -> None:
    events, _, end = follow(second_minimum(), 1, BranchOptions(0.09, 0.2, stop_at=frozenset({Reason.FOLD})))
    assert end.reason is Reason.FOLD
    assert events[-1].point.value == end.value
    assert end.value == pytest.approx(0.112567998, abs=1e-9)


def test_what_the_guard_refuses_ends_the_branch() -> None:
    options = BranchOptions(0.05, 0.2, least_step=1e-3, guard=lambda state: "(it is no band.)")
    taken = advance(second_minimum(), initial_tangent(second_minimum(), 1), 0.01, options)
    assert taken.end is not None
    assert taken.end.reason is Reason.STEP_TOO_SMALL
    assert "would pass through itself (it is no band.)" in taken.end.detail
    assert len(taken.refused) == 5
    assert taken.point is None


def test_steps_come_from_where_they_say() -> None:
    """A step depends on its start, its tangent and its length alone."""
    point = second_minimum()
    options = BranchOptions(0.05, 0.2)
    first, again = (advance(point, initial_tangent(point, 1), 0.01, options) for _ in range(2))
    assert first.point is not None
    assert again.point is not None
    assert np.array_equal(first.point.x, again.point.x)
    assert first.following == again.following
