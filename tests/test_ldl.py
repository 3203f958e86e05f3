"""qdldl's C functions give the bits of its own objects, and are called where they do alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from numeric_support import load

from ribbon_cli.model.problem import Problem
from ribbon_cli.solver import ldl
from ribbon_cli.solver.kkt import KKTMatrix
from ribbon_cli.solver.linear import Factor


def _matrix(shift: float = 0.0) -> scipy.sparse.csc_matrix:
    return _kkt().regularised(shift, 1e-8)


def _kkt() -> KKTMatrix:
    state, multipliers = load("pi-b0.5-N50")
    problem, x = Problem(state.band), state.vector()
    local = problem.local_derivatives(x, multipliers.vector())
    return KKTMatrix(problem, local, problem.rotations(x))


def _both() -> tuple[ldl.Functions, ldl.Objects]:
    objects = ldl.Objects(_matrix())
    symbolic = ldl.Symbolic(_matrix(), objects.solver.factors())
    assert symbolic.known
    return ldl.Functions(symbolic), objects


def test_both_ways_have_the_same_bits() -> None:
    functions, objects = _both()
    rhs = np.cos(np.arange(_matrix().shape[0]))
    for shift in (0.0, -0.3, 0.2):
        for way in (functions, objects):
            way.update(_matrix(shift))
        below, pivots, _ = objects.solver.factors()
        np.testing.assert_array_equal(functions.values, below.data)
        np.testing.assert_array_equal(functions.pivots, pivots)
        assert functions.positive() == objects.positive() == int((pivots > 0).sum())
        np.testing.assert_array_equal(functions.solve(rhs), objects.solve(rhs))


def test_both_ways_tell_of_a_zero_pivot() -> None:
    for way in _both():
        way.update(0.0 * _matrix())
        assert way.positive() is None


def test_a_pattern_has_its_symbolic_part_with_its_second_factors() -> None:
    matrix = _kkt()
    matrix.pattern.forget()
    first = Factor(matrix)
    assert isinstance(first._solver, ldl.Objects)
    assert not matrix.pattern.symbolic
    del first
    second, third = Factor(matrix), Factor(matrix)
    assert isinstance(second._solver, ldl.Functions)
    assert isinstance(third._solver, ldl.Functions)
    assert len(matrix.pattern.symbolic) == 1


def test_functions_that_give_other_factors_are_not_called(monkeypatch: pytest.MonkeyPatch) -> None:
    update = ldl.Functions.update

    def off(self: ldl.Functions, upper: scipy.sparse.csc_matrix) -> None:
        update(self, upper)
        self.pivots[-1] = np.nextafter(self.pivots[-1], 0.0)

    monkeypatch.setattr(ldl.Functions, "update", off)
    matrix = _kkt()
    matrix.pattern.forget()
    for _ in range(3):
        assert isinstance(Factor(matrix)._solver, ldl.Objects)
    assert not matrix.pattern.symbolic[0].known
    matrix.pattern.forget()


def test_other_versions_are_not_called(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ldl, "version", lambda _: "0.2.0")
    ldl._library.cache_clear()
    try:
        assert ldl._library() is None
    finally:
        ldl._library.cache_clear()
