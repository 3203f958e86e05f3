"""Self-contact and clearance: hand-made cases, and an exact comparison of all pairs, triangle by triangle."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ribbon_cli.model import folding
from ribbon_cli.model.band import Band
from ribbon_cli.model.contact import Contact, least_gap, self_contact

Array = NDArray[np.float64]
DATA = Path(__file__).parent / "data"
Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture(autouse=True)
def _strict_floats() -> Iterator[None]:
    with np.errstate(all="raise", under="ignore"):
        yield


def dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...k,...k->...", a, b))


def point_segment(p: Array, a: Array, b: Array) -> Array:
    t = np.clip(dot(p - a, b - a) / dot(b - a, b - a), 0, 1)
    return np.asarray(np.linalg.norm(p - a - t[..., None] * (b - a), axis=-1))


def segment_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least of the four end-to-segment distances and, where its feet are on both, of the common normal."""
    least = np.minimum.reduce(
        [point_segment(a, c, d), point_segment(b, c, d), point_segment(c, a, b), point_segment(d, a, b)]
    )
    n = np.cross(b - a, d - c)
    nn = dot(n, n)
    skew = nn > 1e-24
    nn = np.where(skew, nn, 1.0)
    s, t = dot(np.cross(c - a, d - c), n) / nn, dot(np.cross(c - a, b - a), n) / nn
    inside = skew & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.asarray(np.where(inside, np.minimum(least, np.abs(dot(c - a, n)) / np.sqrt(nn)), least))


def barycentric_inside(p: Array, t: list[Array]) -> NDArray[np.bool_]:
    n = np.cross(t[1] - t[0], t[2] - t[0])
    sides = [dot(np.cross(t[(k + 1) % 3] - t[k], p - t[k]), n) for k in range(3)]
    return np.asarray(np.minimum.reduce(sides) >= 0)


def triangle_triangle(s: list[Array], t: list[Array]) -> Array:
    """Distances of triangles: edges, corners over faces, and zero where an edge pierces a face."""
    least = np.minimum.reduce(
        [segment_segment(s[k], s[(k + 1) % 3], t[m], t[(m + 1) % 3]) for k in range(3) for m in range(3)]
    )
    for one, other in ((s, t), (t, s)):
        n = np.cross(other[1] - other[0], other[2] - other[0])
        n = n / np.linalg.norm(n, axis=-1)[..., None]
        height = [dot(p - other[0], n) for p in one]
        for k in range(3):
            foot = one[k] - height[k][..., None] * n
            least = np.where(barycentric_inside(foot, other), np.minimum(least, np.abs(height[k])), least)
            m = (k + 1) % 3
            pierces = height[k] * height[m] < 0
            part = height[k] / np.where(pierces, height[k] - height[m], 1.0)
            point = one[k] + part[..., None] * (one[m] - one[k])
            least = np.where(pierces & barycentric_inside(point, other), 0.0, least)
    return np.asarray(least)


def quadrilaterals(u: Array, g: Array, g_end: Array, half_width: float, h: float) -> Array:
    p = np.vstack((np.zeros(3), np.cumsum(h * u, axis=0)))
    reach = half_width * np.vstack((g, g_end))
    left, right = p - reach, p + reach
    return np.stack((left[:-1], right[:-1], right[1:], left[1:]), axis=1)


def compare_all_pairs(u: Array, g: Array, g_end: Array, half_width: float, h: float) -> Contact:
    """The definition, by two triangles a facet and every pair of facets that counts."""
    n = len(u)
    i, j = np.triu_indices(n, k=1)
    counts = np.minimum(j - i, n - (j - i)) > max(3, n / 20)
    i, j = i[counts], j[counts]
    q = quadrilaterals(u, g, g_end, half_width, h)
    halves = ((0, 1, 2), (0, 2, 3))
    distance = np.minimum.reduce(
        [triangle_triangle([q[i, k] for k in a], [q[j, k] for k in b]) for a in halves for b in halves]
    )
    meet = distance <= 1e-12 * n * h
    return Contact(
        bool(meet.any()), np.column_stack((i, j))[meet], 0.0 if meet.any() else float(distance.min())
    )


