"""Distances of facets and audits of motions against other means, written without the program's formulas."""

from __future__ import annotations

import numpy as np
import pytest
from resting_support import resting
from touching_brute import collisions, quad_distance

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.contact import near_facets
from ribbon_cli.model.folding import Folding, frames, from_state
from ribbon_cli.model.strip_folding import to_state
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import (
    Motion,
    _beside_facets,
    _crossings,
    _over_facets,
)
from ribbon_cli.model.touching_barrier import Neighbourhood
from ribbon_cli.model.touching_features import corners_of, edge_distances
from ribbon_cli.parts import FREE, Ends, Parts

SHAPES = (("pi-b1.65-N100", 0), ("pi-b1.65-N100", 1), ("3pi-b0.9-N120", 0), ("3pi-b0.9-N120", 1))


def _distances(shape, i, j):
    """Distances of pairs of facets as the audit has them: of edges, and of vertices from facets."""
    edges, corners = shape.edge_numbers, shape.corner_numbers
    crossed = np.stack((np.repeat(edges[i], 4, axis=1), np.tile(edges[j], (1, 4))), axis=-1)
    least = edge_distances(shape, crossed.reshape(-1, 2)).reshape(len(i), 16).min(axis=1)
    for one, other in ((i, j), (j, i)):
        facing = np.stack((corners[one], np.broadcast_to(other[:, None], (len(i), 4))), axis=-1)
        heights, over = _over_facets(shape, facing.reshape(-1, 2))
        least = np.minimum(least, np.where(over, np.abs(heights), np.inf).reshape(-1, 4).min(axis=1))
    return least


@pytest.mark.parametrize(("name", "crossing"), SHAPES)
def test_distances_of_random_facets(name, crossing):
    """Of 250 pairs each, of bands at rest, and of those that may meet of bands folded at random."""
    state, *_ = resting(name)
    random = np.random.default_rng(11)
    if crossing:
        state = _folded(state, random)
    shape = Shape.of(state)
    i, j = np.sort(random.integers(0, shape.segments - 1, (2, 4000)), axis=0)
    if crossing:
        i, j = near_facets(corners_of(shape, shape.vertices), np.zeros(shape.segments), 0.0)
        order = random.permutation(np.flatnonzero(j < shape.segments - 1))
        i, j = i[order], j[order]
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
        crossed = {(int(e), b) for e in edges[a]} | {(int(e), a) for e in edges[b]}
        assert bool(crossed & through) is not free
    assert bool((~apart).sum() > 10) is bool(crossing)


def _folded(state, random):
    """The strip of a band folded by other angles along the same rulings: its facets are as they were, but
    for the last, since it does not close."""
    fold = from_state(state)
    turned = Folding(fold.theta * random.uniform(0.0, 5.0, fold.theta.size), fold.eta)
    frame = frames(turned, np.eye(3))
    u = np.ascontiguousarray(frame[:, :, 0])
    return State(state.band, u, fold.eta[:, None] * u + frame[:, :, 2], state.xi)


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
    """Motions of a strip of 24 facets, folded at random along rulings that lean, a third of them long."""
    random = np.random.default_rng(seed)
    band = Band(24, 0.5, sigma=0, parts=Parts(ends=Ends(end=FREE)))
    for k in range(count):
        theta, eta = random.uniform(-0.2, 0.9, 25), random.uniform(-0.15, 0.15, 25).cumsum()
        shapes = []
        for scale in (0.0, (0.03, 0.1, 0.4)[k % 3]):
            folded = Folding(theta + scale * random.standard_normal(25), eta)
            shapes.append(Shape.of(to_state(band, folded)))
        yield shapes


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
