"""docs/errata.md: the corrected formulas against computed bands; tests/peers/ has the symbolic identities."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numeric_support import Array, ladder, load, ring

from paper.table import agrees_as_printed, thesis_table
from ribbon_cli.model.band import Discretisation, Multipliers, State
from ribbon_cli.model.constraints import sech_squared
from ribbon_cli.model.energy import coth_factor
from ribbon_cli.model.geometry import geometry
from ribbon_cli.model.problem import Problem
from ribbon_cli.solver.continuation import to_segments, to_width
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.prolongation import Phase, phase_of, smooth
from ribbon_cli.solver.saddle_free import null_space
from ribbon_cli.solver.status import Status


def test_factor_two_of_q() -> None:
    """A ring of half-width b has the energy pi b: q as |u_i - u_{i-1}|^2 would give twice as much."""
    state = ring(400, 0.3)
    assert Problem(state.band).energy(state.vector()) == pytest.approx(0.3 * np.pi, rel=1e-4)


def test_null_space_has_n_minus_m_columns() -> None:
    """K of (2.58), rotations left out: 7N - (5N + 3) - 3."""
    state, multipliers = load("pi-b0.5-N50")
    problem = Problem(state.band)
    local = problem.local_derivatives(state.vector(), multipliers.vector())
    assert null_space(problem, local, problem.rotations(state.vector())).shape == (350, 350 - 253 - 3)


def test_xi_changes_sign_across_a_one_sided_seam() -> None:
    """The seam is a label: where it lies changes nothing with xi_0 = sigma xi_N, and much with xi_N."""
    state, _ = load("pi-b0.5-N50")
    energy = Problem(state.band).energy(state.vector())
    wrong = []
    for k in range(50):
        sign = np.where(np.arange(50) < k, -1.0, 1.0)
        u, g, x = (np.roll(v, -k, 0) for v in (state.u, state.g * sign[:, None], state.xi * sign))
        assert Problem(state.band).energy(State(state.band, u, g, x).vector()) == pytest.approx(
            energy, rel=1e-13
        )
        right, other = coth_factor(0.5 * np.array([x[0] - x[-1], x[0] + x[-1]]))[0]
        bend = np.sum((u[0] - u[-1]) ** 2) * np.sum(g[0] ** 2) ** 2
        wrong.append(0.5 * state.band.half_width / state.band.h * bend * abs(right - other))
    assert max(wrong) == pytest.approx(0.0127, abs=1e-4)


def test_checkerboard_is_invisible_to_the_averaged_argument() -> None:
    """3.5: (2.15) does not see xi_i + c (-1)^i; averaging F itself does."""
    change = {}
    for rule in Discretisation:
        state = ring(20, 0.3, rule)
        moved = State(state.band, state.u, state.g, state.xi + 0.1 * (-1.0) ** np.arange(20))
        problem = Problem(state.band)
        change[rule] = problem.energy(moved.vector()) - problem.energy(state.vector())
    assert change[Discretisation.THESIS] == 0.0
    assert change[Discretisation.VALUE_AVERAGE] > 1e-3


def test_symmetry_of_the_pi_band() -> None:
    """3.3.2: kappa_s and eta are odd about the inflection, tau even; half a length on, nothing repeats."""
    state, _ = load("pi-b0.5-N50")
    shape = geometry(state)
    kappa_s, slant = (np.concatenate((-a, a, -a)) for a in (shape.kappa_s, shape.eta))
    torsion = np.tile(shape.tau, 3)
    middle = 99 + np.arange(50), 100 + np.arange(50)  # the inflection lies between nodes 50 and 1
    before, after = 198 - middle[0], middle[1]
    for odd in (kappa_s, slant):
        np.testing.assert_allclose(odd[after], -odd[before], atol=1e-12)
    np.testing.assert_allclose(torsion[after], torsion[before], atol=1e-12)
    at = 50 + np.arange(50)
    assert np.abs(kappa_s[at + 25] + kappa_s[at]).max() == pytest.approx(3.81, abs=0.01)
    assert np.abs(torsion[at + 25] - torsion[at]).max() == pytest.approx(1.65, abs=0.01)
    assert np.abs(shape.kappa_s).max() == pytest.approx(1.94, abs=0.01)


# --- multipliers of computed bands against the corrected formulas ---


@dataclass(frozen=True)
class Errors:
    """Largest deviations of discrete multipliers from the continuum's formulas away from the inflection."""

    lambda_1: float
    lambda_1_printed: float
    lambda_2: float
    lambda_3: float
    lambda_3_shifted: float
    lambda_4: float
    lambda_5: float


def shifted(values: Array, by: int, sign: int) -> Array:
    """Values one place on (by = 1) or back (-1) along the band, with the seam's sign."""
    out = np.roll(values, -by, axis=0)
    out[-1 if by > 0 else 0] *= sign
    return out


