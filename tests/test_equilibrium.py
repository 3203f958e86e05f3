"""(1.61)-(1.66) on computed bands: identities of the discrete scheme, orders, the seam's sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numeric_support import Array, ladder, named_multipliers, random_strip, with_rule

from ribbon_cli.model.band import Band, Discretisation, Multipliers, State
from ribbon_cli.model.equilibrium import Equilibrium, moved_seam, nodal_moment, seam_conditions
from ribbon_cli.model.geometry import geometry
from ribbon_cli.model.multiplier_theory import fields_of
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.staggered import at_facets, distance_to, far_half, inflections, nodes, slope_at_facets
from ribbon_cli.solver.newton import solve


def orders(values: list[float]) -> Array:
    return np.log2(np.divide(values[:-1], values[1:]))


def between(band: Band) -> Array:
    return band.h / 8 * (np.arange(8 * band.segments) + 0.5)


def distance(state: State, alpha: Array) -> Array:
    return distance_to(
        state.band, inflections(geometry(state).kappa_s, state.band.length, state.band.sigma), alpha
    )


def kkt(state: State, multipliers: Multipliers) -> float:
    problem = Problem(state.band)
    local = problem.local_derivatives(state.vector(), multipliers.vector())
    return float(np.abs(local.gradient - problem.jacobian_matrix(local).T @ multipliers.vector()).max())


def value_average() -> tuple[State, Multipliers]:
    """The pi band at N = 50 under the other rule."""
    start = with_rule(ladder()[50][0], Discretisation.VALUE_AVERAGE)
    result = solve(Problem(start.band), start.vector())
    assert result.certified
    return result.state, named_multipliers(result)


def test_centred_differences_of_the_force_are_the_discrete_equations() -> None:
    """Stationarity in u is (1.61) integrated once, with lambda_3 - h lambda_2 eta, to rounding."""
    for state, multipliers in (ladder()[50], ladder()[400], value_average()):
        band, field = state.band, fields_of(state, multipliers)
        g, sigma = state.g, band.sigma
        bracket = nodal_moment(state) - field.lambda_3[:, None] * g
        eta = geometry(state).eta
        force = slope_at_facets(bracket, 1, band.h) + 2.0 * field.lambda_1[:, None] * state.u
        force -= 2.0 * at_facets((field.lambda_2 * eta)[:, None] * g, 1)
        rise = slope_at_facets(g, sigma, band.h)
        force += field.lambda_4[:, None] * np.cross(g, rise)
        force += band.half_width * field.lambda_5[:, None] * rise + field.gamma
        assert np.abs(force).max() < 1e-8


@pytest.mark.parametrize("key", ["force", "balance", "moment", "slope"])
def test_euler_lagrange_residuals_are_of_second_order_everywhere(key: str) -> None:
    """(1.61)-(1.63) with the discrete multipliers, at the inflection as well."""
    found = []
    for n in (100, 200, 400):
        state, multipliers = ladder()[n]
        residuals = Equilibrium(state, multipliers).residuals(between(state.band))
        found.append(float(np.abs(getattr(residuals, key)).max()))
    assert found[-1] < {"force": 2e-3, "balance": 3e-2, "moment": 1e-3, "slope": 1e-3}[key]
    np.testing.assert_allclose(orders(found), 2.0, atol=0.2)


@pytest.mark.parametrize("key", ["force", "balance", "moment"])
def test_xi_eliminated(key: str) -> None:
    """xi and lambda_5 by (1.63) on the surface: second order where it is smooth, none at the inflection."""
    far, everywhere = [], []
    for n in (100, 200, 400):
        state, multipliers = ladder()[n]
        alpha = between(state.band)
        residuals = Equilibrium(state, multipliers, eliminate_xi=True).residuals(alpha)
        size = np.abs(getattr(residuals, key)).max(axis=1)
        far.append(float(size[far_half(distance(state, alpha))].max()))
        everywhere.append(float(size.max()))
    np.testing.assert_allclose(orders(far), 2.0, atol=0.15)
    assert everywhere[-1] > 0.9 * everywhere[0] > 0.5


def test_xi_cannot_be_eliminated_where_rulings_meet() -> None:
    state, multipliers = ladder()[50]
    wide = replace(state, band=state.band.with_half_width(1.0))
    with pytest.raises(ValueError, match="rulings"):
        Equilibrium(wide, multipliers, eliminate_xi=True)


def test_the_balance_is_the_derivative_of_the_force() -> None:
    state, multipliers = ladder()[100]
    found = Equilibrium(state, multipliers)
    alpha, step = np.linspace(0.3, 5.9, 57), 1e-5
    ahead, behind = found.residuals(alpha + step).force, found.residuals(alpha - step).force
    np.testing.assert_allclose(found.residuals(alpha).balance, (ahead - behind) / (2 * step), atol=2e-4)


@pytest.mark.parametrize("name", ["lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma"])
def test_a_wrong_multiplier_is_seen(name: str) -> None:
    state, multipliers = ladder()[400]
    wrong = replace(multipliers, **{name: getattr(multipliers, name) + 0.1})
    alpha = between(state.band)
    residuals = Equilibrium(state, wrong).residuals(alpha)
    assert max(np.abs(residuals.force).max(), np.abs(residuals.moment).max()) > 0.05


# --- the seam ---


@pytest.mark.parametrize("node", [1, 20, 49])
def test_moving_the_seam_keeps_energy_and_equilibrium(node: int) -> None:
    state, multipliers = ladder()[50]
    moved, forces = moved_seam(state, multipliers, node)
    problem = Problem(state.band)
    assert problem.energy(moved.vector()) == pytest.approx(problem.energy(state.vector()), rel=1e-14)
    assert np.abs(problem.constraints(moved.vector())).max() < 1e-13
    assert kkt(moved, forces) < 1e-12
    back, again = moved_seam(moved, forces, 50 - node)
    np.testing.assert_array_equal(back.u, state.u)
    np.testing.assert_array_equal(back.g, -state.g)  # once around a one-sided band
    np.testing.assert_array_equal(again.lambda_5, -multipliers.lambda_5)


def far_seam(n: int) -> tuple[State, Multipliers]:
    state, multipliers = ladder()[n]
    node = int(np.argmax(distance(state, nodes(state.band))))
    return moved_seam(state, multipliers, node)


@pytest.mark.parametrize(("key", "least"), [("moment", 4.5), ("force", 3.9), ("ruling", 4.5)])
def test_matching_conditions_hold_as_far_as_one_sided_limits_go(key: str, least: float) -> None:
    """(1.64), and (1.65), (1.66) as corrected: the mismatch falls at the order of the extrapolation."""
    found = [float(np.abs(getattr(seam_conditions(*far_seam(n)), key)).max()) for n in (100, 200, 400)]
    assert found[-1] < 1e-6
    assert (orders(found) > least).all()


def test_what_is_constant_is_minus_gamma() -> None:
    for end in ("start", "finish"):
        found = [float(np.abs(getattr(seam_conditions(*far_seam(n)), end)).max()) for n in (100, 200, 400)]
        assert found[-1] < 3e-5
        assert (orders(found) > 1.9).all()


def test_without_sigma_the_condition_of_the_rulings_fails() -> None:
    conditions = seam_conditions(*far_seam(400))
    assert np.abs(conditions.ruling).max() < 1e-8
    assert np.abs(conditions.ruling_unsigned).max() > 1.0


def test_conditions_of_a_state_that_is_no_equilibrium_are_seen() -> None:
    """A multiplier that jumps at the seam alone."""
    state, multipliers = far_seam(400)
    jump = np.linspace(0.0, 1.0, 400)
    moved = replace(multipliers, lambda_4=multipliers.lambda_4 + jump)
    assert np.abs(seam_conditions(state, moved).ruling).max() > 0.9
    moved = replace(multipliers, lambda_1=multipliers.lambda_1 + jump)
    assert np.abs(seam_conditions(state, moved).force).max() > 0.9


def test_orientable_bands_have_no_sign() -> None:
    state = random_strip(Band(60, 0.05), 3)
    conditions = seam_conditions(state, Multipliers.zeros(state.band))
    np.testing.assert_array_equal(conditions.ruling, conditions.ruling_unsigned)
