"""What bands at rest cost, counted: patterns, lists of neighbours, looks at ways, eigenvectors."""

from __future__ import annotations

import tracemalloc
from functools import partial

import numpy as np
import pytest
from resting_support import resting

from ribbon_cli.model.band import State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.touching import EDGE, Shape
from ribbon_cli.model.touching_audit import Motion, audit, first_meeting
from ribbon_cli.model.touching_barrier import Neighbourhood, Surroundings, nearest
from ribbon_cli.model.touching_distances import nearer
from ribbon_cli.model.touching_features import Features
from ribbon_cli.model.touching_gaps import Pairs, arguments, gap_values, gaps, vectors
from ribbon_cli.model.touching_gaps import places as places_of
from ribbon_cli.model.touching_sides import Sides
from ribbon_cli.solver import resting_barrier, resting_kkt, resting_set, saddle_free
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, iterate_at, solve
from ribbon_cli.solver.prolongation import divided
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_barrier import BarrierProblem
from ribbon_cli.solver.resting_exchange import GapLostError, off_features
from ribbon_cli.solver.resting_kkt import RestingDerivatives, kkt_matrix

REACH = 5e-4


@pytest.fixture(scope="module")
def places():
    """A band at rest, places (20, 7N) along a smooth motion of its contacts, and its multipliers."""
    state, pairs, *_ = resting("pi-b1.65-N100")
    x = state.vector()
    wave = np.cos(0.01 * np.arange(x.size) * (1.0 + np.arange(20)[:, None] / 7.0))
    near = solve(RestingProblem(state.band, pairs), x, None, Options(leave_saddles=0))
    own = near.multipliers[: Problem(state.band).rows]
    return state, x + 1e-4 * np.arange(1, 21)[:, None] * wave, own


def _counted(monkeypatch, where, name):
    calls, original = [], getattr(where, name)

    def counting(*given, **more):
        calls.append(name)
        return original(*given, **more)

    monkeypatch.setattr(where, name, counting)
    return calls


def test_a_barrier_keeps_the_pattern_of_its_matrix(places, monkeypatch):
    """Pairs come and go, and are nearest at other features: two patterns serve for all of them."""
    state, xs, _ = places
    monkeypatch.setattr(resting_kkt, "_layouts", {})
    built = _counted(monkeypatch, resting_kkt, "_build")
    problem = BarrierProblem(state.band, REACH * state.band.length)
    sets = set()
    for x in xs:
        matrix = kkt_matrix(problem, problem.local_derivatives(x, None), problem.rotations(x))
        assert isinstance(matrix, resting_kkt.RestingMatrix)
        sets.add(frozenset(problem.near(x).names()))
    assert len(sets) >= 6
    assert len(built) <= 2


def test_places_to_spare_change_no_solution(places):
    """The same step with and without them, to rounding."""
    state, xs, own = places
    problem, bare = (BarrierProblem(state.band, REACH * state.band.length) for _ in range(2))
    problem.local_derivatives(xs[0], None)
    steps = []
    for each in (problem, bare):
        local = each.local_derivatives(xs[-5], own)
        matrix = kkt_matrix(each, local, each.rotations(xs[-5]))
        steps.append((matrix.border, saddle_free.newton_step(each, local, own, Factor(matrix), 1e-10)))
    (wide, (step, after)), (narrow, (other, others)) = steps
    assert wide > narrow
    assert np.abs(step - other).max() < 1e-6 * np.abs(step).max()
    assert np.abs(after - others).max() < 1e-6 * np.abs(after).max()


def test_derivatives_for_other_multipliers_keep_the_barrier(places, monkeypatch):
    """No pair is looked at again, and the matrix is the one made anew."""
    state, xs, own = places
    problem = BarrierProblem(state.band, REACH * state.band.length)
    x = xs[-5]
    local, anew = (problem.local_derivatives(x, y) for y in (None, own))
    looked = _counted(monkeypatch, BarrierProblem, "near")
    other = problem.with_multipliers(x, local, own)
    assert not looked
    one, two = (kkt_matrix(problem, each, problem.rotations(x)).upper for each in (other, anew))
    assert (one != two).nnz == 0


