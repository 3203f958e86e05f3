"""Shapes: depth order, the two sides, views, and places along the band."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.export.fields import even_window, field, inflections
from ribbon_cli.export.mesh import facet_corners, facet_normals, strip
from ribbon_cli.export.view import automatic_view, principal_axes, view_along, view_in_axes
from ribbon_cli.plot.outline import SPECK, _edge
from ribbon_cli.plot.painter import depth_order, hidden
from ribbon_cli.plot.pictures import _common_views
from ribbon_cli.plot.shape import _shaded, _sides, _spread, shown_sides
from ribbon_cli.plot.style import SIDES
from ribbon_cli.store import StateRecord


def rectangle(
    right: float, up: float, wide: float, high: float, depth: float, slope: float = 0.0
) -> np.ndarray:
    """A rectangle about a point of the picture whose depth rises by `slope` per unit to the right."""
    corners = np.array([[-wide, -high], [wide, -high], [wide, high], [-wide, high]]) + np.array([right, up])
    return np.column_stack((corners, depth + slope * (corners[:, 0] - right)))


def nearest_by_painting(polygons: np.ndarray, order: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which polygon shows at each point when painted in an order."""
    shown = np.full(len(points), -1)
    for k in order:
        shown[inside(polygons[k], points)] = k
    return shown


def inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    edge = np.roll(polygon[:, :2], -1, axis=0) - polygon[:, :2]
    gap = points[:, None] - polygon[None, :, :2]
    turn = edge[None, :, 0] * gap[..., 1] - edge[None, :, 1] * gap[..., 0]
    return (turn > 0).all(axis=1) | (turn < 0).all(axis=1)


