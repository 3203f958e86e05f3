"""Linking number, twist and writhe: closed forms, exact double integrals, and what must not change them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ribbon_cli.model import topology
from ribbon_cli.model.topology import linking_number, open_turn, twist, twist_angles, writhe

Array = NDArray[np.float64]
DATA = Path(__file__).parent / "data"


@pytest.fixture(autouse=True)
def _strict_floats() -> Iterator[None]:
    with np.errstate(all="raise", under="ignore"):
        yield


def closed_tangents(vertices: Array) -> Array:
    """Tangents (N, 3) of a closed polygon with equal edges near the given one: Newton steps on sum u = 0."""
    u = np.roll(vertices, -1, axis=0) - vertices
    for _ in range(100):
        u /= np.linalg.norm(u, axis=1)[:, None]
        gap = u.sum(axis=0)
        if np.abs(gap).max() < 1e-13:
            return u
        step = np.linalg.solve(len(u) * np.eye(3) - u.T @ u, gap)
        u -= step - (u @ step)[:, None] * u
    raise AssertionError("the test's polygon does not close")


def writhe_reference(u: Array, h: float) -> float:
    """Writhe of a closed polygon by the exact Gauss double integral, Klenin & Langowski (2000), 1a.

    Each pair of edges adds the signed area Omega_ij of the spherical quadrilateral of the directions from one
    edge to the other, Wr = sum_{i<j} Omega_ij / (2 pi). The areas are computed as two triangles each by van
    Oosterom & Strackee (1983), without the loss of digits that arcsines have on flat quadrilaterals.
    """
    stop = h * np.cumsum(u, axis=0)
    start = np.roll(stop, 1, axis=0)
    i, j = np.triu_indices(len(start), k=2)
    apart = j - i < len(start) - 1  # neighbouring edges span a plane and add nothing
    i, j = i[apart], j[apart]
    r13, r14 = start[j] - start[i], stop[j] - start[i]
    r23, r24 = start[j] - stop[i], stop[j] - stop[i]
    area = solid_angle(r13, r14, r24) + solid_angle(r13, r24, r23)
    return -float(np.sum(area)) / math.tau


def solid_angle(a: Array, b: Array, c: Array) -> Array:
    """Signed solid angles (M,) of the triangles with corners a, b, c (M, 3), seen from the origin."""
    na, nb, nc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=1)
    ab, bc, ca = (np.sum(v * w, axis=1) for v, w in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(volume, na * nb * nc + ab * nc + bc * na + ca * nb)


def trefoil(n: int) -> Array:
    t = math.tau * np.arange(n) / n
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    return closed_tangents(np.column_stack((x, y, np.sin(3 * t))))


def figure_eight(n: int, lift: float) -> Array:
    t = math.tau * (np.arange(n) + 0.25) / n
    return closed_tangents(np.column_stack((np.sin(2 * t), 2 * np.sin(t), lift * np.cos(t))))


def circle(n: int) -> tuple[Array, Array]:
    """Tangents and radial directions (N, 3) at the middles of a regular polygon's edges."""
    t = math.tau * np.arange(n) / n
    zero = np.zeros(n)
    return np.column_stack((-np.sin(t), np.cos(t), zero)), np.column_stack((np.cos(t), np.sin(t), zero))


def twisted_circle(n: int, half_twists: int, phase: float = 0.3) -> tuple[Array, Array, int]:
    """A ribbon about a circle whose binormal turns evenly from e_z towards e_r, right-handed about u."""
    u, radial = circle(n)
    angle = (half_twists * math.pi * np.arange(n) / n + phase)[:, None]
    g = np.cos(angle) * [0.0, 0.0, 1.0] + np.sin(angle) * radial
    return u, g, (-1) ** half_twists


def rotation(seed: int) -> Array:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.asarray(q * np.linalg.det(q))