def test_one_list_over_all_pairs_serves_many_shapes(places, monkeypatch):
    """And the short ones that are taken from it miss no pair of all that there are."""
    state, xs, _ = places
    collected = _counted(monkeypatch, resting_barrier.Surroundings, "of")
    around = Surroundings(REACH * state.band.length, 0.004 * state.band.length)
    for k, x in enumerate(xs):
        shape = Shape.of(State.from_vector(state.band, x))
        near = nearest(shape, around.of(shape).features, around.reach).unique()
        assert set(near.names()) == set(nearer(shape, around.reach).names())
        if k % 10 == 0:
            every = Features.of((shape,), *np.triu_indices(shape.segments, 1))
            assert set(near.names()) == set(nearest(shape, every, around.reach).names())
    assert around.collected == 1
    assert len(collected) == len(xs)


def test_each_way_is_looked_at_once(places, monkeypatch):
    state, xs, _ = places
    problem = BarrierProblem(state.band, REACH * state.band.length)
    looked = _counted(monkeypatch, BarrierProblem, "_looked")
    x, y = xs[:2]
    for _ in range(3):
        problem.allows(x, y)
    assert len(looked) == 1


def test_parts_of_a_way_are_looked_at_with_the_whole(places, monkeypatch):
    """A shorter step on the same line needs no look of its own, and the answer is that of one."""
    state, xs, _ = places
    x = xs[0]
    problem = BarrierProblem(state.band, REACH * state.band.length)
    looked = _counted(monkeypatch, Surroundings, "first_meeting")
    random = np.random.default_rng(5)
    seen = []
    assert problem.allows(x, x.copy())
    assert problem.allows(x, x.copy())
    looked.clear()
    for _ in range(3):
        step = 0.01 * random.standard_normal(x.size)
        allowed = [problem.allows(x, x + 0.5**k * step) for k in range(0, 24, 3)]
        count = len(looked)
        fresh = BarrierProblem(state.band, REACH * state.band.length)
        for k, answer in zip(range(0, 24, 3), allowed, strict=True):
            fresh._ray = None
            assert fresh.allows(x, x + 0.5**k * step) == answer
        seen.append((count, *allowed))
        looked.clear()
    assert {count for count, *_ in seen} == {1}
    assert {answer for _, *allowed in seen for answer in allowed} == {True, False}


def test_a_way_beyond_all_lists_is_looked_at_over_all_pairs(places):
    """Whether it passes, as collision detection over every pair of facets has it."""
    state, xs, _ = places
    random = np.random.default_rng(3)
    seen = set()
    for size in (1e-5, 3e-4, 3e-3, 3e-2):
        before = Shape.of(State.from_vector(state.band, xs[0]))
        after = Shape.of(State.from_vector(state.band, xs[0] + size * random.standard_normal(xs[0].size)))
        motion = Motion.__new__(Motion)
        motion.before = motion.after = before
        motion._p, motion._q = before.vertices, after.vertices
        passed = len(motion.passages_of_all_pairs()) > 0
        assert (first_meeting(before, after) <= 1.0) == passed
        seen.add(passed)
    assert seen == {True, False}


def test_values_alone_are_those_with_derivatives():
    """To the last bit, for all kinds of pairs."""
    kinds = set()
    for name, reach in (("pi-b1.65-N100", 0.03), ("pi-b1.65-N100-gap0.02", 0.04)):
        state, pairs, *_ = resting(name)
        shape = Shape.of(state)
        near = nearer(shape, reach).joined(pairs)
        what = arguments(near)
        whole = gaps(vectors(shape, what), what, near.sign, shape.half_width).value
        assert (gap_values(shape, near) == whole).all()
        kinds |= set(what.pointed.tolist())
    assert kinds == {0, 1, 2}


def test_places_on_a_side_of_no_length_are_infinitely_far_off():
    """No overflow is reported, and they are on no feature."""
    state, *_ = resting("pi-b1.65-N100")
    xi = state.xi.copy()
    xi[40] = 25.0
    shape = Shape.of(State(state.band, state.u, state.g, xi))
    side = np.array([[EDGE, 3 * 40 + 1]])
    pairs = Pairs(np.array([[EDGE, 30]]), side, np.ones(1))
    with np.errstate(over="raise"):
        assert np.isinf(places_of(shape, pairs)[0, 2])
        assert off_features(shape, pairs)[0] == np.inf