def depth_at(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
    return polygon[0, 2] - ((points - polygon[0, :2]) @ normal[:2]) / normal[2]


def nearest_by_depth(polygons: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which polygon is nearest to the eye at each point."""
    shown, top = np.full(len(points), -1), np.full(len(points), -np.inf)
    for k, polygon in enumerate(polygons):
        depth = np.where(inside(polygon, points), depth_at(polygon, points), -np.inf)
        shown = np.where(depth > top, k, shown)
        top = np.maximum(depth, top)
    return shown


def test_a_long_facet_is_not_sorted_by_its_centre():
    # The long one's centre is nearer to the eye than the short one, but where they overlap it lies behind.
    long = rectangle(0.0, 0.0, 10.0, 1.0, 0.0, slope=-1.0)
    short = rectangle(5.0, 0.0, 1.0, 0.5, -3.0)
    order, covered = depth_order(np.stack((short, long)))
    assert order.tolist() == [1, 0]
    assert covered.tolist() == [0, 1]


def test_facets_that_go_round_in_a_circle_are_all_painted():
    angles = np.radians([0.0, 120.0, 240.0])
    bar = rectangle(0.0, 1.0, 3.0, 0.3, 0.0, slope=0.4)
    turned = []
    for a in angles:
        c, s = np.cos(a), np.sin(a)
        flat = bar[:, :2] @ np.array([[c, s], [-s, c]])
        turned.append(np.column_stack((flat, bar[:, 2])))
    order, _ = depth_order(np.array(turned))
    assert sorted(order.tolist()) == [0, 1, 2]


@pytest.mark.parametrize("name", ["mobius", "ring"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_band_is_painted_as_it_is_seen(name, seed, solved):  # noqa: F811
    """At points all over the picture, the facet painted last is the one nearest to the eye."""
    random = np.random.default_rng(seed)
    corners = facet_corners(states_of(solved, name)[-1])
    view = view_along(random.standard_normal(3), np.array([0.0, 0.0, 1.0]))
    flat = view.project(corners)
    order, _ = depth_order(flat)
    assert sorted(order.tolist()) == list(range(len(flat)))
    low, high = flat[..., :2].min(axis=(0, 1)), flat[..., :2].max(axis=(0, 1))
    points = low + (high - low) * random.random((3000, 2))
    assert (nearest_by_painting(flat, order, points) == nearest_by_depth(flat, points)).all()


@pytest.mark.parametrize("seed", range(4))
def test_sides_change_at_outlines_only(seed, solved):  # noqa: F811
    """Two facets side by side have different colours only where the surface turns over in the picture."""
    state = states_of(solved, "mobius")[-1]
    eye = np.random.default_rng(seed).standard_normal(3)
    view = view_along(eye, np.array([0.0, 0.0, 1.0]))
    flat = view.project(facet_corners(state))
    _, covered = depth_order(flat)
    facing = facet_normals(state) @ view.eye
    side = _sides(facing, covered, state.sigma, flat)
    following = np.append(side[1:], side[0])
    front = facing > 0
    turns_over = front != np.append(front[1:], ~front[0])
    assert turns_over[side != following].all()
    # Of an odd number of outlines all but one change the colour.
    assert turns_over.sum() % 2 == 1
    assert (side != following).sum() == turns_over.sum() - 1


def test_colours_stay_along_a_family(solved):  # noqa: F811
    """Of neighbours seen from one side, most of the length has the same colour, on another grid as well."""
    records = states_of(solved, "mobius")
    assert {record.segments for record in records} == {24, 48}
    corners = [facet_corners(record) for record in records]
    views = _common_views(corners, None)
    for like, seen in [(0, 1), (1, 0), (0, 3), (3, 0)]:
        sides = shown_sides(records[like], views[like])
        for given in (sides, ~sides):
            found = shown_sides(records[seen], views[seen], given)
            n = found.size
            assert np.mean(found == given[np.arange(n) * given.size // n]) > 0.8


def test_light_does_not_know_the_seam(solved):  # noqa: F811
    """Naming the rulings the other way round swaps the sides' colours, and leaves each facet its light."""
    state = states_of(solved, "ring")[-1]
    normals = facet_normals(state)
    other = facet_normals(replace(state, g=-state.g, g_end=-state.g_end))
    np.testing.assert_allclose(other, -normals, atol=1e-14)
    side = np.arange(state.segments) % 2 == 0
    light = automatic_view(facet_corners(state)).light
    np.testing.assert_array_equal(
        _shaded(side, np.abs(normals @ light)), _shaded(side, np.abs(other @ light))
    )


def test_the_view_turns_with_the_band(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    corners = facet_corners(state)
    one = automatic_view(corners).project(corners)
    other = automatic_view(corners @ turn.T).project(corners @ turn.T)
    np.testing.assert_allclose(np.ptp(one, axis=(0, 1)), np.ptp(other, axis=(0, 1)), atol=1e-6)


def test_views_are_right_handed_and_level():
    for view in (
        view_along(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])),
        view_along([1, 2, 3], [0, 0, 1]),
    ):
        np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.axes) == pytest.approx(1.0)
    points = np.random.default_rng(3).standard_normal((50, 4, 3)) * [3.0, 2.0, 1.0]
    axes = principal_axes(points.reshape(-1, 3))
    np.testing.assert_allclose(view_in_axes(points, 0.0, 0.0).eye, axes[2], atol=1e-12)
    np.testing.assert_allclose(view_in_axes(points, 90.0, 0.0).eye, axes[0], atol=1e-12)
    with pytest.raises(ValueError, match="not zero"):
        view_along(np.zeros(3), np.array([0.0, 0.0, 1.0]))


def test_the_two_sides_differ_in_grey_as_well():
    from matplotlib.colors import to_rgb

    grey = [np.dot(to_rgb(colour), [0.299, 0.587, 0.114]) for colour in SIDES]
    assert abs(grey[0] - grey[1]) > 0.05


# --- places along the band ---


def test_inflections_are_found_between_nodes(solved):  # noqa: F811
    (state, *_) = states_of(solved, "mobius")
    n = state.segments
    alpha = np.arange(n) * state.length / n
    made = replace(state, kappa_s=np.cos(0.5 * (alpha - 1.0)), sigma=-1)
    np.testing.assert_allclose(inflections(made), [1.0 + np.pi], atol=2e-3)
    assert inflections(replace(state, kappa_s=np.cos(alpha) + 2.0, sigma=1)).size == 0


def test_inflections_are_found_among_flat_nodes(solved):  # noqa: F811
    """As in the constructions of bands with n half-twists; interpolation is exact for a linear curvature."""
    (state, *_) = states_of(solved, "mobius")
    n = state.segments
    slope = 1.0 + np.pi - np.arange(n) * state.length / n
    flat = np.where(np.abs(slope) < 0.4, 1e-12 * slope, slope)
    for kappa in (slope, flat, np.where(np.arange(n) == 3, 0.0, slope)):
        found = inflections(replace(state, kappa_s=kappa, sigma=-1))
        np.testing.assert_allclose(found, [1.0 + np.pi], atol=1e-12)
    assert inflections(state).size == 1
    assert inflections(replace(state, kappa_s=np.zeros(n))).size == 0


