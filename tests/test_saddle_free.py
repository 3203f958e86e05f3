"""The sparse saddle-free step against the dense reference, and the inertia against dense eigenvalues."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from dense_reference import LARGEST, DenseModel, dense_direction
from numeric_support import E3, Array, assemble, load, ring, twist_prescription, with_rule

from ribbon_cli.model.band import Band, Discretisation
from ribbon_cli.model.problem import Prescription, Problem
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.kkt import FactorisationError
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.saddle_free import direction, negative_eigenpairs, shift_below

Place = tuple[Problem, Array, Array]


def problem_of(name: str) -> Place:
    """A problem with a point near which to look: kept solutions, rings, twists and held rulings."""
    kind, _, size = name.partition(" ")
    if kind.startswith("pi"):
        state, multipliers = load(kind)
        if size:
            state = with_rule(state, Discretisation(size))
        return Problem(state.band), state.vector(), multipliers.vector()
    n = int(size)
    state = ring(n, 0.3, Discretisation.VALUE_AVERAGE if n % 3 else Discretisation.THESIS)
    problem = {
        "ring": Problem(state.band),
        "twist": Problem(replace(state.band, sigma=-1), twist_prescription(1.0)),
        "held": Problem(state.band, Prescription({0: E3, n // 2: E3})),
        "tilted": Problem(state.band, Prescription({0: E3, n // 3: np.array([0.0, 0.6, 0.8])})),
    }[kind]
    return problem, problem.impose(state.vector()), np.zeros(problem.rows)


@dataclass(frozen=True)
class Case:
    """A seeded disturbance of a point, and the number of negative eigenvalues found there."""

    name: str
    amplitude: float
    seed: int
    negative: int

    def place(self) -> Place:
        problem, x, y = problem_of(self.name)
        rng = np.random.default_rng(self.seed)
        x = problem.impose(x + min(self.amplitude, 0.3) * rng.standard_normal(problem.size))
        return problem, x, y + self.amplitude * rng.standard_normal(problem.rows)


CASES = [
    Case("pi-b0.1-N50", 0.01, 0, 0),
    Case("pi-b0.5-N50", 0.003, 0, 0),
    Case("pi-b0.5-N50 value-average", 0.01, 0, 0),
    Case("ring 8", 0.03, 0, 0),
    Case("ring 33", 0.03, 0, 0),
    Case("ring 99", 0.03, 0, 0),
    Case("twist 23", 0.01, 1, 0),
    Case("held 64", 0.03, 0, 0),
    Case("pi-b0.1-N50", 0.03, 0, 1),
    Case("pi-b0.1-N50-saddle", 0.003, 0, 1),
    Case("pi-b0.1-N50-saddle", 0.01, 1, 1),
    Case("pi-b0.5-N50 value-average", 0.03, 1, 1),
    Case("ring 11", 0.3, 1, 1),
    Case("ring 100", 0.3, 0, 1),
    Case("twist 23", 0.3, 0, 1),
    Case("held 16", 0.3, 0, 1),
    Case("ring 8", 1.0, 0, 3),
    Case("ring 16", 0.3, 0, 3),
    Case("ring 99", 0.3, 0, 3),
    Case("twist 11", 1.0, 1, 3),
    Case("twist 64", 1.0, 0, 3),
    Case("held 8", 3.0, 1, 3),
    Case("held 64", 1.0, 0, 3),
    Case("pi-b0.1-N50", 3.0, 1, 29),
    Case("pi-b0.1-N50 value-average", 3.0, 1, 28),
    Case("ring 40", 6.0, 0, 25),
    Case("ring 81", 6.0, 0, 25),
    Case("ring 99", 6.0, 0, 28),
    Case("twist 57", 6.0, 0, 25),
    Case("held 57", 6.0, 1, 30),
]


def relative(found: Array, true: Array) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


@pytest.mark.parametrize("case", CASES)
def test_sparse_step_is_the_dense_step(case: Case) -> None:
    """Step, multipliers and negative eigenvalues; the count by three independent ways."""
    problem, x, y = case.place()
    local, rotations, matrix = assemble(problem, x, y)
    step, multipliers, values = dense_direction(problem, local, rotations)
    assert int((values < 0).sum()) == inertia(matrix).negative == case.negative
    found = direction(problem, local, y, Factor(matrix))
    assert found.index == case.negative
    np.testing.assert_allclose(found.negative, values[: case.negative], rtol=1e-8)
    assert relative(found.step, step) < 1e-8
    assert relative(found.multipliers, multipliers) < 1e-8


@pytest.mark.parametrize("case", [c for c in CASES if c.negative])
def test_negative_eigenvectors_satisfy_their_equations(case: Case) -> None:
    """W v = mu v + A^T nu (+ gauge forces), A v = 0, v orthonormal and without rotations."""
    problem, x, y = case.place()
    local, rotations, matrix = assemble(problem, x, y)
    found = direction(problem, local, y, Factor(matrix))
    v = found.vectors
    excess = problem.hessian_matrix(local) @ v - v * found.negative
    model = DenseModel(problem, local, rotations)
    scale = np.abs(excess).max() + np.abs(found.negative).max()
    assert np.abs(model.basis.T @ excess).max() < 1e-8 * scale
    np.testing.assert_allclose(v.T @ v, np.eye(case.negative), atol=1e-8)
    assert np.abs(model.normals @ v).max() < 1e-8


def test_lanczos_returns_the_multipliers_of_eigenvectors() -> None:
    """nu solves W v = mu v + A^T nu where no gauge force is needed, at a stationary point."""
    problem, x, y = problem_of("pi-b0.1-N50-saddle")
    local, _, matrix = assemble(problem, x, y)
    values, vectors, nu = negative_eigenpairs(problem, shift_below(matrix, 1), 1)
    assert values[0] == pytest.approx(-0.0204, abs=5e-5)
    rest = problem.hessian_matrix(local) @ vectors - values * vectors - problem.jacobian_matrix(local).T @ nu
    assert np.abs(rest).max() < 1e-8


@pytest.mark.parametrize("kind", ["ring", "twist", "held", "tilted"])
@pytest.mark.parametrize("segments", [8, 9, 12, 17, 31, 50, 64, 99, 100])
def test_inertia_counts_dense_eigenvalues(segments: int, kind: str) -> None:
    """At even and odd N, with rulings held at even and odd nodes, over a wide range of counts."""
    for seed, amplitude in enumerate((0.01, 0.1, 1.0) if segments < 60 else (0.3,)):
        problem, x, y = Case(f"{kind} {segments}", amplitude, seed, -1).place()
        local, rotations, matrix = assemble(problem, x, y)
        values = dense_direction(problem, local, rotations)[2]
        found = inertia(matrix)
        assert found.negative == int((values < 0).sum())
        assert found.trusted


@pytest.mark.parametrize("name", ["pi-b0.1-N50-saddle", "ring 33", "twist 20", "held 40"])
def test_shifted_inertia_counts_eigenvalues_below_the_shift(name: str) -> None:
    problem, x, y = problem_of(name)
    local, rotations, matrix = assemble(problem, x, y)
    values = dense_direction(problem, local, rotations)[2]
    middles = 0.5 * (values[1:] + values[:-1])
    gaps = np.diff(values)
    for k in np.flatnonzero(gaps > 1e-6 * values[-1])[::7]:
        assert inertia(matrix, float(middles[k])).negative == k + 1
    assert inertia(matrix, float(values[0]) - 1.0).negative == 0
    assert inertia(matrix, float(values[-1]) + 1.0).negative == values.size


def test_dense_model_changes_only_the_projected_block() -> None:
    problem, x, y = Case("pi-b0.1-N50", 0.1, 0, -1).place()
    local, rotations, _ = assemble(problem, x, y)
    model = DenseModel(problem, local, rotations)
    assert (model.values < 0).any()
    changed, k = model.modified_hessian(), model.basis
    np.testing.assert_allclose(
        np.sort(np.abs(model.values)), np.linalg.eigvalsh(k.T @ changed @ k), rtol=1e-7, atol=1e-9
    )
    difference = changed - model.hessian
    scale = np.abs(model.hessian).max()
    assert np.abs(difference @ model.range).max() < 1e-12 * scale
    assert np.abs(model.range.T @ difference).max() < 1e-12 * scale
    np.testing.assert_allclose(k.T @ k, np.eye(k.shape[1]), atol=1e-13)
    assert np.abs(model.normals @ k).max() < 1e-13


def test_the_step_descends_the_energy_on_the_constraints() -> None:
    """At a feasible point the saddle-free step is one of descent, where Newton's may ascend."""
    problem, x, y = problem_of("pi-b0.1-N50-saddle")
    local, _, matrix = assemble(problem, x, y)
    found = direction(problem, local, y, Factor(matrix))
    moved = x + 1e-3 * found.vectors[:, 0]
    local = problem.local_derivatives(moved, y)
    matrix = assemble(problem, moved, y)[2]
    found = direction(problem, local, y, Factor(matrix))
    model = DenseModel(problem, local, problem.rotations(moved))
    tangential = model.basis @ (model.basis.T @ found.step)
    newton = model.basis @ (model.basis.T @ found.newton_step)
    reduced = local.gradient - problem.jacobian_matrix(local).T @ y
    assert reduced @ tangential < 0.0 < reduced @ newton


def test_dense_algebra_is_refused_for_large_problems() -> None:
    problem, x, y = problem_of(f"ring {LARGEST + 1}")
    local, rotations, _ = assemble(problem, x, y)
    with pytest.raises(ValueError, match=str(LARGEST)):
        dense_direction(problem, local, rotations)


def test_dependent_constraints_are_reported_by_the_reference() -> None:
    """Two neighbouring rulings held parallel: the triple product has no gradient."""
    problem = Problem(Band(10, 0.2), Prescription({0: E3, 1: E3}))
    x = problem.impose(ring(10, 0.2).vector())
    local, rotations, _ = assemble(problem, x, np.zeros(problem.rows))
    with pytest.raises(FactorisationError, match="linearly dependent"):
        dense_direction(problem, local, rotations)
