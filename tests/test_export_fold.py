"""FOLD files: the flat strip, folded by the angles of the file alone, is the strip in space."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import ribbon
from picture_support import solved, states_of  # noqa: F401
from test_fold_pattern import lines

from ribbon_cli.errors import UsageError
from ribbon_cli.export.fold import fold_bytes
from ribbon_cli.export.mesh import facet_corners, is_closed
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.svg import pattern_svg
from ribbon_cli.store import StateRecord, Summary

Array = np.ndarray


@pytest.fixture(params=["mobius", "ring", "open"])
def state(request: pytest.FixtureRequest, solved: Path) -> StateRecord:  # noqa: F811
    """A one-sided band, a two-sided one, and a strip whose seam is open."""
    if request.param == "open":
        return states_of(solved, "mobius", "auxiliary")[4]
    return states_of(solved, request.param)[-1]


def frames_of(data: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """The key frame and frame 1, with what this inherits."""
    key = json.loads(data, parse_constant=pytest.fail)
    (child,) = key["file_frames"]
    assert child["frame_inherit"] is True
    assert child["frame_parent"] == 0
    return key, {name: value for name, value in key.items() if not name.startswith("file_")} | child


def coordinates(frame: dict[str, Any]) -> Array:
    """Vertices (V, 3), z = 0 where a frame is flat."""
    points = np.array(frame["vertices_coords"])
    return np.column_stack((points, np.zeros((len(points), 3 - points.shape[1]))))


def across(frame: dict[str, Any]) -> list[tuple[int, int, int]]:
    """Edges with two faces: edge, the face on its left and the face on its right, as faces go round."""
    goes = {
        (face[k], face[(k + 1) % len(face)]): number
        for number, face in enumerate(frame["faces_vertices"])
        for k in range(len(face))
    }
    pairs = [(goes.get((a, b)), goes.get((b, a))) for a, b in frame["edges_vertices"]]
    return [
        (e, left, right) for e, (left, right) in enumerate(pairs) if left is not None and right is not None
    ]


def turn(axis: Array, angle: float) -> Array:
    """The rotation (3, 3) by an angle about a unit axis, after Rodrigues."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def folded(frame: dict[str, Any]) -> Array:
    """Corners (F, 4, 3) of faces 0, 1, ... of a flat strip, folded by its angles; face 0 stays.

    A valley lifts the face on the right of a crease towards the reader of the left one. Creases are taken in
    the direction that has the earlier face on its left.
    """
    points, faces = coordinates(frame), frame["faces_vertices"]
    rotation, shift = np.eye(3), np.zeros(3)
    out = [points[faces[0]]]
    for edge, left, right in sorted(across(frame), key=lambda item: max(item[1:])):
        a, b = (points[v] for v in frame["edges_vertices"][edge])
        assert abs(left - right) == 1
        if left > right:
            a, b = b, a
        axis = (b - a) / np.linalg.norm(b - a)
        crease = turn(axis, -np.radians(frame["edges_foldAngle"][edge]))
        rotation, shift = rotation @ crease, shift + rotation @ (a - crease @ a)
        out.append(points[faces[len(out)]] @ rotation.T + shift)
    return np.array(out)


def test_the_flat_strip_folds_into_the_band(state):
    flat, space = frames_of(fold_bytes(state, "a band", None))
    made = folded(flat)
    given = coordinates(space)[space["faces_vertices"]]
    assert len(made) == state.segments
    # Laid onto each other by the first facet, which is not moved: both have its frame.
    legs = [np.stack((c[0, 1] - c[0, 0], c[0, 3] - c[0, 0])) for c in (made, given)]
    bases = [np.vstack((leg, np.cross(*leg))) for leg in legs]
    place = np.linalg.solve(*bases)
    np.testing.assert_allclose(place @ place.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose((made - made[0, 0]) @ place + given[0, 0], given, atol=1e-8)


def test_the_strip_in_space_is_the_state(state):
    _, space = frames_of(fold_bytes(state, "a band", None))
    corners = coordinates(space)[space["faces_vertices"]]
    # Facets of other surfaces go round the other way, and begin with -b g_i as well.
    np.testing.assert_allclose(corners[:, [0, 3, 2, 1]], facet_corners(state), atol=1e-9)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normal, np.cross(state.u, state.g)) > 0).all()


