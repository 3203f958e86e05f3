"""Bands that rest on themselves at a distance: gaps as distances, forces, the energy's slope by the gap."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from resting_support import resting

from ribbon_cli.model.problem import Problem
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import GAP, RestingProblem
from ribbon_cli.solver.resting_barrier import BarrierProblem
from ribbon_cli.solver.resting_certificate import certified
from ribbon_cli.solver.resting_set import NoRestError, Rest, accepted, found, moved, rest_at, slopes
from ribbon_cli.solver.status import Status

KEPT = 0.02


@lru_cache
def _apart() -> Rest:
    """The pi band at rest at a distance of 0.02, solved for anew from a place beside it."""
    state, pairs, *_ = resting("pi-b1.65-N100-gap0.02")
    problem = RestingProblem(state.band, pairs, KEPT)
    x = state.vector() + 1e-5 * np.random.default_rng(3).standard_normal(problem.size)
    result = solve(problem, x, None, Options(leave_saddles=0))
    return accepted(state, problem, result, 1e-4, result.steps, ())


def _touching(name="pi-b1.65-N100") -> Rest:
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces)


def test_a_band_rests_at_a_distance():
    rest, touching = _apart(), _touching()
    assert rest.result.certified
    assert rest.result.energy == pytest.approx(resting("pi-b1.65-N100-gap0.02")[3], rel=1e-12)
    assert rest.result.energy > touching.result.energy
    shape = Shape.of(rest.state, KEPT)
    assert shape.excluded == pytest.approx(0.01 * np.pi + 0.01 * np.pi)
    seen = audit(shape, KEPT + 1e-6)
    assert seen.clearance == pytest.approx(KEPT, abs=1e-9)
    assert set(seen.near.names()) == set(rest.pairs.names())
    assert seen.distance == pytest.approx(KEPT, abs=1e-9)
    assert seen.lacks(KEPT) <= 1e-9
    assert seen.lacks(0.021) == pytest.approx(0.001)


def test_the_energy_rises_with_the_gap_by_the_sum_of_forces():
    rest = _apart()
    along = slopes(rest, GAP)
    assert along.rise == pytest.approx(rest.forces.sum(), rel=1e-14)
    step = 1e-5
    ends = [moved(rest, rest.band, by, along, KEPT + by) for by in (step, -step)]
    energies = [end.result.energy for end in ends]
    assert (energies[0] - energies[1]) / (2 * step) == pytest.approx(rest.forces.sum(), rel=1e-6)
    pushed = (ends[0].forces - ends[1].forces) / (2 * step)
    assert along.multipliers[rest.problem.base.rows :] == pytest.approx(pushed, rel=1e-4)


def test_without_a_row_it_comes_nearer_than_the_gap():
    rest = _apart()
    keep = np.arange(len(rest.pairs)) != 1
    fewer = RestingProblem(rest.band, rest.pairs.take(keep), KEPT)
    point = np.concatenate((rest.multipliers, rest.forces[keep]))
    result = solve(fewer, rest.result.x, point, Options(leave_saddles=0))
    with pytest.raises(NoRestError, match="nearer than the gap"):
        accepted(rest.state, fewer, result, 1e-4, 0, ())
    seen = audit(Shape.of(result.state, KEPT), KEPT + 1e-6)
    judged = certified(fewer, result, seen)
    assert judged.status is Status.GAP_LOST
    assert "Features are nearer than the gap by" in judged.message


def test_a_barrier_keeps_its_gap_and_its_derivatives_are_right():
    rest = _apart()
    held = BarrierProblem(rest.band, 0.004, 0.018)
    v, step = np.random.default_rng(4).standard_normal(held.size), 1e-7
    x, none = rest.result.x, np.zeros(held.rows)
    local = held.local_derivatives(x, none)
    ahead, behind = (held.local_derivatives(x + s * v, none) for s in (step, -step))
    assert len(held.near(x)) >= 4
    assert (ahead.energy - behind.energy) / (2 * step) == pytest.approx(local.gradient @ v, rel=1e-5)
    assert Problem(rest.band).energy(x) < local.energy
    assert held.allows(x, x + 1e-9 * v)
    tighter = BarrierProblem(rest.band, 0.004, KEPT + 1e-6)
    assert not tighter.allows(x, x + 1e-9 * v)


@pytest.mark.long
def test_the_energy_falls_to_that_without_a_gap():
    touching = _touching()
    energies = [found(touching, touching.band, 0.0, None, gap).result for gap in (0.02, 0.01, 0.005)]
    assert all(result.certified for result in energies)
    values = [result.energy for result in energies] + [touching.result.energy]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(_apart().result.energy, rel=1e-12)
    # Halving the gap halves what is left, up to a term of second order.
    left = np.array(values[:3]) - values[3]
    assert left[:2] / left[1:] == pytest.approx(2.2, abs=0.1)