def random_band(n: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return closed_tangents(rng.normal(size=(n, 3))), rng.normal(size=(n, 3))


def gauss_linking(first: Array, second: Array) -> float:
    """Gauss double integral of two closed curves by the midpoint rule, without solid angles or twist."""
    d1, d2 = np.roll(first, -1, axis=0) - first, np.roll(second, -1, axis=0) - second
    r = (first + d1 / 2)[:, None] - (second + d2 / 2)[None, :]
    volume = np.einsum("ijk,ijk->ij", r, np.cross(d1[:, None], d2[None, :]))
    return float((volume / np.linalg.norm(r, axis=2) ** 3).sum() / (4 * math.pi))


@pytest.mark.parametrize("n", [3, 4, 50, 801])
def test_ring_has_no_linking_twist_or_writhe(n: int) -> None:
    u, _ = circle(n)
    result = linking_number(u, np.tile([0.0, 0.0, 1.0], (n, 1)), 1, math.tau / n)
    assert abs(result.twist) < 1e-12
    assert abs(result.writhe) < 1e-12
    assert abs(result.linking_number) < 1e-12
    assert result.exact


@pytest.mark.parametrize("half_twists", [-3, -1, 0, 1, 2, 3, 7])
@pytest.mark.parametrize("n", [40, 257])
def test_twisted_circle_links_by_half_its_half_twists(n: int, half_twists: int) -> None:
    u, g, sigma = twisted_circle(n, half_twists)
    result = linking_number(u, g, sigma, math.tau / n)
    assert result.twist == pytest.approx(half_twists / 2, abs=1e-12)
    assert result.writhe == pytest.approx(0, abs=1e-12)
    assert result.linking_number == pytest.approx(half_twists / 2, abs=1e-12)
    assert result.exact


def test_wrong_sigma_is_not_taken_for_exact() -> None:
    u, g, sigma = twisted_circle(60, 1)
    good = linking_number(u, g, sigma, 0.1)
    assert not topology.Linking(good.linking_number, good.twist, good.writhe, -sigma).exact


@pytest.mark.parametrize("turn", [0.0, 1.0, -2.5, math.pi, 5.0, 3 * math.pi])
def test_open_turn_counts_whole_turns(turn: float) -> None:
    n = 64
    u, radial = circle(n)
    angle = (turn * np.arange(n) / (n - 1))[:, None]
    g = np.cos(angle) * [0.0, 0.0, 1.0] + np.sin(angle) * radial
    q = rotation(4)
    assert open_turn(u @ q, g @ q, 0.1) == pytest.approx(turn / math.tau, abs=1e-12)


@pytest.mark.parametrize("turns", [-2, 0, 1, 3])
def test_linking_number_is_that_of_gauss(turns: int) -> None:
    """The definition: linking of the midline with its push-off, on a knotted and on an unknotted curve."""
    n, h, push = 400, math.tau / 400, 0.05
    for u in (trefoil(n), figure_eight(n, 1.0)):
        p = h * np.vstack((np.zeros(3), np.cumsum(u, axis=0)[:-1]))
        e = np.cross(u, [0.3, -0.2, 0.9])
        e /= np.linalg.norm(e, axis=1)[:, None]
        angle = (math.tau * turns * np.arange(n) / n)[:, None]
        g = np.cos(angle) * e + np.sin(angle) * np.cross(u, e)
        expected = gauss_linking(p + h * u / 2, p + h * u / 2 + push * g)
        result = linking_number(u, g, 1, h)
        assert result.linking_number == pytest.approx(round(expected), abs=1e-10)
        assert expected == pytest.approx(round(expected), abs=0.02)


@pytest.mark.parametrize("n", [5, 8, 20, 75, 300])
@pytest.mark.parametrize("seed", range(4))
def test_writhe_is_the_double_integral_on_random_polygons(n: int, seed: int) -> None:
    u = random_band(n, seed)[0]
    assert writhe(u, 0.1) == pytest.approx(writhe_reference(u, 0.1), abs=1e-10)


@pytest.mark.parametrize("n", [30, 121, 300])
def test_writhe_of_a_trefoil(n: int) -> None:
    u = trefoil(n)
    assert writhe(u, 1.0) == pytest.approx(writhe_reference(u, 1.0), abs=1e-10)
    assert 3 < writhe(u, 1.0) < 3.5  # right-handed: three positive crossings, slightly steep
    assert writhe(u * [1, 1, -1], 1.0) == pytest.approx(-writhe(u, 1.0), abs=1e-10)


def test_blackboard_framing_of_a_trefoil_links_three_times() -> None:
    u = trefoil(90)
    result = linking_number(u, np.tile([0.0, 0.0, 1.0], (90, 1)), 1, 0.1)
    assert result.linking_number == pytest.approx(3, abs=1e-12)


def test_skew_square_does_not_writhe() -> None:
    """Vertices (+-1, 0, c), (0, +-1, -c): a mirror image followed by a quarter turn gives the same polygon.

    So its writhe is zero, at every c.
    """
    for c in (0.0, 0.2, 1.0):
        p = np.array([[1.0, 0, c], [0, 1, -c], [-1, 0, c], [0, -1, -c]])
        edges = np.roll(p, -1, axis=0) - p
        h = float(np.linalg.norm(edges[0]))
        assert writhe_reference(edges / h, h) == pytest.approx(0, abs=1e-14)
        assert writhe(edges / h, h) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_planar_curves_do_not_writhe(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = math.tau * np.arange(150) / 150
    radius = 1 + 0.25 * rng.normal(size=4) @ np.cos(np.outer(np.arange(1, 5), t)) / 2
    flat = np.column_stack((radius * np.cos(t), radius * np.sin(t), np.zeros(150)))
    assert writhe(closed_tangents(flat) @ rotation(seed), 0.1) == pytest.approx(0, abs=1e-11)


@pytest.mark.parametrize("seed", range(20))
def test_every_pair_of_edges_that_can_meet_is_looked_at(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(4, 90))
    edges = random.standard_normal((count, 2)) * random.choice([0.01, 1.0], size=(count, 1))
    edges -= edges.mean(axis=0)
    starts = np.cumsum(edges, axis=0) * random.choice([0.1, 1.0])
    found = list(zip(*(a.tolist() for a in topology._near_pairs(starts, edges)), strict=True))
    assert len(set(found)) == len(found)
    middles = starts + edges / 2
    apart = np.linalg.norm(middles[:, None] - middles, axis=2)
    near = apart <= np.linalg.norm(edges, axis=1).max()
    for i, j in np.argwhere(np.triu(near, 2)).tolist():
        assert (i, j) in found or j - i == count - 1


def test_straight_runs_of_edges_are_no_crossings() -> None:
    side = np.repeat(np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), 25, axis=0)
    for seed in range(20):
        assert writhe(side @ rotation(seed), 0.1) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("lift", [0.3, 1e-2, 1e-5])
def test_lifted_figure_eight(lift: float) -> None:
    u = figure_eight(120, lift)
    up, down = writhe(u, 0.1), writhe(u * [1, 1, -1], 0.1)
    assert up == pytest.approx(writhe_reference(u, 0.1), abs=1e-10)
    assert up == pytest.approx(-down, abs=1e-10)
    assert abs(up) == pytest.approx(1, abs=2 * lift)


def test_curve_that_meets_itself_has_no_writhe() -> None:
    with pytest.raises(ValueError, match="meets itself"):
        writhe(figure_eight(120, 0.0), 0.1)


def test_projection_along_an_edge_is_avoided() -> None:
    """The curve is turned so that an edge lies along each of the first directions in turn."""
    u = trefoil(60)
    expected = writhe_reference(u, 0.1)
    for k, (z, plane) in enumerate(topology._views()[:6]):
        source, target = np.linalg.svd(u[7 * k][None])[2], np.linalg.svd(z[None])[2]
        source[0], target[0] = u[7 * k], z
        source[2] *= np.sign(np.linalg.det(source))
        target[2] *= np.sign(np.linalg.det(target))
        turned = u @ source.T @ target
        assert turned[7 * k] == pytest.approx(z)
        assert topology._writhe_along(turned, np.cumsum(0.1 * turned, axis=0), 0.1, z, plane) is None
        assert writhe(turned, 0.1) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("seed", range(6))
def test_every_framed_polygon_links_exactly(seed: int, sigma: int) -> None:
    u, g = random_band(64, seed)
    assert linking_number(u, g, sigma, 0.1).exact


@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("seed", range(3))
def test_rotation_scale_relabelling_and_mirror(seed: int, sigma: int) -> None:
    u, g = random_band(50, seed)
    base = linking_number(u, g, sigma, 0.1)
    q = rotation(seed)
    shifted = np.roll(g, -13, axis=0)
    shifted[-13:] *= sigma
    same = (
        linking_number(u @ q, g @ q, sigma, 0.1),
        linking_number(u, 3 * g, sigma, 7.0),
        linking_number(u, -g, sigma, 0.1),
        linking_number(np.roll(u, -13, axis=0), shifted, sigma, 0.1),
    )
    for other in same:
        assert (other.linking_number, other.twist, other.writhe) == pytest.approx(
            (base.linking_number, base.twist, base.writhe), abs=1e-10
        )
    flip = np.array([1.0, -1.0, 1.0])
    mirror = linking_number(u * flip, g * flip, sigma, 0.1)
    assert (mirror.linking_number, mirror.twist, mirror.writhe) == pytest.approx(
        (-base.linking_number, -base.twist, -base.writhe), abs=1e-10
    )


def test_reversing_the_band_keeps_its_handedness() -> None:
    u, g, sigma = twisted_circle(70, 3)
    back = linking_number(-u[::-1], g[::-1], sigma, 0.1)
    assert back.linking_number == pytest.approx(1.5, abs=1e-12)


def test_stored_minimum_is_a_right_handed_half_twist() -> None:
    with np.load(DATA / "pi-b0.1-N50-second-minimum.npz") as stored:
        u, g, sigma = stored["u"], stored["g"], int(stored["sigma"])
    result = linking_number(u, g, sigma, math.tau / 50)
    assert sigma == -1
    assert result.exact
    assert result.linking_number == pytest.approx(0.5, abs=1e-10)
    assert result.writhe == pytest.approx(writhe_reference(u, math.tau / 50), abs=1e-12)
    assert twist(u, g, sigma) == pytest.approx(float(twist_angles(u, g, sigma).sum()) / math.tau)


def test_arguments_are_checked() -> None:
    u, g, sigma = twisted_circle(20, 0)
    with pytest.raises(ValueError, match="sigma is 0"):
        twist(u, g, 0)
    with pytest.raises(ValueError, match="must agree"):
        twist(u, g[:-1], sigma)
    with pytest.raises(ValueError, match="shape"):
        writhe(u[:2], 0.1)
    with pytest.raises(ValueError, match="edge length"):
        writhe(u, 0.0)
    with pytest.raises(ValueError, match="midline is open"):
        writhe(np.tile([1.0, 0, 0], (9, 1)), 0.1)
    with pytest.raises(ValueError, match="not finite"):
        writhe(np.where(u > 0.99, np.nan, u), 0.1)
    with pytest.raises(ValueError, match="at node 1 is zero"):
        twist(u, np.zeros_like(g), sigma)
    back = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    with pytest.raises(ValueError, match="folded back"):
        twist(back, np.tile([0.0, 0, 1], (4, 1)), 1)
