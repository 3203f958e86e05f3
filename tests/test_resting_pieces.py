"""Pieces of what does not cross near a shape that touches: clauses against crossings, choices of gaps, and
the certificate at corners."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import scipy
from resting_support import resting

from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import audit, penetration
from ribbon_cli.model.touching_gaps import Pairs, arguments, gaps, vectors
from ribbon_cli.model.touching_pieces import Pieces, _both_sides, pieces
from ribbon_cli.model.touching_sides import Sides
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_certificate import _Judge, _on_all_pieces, _pushing, certified
from ribbon_cli.solver.resting_set import found, rest_at, slopes
from ribbon_cli.solver.status import Status

PI, THREE = "pi-b1.65-N100", "3pi-b0.9-N120"


@lru_cache
def _solved(name):
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    near = audit(Shape.of(result.state), 1e-9).near
    return problem, result, pieces(Shape.of(result.state), near.joined(pairs))


class _Plane:
    """A point in the plane pushed by `needed` off gaps with gradients (2,K)."""

    def __init__(self, gradients, needed):
        self.columns, self.needed = np.array(gradients, float).T, np.array(needed, float)

    def doubt(self, chosen):
        which = np.array(sorted(chosen), dtype=int)
        forces, off = _pushing(self.columns[:, which], self.needed)
        down = self.columns[:, which] @ forces - self.needed
        return ("slips" if off > 1e-9 else ""), down @ self.columns


def _judged(gradients, needed, *clauses, nowhere=()):
    count = len(gradients)
    rows = np.tile(np.array([0, 0]), (count, 1))
    names = np.column_stack((np.full(count, 2), np.arange(count)))
    sign, last = np.ones(count), {}
    for k, gradient in enumerate(gradients):
        if tuple(-v for v in gradient) in last:
            names[k], sign[k] = names[last[tuple(-v for v in gradient)]], -1.0
        last[gradient] = k
    pairs = Pairs(rows, names, sign)
    void = (*_both_sides(pairs), *(frozenset(v) for v in nowhere))
    local = Pieces(pairs, tuple(frozenset(c) for c in clauses), void)
    return _on_all_pieces(_Plane(gradients, needed), local)


def test_bounds_hold_and_ridges_do_not():
    valley = ((1.0, 0.5), (-1.0, 0.5))
    assert _judged(valley, (0.1, 1.0), {0}, {1}) == ("", 1)
    assert _judged(valley, (0.1, 1.0), {0, 1})[0] == "slips"
    assert _judged(valley, (0.0, -1.0), {0}, {1})[0] == "slips"


def test_each_choice_of_gaps_has_to_hold():
    gradients = ((-1.0, 1.0), (1.0, 0.5), (1.0, 0.2), (1.0, 4.0))
    assert _judged(gradients, (0.1, 1.0), {0}, {1, 2}) == ("", 2)
    assert _judged(gradients, (0.5, 1.0), {0}, {1, 3})[0] == "slips"
    assert _judged(gradients, (0.1, 1.0), {0}, {1, 2, 3})[0] == ""


def test_no_shape_is_on_both_sides():
    """A crack between two facets, where both gaps of an edge with their ruling are zero, is no way out."""
    gradients = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0))
    assert _judged(gradients, (1.0, 1.0), {0}, {1, 2}) == ("", 1)
    assert _judged(gradients, (1.0, 1.0), {0}, {1}) == ("", 0)


def test_no_shape_is_all_round_an_edge():
    """Three gaps of which no shape has all positive leave no way out, however the last one is chosen."""
    gradients = ((1.0, 0.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (0.0, 0.0, 1.0))
    clauses, needed = ({0}, {1, 3}, {2, 3}), (0.0, 0.0, 1.0)
    assert _judged(gradients, needed, *clauses)[0] == "slips"
    assert _judged(gradients, needed, *clauses, nowhere=[{0, 1, 2}]) == ("", 2)


def test_clauses_of_plain_contacts_are_the_gaps_kept():
    problem, _, local = _solved(PI)
    assert all(len(clause) == 1 for clause in local.clauses)
    kept = dict(zip(problem.pairs.names(), problem.pairs.sign, strict=True))
    assert dict(zip(local.pairs.names(), local.pairs.sign, strict=True)) == kept
    assert not local.void


@pytest.mark.parametrize("name", [PI, THREE])
def test_shapes_nearby_that_do_not_cross_fulfil_all_clauses(name):
    """Small moves, straight and on the constraints: what does not cross breaks no clause, and what breaks one
    crosses."""
    problem, result, local = _solved(name)
    judge, base = _Judge(problem, result, local.pairs), problem.base
    random = np.random.default_rng(7)
    what, verdicts = arguments(local.pairs), []
    keys = list(zip(local.pairs.names(), local.pairs.sign, strict=True))
    kept = [keys.index(key) for key in zip(problem.pairs.names(), problem.pairs.sign, strict=True)]
    opening = np.linalg.lstsq(judge.columns[:, kept].T, np.ones(len(kept)), rcond=None)[0]
    for part in np.repeat((0.0, 1.0, 3.0), 8):
        move = random.standard_normal(len(opening)) + part * opening / np.linalg.norm(opening)
        x = result.x + 1e-5 * judge.scale * (judge.axes @ move)
        for _ in range(3):
            none = np.zeros(base.size)
            x = x + judge.normal.solve(np.concatenate((none, -base.weighted_constraints(x))))[: base.size]
        shape = Shape.of(base.state(x))
        value = gaps(vectors(shape, what), what, local.pairs.sign, shape.half_width).value
        least = min(max(value[k] for k in clause) for clause in local.clauses)
        verdicts.append((penetration(shape) > 0.0, least < 0.0))
    assert len({crosses for crosses, _ in verdicts}) == 2
    assert all(crosses == broken for crosses, broken in verdicts)


def test_no_move_opens_all_gaps_round_an_edge():
    """Of gaps said to be nowhere all positive one is negative after any small move."""
    problem, result, local = _solved(THREE)
    three = [v for v in local.void if len(v) == 3]
    assert len(three) > 100
    judge, random, what = (
        _Judge(problem, result, local.pairs),
        np.random.default_rng(8),
        arguments(local.pairs),
    )
    open_twice = 0
    for _ in range(200):
        x = result.x + 1e-5 * judge.scale * (judge.axes @ random.standard_normal(judge.axes.shape[1]))
        for _ in range(3):
            off = np.concatenate((np.zeros(problem.size), -problem.base.weighted_constraints(x)))
            x = x + judge.normal.solve(off)[: problem.size]
        shape = Shape.of(problem.base.state(x))
        value = gaps(vectors(shape, what), what, local.pairs.sign, shape.half_width).value
        assert all(min(value[k] for k in some) < 0.0 for some in local.void)
        open_twice += sum(sorted(value[k] for k in some)[1] > 0.0 for some in three)
    assert open_twice > 1000


def test_sides_of_gaps_that_are_kept():
    problem, result, _ = _solved(PI)
    shape = Shape.of(result.state)
    near, value = Sides(shape, problem.pairs).near(shape, 1e-3)
    known = dict(zip(near.names(), near.sign, strict=True))
    kept = dict(zip(problem.pairs.names(), problem.pairs.sign, strict=True))
    assert {name: known[name] for name in kept} == kept
    assert (value > -1e-11).all()
    # A shape that crosses itself a little knows what it crosses.
    wider = type(result.state)(problem.band.with_half_width(1.651), *_parts(result.state))
    near, value = Sides(shape, problem.pairs).near(Shape.of(wider), 1e-2)
    assert {n for n, v in zip(near.names(), value, strict=True) if v < -1e-5} >= set(kept)


def _parts(state):
    return state.u, state.g, state.xi


def test_gaps_are_exchanged():
    """A step on which vertices pass over rulings: at rest, certified, and without a barrier."""
    problem, result, _ = _solved(PI)
    own, forces = problem.split(result.multipliers)
    rest = rest_at(result.state, own, problem.pairs, forces)
    along = slopes(rest)
    end = found(rest, rest.band.with_half_width(1.64), -0.01, along)
    assert end.changes == ("exchange",)
    assert end.result.certified
    assert end.pairs.names() != rest.pairs.names()
    assert end.audit.penetration <= 1e-9 * rest.band.length
    again = found(rest, rest.band.with_half_width(1.64), -0.01, along)
    assert again.result.x.tobytes() == end.result.x.tobytes()


@pytest.mark.long
def test_a_minimum_at_corners():
    """Three vertices of the 3 pi band meet at its axis: a minimum on each piece, with other forces."""
    problem, result, local = _solved(THREE)
    judged = certified(problem, result, audit(Shape.of(result.state), 1e-9))
    assert judged.status is Status.MINIMUM
    assert "pieces of what does not cross" in judged.message
    assert "depend on each other" in judged.message
    assert len(local.clauses) == 36
    # Counted by dense algebra on some pieces.
    judge = _Judge(problem, result, local.pairs)
    assert not judge.independent
    rotations = problem.rotations(result.x)
    for chosen in _some_pieces(local):
        which = np.array(sorted(chosen))
        forces, off = _pushing(judge.columns[:, which], judge.needed)
        assert off < 1e-9
        multipliers, left = judge._balanced(which, forces)
        assert left < 1e-9
        pushing = which[forces > 1e-6 * forces.max()]
        every = judge._every(which, forces)
        rows = np.vstack((judge.jacobian.toarray(), judge.rows[pushing], rotations.T))
        basis = scipy.linalg.null_space(rows, rcond=1e-9)
        hessian = judge._hessian(multipliers, every)
        assert np.linalg.eigvalsh(basis.T @ (hessian @ basis)).min() > 0.0


def _some_pieces(local: Pieces):
    """A few choices of a gap of each clause that keep no two features on both sides of each other."""
    random = np.random.default_rng(3)
    made = 0
    while made < 4:
        chosen: set[int] = set()
        for clause in local.clauses:
            left = [k for k in sorted(clause) if not any(v <= chosen | {k} for v in local.void)]
            if not left:
                break
            if not chosen & clause:
                chosen.add(int(random.choice(left)))
        else:
            made += 1
            yield chosen


@pytest.mark.long
def test_no_gap_with_a_force_can_be_left_out_at_corners():
    problem, result, _ = _solved(THREE)
    own, forces = problem.split(result.multipliers)
    clean = audit(Shape.of(result.state), 1e-9)
    for k in range(len(forces)):
        fewer = RestingProblem(problem.band, problem.pairs.take(np.arange(len(forces)) != k))
        point = np.concatenate((own, np.delete(forces, k)))
        kept = solve(fewer, result.x, point, Options(max_steps=0, leave_saddles=0))
        assert not certified(fewer, kept, clean).certified
