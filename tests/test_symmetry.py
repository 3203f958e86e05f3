"""Symmetries of states: found, named, and with residuals; and their action on moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numeric_support import Array, random_strip, ring, rotation
from spectral_support import RULES, Place, pi_band, ring_place
from test_closed_forms import figure_eight, flat_triangle, solved_figure_eight

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.point_group import element_name, group_name
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.symmetry import Symmetry, SymmetryGroup, find_symmetries
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.prolongation import Phase
from ribbon_cli.solver.saddle_free import null_space

VALUE_AVERAGE = Discretisation.VALUE_AVERAGE


def turned(state: State, q: Array) -> State:
    return replace(state, u=state.u @ q.T, g=state.g @ q.T)


def names(group: SymmetryGroup) -> list[str]:
    return sorted(s.name for s in group.exact)


@pytest.mark.parametrize("sigma", [1, -1])
def test_a_random_strip_has_none(sigma: int) -> None:
    group = find_symmetries(random_strip(Band(50, 0.1, sigma=sigma), 3))
    assert (group.name, group.order, group.near) == ("C1", 1, ())
    assert group.exact[0].is_identity


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("phase", list(Phase))
def test_the_pi_band_has_a_half_turn(rule: Discretisation, phase: Phase) -> None:
    """Its axis meets the band in the inflection, on a node or in the middle of a facet."""
    group = find_symmetries(pi_band(100, rule, phase).result.state)
    assert (group.name, group.near_name, group.order) == ("C2", "C2", 2)
    assert group.residual < 1e-9
    half_turn = group.exact[1]
    assert half_turn.reverse
    assert round(half_turn.shift) % 2 == (phase is Phase.FACET)


@pytest.mark.parametrize("segments", [7, 12, 101])
def test_a_ring_has_every_symmetry_of_its_grid(segments: int) -> None:
    group = find_symmetries(ring(segments, 0.3))
    assert (group.name, group.order) == (f"D{segments}h", 4 * segments)
    assert group.residual < 1e-12


def test_a_flat_folded_band_is_a_triangle() -> None:
    assert find_symmetries(flat_triangle(Band(12, 0.2, sigma=-1))).name == "D3h"


def test_a_figure_eight_and_the_grid_that_breaks_it() -> None:
    assert find_symmetries(solved_figure_eight(26, 0.3).state).name == "D2h"
    # Three steps converge. What is left of the next one is sliding, which has no stiffness there, and would
    # take the state off its symmetries.
    start = figure_eight(Band(27, 0.3))
    options = Options(leave_saddles=0, max_steps=3)
    odd = find_symmetries(solve(Problem(start.band), start.vector(), options=options).state)
    assert (odd.name, odd.order, odd.near_name) == ("C2v", 4, "D2h")
    assert 1e-6 < (odd.near_residual or 0.0) < 1e-3
    assert {s.shift % 1.0 for s in odd.near} == {0.5}


@pytest.mark.parametrize("seed", [1, 2])
def test_names_do_not_depend_on_place_or_seam(seed: int) -> None:
    state = pi_band(50, VALUE_AVERAGE).result.state
    q = rotation(seed)
    for found in (turned(state, q), turned(state, -q), relabelled(state, 17 * seed)):
        group = find_symmetries(found)
        assert (group.name, group.order) == ("C2", 2)
        assert group.residual < 1e-9


def relabelled(state: State, shift: int) -> State:
    moved = Symmetry("E", np.eye(3), float(shift), False, False, 0.0, True)
    y = moved.relabelled(state.vector().reshape(-1, 7), state.band.sigma)
    return State.from_vector(state.band, y.ravel())


def all_states() -> list[State]:
    return [
        pi_band(50, VALUE_AVERAGE).result.state,
        ring(9, 0.3),
        flat_triangle(Band(12, 0.2, sigma=-1)),
        solved_figure_eight(26, 0.3).state,
    ]


@pytest.mark.parametrize("state", all_states(), ids=["pi", "ring", "triangle", "eight"])
def test_symmetries_leave_the_state_alone(state: State) -> None:
    y = state.vector().reshape(-1, 7)
    for symmetry in find_symmetries(state).exact:
        assert symmetry.apply(y, state.band.sigma) == pytest.approx(y, abs=1e-6)


@pytest.mark.parametrize(
    "place",
    [
        pi_band(50, VALUE_AVERAGE),
        pi_band(50, Discretisation.THESIS, Phase.NODE),
        ring_place(9, 0.3, VALUE_AVERAGE),
    ],
    ids=["pi", "pi saddle", "ring"],
)
def test_symmetries_commute_with_the_projected_hessian(place: Place) -> None:
    """They map moves that keep the constraints onto such, with the same second variation."""
    problem, local = place.problem, place.local
    basis = null_space(problem, local, problem.rotations(place.x))
    hessian, jacobian = problem.hessian_matrix(local), problem.jacobian_matrix(local)
    v = basis @ np.random.default_rng(5).standard_normal((basis.shape[1], 3))
    form = v.T @ (hessian @ v)
    for symmetry in find_symmetries(place.result.state).exact:
        image = symmetry.apply(v.reshape(-1, 7, 3), problem.band.sigma).reshape(v.shape)
        assert np.abs(jacobian @ image).max() < 1e-7
        assert image.T @ (hessian @ image) == pytest.approx(form, rel=1e-8, abs=1e-7 * np.abs(form).max())


@pytest.mark.parametrize("state", all_states(), ids=["pi", "ring", "triangle", "eight"])
def test_symmetries_form_a_group(state: State) -> None:
    matrices = [s.matrix for s in find_symmetries(state).exact]
    for a in matrices:
        assert a @ a.T == pytest.approx(np.eye(3), abs=1e-9)
        for b in matrices:
            assert min(np.abs(a @ b - c).max() for c in matrices) < 1e-6


def test_near_symmetries_do_not_act_on_grids() -> None:
    # Three steps converge. What is left of the next one is sliding, which has no stiffness there, and would
    # take the state off its symmetries.
    start = figure_eight(Band(27, 0.3))
    options = Options(leave_saddles=0, max_steps=3)
    odd = find_symmetries(solve(Problem(start.band), start.vector(), options=options).state)
    with pytest.raises(ValueError, match="does not map the grid"):
        odd.near[0].apply(np.zeros((27, 7)), 1)


# --- names ---


def turn(angle: float, axis: int = 2) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = [k for k in range(3) if k != axis]
    out = np.eye(3)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out


MIRROR = np.diag([1.0, 1.0, -1.0])
STANDING = np.diag([1.0, -1.0, 1.0])


def generated(*matrices: Array) -> list[Array]:
    found = [np.eye(3)]
    while True:
        new = [a @ b for a in found for b in matrices if min(np.abs(a @ b - c).max() for c in found) > 1e-6]
        if not new:
            return found
        found.append(new[0])


@pytest.mark.parametrize(
    ("name", "generators"),
    [
        ("C1", []),
        ("Cs", [MIRROR]),
        ("Ci", [-np.eye(3)]),
        ("C2", [turn(np.pi)]),
        ("C5", [turn(2 * np.pi / 5)]),
        ("C3h", [turn(2 * np.pi / 3), MIRROR]),
        ("C2h", [turn(np.pi), MIRROR]),
        ("C2v", [turn(np.pi), STANDING]),
        ("C4v", [turn(np.pi / 2), STANDING]),
        ("S4", [turn(np.pi / 2) @ MIRROR]),
        ("D2", [turn(np.pi), turn(np.pi, 0)]),
        ("D3", [turn(2 * np.pi / 3), turn(np.pi, 0)]),
        ("D2d", [turn(np.pi / 2) @ MIRROR, turn(np.pi, 0)]),
        ("D3d", [turn(np.pi / 3) @ MIRROR, turn(np.pi, 0)]),
        ("D2h", [turn(np.pi), turn(np.pi, 0), MIRROR]),
        ("D3h", [turn(2 * np.pi / 3), turn(np.pi, 0), MIRROR]),
    ],
)
def test_group_names(name: str, generators: list[Array]) -> None:
    q = rotation(4)
    assert group_name([q @ m @ q.T for m in generated(*generators)]) == name


def test_element_names() -> None:
    q = rotation(7)
    given = {
        "E": np.eye(3),
        "C2": turn(np.pi),
        "C3": turn(2 * np.pi / 3),
        "C100": turn(2 * np.pi / 100),
        "C99": turn(2 * np.pi / 99),
        "sigma": MIRROR,
        "i": -np.eye(3),
        "S4": turn(np.pi / 2) @ MIRROR,
        "S3": turn(2 * np.pi / 3) @ MIRROR,
    }
    assert {name: element_name(q @ m @ q.T) for name, m in given.items()} == {name: name for name in given}
