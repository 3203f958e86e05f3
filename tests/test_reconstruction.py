"""The continuous surface of section 2.2: what it interpolates, (2.38)-(2.41), its energies, their orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numeric_support import Array, ladder, random_strip, ring, rotation

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.energy import coth_factor
from ribbon_cli.model.folding import Folding, close, to_state
from ribbon_cli.model.geometry import geometry
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.reconstruction import Reconstruction
from ribbon_cli.model.splines import BandSpline
from ribbon_cli.model.staggered import distance_to, facets, far_half, inflections, nodes


def orders(values: list[float]) -> Array:
    return np.log2(np.divide(values[:-1], values[1:]))


def between(band: Band) -> Array:
    return band.h / 8 * (np.arange(8 * band.segments) + 0.5)


@pytest.mark.parametrize("sign", [1, -1])
def test_splines_follow_smooth_fields_at_fourth_order(sign: int) -> None:
    """Value, slope and curvature at orders 4, 3 or more, 2; beyond the ends by the sign."""
    wave = 1.0 if sign > 0 else 0.5
    errors: list[list[float]] = [[], [], []]
    for n in (40, 80):
        band = Band(n, 0.1, sigma=-1)
        for offset in (0.0, 0.5):
            spline = BandSpline(band, np.sin(wave * band.h * (np.arange(n) + offset)), offset, sign)
            alpha = np.linspace(-8.0, 15.0, 777)
            exact = np.sin(wave * alpha), wave * np.cos(wave * alpha), -(wave**2) * np.sin(wave * alpha)
            if offset:
                for k in range(3):
                    errors[k].append(float(np.abs(spline(alpha, k) - exact[k]).max()))
            else:
                np.testing.assert_allclose(spline(alpha), exact[0], atol=1e-5)
    assert orders(errors[0])[0] == pytest.approx(4.0, abs=0.1)
    assert orders(errors[1])[0] > 2.9
    assert orders(errors[2])[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("n", [50, 200])
def test_it_passes_through_the_discrete_state(n: int) -> None:
    """(2.32), (2.33), and the seam: d' comes back to itself, g and xi with sigma."""
    state, _ = ladder()[n]
    shape = Reconstruction(state)
    band = state.band
    np.testing.assert_allclose(shape.tangent(facets(band)), state.u, atol=1e-14)
    np.testing.assert_allclose(shape.ruling(nodes(band)), state.g, atol=1e-14)
    np.testing.assert_allclose(shape.xi(facets(band)), state.xi, atol=1e-13)
    ends = np.array([0.0, band.length])
    for field, sign in ((shape.tangent, 1), (shape.ruling, -1), (shape.xi, -1)):
        for derivative in range(3):
            start, end = field(ends, derivative)
            np.testing.assert_allclose(end, sign * start, atol=1e-8)


def test_it_closes() -> None:
    """(2.42): a periodic spline on even knots has the mean of its values, so that closure is exact."""
    for n in (50, 400):
        assert np.abs(Reconstruction(ladder()[n][0]).closure()).max() < 1e-13


@pytest.mark.parametrize("key", ["ruling", "fold", "flat", "slope"])
def test_constraints_of_the_continuum_hold_at_second_order(key: str) -> None:
    """(2.38)-(2.41) at their own places and between, inflection included; (2.38) even at fourth order."""
    places = {"ruling": nodes, "fold": nodes, "flat": facets, "slope": facets}
    expected = 4.0 if key == "ruling" else 2.0
    for where in (places[key], between):
        found = []
        for n in (100, 200, 400):
            state, _ = ladder()[n]
            residuals = Reconstruction(state).constraints(where(state.band))
            found.append(float(np.abs(getattr(residuals, key)).max()))
        assert found[-1] < 2e-4
        np.testing.assert_allclose(orders(found)[-1], expected, atol=0.1)


def test_tangents_have_unit_length_on_facets_and_at_fourth_order_between() -> None:
    found = []
    for n in (100, 200, 400):
        state, _ = ladder()[n]
        shape = Reconstruction(state)
        assert np.abs(shape.constraints(facets(state.band)).tangent).max() < 1e-13
        found.append(float(np.abs(shape.constraints(between(state.band)).tangent).max()))
    assert found[-1] < 5e-8
    np.testing.assert_allclose(orders(found), 4.0, atol=0.15)


