"""Prolongation: isometric starts, the phase of the grid, Table 3.1's states at b = 0.5."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numeric_support import Array, load, random_strip, ring
from scipy.sparse.linalg import splu

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.folding import ClosureError
from ribbon_cli.model.problem import Problem
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.prolongation import (
    Phase,
    Start,
    closed_spline,
    grid_shift,
    inflections,
    inflections_of,
    phase_of,
    smooth,
    split,
)
from ribbon_cli.solver.status import Result, Status
from ribbon_cli.solver.steps import inverted_facets

E50, E100, E200, E400 = 5.135473172, 5.147912223884, 5.150751044, 5.15143268
"""Energies of the pi band's minima at b = 0.5; their differences are Table 3.1's 0.0124391, ..."""
SADDLE_400 = 5.151432747


def solve_start(start: Start) -> Result:
    problem = Problem(start.state.band)
    return solve(problem, start.state.vector())


@pytest.fixture(scope="module")
def levels() -> dict[int, Result]:
    """Minima of N = 100, 200, 400, each prolonged from the one before."""
    state, _ = load("pi-b0.5-N50")
    found = {}
    with np.errstate(all="raise", under="ignore"):
        for n in (100, 200, 400):
            found[n] = solve_start(smooth(state, n))
            state = found[n].state
    return found


@pytest.mark.parametrize("phase", list(Phase))
@pytest.mark.parametrize("segments", [50, 77, 100, 400])
@pytest.mark.parametrize("name", ["pi-b0.1-N50", "pi-b0.5-N50"])
def test_smooth_starts_are_isometric(name: str, segments: int, phase: Phase) -> None:
    state, _ = load(name)
    start = smooth(state, segments, phase)
    problem = Problem(start.state.band)
    assert np.abs(problem.constraints(start.state.vector())).max() < 1e-10
    assert (inverted_facets(problem, start.state.vector()) > 0).all()
    assert start.state.band == state.band.with_segments(segments)


def test_levels_reach_the_table(levels: dict[int, Result]) -> None:
    """At most 12 Newton steps a level, to a certified minimum; differences as in Table 3.1."""
    for n, result in levels.items():
        assert (result.status, result.negative) == (Status.MINIMUM, 0), n
        assert result.steps <= 12, n
        assert not result.saddles, n
    assert levels[100].energy == pytest.approx(E100, abs=5e-10)
    assert levels[400].energy == pytest.approx(E400, abs=5e-9)
    energies = [E50, *(levels[n].energy for n in (100, 200, 400))]
    assert np.diff(energies) == pytest.approx([0.0124391, 0.00283882, 0.00068164], abs=5e-8)


def test_order_of_convergence(levels: dict[int, Result]) -> None:
    deltas = np.diff([E50, *(levels[n].energy for n in (100, 200, 400))])
    orders = np.log2(deltas[:-1] / deltas[1:])
    assert orders == pytest.approx([2.13, 2.06], abs=0.01)


def test_minima_have_their_inflection_in_the_middle_of_a_facet(levels: dict[int, Result]) -> None:
    for n, result in levels.items():
        roots = inflections_of(result.state) / result.state.band.h
        assert roots.size == 1, n
        assert float(roots[0] % 1.0) == pytest.approx(0.5, abs=0.02), n
        assert phase_of(result.state) is Phase.FACET


@pytest.fixture(scope="module")
def saddle(levels: dict[int, Result]) -> tuple[Problem, Array, Array]:
    """The twin of the minimum at N = 400 with its inflection on a node, by plain Newton steps."""
    fine = levels[400]
    with np.errstate(all="raise", under="ignore"):
        start = smooth(fine.state, 400, Phase.NODE)
        problem = Problem(start.state.band)
        x, y = start.state.vector(), fine.multipliers
        for _ in range(6):
            local = problem.local_derivatives(x, y)
            matrix = KKTMatrix(problem, local, problem.rotations(x))
            upper = matrix.upper.tocsr()
            full = (upper + upper.T).tolil()
            full.setdiag(matrix.upper.diagonal())
            rhs = np.concatenate((-local.gradient, -local.constraints, np.zeros(3)))
            z = matrix.scale * splu(full.tocsc()).solve(matrix.scale * rhs)
            x, y = x + z[: problem.size], -z[problem.size : problem.size + problem.rows]
    return problem, x, y


@pytest.mark.long
def test_the_twin_on_a_node_is_a_saddle(saddle: tuple[Problem, Array, Array]) -> None:
    """Stationary to 1e-9 with one negative direction: what trusting residuals alone would return."""
    problem, x, y = saddle
    found = solve(problem, x, y, Options(leave_saddles=0))
    assert (found.status, found.negative) == (Status.SADDLE, 1)
    assert phase_of(found.state) is Phase.NODE
    assert found.energy == pytest.approx(SADDLE_400, abs=1e-9)
    assert max(found.kkt_residual, found.constraint_residual) < 1e-9


def test_from_the_saddle_to_the_minimum(saddle: tuple[Problem, Array, Array]) -> None:
    problem, x, y = saddle
    found = solve(problem, x, y)
    assert (found.status, found.negative) == (Status.MINIMUM, 0)
    assert found.energy == pytest.approx(E400, abs=5e-9)
    assert found.saddles
    assert found.saddles[0].index == 1
    assert found.saddles[0].energy == pytest.approx(SADDLE_400, abs=1e-9)


def test_a_ring_is_prolonged_to_a_ring() -> None:
    coarse = ring(12, 0.3)
    fine = smooth(coarse, 31)
    exact = ring(31, 0.3)
    problem = Problem(exact.band)
    assert problem.energy(fine.state.vector()) == pytest.approx(problem.energy(exact.vector()), rel=1e-12)
    assert fine.method.startswith("smooth prolongation")


def test_prolongation_places_the_fine_band_over_the_coarse_one() -> None:
    state, _ = load("pi-b0.5-N50")
    fine = smooth(state, 200).state
    near = np.repeat(state.u, 4, axis=0)
    distances = np.linalg.norm(fine.u - near, axis=1)
    assert float(distances.max()) < 0.4  # two facets' turn of the tangent
    assert float(np.mean(np.sum(fine.g * np.repeat(state.g, 4, axis=0), axis=1) > 0)) > 0.99


@pytest.mark.parametrize("sign", [1, -1])
def test_closed_splines_have_their_parity(sign: int) -> None:
    values = np.random.default_rng(0).standard_normal(9)
    spline = closed_spline(values, 3.0, 0.1, sign)
    nodes = 0.1 + 3.0 * np.arange(9) / 9
    np.testing.assert_allclose(spline(nodes), values, atol=1e-13)
    s = np.linspace(0.1, 3.1, 50)
    period = 3.0 if sign > 0 else 6.0
    np.testing.assert_allclose(spline((s + 3.0 - 0.1) % period + 0.1), sign * spline(s), atol=1e-12)


def test_inflections_of_known_curvatures() -> None:
    band = Band(60, 0.1, length=2.0)
    s = band.h * np.arange(60)
    two = inflections(np.cos(math.pi * (s - 0.3)), band)
    np.testing.assert_allclose(two, [0.8, 1.8], atol=1e-5)
    assert inflections(1.1 + np.cos(math.pi * s), band).size == 0
    one = inflections(np.cos(0.5 * math.pi * (s - 0.3)), Band(60, 0.1, length=2.0, sigma=-1))
    np.testing.assert_allclose(one, [1.3], atol=1e-5)


@pytest.mark.parametrize("phase", list(Phase))
@pytest.mark.parametrize("first", [0.0, 0.013, 0.049, 0.0999])
def test_grid_shift_puts_inflections_in_phase(first: float, phase: Phase) -> None:
    h = 0.1
    roots = np.array([first, first + 20 * h])
    shift = grid_shift(roots, h, phase)
    assert abs(shift) <= h / 2 + 1e-15
    offset = ((roots[0] - shift) / h - (0.5 if phase is Phase.FACET else 0.0)) % 1.0
    assert min(offset, 1.0 - offset) < 1e-12
    assert grid_shift(np.empty(0), h, phase) == 0.0


def test_split_keeps_tangents_and_averages_rulings() -> None:
    """Koldaev (2022), 3.1: the midline keeps its shape; only |g| and the folds of new nodes are off."""
    state, _ = load("pi-b0.5-N50")
    start = split(state)
    fine = start.state
    assert fine.band.segments == 100
    np.testing.assert_array_equal(fine.u[::2], state.u)
    np.testing.assert_array_equal(fine.u[1::2], state.u)
    np.testing.assert_array_equal(fine.g[::2], state.g)
    np.testing.assert_allclose(fine.g[-1], 0.5 * (state.g[-1] - state.g[0]), atol=1e-15)
    values = np.abs(Problem(fine.band).constraints(fine.vector()))[:-3].reshape(-1, 5)
    assert values[:, [0, 2, 3, 4]].max() < 1e-9


def test_split_reaches_the_same_minimum(levels: dict[int, Result]) -> None:
    state, _ = load("pi-b0.5-N50")
    found = solve_start(split(state))
    assert found.status is Status.MINIMUM
    assert found.energy == pytest.approx(levels[100].energy, abs=5e-10)


def test_a_random_strip_survives_there_and_back() -> None:
    state = random_strip(Band(40, 0.1), 3)
    fine = smooth(state, 160)
    back = smooth(fine.state, 40)
    problem = Problem(state.band)
    assert np.abs(problem.constraints(back.state.vector())).max() < 1e-10
    assert problem.energy(back.state.vector()) == pytest.approx(problem.energy(state.vector()), rel=2e-2)


def test_rulings_that_nearly_meet_are_kept_apart() -> None:
    """A strip almost as wide as its rulings allow: splines through eta would overshoot."""
    state, _ = load("pi-b0.5-N50")
    limit = 0.5 / float(np.abs(np.tanh(state.xi)).max())
    wide = Band(50, 0.9999999 * limit, sigma=-1)
    edge = State(wide, state.u, state.g, np.arctanh(np.tanh(state.xi) * wide.half_width / 0.5))
    start = smooth(edge, 200)
    assert np.abs(Problem(start.state.band).constraints(start.state.vector())).max() < 1e-10


def test_a_strip_whose_rulings_meet_is_reported() -> None:
    state, _ = load("pi-b0.5-N50")
    wide = State(Band(50, 3.0, sigma=-1), state.u, state.g, state.xi)
    with pytest.raises(ClosureError):
        smooth(wide, 100)
