"""Moves in a strip's own coordinates keep the constraints, and spectra are those of an orthonormal basis."""

from __future__ import annotations

import numpy as np
import pytest
from spectral_support import Place, pi_band, ring_place

from ribbon_cli.model.band import Band, Discretisation
from ribbon_cli.model.metrics import metric_named
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.tangents import Tangents
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.recipes.twist import twist_stage
from ribbon_cli.solver import spectra
from ribbon_cli.solver.inertia import NodeMetric
from ribbon_cli.solver.tangent_basis import FoldedBasis, NormalBasis, tangent_basis

N = 24
EPS = float(np.finfo(float).eps)


@pytest.fixture(scope="module")
def places() -> list[Place]:
    return [pi_band(50, Discretisation.THESIS), ring_place(N, 0.3, Discretisation.VALUE_AVERAGE)]


def test_coordinates_fulfil_all_rows_but_the_closure(places: list[Place]) -> None:
    for place in places:
        tangents = Tangents(place.problem, place.x, place.local)
        n = place.problem.band.segments
        rows = place.problem.jacobian_matrix(place.local).toarray() @ tangents.moves(np.eye(2 * n))
        left = [2, 5 * n - 2, 5 * n - 1, 5 * n, 5 * n + 1, 5 * n + 2]
        assert np.abs(rows[left] - tangents.closure).max() < 1e-13
        assert np.abs(np.delete(rows, left, axis=0)).max() < 1e-12


def test_forms_are_products_with_the_moves(places: list[Place]) -> None:
    """At any point: the last digits of u, g and xi are not those of a band."""
    random = np.random.default_rng(4)
    for place in places:
        x = place.x + 1e-3 * random.standard_normal(place.x.size)
        local = place.problem.local_derivatives(x, np.ones(place.problem.rows))
        tangents = Tangents(place.problem, x, local)
        moves = tangents.moves(np.eye(tangents.size))
        hessian = place.problem.hessian_matrix(local)
        for matrix in (hessian, metric_named("folding").matrix(place.problem.state(x))):
            blocks = NodeMetric(matrix)
            expected = moves.T @ (matrix @ moves)
            found = tangents.congruent(blocks.diagonal, blocks.coupling)
            assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
        forces = random.standard_normal((x.size, 3))
        assert (
            np.abs(tangents.pull(forces) - moves.T @ forces).max() < 1e-12 * np.abs(moves).sum(axis=0).max()
        )


def test_spectra_are_those_of_an_orthonormal_basis(
    places: list[Place], monkeypatch: pytest.MonkeyPatch
) -> None:
    metrics = ("euclidean", "physical", "folding")
    for place in places:
        arguments = place.problem, place.x, place.local, metrics, 6
        assert isinstance(tangent_basis(*arguments[:3]), FoldedBasis)
        folded = spectra.full_spectra(*arguments)
        with monkeypatch.context() as patched:
            patched.setattr(spectra, "tangent_basis", NormalBasis)
            normal = spectra.full_spectra(*arguments)
        for a, b in zip(folded, normal, strict=True):
            room = a.bounds + b.bounds + 1e-14 * np.abs(b.values).max()
            assert (np.abs(a.values - b.values) <= room).all(), a.metric
            assert a.labels == b.labels
            # Not much is lost: some thousand units in the largest eigenvalue's last digit.
            assert a.residuals.max() <= 1e4 * EPS * np.abs(a.values).max()


def test_held_rulings_have_no_such_coordinates() -> None:
    state = cylinder(Band(segments=N, half_width=0.1, sigma=-1))
    problem = Problem(state.band, twist_stage(1, 4, 1).prescription)
    local = problem.local_derivatives(state.vector(), np.zeros(problem.rows))
    with pytest.raises(ValueError, match="closed bands"):
        Tangents(problem, state.vector(), local)
    assert isinstance(tangent_basis(problem, state.vector(), local), NormalBasis)
