"""What must not change energy, constraints, multipliers' meaning and spectrum of a band."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dense_reference import dense_direction
from numeric_support import Array, assemble, load, random_strip, rotation, with_rule

from ribbon_cli.model.band import Band, Discretisation, Multipliers, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.newton import estimate_multipliers, solve
from ribbon_cli.solver.status import Status

Move = Callable[[State], State]


def rotated(state: State) -> State:
    q = rotation(11)
    return State(state.band, state.u @ q.T, state.g @ q.T, state.xi)


def mirrored(state: State) -> State:
    q = -rotation(12)
    return State(state.band, state.u @ q.T, state.g @ q.T, state.xi)


def other_side(state: State) -> State:
    """Naming the other side of the strip up: g and xi change sign."""
    return State(state.band, state.u, -state.g, -state.xi)


def relabelled(state: State) -> State:
    """Counting from the 8th node: what passes the seam takes sigma along."""
    shift, sigma = 7, state.band.sigma
    g, xi = np.roll(state.g, -shift, axis=0), np.roll(state.xi, -shift)
    g[-shift:] *= sigma
    xi[-shift:] *= sigma
    return State(state.band, np.roll(state.u, -shift, axis=0), g, xi)


def reversed_(state: State) -> State:
    """Running through the band the other way: node j is the old node N - j, node 0 the seam."""
    g = np.roll(state.g[::-1], 1, axis=0)
    g[0] *= state.band.sigma
    return State(state.band, -state.u[::-1], g, state.xi[::-1].copy())


def rescaled(state: State) -> State:
    """All lengths times 3: energies and constraints are free of dimension."""
    band = state.band
    return replace(state, band=replace(band, length=3.0 * band.length, half_width=3.0 * band.half_width))


MOVES: dict[str, Move] = {
    "rotation": rotated,
    "mirror image": mirrored,
    "other side": other_side,
    "relabelling": relabelled,
    "reversal": reversed_,
    "scaling": rescaled,
    "all": lambda s: rescaled(reversed_(relabelled(other_side(mirrored(s))))),
}


REVERSING = ("reversal", "all")


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("sigma", [1, -1])
def test_energy_and_constraints_off_the_constraints(sigma: int, rule: Discretisation, move: str) -> None:
    """For any (u, g, xi) at all: the energy and the sizes of all constraints are the same.

    But for reversal, which takes |g_i|^2 = (g_i.u_i)^2 + 1 to u_{i-1}: the same only where the
    fold condition holds.
    """
    band = Band(19, 0.4, sigma=sigma, discretisation=rule)
    state = State.from_vector(band, np.random.default_rng(3).standard_normal(7 * 19))
    moved = MOVES[move](state)
    before, after = Problem(band), Problem(moved.band)
    x, y = state.vector(), moved.vector()
    assert after.energy(y) == pytest.approx(before.energy(x), rel=1e-12)
    old, new = np.abs(before.constraints(x)), np.abs(after.constraints(y))
    for k in [0, 2, 3, 4] if move in REVERSING else range(5):
        np.testing.assert_allclose(np.sort(new[k:-3:5]), np.sort(old[k:-3:5]), atol=1e-11)
    assert np.linalg.norm(new[-3:]) == pytest.approx(np.linalg.norm(old[-3:]), rel=1e-12)


@pytest.mark.parametrize("move", [m for m in MOVES if m != "scaling"])
def test_relabelled_constraints_sit_where_they_should(move: str) -> None:
    """lambda_2 and lambda_3 belong to nodes, the others to facets: reversal shifts them differently."""
    band = Band(19, 0.4, sigma=-1)
    state = State.from_vector(band, np.random.default_rng(3).standard_normal(7 * 19))
    old = np.abs(Problem(band).constraints(state.vector()))[:-3].reshape(19, 5)
    moved = MOVES[move](state)
    new = np.abs(Problem(moved.band).constraints(moved.vector()))[:-3].reshape(19, 5)
    node = np.arange(19)
    if move in ("relabelling", "all"):
        node = np.roll(node, -7)
    facet = node
    if move in REVERSING:
        node, facet = np.roll(node[::-1], 1), facet[::-1]
    at_nodes = [2] if move in REVERSING else [1, 2]
    np.testing.assert_allclose(new[:, at_nodes], old[node][:, at_nodes], atol=1e-11)
    np.testing.assert_allclose(new[:, [0, 3, 4]], old[facet][:, [0, 3, 4]], atol=1e-11)


def spectrum(state: State) -> tuple[Array, int]:
    """Eigenvalues of the projected Hessian with least-squares multipliers, and the inertia's count."""
    problem, x = Problem(state.band), state.vector()
    local, rotations, matrix = assemble(problem, x, estimate_multipliers(problem, x))
    return dense_direction(problem, local, rotations)[2], inertia(matrix).negative