def test_edges_are_as_long_flat_as_in_space(state):
    flat, space = frames_of(fold_bytes(state, "a band", None))
    edges = np.array(flat["edges_vertices"])
    assert len({frozenset(edge) for edge in edges.tolist()}) == len(edges) == 3 * state.segments + 1
    one, other = (
        np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
        for points in (coordinates(flat), coordinates(space))
    )
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_flat_faces_are_upside_up_and_do_not_overlap(state):
    flat, _ = frames_of(fold_bytes(state, "a band", None))
    x, y, _ = np.moveaxis(coordinates(flat)[flat["faces_vertices"]], 2, 0)
    area = 0.5 * (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    assert area.min() > 0
    assert area.sum() == pytest.approx(2 * state.half_width * state.length, rel=1e-12)
    assert np.ptp(y) == pytest.approx(2 * state.half_width, rel=1e-12)


def test_assignments_go_with_faces_and_angles(state):
    flat, _ = frames_of(fold_bytes(state, "a band", None))
    inner = {edge for edge, _, _ in across(flat)}
    letters, angles = flat["edges_assignment"], flat["edges_foldAngle"]
    assert len(letters) == len(angles) == len(flat["edges_vertices"])
    assert len(inner) == state.segments - 1
    for edge, (letter, angle) in enumerate(zip(letters, angles, strict=True)):
        wanted = ("V" if angle > 0 else "M" if angle < 0 else "F") if edge in inner else "B"
        assert letter == wanted
        assert abs(angle) <= (180.0 if edge in inner else 0.0)


def test_mountains_are_those_of_the_fold_pattern(solved):  # noqa: F811
    for name in ("mobius", "ring"):
        state = states_of(solved, name)[-1]
        flat, _ = frames_of(fold_bytes(state, "a band", None))
        printed = lines(pattern_svg(fold_pattern(state, state.length), "a band"), "data-node")
        letters = {"mountain": "M", "valley": "V", "flat": "F"}
        assert [letters[a["class"]] for a, _ in printed] == flat["edges_assignment"][1 : len(printed) + 1]
        angles = [-float(a["data-angle"]) for a, _ in printed]
        np.testing.assert_allclose(flat["edges_foldAngle"][1 : len(printed) + 1], angles, atol=1e-9)
        ends = coordinates(flat)[flat["edges_vertices"][1 : len(printed) + 1]][:, ::-1, :2]
        np.testing.assert_allclose(ends, [e for _, e in printed], atol=1e-8)


def test_a_fold_that_is_none_is_flat(solved):  # noqa: F811
    ring = states_of(solved, "ring")[0]
    kappa = ring.kappa_s.copy()
    kappa[3] = 1e-10
    flat, _ = frames_of(fold_bytes(replace(ring, kappa_s=kappa), "a band", None))
    assert (flat["edges_assignment"][3], flat["edges_foldAngle"][3]) == ("F", 0.0)


def test_the_seam_is_told(state):
    flat, space = frames_of(fold_bytes(state, "a band", None))
    if not is_closed(state):
        assert "frame_ribbon:seam" not in flat
        assert "The strip is open." in flat["file_description"]
        return
    seam, points = flat["frame_ribbon:seam"], coordinates(space)
    for one, other in seam["vertices"]:
        np.testing.assert_allclose(points[one], points[other], atol=1e-8)
    assert [sorted(flat["edges_vertices"][e]) for e in seam["edges"]] == [
        sorted(pair[k] for pair in seam["vertices"]) for k in (0, 1)
    ]
    assert ("one-sided" in flat["file_description"]) == (state.sigma < 0)
    # Signed by the first face's upper side, which the last one's is on a two-sided band.
    corners = points[space["faces_vertices"]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    low, high = points[flat["edges_vertices"][0]]
    axis = (high - low) / np.linalg.norm(high - low)
    before, after = state.sigma * normal[-1], normal[0]
    angle = np.degrees(np.arctan2(-np.cross(before, after) @ axis, before @ after))
    assert seam["foldAngle"] == pytest.approx(angle, abs=1e-6)
    assert seam["assignment"] == ("V" if angle > 0 else "M")


def test_what_a_file_says_of_itself(state):
    flat, space = frames_of(fold_bytes(state, "a band", "run-1"))
    assert (flat["file_spec"], flat["file_title"], flat["frame_unit"]) == (1.2, "a band", "unit")
    assert flat["file_ribbon:state"] == Summary.of(state).listed("run-1")
    assert (flat["frame_classes"], space["frame_classes"]) == (["creasePattern"], ["foldedForm"])
    assert (flat["frame_attributes"][0], space["frame_attributes"][0]) == ("2D", "3D")
    assert {"manifold", "orientable", "convexFaces"} < set(space["frame_attributes"])
    own = [name for name in (*flat, *space) if name.split("_")[0] not in ("vertices", "edges", "faces")]
    assert all(name.startswith(("file_", "frame_")) for name in own)


def test_a_band_in_two_pieces_has_no_fold_file(solved):  # noqa: F811
    state = replace(states_of(solved, "ring")[0], cut_node=5)
    with pytest.raises(UsageError, match="is in two pieces"):
        fold_bytes(state, "a band", None)


def test_a_run_is_no_fold_file(solved, tmp_path):  # noqa: F811
    result = ribbon("export", "mobius", "--to", "fold", "-o", tmp_path / "x.fold", "--runs", solved)
    assert result.exit_code == 2
    assert "fold takes one state" in result.stderr