def folded_strip(theta: Array, eta: Array) -> tuple[Array, Array]:
    """Tangents and rulings (N, 3) of a strip folded at node i by theta_i about (eta_i, 0, 1) in its frame."""
    u, g = np.empty((len(theta), 3)), np.empty((len(theta), 3))
    frame = np.eye(3)
    for i, (angle, slope) in enumerate(zip(theta, eta, strict=True)):
        g[i] = frame @ [slope, 0, 1]
        axis = g[i] / np.linalg.norm(g[i])
        across = np.cross(axis, frame.T).T
        along = np.outer(axis, axis @ frame)
        frame = along + np.cos(angle) * (frame - along) + np.sin(angle) * across
        u[i] = frame[:, 0]
    return u, g


def random_strip(n: int, seed: int, bend: float = 12.0, slope: float = 0.15) -> tuple[Array, Array, Array]:
    """A developable strip of length 2 pi, open, with its last ruling."""
    rng = np.random.default_rng(seed)
    x = np.arange(n + 1) / n
    wave = [np.cos(math.tau * k * x + rng.uniform(0, math.tau)) for k in range(6)]
    theta, eta = bend / n * rng.normal(size=6) @ wave, slope * rng.normal(size=6) @ wave
    u, g = folded_strip(theta, eta)
    return u[:-1], g[:-1], g[-1]


def rotation(seed: int) -> Array:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.asarray(q * np.linalg.det(q))


def ring(n: int) -> tuple[Array, Array]:
    t = math.tau * np.arange(n) / n
    return np.column_stack((-np.sin(t), np.cos(t), np.zeros(n))), np.tile(Z, (n, 1))


def path(*runs: tuple[tuple[float, float, float], int]) -> Array:
    """Tangents of a path of straight runs: (direction, number of facets)."""
    return np.concatenate([np.tile(np.array(d) / np.linalg.norm(d), (count, 1)) for d, count in runs])


def assert_same(result: Contact, expected: Contact, tolerance: float) -> None:
    assert result.contact == expected.contact
    assert result.pairs.tolist() == expected.pairs.tolist()
    assert result.clearance == pytest.approx(expected.clearance, abs=tolerance)


@pytest.mark.parametrize("n", [8, 9, 50, 64, 200, 801])
@pytest.mark.parametrize("half_width", [0.01, 1.5])
def test_ring_is_as_near_to_itself_as_the_first_facets_that_count(n: int, half_width: float) -> None:
    """Facets k + 1 apart have k facets between their nearest nodes: a chord of the polygon."""
    u, g = ring(n)
    h = math.tau / n
    result = self_contact(u, g, Z, half_width, h)
    chord = h * math.sin(math.pi * least_gap(n) / n) / math.sin(math.pi / n)
    assert not result.contact
    assert result.pairs.shape == (0, 2)
    assert result.clearance == pytest.approx(chord, abs=1e-11)


@pytest.mark.parametrize(("n", "gap"), [(8, 3), (50, 3), (79, 3), (80, 4), (99, 4), (100, 5), (3200, 160)])
def test_least_gap(n: int, gap: int) -> None:
    assert least_gap(n) == gap


@pytest.mark.parametrize("n", [1, 3, 7])
def test_bands_too_short_for_any_pair(n: int) -> None:
    u, g = ring(n)
    assert self_contact(u, g, Z, 0.1, 1.0).clearance == math.inf


def test_two_upright_sheets_that_cross() -> None:
    """A loop seen from above: its last run crosses the first in facet 5, on facet 10 + 5 + 4 + 5."""
    u = path(((1, 0, 0), 10), ((0, 1, 0), 5), ((-1, 0, 0), 4), ((-0.1, -math.sqrt(0.99), 0), 10))
    result = self_contact(u, np.tile(Z, (29, 1)), Z, 0.3, 1.0)
    assert result.contact
    assert result.pairs.tolist() == [[5, 24]]
    assert result.clearance == 0


@pytest.mark.parametrize("rise", [0.0, 0.5, 2.5])
def test_crossing_of_sheets_that_lean(rise: float) -> None:
    """The same loop, climbing: it still crosses itself while the sheets reach each other's height."""
    up, leaning = rise / 19, np.array([0.3, 0.2, 1.0])
    u = path(((1, 0, 0), 10), ((0, 1, up), 5), ((-1, 0, up), 4), ((-0.1, -math.sqrt(0.99), 0), 10))
    arguments = u, np.tile(leaning, (29, 1)), leaning, 0.3, 1.0
    assert_same(self_contact(*arguments), compare_all_pairs(*arguments), 1e-12)
    assert self_contact(*arguments).contact == (rise < 1)


