"""States known in closed form: ring, elastica figure-eight, flat folds; with absolute errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numeric_support import E3, ring
from scipy.optimize import brentq
from scipy.special import ellipe, ellipj, ellipk

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.solver.newton import Options, Result, solve
from ribbon_cli.solver.status import Status
from ribbon_cli.solver.steps import inverted_facets


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("segments", [5, 24, 51, 200])
def test_the_ring_is_a_certified_minimum(segments: int, rule: Discretisation) -> None:
    state = ring(segments, 0.4, rule)
    x = state.vector()
    x[3:6] += [1e-3, -2e-3, 1e-3]
    found = solve(Problem(state.band), x)
    assert (found.status, found.negative) == (Status.MINIMUM, 0)
    h = math.tau / segments
    assert found.energy == pytest.approx(0.4 * segments / h * (1.0 - math.cos(h)), rel=1e-12)
    assert max(found.kkt_residual, found.constraint_residual) < 1e-10


# The closed planar elastica without turning, Euler's figure-eight: theta(s) the tangent's angle,
# sin(theta/2) = k sn(w s), curvature 2 k w cn(w s), one period 4 K / w = l. Closure is
# 0 = int cos theta = int (1 - 2 k^2 sn^2), that is 2 E(k) = K(k). With int_0^K cn^2 = (E - (1-k^2) K) / k^2,
#   int kappa^2 ds = 16 w (E - (1 - k^2) K) = 64 K^2 (k^2 - 1/2) / l,
# and a band with parallel rulings (xi = 0, eta = 0) has the energy b/2 of it.
MODULUS2 = float(brentq(lambda m: 2.0 * ellipe(m) - ellipk(m), 0.5, 0.95, xtol=1e-15))
QUARTER = float(ellipk(MODULUS2))
BENDING = 64.0 * QUARTER**2 * (MODULUS2 - 0.5)
"""l int kappa^2 ds of the figure-eight; a circle has 4 pi^2."""


def figure_eight(band: Band) -> State:
    """The continuum's tangents at the middles of the facets, rulings normal to the plane."""
    n = band.segments
    sn = ellipj((np.arange(n) + 0.5) * 4.0 * QUARTER / n, MODULUS2)[0]
    angle = 2.0 * np.arcsin(math.sqrt(MODULUS2) * sn)
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(n)))
    return State(band, u, np.tile(E3, (n, 1)), np.zeros(n))


def solved_figure_eight(segments: int, half_width: float, length: float = math.tau) -> Result:
    state = figure_eight(Band(segments, half_width, length))
    return solve(Problem(state.band), state.vector(), options=Options(leave_saddles=0))


def test_the_figure_eight_closes_and_has_this_curvature() -> None:
    """By the trapezoidal rule over one period, which is exact here to roundoff; l = 4 K."""
    sn, cn = ellipj(4.0 * QUARTER * np.arange(64) / 64, MODULUS2)[:2]
    assert abs(np.mean(1.0 - 2.0 * MODULUS2 * sn**2)) < 1e-13
    assert (4.0 * QUARTER) ** 2 * np.mean(4.0 * MODULUS2 * cn**2) == pytest.approx(BENDING, rel=1e-13)
    assert BENDING / (4.0 * math.pi**2) == pytest.approx(2.848128586818, rel=1e-12)  # circles: 1


@pytest.mark.parametrize("half_width", [0.1, 1.0])
@pytest.mark.parametrize("segments", [18, 22, 26])
def test_the_figure_eight_is_a_certified_minimum(segments: int, half_width: float) -> None:
    found = solved_figure_eight(segments, half_width)
    assert (found.status, found.negative) == (Status.MINIMUM, 0)
    assert found.steps <= 4
    assert max(np.abs(found.state.u[:, 2]).max(), np.abs(found.state.g[:, :2]).max()) < 1e-12  # planar
    assert np.abs(found.state.xi).max() < 1e-12
    assert found.kkt_residual < 1e-10


def test_a_coarse_figure_eight_is_a_saddle() -> None:
    found = solved_figure_eight(12, 0.5)
    assert (found.status, found.negative) == (Status.SADDLE, 1)


