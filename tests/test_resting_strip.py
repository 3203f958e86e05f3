"""A strip between clamps that is pushed until it rests on itself."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from resting_support import DATA

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.touching import EDGE, FACET, VERTEX, Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.model.touching_gaps import Pairs
from ribbon_cli.parts import HALF_WIDTH, Ends, Parts
from ribbon_cli.recipes.strip import elastica
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem, resting_rates, resting_reactions
from ribbon_cli.solver.resting_refine import resting_refined
from ribbon_cli.solver.resting_set import NoRestError, Rest, found, moved, rest_at, slopes


@lru_cache
def _strip() -> Rest:
    """A strip of half-width 0.4, twisted by 0.7 pi and pushed together: sides of facets 4 and 18 touch."""
    with np.load(DATA / "strip-b0.4-N30.npz") as kept:
        ends = Ends(span=float(kept["span"]), twist=float(kept["twist"]))
        band = Band(30, float(kept["half_width"]), sigma=0, parts=Parts(ends=ends))
        state = State(band, kept["u"], kept["g"], kept["xi"], kept["g_end"])
        pairs = Pairs(kept["first"], kept["second"], kept["sign"])
    problem = RestingProblem(band, pairs)
    x = state.vector() + 1e-5 * np.random.default_rng(5).standard_normal(problem.size)
    result = solve(problem, x, None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces)


def test_a_strip_rests_on_itself():
    rest = _strip()
    assert rest.result.certified
    assert rest.forces.min() > 0.1
    seen = audit(Shape.of(rest.state), 1e-6)
    assert seen.penetration <= 1e-9
    # Nothing touches at the clamps.
    assert set(seen.near.names()) == set(rest.pairs.names()) == {(EDGE, 14, EDGE, 55)}


def test_reactions_balance_with_contacts():
    rest = _strip()
    found = resting_reactions(rest.problem, rest.result.x, rest.result.multipliers)
    assert np.abs(found.force).max() > 1.0
    assert found.force + found.start_force == pytest.approx(np.zeros(3), abs=1e-9)
    turning = np.cross(rest.problem.target, found.force)
    assert found.moment + found.start_moment + turning == pytest.approx(np.zeros(3), abs=1e-9)
    assert slopes(rest, "span").rise == pytest.approx(found.force[0], rel=1e-9)


@pytest.mark.parametrize("name", ["span", "twist", HALF_WIDTH])
def test_slopes_of_the_energy_against_differences(name):
    rest = _strip()
    along, value, step = slopes(rest, name), rest.band.parameter(name), 1e-5
    ends = [
        moved(rest, rest.band.with_parameter(name, value + by), by, along).result.energy
        for by in (step, -step)
    ]
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(along.rise, rel=1e-6)


@pytest.mark.parametrize("name", ["twist", "tilt"])
def test_what_touches_a_clamp_turns_with_it(name):
    """Gaps on the end's ruling depend on its angles; their reactions belong to the clamp."""
    state = _strip().state
    pairs = Pairs(
        np.array([[VERTEX, 60], [EDGE, 10], [VERTEX, 1]]),
        np.array([[FACET, 9], [EDGE, 90], [FACET, 20]]),
        np.ones(3),
    )
    problem = RestingProblem(state.band, pairs)
    random = np.random.default_rng(6)
    x, multipliers = state.vector(), random.standard_normal(problem.rows)

    def turned(by):
        band = state.band.with_parameter(name, state.band.parameter(name) + by)
        other = RestingProblem(band, pairs)
        local = other.local_derivatives(other.impose(x), multipliers)
        lagrangian = local.energy - multipliers @ other.weighted_constraints(other.impose(x))
        return (
            lagrangian,
            other.lagrangian_gradient(local, multipliers),
            other.weighted_constraints(other.impose(x)),
        )

    step = 1e-5
    ahead, here, behind = (turned(by) for by in (step, 0.0, -step))
    rates = resting_rates(problem, x, multipliers, name)
    assert (ahead[0] - behind[0]) / (2 * step) == pytest.approx(rates.lagrangian, rel=1e-6)
    assert (ahead[1] - behind[1]) / (2 * step) == pytest.approx(rates.gradient, abs=1e-5)
    assert (ahead[2] - behind[2]) / (2 * step) == pytest.approx(rates.constraints, abs=1e-7)
    assert (ahead[0] - 2 * here[0] + behind[0]) / step**2 == pytest.approx(rates.second, rel=1e-3, abs=1e-3)
    assert (np.abs(rates.constraints[-3:-1]).min() > 0.01) is np.bool_(name == "twist")
    # A turn of everything, what is held as well, changes no gap: contacts have no moment in all.
    pull = problem.pull_with_data(np.ones(3)[:, None, None] * problem.gaps(x).gradient)
    y, on = x.reshape(-1, 7), pull[: problem.size].reshape(-1, 7)
    moment = np.cross(y[:, :3], on[:, :3]).sum(axis=0) + np.cross(y[:, 3:6], on[:, 3:6]).sum(axis=0)
    assert moment + np.cross(state.g[0], pull[-6:-3]) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.abs(pull[-6:-3]).max() > 0.01


@pytest.mark.long
def test_a_strip_is_pushed_until_it_rests_on_itself():
    """From the free elastica: twisted by 0.3 pi, then its clamps pushed together."""
    band = Band(30, 0.3, sigma=0, parts=Parts(ends=Ends(span=1.2 * np.pi)))
    free = solve(Problem(band), elastica(band).vector())
    rest = rest_at(free.state, free.multipliers)
    for name, end, step in (("twist", 0.3 * np.pi, 0.3), ("span", 1.2, 0.25)):
        while abs(end - rest.band.parameter(name)) > 1e-9:
            away = end - rest.band.parameter(name)
            by = float(np.copysign(min(step, abs(away)), away))
            along, wanted = slopes(rest, name), rest.band.with_parameter(name, rest.band.parameter(name) + by)
            try:
                rest = moved(rest, wanted, by, along)
            except NoRestError:
                rest = found(rest, wanted, by, along)
    assert rest.result.certified
    assert len(rest.pairs) >= 1
    assert rest.forces.min() > 1e-3
    balance = resting_reactions(rest.problem, rest.result.x, rest.result.multipliers)
    assert balance.force + balance.start_force == pytest.approx(np.zeros(3), abs=1e-8)
    finer = resting_refined(rest, 60)
    assert finer.result.certified
    assert finer.result.energy == pytest.approx(rest.result.energy, rel=0.02)