def test_sheet_folded_flat_upon_itself() -> None:
    """Facet i lies on facet 19 - i, and along an edge it touches the two beside that one."""
    u = path(((1, 0, 0), 10), ((-1, 0, 0), 10))
    result = self_contact(u, np.tile(Z, (20, 1)), Z, 0.7, 0.25)
    expected = [
        [i, j]
        for i in range(20)
        for j in range(i, 20)
        if abs(i + j - 19) <= 1 and 3 < j - i < 17 and i < 10 <= j
    ]
    assert result.pairs.tolist() == expected


def test_small_facet_inside_a_larger_one_in_its_plane() -> None:
    """No edges cross: the path comes back to the plane of its wide first run and goes on in it, narrow."""
    steep = (0.3, 0.0, math.sqrt(1 - 0.09))
    u = path(((1, 0, 0), 6), ((0, 1, 0), 4), ((-1, 0, 0), 3), ((0, -1, 0), 4), (steep, 3))
    g = np.tile(Z, (20, 1))
    g[:7] *= 30
    pairs = self_contact(u, g, Z, 0.1, 1.0).pairs.tolist()
    assert [3, 18] in pairs
    assert [2, 18] not in pairs
    assert [4, 18] not in pairs


@pytest.mark.parametrize(("gap", "touches"), [(0.0, True), (1e-12, True), (1e-9, False), (1e-3, False)])
def test_grazing(gap: float, touches: bool) -> None:
    """The last facet's end comes down to the first run but for `gap`; the tolerance is 24e-12."""
    down = 1 - gap
    last = (-math.sqrt(1 - down**2), -down, 0.0)
    u = path(((1, 0, 0), 10), ((0, 1, 0), 5), ((-1, 0, 0), 4), ((0, -1, 0), 4), (last, 1))
    for q in (np.eye(3), rotation(1)):
        result = self_contact(u @ q, np.tile(Z, (24, 1)) @ q, Z @ q, 0.3, 1.0)
        assert result.contact == touches
        assert result.clearance == pytest.approx(0.0 if touches else gap, abs=1e-14)


@pytest.mark.parametrize("n", [10, 33, 64, 90])
@pytest.mark.parametrize("half_width", [0.02, 0.15, 0.6])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 8))])
def test_random_strips_against_all_pairs(n: int, half_width: float, seed: int) -> None:
    u, g, g_end = random_strip(n, seed)
    h = math.tau / n
    # Where rulings meet inside the strip a facet crosses itself and is none.
    q = quadrilaterals(u, g, g_end, half_width, h)
    if min(dot(q[:, 2] - q[:, 1], u).min(), dot(q[:, 3] - q[:, 0], u).min()) < 1e-3 * h:
        half_width *= 0.1
    arguments = u, g, g_end, half_width, h
    assert_same(self_contact(*arguments), compare_all_pairs(*arguments), 1e-11)


def test_random_strips_meet_and_miss() -> None:
    """What the comparison above rests on: both outcomes are among its cases."""
    found = {self_contact(*random_strip(64, seed), 0.15, math.tau / 64).contact for seed in range(8)}
    assert found == {True, False}


@pytest.mark.parametrize(
    "bands",
    [20, pytest.param(50, marks=pytest.mark.long), pytest.param(200, marks=pytest.mark.large)],
)
def test_random_closed_bands_against_all_pairs(bands: int) -> None:
    """Closed bands of 60 facets, one-sided and two-sided: the same pairs, the same clearances."""
    n, rng = 60, np.random.default_rng(2022)
    meet = miss = number = 0
    while meet + miss < bands:
        number += 1
        band, folds = random_closed_band(n, 1 if number % 2 else -1, rng)
        try:
            closed = folding.close(folds, band.sigma, steps=25)
            state = folding.to_state(band, closed)
        except folding.ClosureError:
            continue
        arguments = state.u, state.g, band.sigma * state.g[0], band.half_width, band.h
        found = self_contact(*arguments)
        assert_same(found, compare_all_pairs(*arguments), 1e-11)
        meet, miss = meet + found.contact, miss + (not found.contact)
    assert min(meet, miss) >= 0.3 * bands


def random_closed_band(n: int, sigma: int, rng: np.random.Generator) -> tuple[Band, folding.Folding]:
    """Random smooth folds about those of a ring (or, one-sided, of none), not closed yet."""
    modes = np.arange(1, 6) - (0.0 if sigma > 0 else 0.5)
    angles = math.tau * np.outer(modes, (np.arange(n) + 0.5) / n)

    def field(size: float) -> Array:
        a, b = rng.normal(size=(2, 5)) / modes
        return np.asarray(size * (a @ np.cos(angles) + b @ np.sin(angles)))

    theta = math.tau / n * ((1.0 if sigma > 0 else 0.0) + field(0.9))
    eta = field(0.35)
    return Band(n, float(rng.choice([0.1, 0.3, 0.5, 0.8])), sigma=sigma), folding.Folding(theta, eta)