@cache
def solved(name: str, rule: Discretisation) -> State:
    state = with_rule(load(name)[0], rule)
    found = solve(Problem(state.band), state.vector())
    assert found.certified
    return found.state


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("name", ["pi-b0.1-N50", "pi-b0.5-N50"])
@pytest.mark.parametrize("rule", list(Discretisation))
def test_spectrum_and_inertia_of_solutions(rule: Discretisation, name: str, move: str) -> None:
    state = solved(name, rule)
    moved = MOVES[move](state)
    assert np.abs(Problem(moved.band).constraints(moved.vector())).max() < 1e-10
    before, after = spectrum(state), spectrum(moved)
    assert before[1] == after[1] == 0
    np.testing.assert_allclose(after[0], before[0], rtol=1e-5, atol=1e-9 * before[0][-1])


@pytest.mark.parametrize("move", MOVES)
def test_solving_commutes_with_moves(move: str) -> None:
    """A solve from a moved start ends at the moved solution."""
    start = random_strip(Band(25, 0.2), 1)
    moved = MOVES[move](start)
    plain = solve(Problem(start.band), start.vector())
    other = solve(Problem(moved.band), moved.vector())
    assert plain.status is other.status is Status.MINIMUM
    assert other.energy == pytest.approx(plain.energy, abs=1e-9)


def test_multipliers_of_a_rotated_band() -> None:
    state, multipliers = load("pi-b0.5-N50")
    turned = rotated(state)
    problem = Problem(state.band)
    moved = replace(multipliers, gamma=rotation(11) @ multipliers.gamma)
    local = problem.local_derivatives(turned.vector(), moved.vector())
    assert np.abs(problem.lagrangian_gradient(local, moved.vector())).max() < 1e-10


def test_multipliers_of_a_mirrored_band() -> None:
    """A reflection turns the triple product's sign: lambda_4 changes sign and gamma is reflected."""
    state, multipliers = load("pi-b0.5-N50")
    image = mirrored(state)
    problem = Problem(state.band)
    moved = replace(multipliers, lambda_4=-multipliers.lambda_4, gamma=-rotation(12) @ multipliers.gamma)
    local = problem.local_derivatives(image.vector(), moved.vector())
    assert np.abs(problem.lagrangian_gradient(local, moved.vector())).max() < 1e-10


@pytest.mark.parametrize("factor", [0.1, 7.0])
def test_multipliers_of_a_rescaled_band(factor: float) -> None:
    """h lambda h^0 c has the energy's dimension: lambda_1, lambda_2, lambda_5, gamma scale like 1/l."""
    state, m = load("pi-b0.5-N50")
    band = replace(state.band, length=factor * state.band.length, half_width=factor * state.band.half_width)
    problem = Problem(band)
    scaled = Multipliers(
        m.lambda_1 / factor,
        m.lambda_2 / factor,
        m.lambda_3,
        m.lambda_4,
        m.lambda_5 / factor,
        m.gamma / factor,
    ).vector()
    local = problem.local_derivatives(state.vector(), scaled)
    assert np.abs(problem.lagrangian_gradient(local, scaled)).max() < 1e-10
