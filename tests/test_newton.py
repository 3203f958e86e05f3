"""The Newton solver: how solves end, saddles that are left, and the same outcome by dense algebra."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import qdldl
import scipy
from dense_reference import dense_solve
from numeric_support import DATA, E3, Array, load, named_multipliers, random_strip, ring, twist_prescription

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.problem import Prescription, Problem
from ribbon_cli.solver import ldl
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import SETTLED, Options, estimate_multipliers, solve
from ribbon_cli.solver.resting_kkt import kkt_matrix
from ribbon_cli.solver.spectra import lowest_spectrum
from ribbon_cli.solver.status import Result, Status
from ribbon_cli.solver.steps import change, inverted_facets

Solver = Callable[..., Result]
SADDLE, MINIMUM = 0.930715115, 0.925620733
"""Energies of the pi band at b = 0.1, N = 50."""
SOLVERS = pytest.mark.parametrize("run", [solve, dense_solve], ids=["sparse", "dense"])


def disturbed_ring(segments: int = 24, size: float = 0.02) -> tuple[Problem, Array]:
    state = ring(segments, 0.3)
    rng = np.random.default_rng(1)
    return Problem(state.band), state.vector() + size * rng.standard_normal(7 * segments)


def kept(name: str) -> tuple[Problem, Array, Array]:
    state, multipliers = load(name)
    return Problem(state.band), state.vector(), multipliers.vector()


def assert_solved(found: Result) -> None:
    assert (found.status, found.negative) == (Status.MINIMUM, 0)
    assert found.certified
    assert max(found.kkt_residual, found.constraint_residual) < 1e-9


# --- what solves ---


@SOLVERS
def test_a_disturbed_ring_returns(run: Solver) -> None:
    problem, x = disturbed_ring()
    found = run(problem, x)
    assert_solved(found)
    h = math.tau / 24
    assert found.energy == pytest.approx(0.3 * 24 / h * (1.0 - math.cos(h)), rel=1e-10)
    assert found.message.startswith("Converged to a minimum")


@SOLVERS
def test_convergence_is_quadratic(run: Solver) -> None:
    problem, x = disturbed_ring(size=0.01)
    found = run(problem, x)
    assert_solved(found)
    assert found.steps <= 8


def test_solutions_and_steps_repeat_bit_for_bit() -> None:
    state = random_strip(Band(25, 0.2), 1)
    first, second = (solve(Problem(state.band), state.vector()) for _ in range(2))
    np.testing.assert_array_equal(first.x, second.x)
    np.testing.assert_array_equal(first.multipliers, second.multipliers)
    assert first.steps == second.steps


def test_watch_sees_every_step() -> None:
    seen: list[tuple[int, float, float]] = []
    problem, x = disturbed_ring()
    found = solve(problem, x, options=Options(watch=lambda *args: seen.append(args)))
    assert [s[0] for s in seen[: found.steps]] == list(range(found.steps))
    assert seen[-1][2] < 1e-6 < seen[0][2]


def test_estimated_multipliers_are_those_of_a_solution() -> None:
    problem, x, y = kept("pi-b0.5-N50")
    np.testing.assert_allclose(estimate_multipliers(problem, x), y, rtol=1e-6, atol=1e-6 * np.abs(y).max())


def test_a_ring_needs_no_closure_force() -> None:
    problem, x = disturbed_ring()
    found = solve(problem, x)
    assert np.abs(named_multipliers(found).gamma).max() < 1e-6


def test_held_rulings_stay_where_they_are() -> None:
    band = Band(20, 0.2)
    held = Prescription({0: E3, 10: np.array([0.0, 0.6, 0.8])})
    problem = Problem(band, held)
    found = solve(problem, ring(20, 0.2).vector())
    assert_solved(found)
    np.testing.assert_array_equal(found.state.g[0], E3)
    np.testing.assert_array_equal(found.state.g[10], held.rulings[10])
    assert found.energy > 0.2 * 20 / band.h * (1.0 - math.cos(band.h))


@pytest.mark.parametrize("node", [9, 10])
def test_rulings_may_be_held_at_odd_and_even_nodes(node: int) -> None:
    problem = Problem(Band(20, 0.2), Prescription({0: E3, node: E3}))
    found = solve(problem, ring(20, 0.2).vector())
    assert_solved(found)


# --- twisting a ring into a pi band ---


@pytest.fixture(scope="module")
def twisted() -> State:
    """The ring with its seam opened and turned by pi in 50 stages: the thesis's guess for the pi band."""
    band = Band(50, 0.1, sigma=-1)
    x, y = replace(ring(50, 0.1), band=band).vector(), None
    for k in range(1, 51):
        problem = Problem(band, twist_prescription(math.pi * k / 50))
        with np.errstate(all="raise", under="ignore"):
            found = solve(problem, x, y)
        assert found.certified, k
        assert found.steps <= 8, k
        assert (inverted_facets(problem, found.x) > 0).all(), k
        x, y = found.x, found.multipliers
    return found.state


