"""Distances of facets and audits of motions against other means, written without the program's formulas."""

from __future__ import annotations

import numpy as np
import pytest
from resting_support import resting
from touching_brute import collisions, quad_distance

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import Motion, _beside_facets, _crossings, _edge_distances, _over_facets
from ribbon_cli.model.touching_barrier import Neighbourhood

SHAPES = (("pi-b1.65-N100", 1.0), ("pi-b1.65-N100", 1.3), ("3pi-b0.9-N120", 1.0), ("3pi-b0.9-N120", 1.4))


def _distances(shape, i, j):
    """Distances of pairs of facets as the audit has them: of edges, and of vertices from facets."""
    edges, corners = shape.edge_numbers, shape.corner_numbers
    crossed = np.stack((np.repeat(edges[i], 4, axis=1), np.tile(edges[j], (1, 4))), axis=-1)
    least = _edge_distances(shape, crossed.reshape(-1, 2)).reshape(len(i), 16).min(axis=1)
    for one, other in ((i, j), (j, i)):
        facing = np.stack((corners[one], np.broadcast_to(other[:, None], (len(i), 4))), axis=-1)
        heights, over = _over_facets(shape, facing.reshape(-1, 2))
        least = np.minimum(least, np.where(over, np.abs(heights), np.inf).reshape(-1, 4).min(axis=1))
    return least


@pytest.mark.parametrize(("name", "stretch"), SHAPES)
def test_distances_of_random_facets(name, stretch):
    """Of 250 pairs each, in shapes of which half are stretched until they cross themselves."""
    state, *_ = resting(name)
    shape = Shape.of(State(state.band.with_half_width(stretch * state.band.half_width), *_fields(state)))
    random = np.random.default_rng(11)
    i, j = np.sort(random.integers(0, shape.segments, (2, 4000)), axis=0)
    counts = shape.flat_distance(shape.flat_of_facets(i), shape.flat_of_facets(j)) >= shape.excluded
    i, j = i[counts][:250], j[counts][:250]
    quads = shape.vertices[shape.corner_numbers]
    known, apart = quad_distance(quads[i], quads[j])
    assert len(i) == 250
    assert _distances(shape, i[apart], j[apart]) == pytest.approx(known[apart], abs=1e-8)
    met = _crossings(shape, i, j)
    through = {(int(e), int(f)) for e, f in zip(met.edge, met.facet, strict=True)}
    edges = shape.edge_numbers
    for a, b, free in zip(i.tolist(), j.tolist(), apart.tolist(), strict=True):
        crossing = {(int(e), b) for e in edges[a]} | {(int(e), a) for e in edges[b]}
        assert bool(crossing & through) is not free
    if stretch > 1.0:
        assert (~apart).sum() > 5


def _fields(state):
    return state.u, state.g, state.xi


def test_distances_beside_facets():
    """Of vertices that are not over a facet, from its rim."""
    state, *_ = resting("3pi-b0.9-N120")
    shape = Shape.of(state)
    random = np.random.default_rng(12)
    pairs = np.column_stack((random.integers(0, 240, 300), random.integers(0, 120, 300)))
    pairs = pairs[~_over_facets(shape, pairs)[1]]
    found = _beside_facets(shape, pairs, 100.0)
    quads = shape.vertices[shape.corner_numbers[pairs[:, 1]]]
    points = np.repeat(shape.vertices[pairs[:, 0]][:, None], 4, axis=1)
    assert found == pytest.approx(quad_distance(points, quads)[0], abs=1e-12)


def _motions(count, seed):
    """Motions of a band of 25 facets, a third of them long."""
    random = np.random.default_rng(seed)
    state, *_ = resting("pi-b1.65-N100")
    every = slice(None, None, 4)
    band = Band(25, 1.2, sigma=-1)
    start = State(band, state.u[every], state.g[every], state.xi[every])
    for k in range(count):
        move = random.standard_normal(start.vector().size) * (0.02, 0.06, 0.3)[k % 3]
        yield Shape.of(start), Shape.of(State.from_vector(band, start.vector() + move))


def _verdicts(count, seed):
    """How many motions pass through themselves, and how many of those a list that is too short misses."""
    passed, missed = 0, 0
    for before, after in _motions(count, seed):
        motion = Motion(before, after)
        replayed = collisions(motion.before, motion.after)
        found = motion.passages()
        assert set(found.pairs.names()) == replayed
        short = Neighbourhood.of(before, 1e-3, 1e-3)
        passed += bool(replayed)
        missed += bool(replayed) and not short.passes(motion.before, motion.after)
    return passed, missed


def test_the_audit_sees_what_a_short_list_misses():
    passed, missed = _verdicts(6, 21)
    assert missed >= 1
    assert passed < 6


@pytest.mark.long
def test_the_audit_sees_what_short_lists_miss():
    passed, missed = _verdicts(200, 22)
    assert missed >= 20
    assert passed < 200
