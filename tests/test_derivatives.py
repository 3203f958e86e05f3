"""Derivatives by Taylor remainders, for both rules, both seams, held rulings and the open seam."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numeric_support import E3, Array, load, unit, with_rule

from ribbon_cli.model.band import Band, Discretisation
from ribbon_cli.model.diagnostics import problem_slopes, taylor_slopes
from ribbon_cli.model.problem import FREE, Prescription, Problem

EXPECTED = {"energy": 2.0, "constraints": 2.0, "lagrangian": 3.0, "gradient": 2.0}
PRESCRIPTIONS = {
    "free": FREE,
    "held": Prescription({0: unit(1), 3: unit(2)}),
    "open seam": Prescription({0: E3}, seam=unit(3)),
    "open seam, nothing held": Prescription(seam=unit(4)),
}


def slopes_at(problem: Problem, x: Array, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    d = rng.standard_normal(problem.size)
    return problem_slopes(problem, x, rng.standard_normal(problem.rows), d / np.linalg.norm(d))


@pytest.mark.parametrize(
    "rule", [Discretisation.THESIS, pytest.param(Discretisation.VALUE_AVERAGE, marks=pytest.mark.long)]
)
@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("case", PRESCRIPTIONS)
def test_taylor_slopes_away_from_the_constraints(rule: Discretisation, sigma: int, case: str) -> None:
    problem = Problem(Band(13, 0.7, sigma=sigma, discretisation=rule), PRESCRIPTIONS[case])
    x = problem.impose(np.random.default_rng(7).standard_normal(problem.size))
    assert slopes_at(problem, x, 8) == pytest.approx(EXPECTED, abs=0.03)


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("name", ["pi-b0.1-N50", "pi-b0.5-N50"])
def test_taylor_slopes_at_a_solution(rule: Discretisation, name: str) -> None:
    state = with_rule(load(name)[0], rule)
    assert slopes_at(Problem(state.band), state.vector(), 9) == pytest.approx(EXPECTED, abs=0.03)


@pytest.mark.parametrize("segments", [3, 4, 5])
def test_taylor_slopes_where_neighbours_coincide(segments: int) -> None:
    """With three segments a node's neighbours are each other's neighbours too."""
    problem = Problem(Band(segments, 0.4, sigma=-1))
    x = np.random.default_rng(1).standard_normal(problem.size)
    found = slopes_at(problem, x, 5)
    assert found == pytest.approx(EXPECTED, abs=0.1)


@pytest.mark.parametrize("case", PRESCRIPTIONS)
def test_hessian_is_symmetric_and_still_components_are_still(case: str) -> None:
    problem = Problem(Band(8, 0.5, sigma=-1), PRESCRIPTIONS[case])
    rng = np.random.default_rng(3)
    x, y = problem.impose(rng.standard_normal(problem.size)), rng.standard_normal(problem.rows)
    hessian = problem.hessian(x, y).toarray()
    assert np.abs(hessian - hessian.T).max() <= 1e-14 * np.abs(hessian).max()
    held = problem.fixed
    assert held.sum() == 3 * len(problem.prescription.rulings)
    assert not hessian[held].any()
    assert not problem.gradient(x)[held].any()
    assert not problem.jacobian(x).toarray()[:, held].any()


@pytest.mark.parametrize("case", PRESCRIPTIONS)
def test_rotations_keep_energy_and_constraints(case: str) -> None:
    problem = Problem(Band(9, 0.5, sigma=-1), PRESCRIPTIONS[case])
    x = problem.impose(np.random.default_rng(3).standard_normal(problem.size))
    gauge = problem.rotations(x)
    assert gauge.shape == (problem.size, {"free": 3, "open seam, nothing held": 1}.get(case, 0))
    assert np.abs(gauge.T @ gauge - np.eye(gauge.shape[1])).max(initial=0.0) < 1e-14
    assert np.abs(problem.gradient(x) @ gauge).max(initial=0.0) < 1e-9
    rows = problem.jacobian(x) @ gauge
    assert np.abs(rows[:-3]).max(initial=0.0) < 1e-13  # the closure sum turns with the band


def test_an_axis_kept_by_all_held_rulings_remains_free() -> None:
    problem = Problem(Band(12, 0.2), Prescription({0: E3, 6: -E3}))
    assert problem.rotations(problem.impose(np.ones(problem.size))).shape[1] == 1


def test_a_wrong_gradient_shows_as_slope_one() -> None:
    x, d = np.array([0.3, -0.2]), np.array([0.6, 0.8])
    gradient = np.cos(x) * d
    right = taylor_slopes(lambda y: float(np.sin(y).sum()), x, d, [float(gradient.sum())])
    wrong = taylor_slopes(lambda y: float(np.sin(y).sum()), x, d, [1.001 * float(gradient.sum())])
    assert [s.slope for s in right] == pytest.approx([1.0, 2.0], abs=0.02)
    assert wrong[1].slope == pytest.approx(1.0, abs=0.05)
    assert right[1].window[0] < right[1].window[1]


def test_an_exact_expansion_has_infinite_slope() -> None:
    x, d = np.array([1.0, 2.0]), np.array([0.5, -1.0])
    linear = taylor_slopes(lambda y: 3.0 * y, x, d, [3.0 * d])
    assert linear[0].slope == pytest.approx(1.0, abs=1e-6)
    assert math.isinf(linear[1].slope)


def test_unit_length_of_held_rulings_is_demanded() -> None:
    with pytest.raises(ValueError, match="unit vectors"):
        Prescription({0: np.array([0.0, 0.0, 1.1])})
    with pytest.raises(ValueError, match="unit vectors"):
        Prescription(seam=np.zeros(3))


@pytest.mark.parametrize("case", PRESCRIPTIONS)
def test_derivatives_for_other_multipliers_are_those_made_anew(case: str) -> None:
    problem = Problem(Band(9, 0.5, sigma=-1), PRESCRIPTIONS[case])
    rng = np.random.default_rng(4)
    x, y = problem.impose(rng.standard_normal(problem.size)), rng.standard_normal(problem.rows)
    other = problem.with_multipliers(x, problem.local_derivatives(x, None), y)
    anew = problem.local_derivatives(x, y)
    assert (problem.hessian_matrix(other) != problem.hessian_matrix(anew)).nnz == 0
    assert (problem.jacobian_matrix(other) != problem.jacobian_matrix(anew)).nnz == 0
    assert not problem.hessian_matrix(problem.local_derivatives(x, None)).data.any()