def test_energy_of_the_figure_eight_is_of_second_order() -> None:
    b, length = 0.3, 5.0
    exact = 0.5 * b * BENDING / length
    sizes = np.array([18, 22, 26, 34])
    energies = np.array([solved_figure_eight(int(n), b, length).energy for n in sizes])
    errors = exact - energies
    assert -np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.01)
    assert errors[-1] < 0.02 * exact
    extrapolated = energies[-1] + (energies[-1] - energies[-2]) * 26**2 / (34**2 - 26**2)
    assert extrapolated == pytest.approx(exact, rel=5e-5)


def test_the_figure_eight_on_a_fine_grid_is_stationary() -> None:
    """Its sliding mode falls below roundoff (faster than any power of h): no certificate, but no error."""
    found = solved_figure_eight(160, 0.1)
    assert found.status in (Status.UNDECIDED, Status.MINIMUM, Status.SADDLE)
    assert max(found.kkt_residual, found.constraint_residual) < 1e-10
    assert found.energy == pytest.approx(0.05 * BENDING / math.tau, rel=1e-3)


def test_a_strip_folded_flat_and_back() -> None:
    """Two folds by pi: q = 2 at each, Q_h = 4 b / h."""
    band = Band(16, 0.3)
    u = np.outer(np.repeat([1.0, -1.0], 8), [1.0, 0.0, 0.0])
    state = State(band, u, np.tile(E3, (16, 1)), np.zeros(16))
    problem = Problem(band)
    x = state.vector()
    assert not problem.constraints(x).any()
    assert problem.energy(x) == pytest.approx(4.0 * 0.3 / band.h, rel=1e-15)


def flat_triangle(band: Band) -> State:
    """The Moebius band folded flat to a triangle: three folds by pi at 60 degrees, eta = +-1/sqrt(3).

    Between folds eta runs linearly from one sign to the other: tanh xi = +-2 sqrt(3) b / l.
    """
    n, side = band.segments, band.segments // 3
    angle = np.repeat(math.tau * np.arange(3) / 3.0, side)
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(n)))
    across = np.column_stack((-np.sin(angle), np.cos(angle), np.zeros(n)))
    # The side of the strip that faces up changes at each fold, and with it the sign of eta.
    turn = np.repeat([1.0, -1.0, 1.0], side)
    eta = -turn * (1.0 - 2.0 * (np.arange(n) % side) / side) / math.sqrt(3.0)
    xi = turn * math.atanh(2.0 * math.sqrt(3.0) * band.half_width / band.length)
    return State(band, u, eta[:, None] * u + turn[:, None] * across, xi)


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("segments", [3, 12, 60])
@pytest.mark.parametrize("half_width", [0.2, 1.5])
def test_the_flat_folded_moebius_band(segments: int, rule: Discretisation, half_width: float) -> None:
    """Q_h = 8 b / h: each fold has (b/h) (1 + eta^2) (1 - cos pi), times F(0) or F(xi) by the rule."""
    band = Band(segments, half_width, sigma=-1, discretisation=rule)
    state = flat_triangle(band)
    problem, x = Problem(band), state.vector()
    assert np.abs(problem.constraints(x)).max() < 1e-13
    assert (inverted_facets(problem, x) > 0.0).all()
    xi = abs(float(state.xi[0]))
    factor = 1.0 if rule is Discretisation.THESIS else xi / math.tanh(xi)
    assert problem.energy(x) == pytest.approx(8.0 * half_width / band.h * factor, rel=1e-12)


def test_the_flat_folded_moebius_band_needs_its_seam_signs() -> None:
    """Without xi_0 = sigma xi_N the average at the seam's fold would not vanish."""
    state = flat_triangle(Band(12, 1.5, sigma=-1))
    right, wrong = Problem(state.band), Problem(Band(12, 1.5, sigma=1))
    assert np.abs(wrong.constraints(state.vector())).max() > 0.1
    assert wrong.energy(state.vector()) > right.energy(state.vector()) * 1.05