@pytest.mark.parametrize("bend", [0.0, 3.0, 30.0])
def test_fans_of_rulings(bend: float) -> None:
    """Rulings that almost meet at a point on the edge: their facets are within 1e-3 of each other there."""
    n, half_width = 60, 0.5
    h = math.tau / n
    eta = np.concatenate((np.zeros(20), 0.999 / half_width * h * np.arange(21), np.full(20, 0.999 * 40 * h)))
    u, g = folded_strip(np.full(n + 1, bend / n), eta)
    arguments = u[:-1], g[:-1], g[-1], half_width, h
    expected = compare_all_pairs(*arguments)
    assert_same(self_contact(*arguments), expected, 1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_rotation_mirror_and_scale(seed: int) -> None:
    n = 70
    u, g, g_end = random_strip(n, seed)
    h = math.tau / n
    base = self_contact(u, g, g_end, 0.2, h)
    q = rotation(seed)
    flip = np.array([1.0, 1.0, -1.0])
    assert_same(self_contact(u @ q, g @ q, g_end @ q, 0.2, h), base, 1e-12)
    assert_same(self_contact(u * flip, g * flip, g_end * flip, 0.2, h), base, 1e-12)
    assert_same(self_contact(u, -g, -g_end, 0.2, h), base, 1e-12)
    scaled = self_contact(u, g, g_end, 20.0, 100 * h)
    assert_same(Contact(scaled.contact, scaled.pairs, scaled.clearance / 100), base, 1e-12)


def stored_minimum() -> tuple[Array, Array, int, float]:
    with np.load(DATA / "pi-b0.1-N50-second-minimum.npz") as stored:
        return stored["u"], stored["g"], int(stored["sigma"]), float(stored["half_width"])


def test_stored_minimum_is_clear_of_itself() -> None:
    u, g, sigma, half_width = stored_minimum()
    arguments = u, g, sigma * g[0], half_width, math.tau / 50
    result = self_contact(*arguments)
    assert not result.contact
    # The facets are flat to about 1e-11, and two triangles and one quadrilateral differ by that much.
    assert_same(result, compare_all_pairs(*arguments), 1e-9)
    assert result.clearance == pytest.approx(0.2022722, abs=1e-7)


@pytest.mark.parametrize("width", [1.0, 15.0])
@pytest.mark.parametrize("shift", [1, 17, 49])
def test_relabelling_a_one_sided_band(shift: int, width: float) -> None:
    """Nodes counted from another one: rulings that pass the seam change sign, pairs move along.

    At 15 times its width the band passes through itself, and some facets cross
    themselves, which does not matter here.
    """
    u, g, sigma, half_width = stored_minimum()
    n, h = 50, math.tau / 50
    base = self_contact(u, g, sigma * g[0], width * half_width, h)
    moved_u, moved_g = np.roll(u, -shift, axis=0), np.roll(g, -shift, axis=0)
    moved_g[-shift:] *= sigma
    moved = self_contact(moved_u, moved_g, sigma * moved_g[0], width * half_width, h)
    assert base.contact == (width > 1)
    assert moved.clearance == pytest.approx(base.clearance, abs=1e-10)
    back = np.sort((moved.pairs + shift) % n, axis=1)
    assert sorted(back.tolist()) == base.pairs.tolist()


def test_memory_stays_far_below_one_number_a_pair() -> None:
    n = 3200
    u, g = ring(n)
    tracemalloc.start()
    self_contact(u, g, Z, 1.5, math.tau / n)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * n * n / 4


def test_arguments_are_checked() -> None:
    u, g = ring(20)
    with pytest.raises(ValueError, match=r"must be \(N, 3\)"):
        self_contact(u, g[:-1], Z, 0.1, 0.1)
    with pytest.raises(ValueError, match="not finite"):
        self_contact(u, g, Z * np.nan, 0.1, 0.1)
    with pytest.raises(ValueError, match="empty"):
        self_contact(u[:0], g[:0], Z, 0.1, 0.1)
    with pytest.raises(ValueError, match="must be positive"):
        self_contact(u, g, Z, 0.0, 0.1)