def test_the_energy_of_the_surface_is_the_discrete_one_at_second_order() -> None:
    """(2.46)."""
    found = []
    for n in (50, 100, 200, 400):
        state, _ = ladder()[n]
        found.append(Reconstruction(state).energy() - Problem(state.band).energy(state.vector()))
    assert 0 < found[-1] < 4e-4
    np.testing.assert_allclose(orders(found), 2.0, atol=0.12)


def test_the_ring_in_closed_form() -> None:
    """Both energies of the reconstructed ring are pi b at fourth order, its constraints rounding."""
    for energy in (Reconstruction.energy, surface_energy):
        found = [abs(energy(Reconstruction(ring(n, 0.3))) - 0.3 * np.pi) for n in (25, 50)]
        assert found[-1] < 2e-6
        assert orders(found)[0] == pytest.approx(4.0, abs=0.05)
    residuals = Reconstruction(ring(60, 0.3)).constraints(np.linspace(0.0, 2 * np.pi, 101))
    for name in ("ruling", "fold", "flat", "slope"):
        assert np.abs(getattr(residuals, name)).max() < 1e-13


def surface_energy(shape: Reconstruction) -> float:
    alpha, weight = shape.quadrature()
    return float(weight @ shape.surface_density(alpha))


def smooth_strip(n: int) -> State:
    """A closed orientable band without inflections and with rulings that turn, the same for every n."""
    band = Band(n, 0.3)
    alpha = nodes(band)
    kappa, eta = 1.0 + 0.3 * np.cos(2 * alpha), 0.2 * np.sin(2 * alpha)
    fold = close(Folding(kappa * band.h * np.sqrt(1 + eta**2), eta), 1)
    return to_state(band, fold, rotation(4))


def test_h_squared_over_the_surface_is_the_reduced_energy() -> None:
    """(1.40) against (1.48): by fundamental forms of the surface, without xi or developability."""
    found = []
    for n in (40, 80, 160):
        shape = Reconstruction(smooth_strip(n))
        found.append(abs(surface_energy(shape) - shape.energy()))
    assert found[-1] < 1e-4
    np.testing.assert_allclose(orders(found), 2.0, atol=0.2)


def test_at_an_inflection_the_surface_itself_is_not_that_of_the_limit() -> None:
    """Its H^2 da agrees with (1.57)'s density at second order at fixed distances, and grows next to it."""
    far, near = [], []
    for n in (100, 200, 400):
        state, _ = ladder()[n]
        shape = Reconstruction(state)
        alpha, weight = shape.quadrature()
        excess = weight * (shape.surface_density(alpha) - shape.density(alpha))
        distance = distance_to(
            state.band, inflections(geometry(state).kappa_s, state.band.length, state.band.sigma), alpha
        )
        far.append(abs(float(excess[far_half(distance)].sum())))
        near.append(float(excess[distance < 2 * state.band.h].sum()))
        assert abs(excess[distance >= 2 * state.band.h].sum()) < 0.01
    np.testing.assert_allclose(orders(far), 2.0, atol=0.05)
    assert 0.1 < near[0] < near[1] < near[2]


def test_no_density_where_rulings_meet_within_the_band() -> None:
    state = smooth_strip(40)
    wide = replace(state, band=state.band.with_half_width(3.0))
    density = Reconstruction(wide).surface_density(facets(wide.band))
    assert np.isnan(density).any()
    assert np.isfinite(density).any()


def test_energies_do_not_depend_on_orientation_or_label() -> None:
    state = random_strip(Band(60, 0.05, sigma=-1), 5)
    q = rotation(6)
    turned = State(state.band, state.u @ q.T, state.g @ q.T, state.xi)
    flipped = State(state.band, state.u, -state.g, -state.xi)
    expected = Reconstruction(state)
    for other in (turned, flipped):
        shape = Reconstruction(other)
        assert shape.energy() == pytest.approx(expected.energy(), rel=1e-12)
        assert surface_energy(shape) == pytest.approx(surface_energy(expected), rel=1e-10)


def test_density_is_1_60() -> None:
    state, _ = ladder()[50]
    shape = Reconstruction(state)
    alpha = np.array([0.1, 1.0, 3.0])
    bend = np.sum(shape.tangent(alpha, 1) ** 2, axis=1)
    size2 = np.sum(shape.ruling(alpha) ** 2, axis=1)
    expected = 0.25 * bend * size2**2 * coth_factor(shape.xi(alpha))[0]
    np.testing.assert_allclose(shape.density(alpha), expected, rtol=1e-14)
