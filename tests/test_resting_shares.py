"""Forces of contacts that depend on each other, shared out anew."""

from __future__ import annotations

import numpy as np
import pytest
from resting_support import resting

from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_gaps import Pairs
from ribbon_cli.model.touching_sides import Sides
from ribbon_cli.solver import resting_exchange
from ribbon_cli.solver.kkt import FactorisationError
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_certificate import certified
from ribbon_cli.solver.resting_exchange import Exchange, NoRestError
from ribbon_cli.solver.resting_set import moved, rest_at, slopes
from ribbon_cli.solver.resting_shares import least


def test_shares_have_the_least_sum():
    """Three gaps of rank two: what pulls with two of them pushes with others."""
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    m, forces = rows @ rows.T, np.array([3.0, -1.0, 2.0])
    share = least(m, forces)
    assert (share >= 0.0).all()
    assert m @ share == pytest.approx(m @ forces, abs=1e-9)
    assert share == pytest.approx([4.0, 0.0, 1.0], abs=1e-9)


def test_what_cannot_be_held_has_no_shares():
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(NoRestError, match="no forces that push"):
        least(rows @ rows.T, np.array([1.0, -1.0]))


def test_a_matrix_that_is_nearly_singular_is_no_rest(monkeypatch):
    """A search for the gaps that push ends with a reason where its linear system has no accurate solution."""
    state, pairs, forces, _ = resting("pi-b1.65-N100")

    def solve(*_):
        raise FactorisationError("no accurate solution")

    monkeypatch.setattr(resting_exchange.Factor, "solve", solve)
    search = Exchange(state.band, Sides(Shape.of(state), pairs), 0.5)
    own = np.zeros(RestingProblem(state.band, Pairs.none()).rows)
    with pytest.raises(NoRestError, match="no accurate solution"):
        search.rest(state.vector(), own, pairs, forces)


def _rest(name):
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces)


@pytest.mark.long
def test_gaps_that_come_to_depend_on_each_other_are_exchanged_for_others():
    """The six gaps kept where three vertices meet have forces of 338 in all at b = 0.9; at b = 0.92 they have
    none, and others hold the same corners with less."""
    rest = _rest("3pi-b0.9-N60")
    assert rest.forces.sum() > 300.0
    end = moved(rest, rest.band.with_half_width(0.92), 0.02, slopes(rest))
    assert end.result.certified
    assert end.forces.sum() < 200.0
    assert end.pairs.names() != rest.pairs.names()
    assert end.result.energy == pytest.approx(49.958415985, rel=1e-10)


@pytest.mark.long
def test_sheets_do_not_slip_off_through_a_crack():
    """Three vertices meet: a way downhill is on a piece on which a vertex stays on a ruling, with gaps all
    round it. No shape is inside that piece."""
    rest = _rest("3pi-b0.97-N60")
    judged = certified(rest.problem, rest.result, rest.audit)
    assert judged.certified
    assert "pieces of what does not cross" in judged.message