def test_the_twisted_band_is_exactly_stationary_when_freed(twisted: State) -> None:
    """A saddle with its inflection on the seam's node: a saddle-free step alone would be zero."""
    found = solve(Problem(twisted.band), twisted.vector(), options=Options(leave_saddles=0))
    assert (found.status, found.negative) == (Status.SADDLE, 1)
    assert found.energy == pytest.approx(SADDLE, abs=5e-10)
    assert found.message.startswith("Converged to a saddle")


@SOLVERS
def test_from_the_twisted_guess_to_the_minimum(run: Solver, twisted: State) -> None:
    found = run(Problem(twisted.band), twisted.vector())
    assert_solved(found)
    assert found.energy == pytest.approx(MINIMUM, abs=5e-10)
    assert [s.index for s in found.saddles] == [1]
    assert found.saddles[0].energy == pytest.approx(SADDLE, abs=5e-10)


@SOLVERS
def test_a_saddle_at_the_start_is_left(run: Solver) -> None:
    problem, x, y = kept("pi-b0.1-N50-saddle")
    found = run(problem, x, y)
    assert_solved(found)
    assert found.energy == pytest.approx(MINIMUM, abs=5e-10)
    met = found.saddles[0]
    assert met.index == 1
    np.testing.assert_allclose(met.x, x, atol=1e-7)
    assert met.kkt_residual < 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_a_disturbed_saddle_is_left_for_good(seed: int) -> None:
    """Near a saddle too, not only on it; and it is not come back to again and again."""
    problem, x, y = kept("pi-b0.1-N50-saddle")
    x = x + 10.0 ** (-1 - seed) * 0.1 * np.random.default_rng(seed).standard_normal(x.size)
    found = solve(problem, x, y)
    assert_solved(found)
    assert found.energy == pytest.approx(MINIMUM, abs=5e-10)
    assert len(found.saddles) <= 1


def test_the_second_minimum_is_a_minimum_too() -> None:
    """Table 3.1's coarsest state: trap 4 of several discrete minima."""
    with np.load(DATA / "pi-b0.1-N50-second-minimum.npz") as z:
        band = Band(50, float(z["half_width"]), sigma=int(z["sigma"]))
        state = State(band, z["u"], z["g"], z["xi"])
    found = solve(Problem(band), state.vector())
    assert_solved(found)
    assert found.energy == pytest.approx(0.972161, abs=1e-6)


# --- impossible problems ---


@SOLVERS
def test_an_inverted_facet_at_the_start(run: Solver) -> None:
    problem, x = disturbed_ring(size=0.0)
    x[7 * 5 + 3 : 7 * 5 + 6] *= -1.0
    found = run(problem, x)
    assert found.status is Status.INVERTED_FACET
    assert not found.certified
    assert found.steps == 0
    np.testing.assert_array_equal(found.x, x)


@SOLVERS
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e200])
def test_a_start_that_is_not_finite(run: Solver, value: float) -> None:
    problem, x = disturbed_ring()
    x[30] = value
    with np.errstate(over="ignore", invalid="ignore"):
        found = run(problem, x)
    assert found.status is Status.NOT_FINITE
    assert found.negative is None


@SOLVERS
def test_the_iteration_limit(run: Solver) -> None:
    problem, x = disturbed_ring(size=0.05)
    found = run(problem, x, options=Options(max_steps=2))
    assert (found.status, found.steps, found.negative) == (Status.ITERATION_LIMIT, 2, None)


@SOLVERS
def test_a_guard_that_always_complains(run: Solver) -> None:
    problem, x = disturbed_ring(size=0.05)
    found = run(problem, x, options=Options(guard=lambda state: "Lk is wrong."))
    assert found.status is Status.LEFT_TOPOLOGY
    assert found.steps <= 1


def test_the_guards_sentence_reaches_the_user() -> None:
    problem, x = disturbed_ring(size=0.05)
    found = solve(problem, x, options=Options(guard=lambda state: "Lk is wrong."))
    assert found.message.endswith("Lk is wrong.")


@SOLVERS
def test_a_guard_sees_states_of_the_band(run: Solver) -> None:
    seen: list[State] = []

    def guard(state: State) -> None:
        seen.append(state)

    problem, x = disturbed_ring()
    assert_solved(run(problem, x, options=Options(guard=guard)))
    assert seen
    assert all(state.band == problem.band for state in seen)


