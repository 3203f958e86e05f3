"""Bands that rest on themselves: Newton's system with gaps, certificates, slopes by width, polish after a
barrier."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
import scipy
from resting_support import DATA, resting

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.touching import EDGE, FACET, VERTEX, Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.model.touching_barrier import candidates
from ribbon_cli.model.touching_gaps import Pairs
from ribbon_cli.solver import resting_certificate
from ribbon_cli.solver.inertia import inertia
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_barrier import BarrierProblem
from ribbon_cli.solver.resting_certificate import certified
from ribbon_cli.solver.resting_kkt import kkt_matrix
from ribbon_cli.solver.resting_set import NoRestError, found, moved, pushing, rest_at, slopes, touch_down
from ribbon_cli.solver.status import Status

PI, THREE = "pi-b1.65-N100", "3pi-b0.9-N120"


@lru_cache
def _solved(name):
    """A known state solved for anew from a place beside it."""
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    random = np.random.default_rng(1)
    x = state.vector() + 1e-4 * random.standard_normal(problem.size)
    return problem, solve(problem, x, None, Options(leave_saddles=0))


@lru_cache
def _rest():
    _, pairs, *_ = resting(PI)
    problem, result = _solved(PI)
    own, forces = problem.split(result.multipliers)
    return rest_at(result.state, own, pairs, forces)


@pytest.mark.parametrize("name", [PI, THREE])
def test_energies_and_forces_are_those_known(name):
    _, _, force, energy = resting(name)
    problem, result = _solved(name)
    assert result.status is Status.MINIMUM
    assert result.energy == pytest.approx(energy, rel=1e-12)
    assert problem.split(result.multipliers)[1] == pytest.approx(force, rel=1e-7)
    assert np.abs(problem.gaps(result.x).value).max() < 1e-11


def test_derivatives_with_gaps():
    problem, result = _solved(PI)
    random = np.random.default_rng(2)
    x, step = result.x, 1e-6
    v = random.standard_normal(x.size)
    multipliers = result.multipliers
    local = problem.local_derivatives(x, multipliers)
    rows = (problem.weighted_constraints(x + step * v) - problem.weighted_constraints(x - step * v)) / (
        2 * step
    )
    assert problem.jacobian_matrix(local) @ v == pytest.approx(rows, abs=1e-6)
    ahead, behind = (
        problem.lagrangian_gradient(problem.local_derivatives(y, multipliers), multipliers)
        for y in (x + step * v, x - step * v)
    )
    turned = problem.hessian_matrix(local) @ v
    assert turned == pytest.approx((ahead - behind) / (2 * step), abs=1e-6 * np.abs(turned).max())


@pytest.mark.parametrize("name", [PI, THREE])
def test_counts_agree_with_dense_algebra(name):
    problem, result = _solved(name)
    own, forces = problem.split(result.multipliers)
    for k in (None, 0, len(forces) - 1):
        keep = np.arange(len(forces)) != (-1 if k is None else k)
        fewer = RestingProblem(problem.band, problem.pairs.take(keep))
        local = fewer.local_derivatives(result.x, np.concatenate((own, forces[keep])))
        rotations = fewer.rotations(result.x)
        matrix = kkt_matrix(fewer, local, rotations)
        rows = np.vstack((fewer.jacobian_matrix(local).toarray(), rotations.T))
        basis = scipy.linalg.null_space(rows)
        values = np.linalg.eigvalsh(basis.T @ (fewer.hessian_matrix(local) @ basis))
        counted = inertia(matrix)
        assert counted.trusted
        assert counted.negative == (values < 0).sum()
        assert Factor(matrix).surplus >= counted.negative


def test_a_minimum_that_falls_without_a_row():
    """The 3 pi band has a negative direction without the row of one of its contacts, and none with it."""
    problem, result = _solved(THREE)
    own, forces = problem.split(result.multipliers)
    keep = np.arange(6) != 4
    fewer = RestingProblem(problem.band, problem.pairs.take(keep))
    local = fewer.local_derivatives(result.x, np.concatenate((own, forces[keep])))
    assert result.negative == 0
    assert inertia(kkt_matrix(fewer, local, fewer.rotations(result.x))).negative == 1


def test_certificates():
    problem, result = _solved(PI)
    clean = audit(Shape.of(result.state), 1e-9)
    judged = certified(problem, result, clean)
    assert judged.certified
    assert "At rest on 4 contacts, with forces of 82.6484 in all." in judged.message
    # A row that pushes is never left out: without it the state is not stationary.
    for k in range(4):
        fewer = RestingProblem(problem.band, problem.pairs.take(np.arange(4) != k))
        own, forces = problem.split(result.multipliers)
        point = np.concatenate((own, np.delete(forces, k)))
        kept = solve(fewer, result.x, point, Options(max_steps=0, leave_saddles=0))
        assert not certified(fewer, kept, clean).certified
    # Forces that pull, and shapes that cross themselves.
    pulled = RestingProblem(problem.band, problem.pairs.flipped())
    own, forces = problem.split(result.multipliers)
    back = solve(pulled, result.x, np.concatenate((own, -forces)), Options(leave_saddles=0))
    assert back.status is Status.MINIMUM
    assert certified(pulled, back, clean).status is Status.UNDECIDED
    assert "pulls" in certified(pulled, back, clean).message
    wide = _wider(result, 1.651)
    lost = certified(problem, result, audit(Shape.of(wide), 1e-9))
    assert lost.status is Status.GAP_LOST


def _wider(result, half_width):
    state = result.state
    return type(state)(state.band.with_half_width(half_width), state.u, state.g, state.xi)


@pytest.mark.long
@pytest.mark.parametrize(("name", "steepest"), [("pi-b1.72-N400", 13.0), ("pi-b1.78-N400", 19.0)])
def test_steep_facets_are_counted_as_dense_algebra_does(name, steepest):
    """Facets that are triangles but for 1e-11, or 1e-17, of their width: their eigenvalues are small only for
    the scale of xi. With each xi scaled by its own stiffness all are far above roundoff."""
    problem, result = _solved(name)
    assert np.abs(result.state.xi).max() > steepest
    judged = certified(problem, result, audit(Shape.of(result.state), 1e-9))
    assert judged.certified
    local = problem.local_derivatives(result.x, result.multipliers)
    rotations = problem.rotations(result.x)
    scale = kkt_matrix(problem, local, rotations).scale[: problem.size].copy()
    hessian = problem.hessian_matrix(local).toarray()
    stiffness = np.diag(hessian)[6::7]
    assert stiffness.min() > 0.0
    scale[6::7] = 1.0 / np.sqrt(stiffness)
    rows = np.vstack((problem.jacobian_matrix(local).toarray() * scale, rotations.T / scale))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    basis = scipy.linalg.null_space(rows)
    assert basis.shape[1] == problem.size - len(rows)
    values = np.linalg.eigvalsh(basis.T @ (hessian * scale * scale[:, None]) @ basis)
    assert values[0] > 1e9 * np.finfo(float).eps * values[-1]


def test_counts_that_roundoff_may_turn_certify_nothing(monkeypatch):
    problem, result = _solved(PI)
    clean = audit(Shape.of(result.state), 1e-9)
    assert certified(problem, result, clean).certified
    monkeypatch.setattr(Factor, "proves_minimum", lambda self: False)
    counted = inertia(
        kkt_matrix(problem, problem.local_derivatives(result.x, None), np.zeros((problem.size, 0)))
    )
    unclear = dataclasses.replace(counted, negative=0, roundoff=1.0)
    assert not unclear.trusted
    monkeypatch.setattr(resting_certificate, "inertia", lambda matrix: unclear)
    judged = certified(problem, result, clean)
    assert judged.status is Status.UNDECIDED
    assert "not known to rise" in judged.message


def test_slopes_by_width_against_differences():
    rest = _rest()
    along = slopes(rest)
    step = 1e-4
    ends = [
        moved(rest, rest.band.with_half_width(1.65 + by), by, along).result.energy for by in (step, -step)
    ]
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(along.rise, rel=1e-6)


def test_a_step_with_other_gaps_is_refused():
    rest = _rest()
    along = slopes(rest)
    with pytest.raises(NoRestError):
        moved(rest, rest.band.with_half_width(1.69), 0.04, along)


def test_forces_of_dependent_gaps():
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [-1.0, 0.2]])
    m, away = rows @ rows.T, np.array([-1.0, 2.0, -1.0, 3.0])
    force = pushing(m, away)
    assert (force >= 0).all()
    assert (m @ force + away >= -1e-7).all()
    assert force @ (m @ force + away) == pytest.approx(0.0, abs=1e-7)
    assert force[1] == force[3] == 0
    assert force.sum() == pytest.approx(1.0, rel=1e-6)
    assert (force > 0).sum() == 1


def test_candidates_of_a_vertex_in_a_valley_are_two_planes():
    rest = _rest()
    shape = Shape.of(rest.state)
    # Vertex 21 lies in facet 49; of a ruling both facets count, or the sides that meet at the vertex.
    near = Pairs(np.array([[VERTEX, 21]]), np.array([[EDGE, 3 * 50]]), np.ones(1))
    stand, forces = candidates(shape, near, np.array([3.0]))
    assert forces.sum() == pytest.approx(3.0)
    kinds = {(name[0], name[2]) for name in stand.names()}
    assert kinds in ({(VERTEX, FACET)}, {(EDGE, EDGE)})


def test_a_barrier_keeps_features_apart_and_its_derivatives_are_right():
    state, *_ = resting(PI)
    band = state.band
    rest = _rest()
    problem = RestingProblem(band, rest.pairs, 0.001)
    opened = solve(problem, rest.result.x, rest.result.multipliers, Options(leave_saddles=0, max_steps=20))
    x = opened.x
    held = BarrierProblem(band, 0.004)
    random = np.random.default_rng(4)
    v, step = random.standard_normal(x.size), 1e-7
    none = np.zeros(held.rows)
    local = held.local_derivatives(x, none)
    ahead, behind = (held.local_derivatives(x + s * v, none) for s in (step, -step))
    assert len(held.near(x)) >= 4
    assert (ahead.energy - behind.energy) / (2 * step) == pytest.approx(local.gradient @ v, rel=1e-5)
    assert Problem(band).energy(x) < local.energy
    assert held.allows(x, x + 1e-9 * v)
    through = x + 1.02 * (rest.result.x - x)  # the gaps are closed at 1, and crossed beyond
    assert not held.allows(x, through)


@pytest.mark.long
def test_touch_down_from_both_sides():
    """Where a band begins to touch, width, energy and the energy's slope are the same without forces."""
    with np.load(DATA / "pi-b1.5-N50-free.npz") as kept:
        band = Band(50, float(kept["half_width"]), sigma=-1)
        state = State(band, kept["u"], kept["g"], kept["xi"])
    own = solve(Problem(band), state.vector()).multipliers
    free = rest_at(state, own)
    low, step = band.half_width, 0.004
    while True:
        try:
            free = moved(free, band.with_half_width(low + step), step, slopes(free))
        except NoRestError:
            break
        low += step
    touching = found(free, band.with_half_width(low + step), step, slopes(free))
    assert touching.result.certified
    down = touch_down(touching)
    assert 0.0 < down.forces.max() < 1e-5
    high = low + step
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        try:
            free = moved(free, band.with_half_width(middle), middle - free.band.half_width, slopes(free))
            low = middle
        except NoRestError:
            high = middle
    assert down.band.half_width == pytest.approx(high, abs=2e-8)
    assert down.result.energy == pytest.approx(free.result.energy, abs=1e-5)
    assert slopes(down).rise == pytest.approx(slopes(free).rise, rel=1e-6)


@pytest.mark.long
def test_a_wider_band_is_found_by_a_barrier():
    """A step over which gaps change: what comes out is at rest, certified, and crosses nothing."""
    rest = _rest()
    end = found(rest, rest.band.with_half_width(1.651), 0.001, slopes(rest))
    direct = moved(rest, rest.band.with_half_width(1.651), 0.001, slopes(rest))
    assert end.result.certified
    assert end.result.energy == pytest.approx(direct.result.energy, rel=1e-9)
    assert end.audit.penetration <= 1e-9 * rest.band.length


def test_gaps_without_derivatives_have_no_forces():
    with pytest.raises(NoRestError, match="parallel"):
        pushing(np.array([[1.0, np.inf], [np.inf, 1.0]]), np.array([-1.0, 1.0]))