def test_rows_of_many_gaps_are_those_of_each():
    state, pairs, force, _ = resting("pi-b1.65-N100")
    problem = RestingProblem(state.band, pairs)
    gradient = problem.gaps(state.vector()).gradient
    rows = problem.rows_of(gradient)
    for k in range(len(pairs)):
        alone = np.zeros_like(gradient)
        alone[k] = gradient[k]
        assert np.abs(rows[k] - problem.pull(alone)).max() < 1e-15
    assert np.abs(force @ rows - problem.pull(force[:, None, None] * gradient)).max() < 1e-12
    assert RestingProblem(state.band, Pairs.none()).rows_of(gradient[:0]).shape == (0, problem.size)


def test_far_from_rest_no_eigenvectors_are_looked_for(places, monkeypatch):
    """A step from where a barrier has negative directions is downhill without them."""
    state, xs, own = places
    problem = BarrierProblem(state.band, REACH * state.band.length)
    found = []
    looked = _counted(monkeypatch, saddle_free, "_negative_space")
    for x in xs[:13:4]:
        point = iterate_at(problem, x, own)
        factor = Factor(kkt_matrix(problem, point.local, problem.rotations(x)))
        if not factor.surplus:
            continue
        found.append(saddle_free.direction(problem, point.local, point.multipliers, factor).index)
    assert found
    assert not looked


def test_a_convex_gap_has_no_negative_part():
    state, pairs, force, _ = resting("pi-b1.65-N100")
    problem = RestingProblem(state.band, pairs)
    own = np.concatenate((np.zeros(problem.base.rows), force))
    local = problem.local_derivatives(state.vector(), own)
    assert isinstance(local, RestingDerivatives)
    bent = local.convex()
    assert local.touched is not None
    assert bent.touched is not None
    assert np.linalg.eigvalsh(local.touched.hessian).min() < -1e-3
    assert np.linalg.eigvalsh(bent.touched.hessian).min() > -1e-9
    left = bent.touched.hessian - local.touched.hessian
    assert np.linalg.eigvalsh(left).min() > -1e-9


def test_memory_of_lists_and_looks_grows_no_faster_than_the_grid():
    """In the fan beside the inflection a third of all facets are near each other: they are looked at in
    blocks."""
    state, *_ = resting("pi-b1.65-N100")
    peaks = {}
    for parts in (4, 8):
        shape = Shape.of(divided(state, parts))
        near = REACH * shape.length, 0.004 * shape.length
        for name, look in (
            ("list", partial(Neighbourhood.of, shape, *near)),
            ("audit", partial(audit, shape, 1e-10)),
            ("way", Motion(shape, shape).passages),
        ):
            tracemalloc.start()
            look()
            peaks[name, parts] = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
    for name in ("list", "audit", "way"):
        assert peaks[name, 8] < 2.2 * peaks[name, 4], peaks


def test_gaps_are_opened_by_the_moves_of_few(monkeypatch):
    """All gaps nearby are at least as wide as asked for, and few moves were needed for it."""
    state, pairs, *_ = resting("pi-b1.65-N100")
    shape, length = Shape.of(state), state.band.length
    every = Sides(shape, pairs, corners=True).near(shape, 0.02 * length)[0]
    room = 0.5 * REACH * length
    solved = _counted(monkeypatch, resting_set.Factor, "solve")
    x = resting_set._apart(state.band, state.vector(), every, room, room)
    opened = RestingProblem(state.band, every).gaps(x).value
    assert opened.min() >= (1.0 - 2e-3) * room
    assert np.abs(Problem(state.band).constraints(x)).max() < 1e-3 * room
    assert len(every) > 80
    assert len(solved) < len(every)


def test_moves_that_lead_off_the_constraints_are_given_up():
    """Gaps that no small move opens."""
    state, pairs, *_ = resting("pi-b1.65-N100")
    with pytest.raises(GapLostError, match="by small moves"):
        resting_set._apart(state.band, state.vector(), pairs, 1.5, 1e-3)
