"""Solids for printing: no triangle passes through another, and walls are as thick as asked for."""

from __future__ import annotations

import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cli_support import ribbon, ribbon_json

from ribbon_cli import load_state, solve
from ribbon_cli.config import load_config
from ribbon_cli.export.crossings import crossing_pairs
from ribbon_cli.export.mesh import facet_corners, facet_normals
from ribbon_cli.export.solid import printed, solid
from ribbon_cli.store import StateRecord

DATA = Path(__file__).parent / "data"
CONFIGS = {
    "pi": "topology: {half_twists: -1}\ninitial_guess: {state: pi-b0.5-N50.npz}\nwidths: [0.5, 1.2, 1.5]\n",
    "three": "topology: {half_twists: 3}\ninitial_guess: {state: 3pi-b0.3-N60.npz}\nwidths: [0.3, 0.5]\n"
    "refinement: {levels: [60, 120], at: [0.5]}\n",
}

Point = tuple[int | Fraction, ...]
UNIT = 2**70
"""Corners are integers in this part of a millimetre."""


@pytest.fixture(scope="module")
def bands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: bands with one half-twist up to b = 1.5, and one with three."""
    root = tmp_path_factory.mktemp("solids")
    for path in DATA.glob("*.npz"):
        (root / path.name).write_bytes(path.read_bytes())
    with np.errstate(all="raise", under="ignore"):
        for name, text in CONFIGS.items():
            (root / f"{name}.yaml").write_text(f"{text}spectrum: {{modes: 0, full_up_to: 0}}\n", "utf-8")
            solve(load_config(root / f"{name}.yaml"), runs=root / "runs")
    return root / "runs"


def minus(a: Point, b: Point) -> Point:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def cross(a: Point, b: Point) -> Point:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Point, b: Point) -> int | Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def clipped(polygon: list[Point], normal: Point, origin: Point, sides: tuple[int, ...]) -> list[Point]:
    """The part of a convex polygon where the side of a plane is among `sides`; corners may repeat."""
    heights = [dot(normal, minus(p, origin)) for p in polygon]
    kept = []
    for k, (p, h) in enumerate(zip(polygon, heights, strict=True)):
        if (h > 0) - (h < 0) in sides:
            kept.append(p)
        q, other = polygon[k - 1], heights[k - 1]
        if h * other < 0:
            kept.append(tuple(a + (b - a) * Fraction(h, h - other) for a, b in zip(p, q, strict=True)))
    return kept


def crosses(one: list[Point], other: list[Point]) -> bool:
    """Whether two triangles share more than their common corners or edge: one is clipped by the other."""
    a, b, c = other
    normal = cross(minus(b, a), minus(c, a))
    common = clipped(one, normal, a, (0,))
    for p, q in ((a, b), (b, c), (c, a)):
        common = clipped(common, cross(normal, minus(q, p)), p, (0, 1)) if common else []
    shared = [p for p in one if p in other]
    if len(shared) == 2:
        along = minus(shared[1], shared[0])
        return any(any(cross(along, minus(p, shared[0]))) for p in common)
    return bool(set(common) - set(shared)) or len(shared) == 3


def crossings_in_fractions(points: np.ndarray, triangles: np.ndarray) -> set[tuple[int, int]]:
    """Pairs of triangles that cross, of all whose boxes meet."""
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    meet = (low[:, None] <= high[None]).all(axis=2)
    whole = [[int(x * UNIT) for x in p] for p in points.tolist()]
    assert all(
        n / UNIT == x for p, q in zip(whole, points.tolist(), strict=True) for n, x in zip(p, q, strict=True)
    )
    exact = [[tuple(whole[v]) for v in triangle] for triangle in triangles.tolist()]
    pairs = np.argwhere(np.triu(meet & meet.T, 1)).tolist()
    return {(i, j) for i, j in pairs if crosses(exact[i], exact[j])}


def pairs_of(found: np.ndarray) -> set[tuple[int, int]]:
    return {(min(pair), max(pair)) for pair in found.tolist()}


@pytest.mark.parametrize("seed", range(4))
def test_crossings_are_those_in_fractions(seed):
    """Corners on a coarse lattice: most pairs touch, share corners or edges, or lie in a plane."""
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3 if seed % 2 else 6, size=(24, 3)).astype(float) / 7.0
    all_ = np.array(list(itertools.combinations(range(24), 3)))
    triangles = rng.permutation(all_)[:60]
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangles = triangles[area > 1e-9]
    expected = crossings_in_fractions(points, triangles)
    assert len(expected) > 30
    assert pairs_of(crossing_pairs(points, triangles)) == expected


def states(bands: Path) -> dict[str, StateRecord]:
    names = {"pi 1.2": "pi@b=1.2", "pi 1.5": "pi@b=1.5", "three": "three@b=0.5,N=120"}
    return {key: load_state(name, runs=bands) for key, name in names.items()}


@pytest.mark.parametrize(
    ("name", "thickness"),
    [("pi 1.2", 1.0), ("pi 1.2", 5.0), ("three", 5.0)],
)
def test_no_triangle_of_a_solid_passes_through_another(name, thickness, bands):
    """A midline of 200 mm; where offset facets pass through each other there are 24 to 683 such pairs."""
    state = states(bands)[name]
    body = printed(state, 200.0, thickness)
    assert crossings_in_fractions(body.points, body.triangles) == set()
    assert len(crossing_pairs(body.points, body.triangles)) == 0
    mesh = trimesh.Trimesh(body.points, body.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 0
    assert mesh.volume == pytest.approx(2 * state.half_width * 200 / state.length * 200 * thickness, rel=5e-3)
    assert 0.99 * thickness < body.thinnest <= thickness * (1 + 1e-9)
    assert thickness * (1 - 1e-9) <= body.thickest < 1.05 * thickness


def test_walls_away_from_fans_are_as_thick_as_asked_for(bands):
    """All but the joined corners lie at half the thickness from the planes of two facets."""
    state, thickness = states(bands)["pi 1.2"], 0.06
    body = solid(state, thickness)
    assert body.joined > 10
    corners, normals = facet_corners(state), facet_normals(state)
    heights = np.abs(np.einsum("vfj,fj->vf", body.points[:, None] - corners[None, :, 0], normals))
    beside = np.linalg.norm(body.points[:, None, None] - corners[None], axis=3).min(axis=2) < thickness
    exact = (np.abs(heights - thickness / 2) < 1e-9) & beside
    assert (exact.sum(axis=1) >= 2).sum() >= len(body.points) - body.joined
    assert len(body.points) == 4 * state.segments - body.joined


def test_walls_with_no_room_are_counted_and_named(bands, tmp_path):
    """At b = 1.5 sheets are 0.5 mm from each other: the solid says how many triangles cross."""
    words = ("export", "pi@b=1.5", "--to", "stl", "--runs", bands)
    document = ribbon_json(*words, "-o", tmp_path / "a.stl")
    body = printed(states(bands)["pi 1.5"], 200.0, 1.0)
    count = len(crossings_in_fractions(body.points, body.triangles))
    assert document["crossing_triangles"] == count > 10
    assert document["joined_corners"] == body.joined > 10
    assert document["wall_min"] <= 1.0 <= document["wall_max"]
    result = ribbon(*words, "-o", tmp_path / "b.stl")
    assert result.exit_code == 0
    assert f"warning: {count} pairs of triangles of the solid pass through each other" in result.stderr
    assert "nearer to each other than the wall is thick" in result.stderr
    thin = ribbon(*words, "-o", tmp_path / "c.stl", "--thickness", "0.05")
    assert "warning" not in thin.stderr
    written = trimesh.load_mesh(tmp_path / "a.stl")
    assert written.is_watertight
    assert written.is_winding_consistent
