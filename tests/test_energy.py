"""The energy: x coth x and its derivatives to full precision, and energies known in closed form."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from numeric_support import ring

from ribbon_cli.model.band import Band, Discretisation
from ribbon_cli.model.energy import SERIES_BELOW, coth_factor, energy_derivatives, energy_terms
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.stencil import G1, SIZE, U0, X0, G, U, X

EPS = float(np.finfo(float).eps)


def exact(x: float) -> tuple[float, float, float]:
    """F, F', F'' of x coth x in 80 digits from the exponential form."""
    with localcontext() as context:
        context.prec = 80
        d = Decimal(x)
        e = (2 * d).exp()
        coth, sinh2 = (e + 1) / (e - 1), (e - 1) ** 2 / (4 * e)
        return float(d * coth), float(coth - d / sinh2), float(2 * (d * coth - 1) / sinh2)


POINTS = [
    1e-7,
    1e-4,
    0.01,
    0.1,
    0.3,
    0.49,
    0.4999999,
    0.5,
    0.5000001,
    0.51,
    0.7,
    1.0,
    2.0,
    5.0,
    17.0,
    40.0,
    300.0,
]


@pytest.mark.parametrize("x", POINTS + [-p for p in POINTS])
def test_coth_factor_to_full_precision(x: float) -> None:
    found = [float(v) for v in coth_factor(np.array(x))]
    for value, true in zip(found, exact(x), strict=True):
        assert abs(value - true) <= 40 * EPS * max(abs(true), 1e-250)


def test_coth_factor_at_zero_and_its_parity() -> None:
    assert [float(v) for v in coth_factor(np.zeros(()))] == [1.0, 0.0, float(Fraction(2, 3))]
    x = np.linspace(0.0, 3.0, 31)
    plus, minus = coth_factor(x), coth_factor(-x)
    for value, mirrored, sign in zip(plus, minus, (1, -1, 1), strict=True):
        np.testing.assert_array_equal(value, sign * mirrored)


def test_series_and_closed_form_agree_where_they_meet() -> None:
    below, above = np.nextafter(SERIES_BELOW, 0.0), SERIES_BELOW
    for a, b in zip(coth_factor(np.array([below])), coth_factor(np.array([above])), strict=True):
        assert a[0] == pytest.approx(b[0], rel=30 * EPS)


def test_coth_factor_does_not_overflow() -> None:
    x = np.array([350.0, 351.0, 710.0, 1e5, 1e200, -1e200])
    f, f1, f2 = coth_factor(x)
    np.testing.assert_allclose(f, np.abs(x), rtol=4 * EPS)
    np.testing.assert_allclose(f1, np.sign(x), rtol=4 * EPS)
    assert (np.abs(f2) < 1e-290).all()


def test_coth_factor_mixes_small_and_large_in_any_shape() -> None:
    x = np.array([[0.1, 3.0], [1e4, -0.2]])
    whole = coth_factor(x)
    for k, value in enumerate(whole):
        assert value.shape == (2, 2)
        for index in np.ndindex(2, 2):
            assert value[index] == coth_factor(x[index])[k]


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("segments", [3, 10, 57, 400])
def test_energy_of_the_regular_polygon(segments: int, rule: Discretisation) -> None:
    state = ring(segments, 0.3, rule)
    h = math.tau / segments
    expected = 0.3 / h * segments * (1.0 - math.cos(h))
    assert Problem(state.band).energy(state.vector()) == pytest.approx(expected, rel=1e-13)


def test_energy_of_the_ring_is_of_second_order() -> None:
    """Q_h = pi b (1 - h^2/12 + ...) at l = 2 pi."""
    b, sizes = 0.3, np.array([20, 40, 80, 160])
    errors = []
    for n in sizes:
        state = ring(int(n), b)
        errors.append(math.pi * b - Problem(state.band).energy(state.vector()))
    slope = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.01)
    assert errors[-1] == pytest.approx(math.pi * b * (math.tau / 160) ** 2 / 12, rel=1e-3)


@pytest.mark.parametrize(
    ("rule", "factor"), [(Discretisation.THESIS, 1.0), (Discretisation.VALUE_AVERAGE, None)]
)
def test_the_rules_see_a_checkerboard_of_xi_differently(rule: Discretisation, factor: float | None) -> None:
    """xi = (-1)^i a is averaged away inside F, but F(a) stays where values are averaged."""
    state = ring(12, 0.3, rule)
    x = state.vector()
    base = Problem(state.band).energy(x)
    x[6::7] = 0.8 * (-1.0) ** np.arange(12)
    expected = factor if factor is not None else 0.8 / math.tanh(0.8)
    assert Problem(state.band).energy(x) / base == pytest.approx(expected, rel=1e-13)


def test_one_fold_of_an_oblique_strip() -> None:
    """A fold by theta at eta costs (b/h) (1 + eta^2) (1 - cos theta) F."""
    theta, eta, xi = 0.7, -1.3, 0.9
    band = Band(5, 0.4)
    axis = np.array([eta, 0.0, 1.0]) / math.hypot(eta, 1.0)
    before = np.array([1.0, 0.0, 0.0])
    after = (
        math.cos(theta) * before
        + math.sin(theta) * np.cross(axis, before)
        + (1.0 - math.cos(theta)) * (axis @ before) * axis
    )
    local = np.zeros((SIZE, 1))
    local[U0, 0], local[U, 0], local[G, 0] = before, after, np.array([eta, 0.0, 1.0])
    local[[X0, X], 0] = xi
    expected = band.half_width / band.h * (1.0 + eta**2) * (1.0 - math.cos(theta)) * xi / math.tanh(xi)
    assert energy_terms(band, local)[0] == pytest.approx(expected, rel=1e-14)
    terms, gradient = energy_derivatives(band, local)
    assert terms[0] == pytest.approx(expected, rel=1e-14)
    assert not gradient[G1].any()


def test_energy_is_never_negative_off_the_constraints() -> None:
    """1 - u_i . u_{i-1} would be: solvers would run away along it."""
    rng = np.random.default_rng(0)
    problem = Problem(Band(20, 0.3, sigma=-1))
    assert min(problem.energy(5.0 * rng.standard_normal(problem.size)) for _ in range(50)) > 0.0


@pytest.mark.parametrize(
    ("argument", "value", "word"),
    [
        ("segments", 2, "3 segments"),
        ("half_width", 0.0, "half-width"),
        ("half_width", math.inf, "half-width"),
        ("length", -1.0, "length"),
        ("sigma", 0, "sigma"),
    ],
)
def test_bands_out_of_range_are_refused(argument: str, value: float, word: str) -> None:
    good: dict[str, float] = {"segments": 10, "half_width": 0.1, "length": 1.0, "sigma": 1}
    with pytest.raises(ValueError, match=word):
        Band(**{**good, argument: value})