@pytest.mark.parametrize(("n", "most"), [(10, 72), (73, 72), (160, 72), (3200, 72), (3200, 24)])
def test_rulings_are_spread_evenly_across_the_seam(n, most):
    places = np.flatnonzero(_spread(n, most))
    gaps = np.diff(np.append(places, n))
    assert places.size <= most
    assert gaps.max() - gaps.min() <= 1


@pytest.mark.parametrize("shift", [0, 1, 7, 20])
def test_moving_the_seam_changes_no_picture(shift, solved: Path):  # noqa: F811
    """The same band with its seam elsewhere: fields come out the same, sign included."""
    state = states_of(solved, "mobius")[-1]
    moved = relabelled(state, shift)
    for name in ("kappa_s", "tau", "eta", "eta_prime", "lambda_1", "lambda_3", "lambda_5"):
        alpha, values = field(state, name, even_window(state))
        other, same = field(moved, name, even_window(moved))
        np.testing.assert_allclose(other, alpha, atol=1e-9)
        np.testing.assert_allclose(same, values, atol=1e-9)


def relabelled(state: StateRecord, shift: int) -> StateRecord:
    """A one-sided band whose node 1 is what was node 1 + shift."""
    odd = ("kappa_s", "eta", "eta_prime", "xi", "lambda_3", "lambda_5", "g")
    even = ("tau", "lambda_1", "lambda_2", "lambda_4", "u")
    changes = {}
    for name in (*odd, *even):
        values = np.roll(getattr(state, name), -shift, axis=0)
        if name in odd and shift:
            values[-shift:] *= -1.0
        changes[name] = values
    walk = np.vstack((np.zeros(3), np.cumsum(changes["u"], axis=0) * state.length / state.segments))
    return replace(state, midline=walk, g_end=-changes["g"][0], **changes)


def test_inflections_lie_evenly(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    window = even_window(state)
    h = state.length / state.segments
    (place,) = (inflections(state) - window.first * h + window.offset) % state.length
    assert place == pytest.approx(state.length / 2)
    _, kappa = field(state, "kappa_s", window)
    assert (kappa[2:20] > 0).all()


def test_points_behind_a_facet_are_hidden():
    sheet = rectangle(0.0, 0.0, 1.0, 1.0, 0.0, slope=0.5)
    other = rectangle(5.0, 0.0, 1.0, 1.0, 0.0)
    # Behind, in front, beside, and on the sheet that it belongs to.
    points = np.array([[0.5, 0.0, 0.2], [0.5, 0.0, 0.3], [1.5, 0.0, -1.0], [0.0, 0.0, -1.0]])
    owners = np.array([[1], [1], [1], [0]])
    assert hidden(points, owners, np.stack((sheet, other))).tolist() == [True, False, False, False]


@pytest.mark.parametrize("name", ["mobius", "ring"])
def test_edges_are_drawn_where_they_are_seen(name, solved):  # noqa: F811
    """Against the nearest facet at points of the edges, but for specks that are left out."""
    state = states_of(solved, name)[-1]
    corners = facet_corners(state)
    flat = automatic_view(corners).project(corners - corners.reshape(-1, 3).mean(axis=0))
    size = float(np.ptp(flat[:, :, :2], axis=(0, 1)).max())
    for side in ((1, 2), (0, 3)):
        points = 0.3 * flat[:, side[0]] + 0.7 * flat[:, side[1]]
        over = [
            max(
                (
                    depth_at(p, q[None, :2])[0]
                    for j, p in enumerate(flat)
                    if j != i and inside(p, q[None, :2])[0]
                ),
                default=-np.inf,
            )
            for i, q in enumerate(points)
        ]
        seen = points[:, 2] > np.array(over) - 1e-9
        lines = _edge(flat, side, strip(state))
        drawn = np.array([min(_distance(q[:2], line) for line in lines) for q in points]) < 1e-6 * size
        assert (drawn != seen).mean() <= 2 * SPECK


def _distance(point: np.ndarray, line: np.ndarray) -> float:
    """Distance of a point of the picture from a line of several pieces."""
    a, d = line[:-1], np.diff(line, axis=0)
    t = np.clip(((point - a) * d).sum(axis=1) / np.maximum((d**2).sum(axis=1), 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(a + t[:, None] * d - point, axis=1).min())
