"""Gaps and their derivatives, which pairs count, and audits of shapes and of motions over all pairs."""

from __future__ import annotations

import numpy as np
import pytest
from resting_support import resting

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.contact import _facet_distance, _facets, near_facets
from ribbon_cli.model.diagnostics import taylor_slopes
from ribbon_cli.model.touching import EDGE, FACET, VERTEX, Shape, excluded_distance
from ribbon_cli.model.touching_audit import Motion, _over_facets, audit
from ribbon_cli.model.touching_barrier import barrier, nearest
from ribbon_cli.model.touching_features import Features, corners_of, edge_distances
from ribbon_cli.model.touching_gaps import Pairs, arguments, gap_rates, gaps, places, vectors

KINDS = {
    "vertex-facet": ((VERTEX, 4), (FACET, 21)),
    "ruling-ruling": ((EDGE, 3), (EDGE, 30)),
    "ruling-side": ((EDGE, 3), (EDGE, 31)),
    "side-side": ((EDGE, 5), (EDGE, 61)),
    "vertex-ruling": ((VERTEX, 7), (EDGE, 60)),
    "vertex-side": ((VERTEX, 7), (EDGE, 61)),
    "vertex-vertex": ((VERTEX, 7), (VERTEX, 50)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_derivatives_of_gaps(kind, sign):
    first, second = KINDS[kind]
    pairs = Pairs(np.array([first]), np.array([second]), np.array([sign]))
    what = arguments(pairs)
    random = np.random.default_rng(len(kind))
    at, move = random.standard_normal((2, 19))

    def value(y):
        return gaps(y[:18].reshape(1, 6, 3), what, pairs.sign, 0.7 + y[18]).value

    at[18] = 0.0
    found = gaps(at[:18].reshape(1, 6, 3), what, pairs.sign, 0.7)
    rates = gap_rates(at[:18].reshape(1, 6, 3), what, pairs.sign, 0.7)
    v, b = move[:18], move[18]
    once = found.gradient.reshape(18) @ v + b * rates.rate[0]
    twice = v @ found.hessian[0] @ v + 2.0 * b * (rates.gradient.reshape(18) @ v)
    twice += b * b * rates.second[0]
    slopes = [s.slope for s in taylor_slopes(value, at, move, (once, twice))]
    assert slopes == pytest.approx([1.0, 2.0, 3.0], abs=0.1)


def test_derivatives_of_the_barrier():
    y = np.array([0.01, 0.3, 0.9])
    value, first, second = barrier(y)
    step = 1e-5
    ahead, behind = barrier(y + step), barrier(y - step)
    assert (ahead[0] - behind[0]) / (2 * step) == pytest.approx(first, rel=1e-5)
    assert (ahead[1] - behind[1]) / (2 * step) == pytest.approx(second, rel=1e-5)
    assert (value > 0).all()


def test_distances_of_features_are_those_of_facets():
    state, *_ = resting("pi-b1.65-N100")
    shape = Shape.of(state)
    quads = _facets(state.u, state.g, state.next_rulings()[-1], state.band.half_width, state.band.h)
    random = np.random.default_rng(3)
    pairs = np.sort(random.integers(0, 100, (1300, 2)), axis=1)
    pairs = pairs[(pairs[:, 1] - pairs[:, 0] > 8) & (pairs[:, 1] - pairs[:, 0] < 92)]
    known = _facet_distance(quads, pairs[:, 0], pairs[:, 1], 1e-12)
    edges, corners = shape.edge_numbers, shape.corner_numbers
    i, j = pairs.T
    crossed = np.stack((np.repeat(edges[i], 4, axis=1), np.tile(edges[j], (1, 4))), axis=-1)
    least = edge_distances(shape, crossed.reshape(-1, 2)).reshape(len(i), 16).min(axis=1)
    for one, other in ((i, j), (j, i)):
        facing = np.stack((corners[one], np.broadcast_to(other[:, None], (len(i), 4))), axis=-1)
        heights, over = _over_facets(shape, facing.reshape(-1, 2))
        least = np.minimum(least, np.where(over, np.abs(heights), np.inf).reshape(-1, 4).min(axis=1))
    apart = known > 1e-9
    assert apart.sum() > 800
    assert least[apart] == pytest.approx(known[apart], abs=1e-9)


def test_pairs_count_by_their_distance_on_the_flat_strip():
    state, *_ = resting("pi-b1.65-N100")
    shape = Shape.of(state)
    assert shape.excluded == pytest.approx(0.005 * 2 * np.pi)
    assert excluded_distance(1.0, 0.02) == pytest.approx(0.005 + 0.01 * np.pi)
    facets = np.arange(100)
    beside = shape.flat_distance(shape.flat_of_facets(facets), shape.flat_of_facets((facets + 1) % 100))
    assert beside == pytest.approx(0.0, abs=1e-12)  # over the seam as well
    # A facet's neighbour but one is at a distance where rulings do not meet, 0 where fans of them do.
    apart = shape.flat_distance(shape.flat_of_facets(facets), shape.flat_of_facets((facets + 2) % 100))
    assert apart.max() <= 2 * np.pi / 100 + 1e-12
    assert (apart < shape.excluded).sum() > 0
    far = shape.flat_distance(shape.flat_of_facets(facets), shape.flat_of_facets((facets + 30) % 100))
    # In the fans of a wide band even facets 30 numbers apart lie next to each other.
    assert far.max() > 10 * shape.excluded
    assert far.min() < shape.excluded


def test_slivers_are_no_features():
    state, *_ = resting("pi-b1.65-N100")
    xi = state.xi.copy()
    xi[7] = 15.0
    shape = Shape.of(State(state.band, state.u, state.g, xi))
    assert shape.slivers[3 * 7 + 1]
    assert not shape.slivers[3 * 7 + 2]
    assert shape.slivers.sum() == 2  # and where |xi| is 8.6


@pytest.mark.parametrize("name", ["pi-b1.65-N100", "3pi-b0.9-N120"])
def test_a_resting_band_touches_and_does_not_cross(name):
    state, pairs, *_ = resting(name)
    found = audit(Shape.of(state), 1e-3)
    assert found.penetration <= 1e-9 * state.band.length
    assert found.clearance <= 1e-9
    near = set(found.near.take(found.distance < 1e-9).names())
    if name.startswith("pi"):
        assert near == set(pairs.names())
    at = places(Shape.of(state), pairs)
    assert at.min() > -1e-9
    assert at.max() < 1 + 1e-9


def test_a_crossing_has_a_depth():
    state, pairs, *_ = resting("pi-b1.65-N100")
    wider = State(state.band.with_half_width(1.651), state.u, state.g, state.xi)
    what = arguments(pairs)
    value = gaps(vectors(Shape.of(wider), what), what, pairs.sign, 1.651).value
    found = audit(Shape.of(wider), 0.0)
    assert value.min() < -1e-4
    assert 0.1 * abs(value.min()) < found.penetration <= 1.01 * abs(value.min())


def _motions(count: int, seed: int):
    """Motions of a band of 24 facets with free ones among them: a third of them long."""
    random = np.random.default_rng(seed)
    state, *_ = resting("pi-b1.65-N100")
    every = slice(None, None, 4)
    band = Band(25, 1.2, sigma=-1)
    start = State(band, state.u[every], state.g[every], state.xi[every])
    for k in range(count):
        move = random.standard_normal(start.vector().size) * (0.03, 0.15, 0.6)[k % 3]
        yield Shape.of(start), Shape.of(State.from_vector(band, start.vector() + move))


def _agree(count: int, seed: int) -> int:
    tunnelled = 0
    for before, after in _motions(count, seed):
        motion = Motion(before, after)
        quick, slow = motion.passages(), motion.passages_of_all_pairs()
        assert quick.pairs.names() == slow.pairs.names()
        assert np.array_equal(quick.when, slow.when)
        tunnelled += len(slow) > 0 and audit(after, 0.0).penetration == 0.0
    return tunnelled


def test_the_audit_of_a_motion_misses_no_pair():
    _agree(6, 5)


@pytest.mark.long
def test_the_audit_of_many_motions_misses_no_pair():
    _agree(200, 6)


def test_a_complete_passage_is_seen_in_the_motion_alone():
    """Two shapes that cross nothing, one sheet on the other's other side: only the way tells."""
    state, pairs, *_ = resting("pi-b1.65-N100")
    shape = Shape.of(state)
    lifted, sunk = _shifted(shape, 0.01), _shifted(shape, -0.01)
    met = Motion(lifted, sunk).passages()
    assert len(met) > 0
    assert {key[:2] for key in pairs.names()} & {key[:2] for key in met.pairs.names()}
    assert Motion(lifted, sunk).depth(met) > 1e-5


def _shifted(shape: Shape, by: float) -> Shape:
    """The half of a band around a contact moved along the contact's normal."""
    from dataclasses import replace

    normal = np.cross(shape.u[49], shape.rulings[49])
    lift = np.zeros_like(shape.nodes)
    lift[:30] = by * normal
    return replace(shape, nodes=shape.nodes + lift)


def test_near_pairs_are_signed_and_within_reach():
    state, *_ = resting("pi-b1.65-N100")
    shape = Shape.of(state)
    i, j = near_facets(corners_of(shape, shape.vertices), np.zeros(100), 0.01)
    features = Features.of((shape,), i, j)
    near = nearest(shape, features, 0.01)
    what = arguments(near)
    value = gaps(vectors(shape, what), what, near.sign, 1.65).value
    assert len(near) > 8
    assert (value >= 0).all()
    assert (value < 0.01).all()
