"""What a Newton step costs, in counts: evaluations, factorisations, and what is looked at of them."""

from __future__ import annotations

import numpy as np
import pytest
from numeric_support import load

from ribbon_cli.model import folding
from ribbon_cli.model.energy import REPEATED_UP_TO, coth_factor
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.sparsity import Scatter
from ribbon_cli.solver import ldl
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import _normal_factor, solve
from ribbon_cli.solver.resting_kkt import kkt_matrix


def _counted(monkeypatch: pytest.MonkeyPatch, *methods: tuple[type, str]) -> dict[str, int]:
    """How often methods are called from now on, by name."""
    counts = dict.fromkeys((name for _, name in methods), 0)
    for owner, name in methods:

        def counted(*given: object, name: str = name, call: object = getattr(owner, name)) -> object:
            counts[name] += 1
            return call(*given)  # type: ignore[operator]

        monkeypatch.setattr(owner, name, counted)
    return counts


@pytest.mark.parametrize("known", [True, False], ids=["multipliers known", "estimated"])
def test_a_solve_evaluates_and_factors_once_a_step(known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Besides, the start is evaluated, and the end factored once more, and evaluated a step on. Estimated
    multipliers take a factorisation, and no other evaluation of the start."""
    state, multipliers = load("pi-b0.5-N50")
    problem = Problem(state.band)
    methods = (Problem, "local_derivatives"), (Problem, "lagrangian_gradient"), (Factor, "_factor")
    counts = _counted(monkeypatch, *methods, (Problem, "_hessian_entries"))
    x = state.vector() + 1e-4 * np.sin(np.arange(problem.size))
    result = solve(problem, x, multipliers.vector() if known else None)
    assert result.certified
    assert result.surplus_seen == 0
    steps, more = result.steps, int(not known)
    assert counts == {
        "local_derivatives": steps + 2,
        "lagrangian_gradient": steps + 1 + more,
        "_factor": steps + 1 + more,
        "_hessian_entries": steps + 2 + more,
    }


def test_trials_that_are_not_taken_have_no_hessian(monkeypatch: pytest.MonkeyPatch) -> None:
    state, multipliers = load("pi-b0.5-N50")
    problem = Problem(state.band)
    counts = _counted(monkeypatch, (Problem, "local_derivatives"), (Problem, "_hessian_entries"))
    x = state.vector() + 0.03 * np.sin(np.arange(problem.size))
    result = solve(problem, x, multipliers.vector())
    assert result.certified
    assert counts["_hessian_entries"] == result.steps + 2 < counts["local_derivatives"]


def test_pivots_of_normal_matrices_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """They come with a copy of the factors in qdldl's own object, and none of a quasi-definite matrix is
    zero."""
    monkeypatch.setattr(ldl, "_library", lambda: None)
    state, _ = load("pi-b0.5-N50")
    problem, x = Problem(state.band), state.vector()
    local = problem.local_derivatives(x, None)
    kkt_matrix(problem, local, np.zeros((problem.size, 0))).pattern.forget()
    _normal_factor(problem, x, local)  # the second one updates its symbolic factorisation
    solver = _normal_factor(problem, x, local)._solver
    assert isinstance(solver, ldl.Objects)
    assert solver._pivots is None


@pytest.mark.parametrize("most", [1, 2, 4, 9])
def test_entries_taken_in_turn_add_up_as_if_counted_through(most: int) -> None:
    rng = np.random.default_rng(most)
    place = rng.permutation(np.concatenate([np.arange(60) for _ in range(most)]))
    rows, columns = np.divmod(np.concatenate((place, np.arange(80))), 8)
    scatter = Scatter.build(rows, columns, (10, 8), zeros=80)
    values = np.append(rng.standard_normal(60 * most), 0.0)
    expected = np.bincount(scatter.slot[: values.size], weights=values, minlength=80)
    assert np.array_equal(scatter.data(values), expected)
    assert (scatter._rounds is None) == (most == 9)


def test_coth_factor_is_the_same_however_many_arguments() -> None:
    x = np.linspace(-1.0, 1.0, REPEATED_UP_TO + 100)
    for whole, part in zip(coth_factor(x), coth_factor(x[100:]), strict=True):
        assert np.array_equal(whole[100:], part)


def test_closing_moves_no_ruling_and_knows_fold_angles_alone() -> None:
    fold = folding.from_state(load("pi-b0.5-N50")[0])
    bent = folding.Folding(fold.theta * 1.001, fold.eta)
    residual, whole = folding.closure(bent, -1)
    again, part = folding.closure(bent, -1, by_eta=False)
    assert np.array_equal(again, residual)
    assert np.array_equal(part, whole[:, :50])
    assert np.array_equal(folding.close(bent, -1).eta, fold.eta)


def test_closing_makes_no_jacobian_of_what_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {"_closed_frames": 0, "_closure_rows": 0}
    for name in counts:

        def counted(
            *given: object, name: str = name, call: object = getattr(folding, name), **more: object
        ) -> object:
            counts[name] += 1
            return call(*given, **more)  # type: ignore[operator]

        monkeypatch.setattr(folding, name, counted)
    fold = folding.from_state(load("pi-b0.5-N50")[0])
    folding.close(folding.Folding(fold.theta * 1.001, fold.eta), -1)
    assert counts["_closed_frames"] == counts["_closure_rows"] + 1 > 2
