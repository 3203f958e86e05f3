"""The pi band near its limit, where flat fans of rulings form and xi says nothing of the shape."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from resting_support import resting

from ribbon_cli.model.band import State
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_certificate import PENETRATION
from ribbon_cli.solver.resting_exchange import AstrayError
from ribbon_cli.solver.resting_set import SLIP, Guess, Rest, _passed, exchanged, found, rest_at, slopes
from ribbon_cli.solver.steps import MOST_XI, change, followed, turned

START = "pi-b1.65-N100"


@lru_cache
def _started(name: str) -> Rest:
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces)


def test_no_step_waits_for_xi():
    state = resting(START)[0]
    x = state.vector()
    step = np.zeros_like(x)
    step[0], step[6], step[13] = 1e-3, -400.0, 0.25
    assert turned(x, step) == pytest.approx(1e-3)
    assert change(x, step) == pytest.approx(100.0)
    moved = followed(x, step) - x
    assert (moved[0], moved[13]) == pytest.approx((1e-3, 0.25))
    assert moved[6] == pytest.approx(-MOST_XI)


def test_sheets_that_slide_far_pass_nothing():
    """A band slid along itself: the straight way cuts curves short, halves of it keep sheets apart."""
    state, nodes = resting(START)[0], 2
    g = np.roll(state.g, -nodes, axis=0)
    g[-nodes:] *= -1.0
    slid = State(state.band, np.roll(state.u, -nodes, axis=0), g, np.roll(state.xi, -nodes))
    slip = SLIP * state.band.length
    assert _passed(state, slid, 0.0, SLIP, 0) > 3.0 * slip
    assert _passed(state, slid, 0.0, SLIP) <= slip


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "width", "energy"),
    [
        ("pi-b1.62-N200", 1.64, 78.923009063),  # exchange ends where a vertex slips off a ruling
        ("pi-b1.76-N200", 1.78, 329.808065360),  # by a barrier, which crept there
        ("pi-b1.72-N400", 1.74, 196.786785969),  # a way of many facets
    ],
)
def test_next_width(name, width, energy):
    rest = _started(name)
    end = found(
        rest, rest.band.with_parameter("half_width", width), width - rest.band.half_width, slopes(rest)
    )
    assert end.result.certified
    assert end.result.energy == pytest.approx(energy, abs=1e-8)
    assert end.audit.penetration <= PENETRATION * rest.band.length
    assert end.forces.min() >= 0.0


@pytest.mark.long
def test_a_search_that_goes_astray_ends():
    rest = _started("pi-b1.76-N200")
    along, by = slopes(rest), 0.02
    x, multipliers = rest.result.x + by * along.x, rest.result.multipliers + by * along.multipliers
    own, forces = rest.problem.split(multipliers)
    band = rest.band.with_parameter("half_width", rest.band.half_width + by)
    with pytest.raises(AstrayError, match="forces grow beyond"):
        exchanged(Guess(rest.state, band, x, own, rest.pairs, forces))