def dot(a: Array, c: Array) -> Array:
    return np.einsum("ij,ij->i", a, c)


def errors(state: State, m: Multipliers) -> Errors:
    """(1.70), (1.75)-(1.78) corrected, by central differences; even fields pass the seam with sign 1."""
    half, step, sigma = state.band.half_width, state.band.h, state.band.sigma
    u, g = state.u, state.g
    second = (u - shifted(u, -1, 1)) / step
    mean = 0.5 * (u + shifted(u, -1, 1))
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    shape = geometry(state)
    f, f1, _ = coth_factor(0.5 * (state.xi + shifted(state.xi, -1, sigma)))
    size2, bend = dot(g, g), dot(second, second)
    pull = (2.0 * half * bend * size2 * f)[:, None] * g  # zeta_g
    curvature = dot(second, np.cross(g, mean))
    five = -0.5 * half * bend * size2**2 * f1 / sech_squared(0.5 * (state.xi + shifted(state.xi, -1, sigma)))
    rate = (m.lambda_5 - shifted(m.lambda_5, -1, sigma)) / step
    four = -(half * rate + dot(pull, mean)) / curvature
    two = 0.5 * (dot(pull, g) + half * rate * shape.eta)
    four_rate = (m.lambda_4 - shifted(m.lambda_4, -1, 1)) / step
    three = half * 0.5 * (m.lambda_5 + shifted(m.lambda_5, -1, sigma)) - four_rate / curvature
    symmetric = m.lambda_3 - step * m.lambda_2 * shape.eta
    moment = (half * size2**2 * f)[:, None] * second - symmetric[:, None] * g
    moment_rate = dot((shifted(moment, 1, 1) - moment) / step, u)
    slant = 0.5 * dot(u, g + state.next_rulings())
    others = half * m.lambda_5 * shape.eta_prime + u @ m.gamma
    normal = 2.0 * 0.5 * (m.lambda_2 + shifted(m.lambda_2, 1, 1)) * slant**2
    far = np.abs(shape.kappa_s) > 0.8 * np.abs(shape.kappa_s).max()
    deviations = (
        0.5 * (-moment_rate + normal - others) - m.lambda_1,
        0.5 * (moment_rate - normal - others) - m.lambda_1,
        two - m.lambda_2,
        three - m.lambda_3,
        three - symmetric,
        0.5 * (four + shifted(four, 1, 1)) - m.lambda_4,
        0.5 * (five + shifted(five, 1, sigma)) - m.lambda_5,
    )
    return Errors(*(float(np.abs(d[far]).max()) for d in deviations))


@pytest.mark.parametrize("name", ["lambda_1", "lambda_3_shifted", "lambda_4", "lambda_5"])
def test_multipliers_converge_at_second_order_to_the_corrected_formulas(name: str) -> None:
    found = [getattr(errors(*ladder()[n]), name) for n in (100, 200, 400)]
    assert found[-1] < 5e-4
    orders = np.log2(np.divide(found[:-1], found[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_lambda_2_holds_exactly_and_lambda_3_at_first_order() -> None:
    """(2.48): the constraint g.u_i in place of g.(u_i + u_{i-1})/2 adds h lambda_2 eta to lambda_3."""
    found = [errors(*ladder()[n]) for n in (100, 200, 400)]
    assert max(e.lambda_2 for e in found) < 1e-10
    orders = np.log2([a.lambda_3 / c.lambda_3 for a, c in pairwise(found)])
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


def test_the_printed_lambda_1_is_something_else() -> None:
    assert errors(*ladder()[400]).lambda_1_printed > 1.0


# --- Table 3.1 ---


def test_the_published_entry_at_b_08_is_of_a_saddle() -> None:
    """|E_200 - E_400| rounds to the printed 0.00181386 with the saddle at N = 400, not with the minimum."""
    (printed,) = [r.delta for r in thesis_table() if (r.half_width, r.segments) == (0.8, 200)]
    state, multipliers = load("pi-b0.5-N50")
    result = to_width(state, multipliers.vector(), 0.8, Options()).result
    for n in (100, 200):
        result = to_segments(result.state, n, Options()).result
        assert result.certified
    deltas = {}
    for phase in Phase:
        start = smooth(result.state, 400, phase).state
        end = solve(Problem(start.band), start.vector(), None, Options(leave_saddles=0))
        deltas[end.status] = abs(end.energy - result.energy)
        assert end.negative == (0 if phase is phase_of(result.state) else 1)
    assert not agrees_as_printed(deltas[Status.MINIMUM], printed)
    assert agrees_as_printed(deltas[Status.SADDLE], printed)