@SOLVERS
def test_linearly_dependent_constraints(run: Solver) -> None:
    """A strip folded flat and back: all tangents are +-e_x, and closure along x repeats |u| = 1."""
    band = Band(16, 0.3)
    u = np.outer(np.repeat([1.0, -1.0], 8), [1.0, 0.0, 0.0])
    state = State(band, u, np.tile(E3, (16, 1)), np.zeros(16))
    found = run(Problem(band), state.vector())
    assert found.status in (Status.STALLED, Status.UNDECIDED)  # stationary, but with a singular KKT matrix
    assert not found.certified
    assert found.negative is None


@SOLVERS
def test_a_ring_cannot_be_called_one_sided(run: Solver) -> None:
    """With sigma = -1 its last facet would have to turn over."""
    problem = Problem(Band(30, 0.3, sigma=-1))
    found = run(problem, ring(30, 0.3).vector())
    assert found.status is Status.INVERTED_FACET
    assert "inside out" in found.message


def test_every_status_has_its_sentence() -> None:
    sentences = [status.sentence for status in Status]
    assert len(set(sentences)) == len(sentences)
    assert all(s.endswith(".") and "\n" not in s for s in sentences)


def slid_band(distance: float) -> tuple[Problem, Result, Array]:
    """A stationary band, and it slid by a change of `distance`."""
    state, multipliers = load("pi-b0.5-N50")
    problem = Problem(state.band)
    at = solve(problem, state.vector(), multipliers.vector())
    local = problem.local_derivatives(at.x, at.multipliers)
    modes = lowest_spectrum(problem, at.x, local, "euclidean", 1)
    sliding = modes.vectors[modes.labels.index("sliding")].ravel()
    return problem, at, at.x + distance / change(at.x, sliding) * sliding


def test_no_certificate_far_from_the_stationary_point() -> None:
    """Slid by 1e-4 a band has small residuals, by a loose tolerance, and a long step to go."""
    problem, at, slid = slid_band(1e-4)
    loose = solve(problem, slid, at.multipliers, Options(tolerance=1e-4, goal=1e-4, max_steps=0))
    assert loose.steps == 0
    assert max(loose.kkt_residual, loose.constraint_residual) < 1e-4
    assert loose.status is Status.UNDECIDED
    assert "next Newton step would be a change of 1.0e-04" in loose.message
    assert not loose.certified
    assert solve(problem, slid, at.multipliers).certified


def test_a_long_last_step_is_taken_and_judged_where_it_leads() -> None:
    """Slid by 1e-3 a band has residuals below a loose goal: the steps left are taken all the same."""
    problem, at, slid = slid_band(1e-3)
    loose = solve(problem, slid, at.multipliers, Options(tolerance=1e-3, goal=1e-3))
    assert loose.certified
    assert 1 <= loose.steps <= 3
    assert change(at.x, loose.x - at.x) < SETTLED


@pytest.mark.parametrize("hidden", [False, True])
def test_a_solver_that_serves_again_tells_of_a_zero_pivot(
    monkeypatch: pytest.MonkeyPatch, hidden: bool
) -> None:
    """qdldl 0.1.9 raises for a zero pivot where a solver is made, and is silent where it is updated: what it
    solves from then on is wrong (https://github.com/osqp/qdldl-python)."""
    good, singular = (scipy.sparse.csc_matrix(np.triu([[d, 1.0], [1.0, d]])) for d in (2.0, 1.0))
    with pytest.raises(RuntimeError, match="not quasi-definite"):
        qdldl.Solver(singular, upper=True)
    solver = qdldl.Solver(good, upper=True)
    solver.update(singular, upper=True)
    assert solver.factors()[1].tolist() == [1.0, 0.0]

    problem, x, multipliers = kept("pi-b0.5-N50")
    matrix = kkt_matrix(problem, problem.local_derivatives(x, multipliers), problem.rotations(x))
    rhs = np.cos(np.arange(matrix.size + matrix.border))
    if hidden:
        monkeypatch.setattr(ldl, "_library", lambda: None)
    matrix.pattern.forget()
    Factor(matrix)
    right = Factor(matrix).solve(rhs)
    assert isinstance(matrix.pattern.idle[0], ldl.Objects if hidden else ldl.Functions)
    zeros = 0.0 * matrix.regularised(0.0, 1e-8)
    monkeypatch.setattr(matrix, "regularised", lambda *_: zeros, raising=False)
    assert Factor(matrix).solve_roughly(rhs) == pytest.approx(right, rel=1e-8, abs=1e-10)
