"""Spectra of bands that rest on themselves, against dense algebra: modes keep constraints and gaps."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import scipy
from resting_support import resting

from ribbon_cli.model.metrics import metric_named
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_kkt import kkt_matrix
from ribbon_cli.solver.spectra import full_spectra, lowest_spectra

PI, THREE = "pi-b1.65-N100", "3pi-b0.9-N120"
METRICS = ("euclidean", "physical")
CASES = ((PI, None), (THREE, None), (THREE, 4))
"""Bands, and the contact whose row is left out."""


@lru_cache
def _at_rest(name, without):
    """A band at rest, its derivatives, with all rows or without one of them."""
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    keep = np.arange(len(forces)) != (-1 if without is None else without)
    problem = RestingProblem(state.band, pairs.take(keep))
    return problem, result.x, problem.local_derivatives(result.x, np.concatenate((own, forces[keep])))


@lru_cache
def _full(name, without):
    return full_spectra(*_at_rest(name, without), METRICS, 12)


@pytest.mark.parametrize(("name", "without"), CASES)
def test_full_spectra_are_those_of_dense_algebra(name, without):
    problem, x, local = _at_rest(name, without)
    rows = np.vstack((problem.jacobian_matrix(local).toarray(), problem.rotations(x).T))
    basis = scipy.linalg.null_space(rows)
    hessian = problem.hessian_matrix(local)
    for metric, found in zip(METRICS, _full(name, without), strict=True):
        mass = metric_named(metric).matrix(problem.state(x))
        known = scipy.linalg.eigvalsh(basis.T @ (hessian @ basis), basis.T @ (mass @ basis))
        values = found.values[[label != "rotation" for label in found.labels]]
        assert len(values) == 2 * problem.band.segments - 6 - len(problem.pairs)
        assert values[:40] == pytest.approx(known[:40], rel=1e-6, abs=1e-9)
        counted = inertia(kkt_matrix(problem, local, problem.rotations(x)))
        assert counted.trusted
        assert (values < 0).sum() == counted.negative == (0 if without is None else 1)
        moves = found.vectors.reshape(len(found.vectors), -1)
        assert np.abs(problem.jacobian_matrix(local) @ moves.T).max() < 1e-9 * np.abs(moves).max()


@pytest.mark.parametrize(("name", "without"), CASES)
def test_lowest_modes_are_those_of_full_spectra(name, without):
    lowest = lowest_spectra(*_at_rest(name, without), METRICS, 12)
    for few, every in zip(lowest, _full(name, without), strict=True):
        assert few.values == pytest.approx(every.values[: len(few.values)], rel=1e-7, abs=1e-10)
        assert few.labels == every.labels[: len(few.labels)]
        assert (few.bounds[3:] < 1e-6).all()
