"""(1.70)-(1.78) on discrete bands: closed forms, orders away from inflections, invariances, failures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numeric_support import Array, ladder, named_multipliers, random_strip, ring, rotation

from ribbon_cli.model.band import Band, Multipliers, State
from ribbon_cli.model.equilibrium import moved_seam
from ribbon_cli.model.folding import Folding, to_state
from ribbon_cli.model.geometry import geometry
from ribbon_cli.model.multiplier_theory import fields_of, multiplier_curves, theoretical_multipliers
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.staggered import distance_to, facets, far_half, inflections, nodes
from ribbon_cli.solver.newton import solve

FIELDS = [f"lambda_{k}" for k in range(1, 6)]


def orders(values: list[float]) -> Array:
    return np.log2(np.divide(values[:-1], values[1:]))


def test_the_ring_in_closed_form() -> None:
    """kappa = 1, eta = xi = 0: lambda_1 = b/2, lambda_2 = b, the others zero; discretely at order 2."""
    found = []
    for n in (50, 100, 200):
        state = ring(n, 0.3)
        theory = theoretical_multipliers(state)
        np.testing.assert_allclose(theory.lambda_1, 0.15, atol=1e-12)
        np.testing.assert_allclose(theory.lambda_2, 0.3, atol=1e-12)
        for name in ("lambda_3", "lambda_4", "lambda_5", "gamma"):
            np.testing.assert_allclose(getattr(theory, name), 0.0, atol=1e-12)
        result = solve(Problem(state.band), state.vector())
        assert result.certified
        curves = multiplier_curves(state, named_multipliers(result))
        found.append(max(float(np.abs(curve.computed - curve.theory).max()) for curve in curves))
    assert found[-1] < 3e-5
    np.testing.assert_allclose(orders(found), 2.0, atol=0.01)


@pytest.mark.parametrize("name", FIELDS)
def test_formulas_agree_at_second_order_away_from_inflections(name: str) -> None:
    found = []
    for n in (100, 200, 400):
        curve = multiplier_curves(*ladder()[n])[FIELDS.index(name)]
        assert curve.name == name
        found.append(float(np.abs(curve.computed - curve.theory)[curve.far].max()))
    assert found[-1] < 5e-4
    np.testing.assert_allclose(orders(found), 2.0, atol=0.12)


def test_gamma_follows_from_the_shape_alone() -> None:
    found = []
    for n in (50, 100, 200, 400):
        state, multipliers = ladder()[n]
        found.append(float(np.linalg.norm(theoretical_multipliers(state).gamma - multipliers.gamma)))
    assert found[-1] < 2e-4
    np.testing.assert_allclose(orders(found), 2.0, atol=0.06)


def test_lambda_3_as_stored_is_of_first_order() -> None:
    found = []
    for n in (100, 200, 400):
        state, multipliers = ladder()[n]
        curve = multiplier_curves(state, multipliers)[2]
        found.append(float(np.abs(multipliers.lambda_3 - curve.theory)[curve.far].max()))
    np.testing.assert_allclose(orders(found), 1.0, atol=0.1)


def test_what_fails_at_an_inflection_and_how() -> None:
    """At a fixed distance second order; next to it lambda_5 is wrong by as much on every grid."""
    beside, fixed = [], []
    for n in (200, 400):
        curve = multiplier_curves(*ladder()[n])[4]
        difference = np.abs(curve.computed - curve.theory)
        beside.append(float(difference.max()))
        assert curve.distance[np.argmax(difference)] < 2 * 2 * np.pi / n
        fixed.append(float(difference[curve.distance >= 2 * np.pi / 10].max()))
    assert beside[0] == pytest.approx(beside[1], rel=0.1)
    assert beside[1] > 0.4
    np.testing.assert_allclose(orders(fixed), 2.0, atol=0.2)


def test_a_given_gamma_enters_lambda_1_alone() -> None:
    state, multipliers = ladder()[100]
    free = theoretical_multipliers(state)
    given = theoretical_multipliers(state, multipliers.gamma)
    np.testing.assert_array_equal(given.gamma, multipliers.gamma)
    change = 0.5 * state.u @ (free.gamma - given.gamma)
    np.testing.assert_allclose(
        given.lambda_1 - free.lambda_1, change, atol=1e-12 * np.abs(free.lambda_1).max()
    )
    for name in FIELDS[1:]:
        np.testing.assert_array_equal(getattr(given, name), getattr(free, name))


def test_the_discrete_multipliers_are_untouched_but_lambda_3() -> None:
    state, multipliers = ladder()[50]
    field = fields_of(state, multipliers)
    shift = state.band.h * multipliers.lambda_2 * geometry(state).eta
    np.testing.assert_allclose(multipliers.lambda_3 - field.lambda_3, shift, atol=1e-15)
    for name in ("lambda_1", "lambda_2", "lambda_4", "lambda_5", "gamma"):
        np.testing.assert_array_equal(getattr(field, name), getattr(multipliers, name))


def assert_same(found: Multipliers, expected: Multipliers, far: dict[str, Array]) -> None:
    """Compare where nothing is divided by a curvature near zero."""
    for name in FIELDS:
        a, c = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(a[far[name]], c[far[name]], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found.gamma, expected.gamma, rtol=1e-7, atol=1e-9)


def far_of(state: State) -> dict[str, Array]:
    turns = inflections(geometry(state).kappa_s, state.band.length, state.band.sigma)
    places = dict.fromkeys(FIELDS, facets(state.band)) | dict.fromkeys(FIELDS[1:3], nodes(state.band))
    return {name: far_half(distance_to(state.band, turns, alpha)) for name, alpha in places.items()}


def test_rigid_rotations_turn_gamma() -> None:
    state, _ = ladder()[50]
    q = rotation(3)
    turned = replace(state, u=state.u @ q.T, g=state.g @ q.T)
    expected = theoretical_multipliers(state)
    expected = replace(expected, gamma=q @ expected.gamma)
    assert_same(theoretical_multipliers(turned), expected, far_of(state))


@pytest.mark.parametrize("node", [1, 17, 49])
def test_the_seam_is_a_label(node: int) -> None:
    state, _ = ladder()[50]
    moved, expected = moved_seam(state, theoretical_multipliers(state), node)
    assert_same(theoretical_multipliers(moved), expected, far_of(moved))


def test_units() -> None:
    """lambda_1, lambda_2, lambda_5 and gamma are in 1/length, lambda_3 and lambda_4 are numbers."""
    state, _ = ladder()[50]
    band = state.band
    larger = replace(state, band=replace(band, length=3 * band.length, half_width=3 * band.half_width))
    plain, found = theoretical_multipliers(state), theoretical_multipliers(larger)
    in_units = {name: 3.0 if name in ("lambda_1", "lambda_2", "lambda_5") else 1.0 for name in FIELDS}
    scaled = {name: getattr(found, name) * factor for name, factor in in_units.items()}
    assert_same(replace(found, gamma=3.0 * found.gamma, **scaled), plain, far_of(state))


def test_a_node_without_curvature_gives_no_number_and_no_exception() -> None:
    band = Band(24, 0.1)
    theta = np.full(24, 2 * np.pi / 24)
    theta[5] = 0.0
    state = to_state(band, Folding(theta, np.zeros(24)), np.eye(3))
    state.u[5] = state.u[4]  # where there is no fold they are one, but for rounding
    theory = theoretical_multipliers(state)
    assert np.isfinite(theory.gamma).all()
    np.testing.assert_array_equal(theoretical_multipliers(state, np.zeros(3)).gamma, 0.0)
    assert np.isnan(theory.lambda_3[5])
    assert np.isfinite(theory.lambda_2).all()
    assert np.isfinite(theory.lambda_5).all()
    assert np.isnan(theory.lambda_4).sum() == 2


def test_a_state_that_went_wrong_gives_large_numbers_and_no_exception() -> None:
    state = ring(24, 0.3)
    wrong = replace(state, xi=np.full(24, 1000.0))
    assert np.abs(theoretical_multipliers(wrong).lambda_5).min() > 1e200


# --- inflections ---


def test_inflections_of_known_curvatures() -> None:
    orientable, one_sided = Band(40, 0.1), Band(40, 0.1, sigma=-1)
    alpha = nodes(orientable)
    np.testing.assert_allclose(
        inflections(np.sin(alpha - 1.0), orientable.length, orientable.sigma), [1.0, 1.0 + np.pi], atol=5e-4
    )
    np.testing.assert_allclose(
        inflections(np.sin(0.5 * (alpha - 1.0)), one_sided.length, one_sided.sigma), [1.0], atol=5e-4
    )
    assert inflections(np.cos(alpha) + 2.0, orientable.length, orientable.sigma).size == 0
    # Across a one-sided seam, a curvature of one sign changes it.
    np.testing.assert_allclose(
        inflections(np.ones(40), one_sided.length, one_sided.sigma), [39.5 * one_sided.h]
    )
    assert inflections(np.zeros(40), orientable.length, orientable.sigma).size == 0


def test_an_inflection_on_a_node_is_found_once() -> None:
    band = Band(40, 0.1)
    for noise in (0.0, 1e-17, -1e-17):
        curvature = np.sin(nodes(band))
        curvature[[0, 20]] = noise
        np.testing.assert_allclose(inflections(curvature, band.length, band.sigma), [0.0, np.pi], atol=1e-12)


def test_distance_is_measured_around_the_band() -> None:
    band = Band(40, 0.1)
    alpha = np.array([0.0, 1.0, 6.0])
    np.testing.assert_allclose(
        distance_to(band, np.array([6.1]), alpha), [2 * np.pi - 6.1, 2 * np.pi - 5.1, 0.1]
    )
    assert np.isinf(distance_to(band, np.empty(0), alpha)).all()


def test_the_far_half_is_half() -> None:
    state = random_strip(Band(40, 0.1, sigma=-1), 2)
    far = far_of(state)["lambda_1"]
    assert 20 <= far.sum() <= 21
