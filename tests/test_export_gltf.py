"""Binary glTF files, read back by trimesh."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.export.mesh import FACET_FIELDS, NODE_FIELDS, ODD_FIELDS, facet_corners, facet_normals
from ribbon_cli.store import StateRecord, Summary


@pytest.fixture(params=["mobius", "ring", "open"])
def state(request: pytest.FixtureRequest, solved: Path) -> StateRecord:  # noqa: F811
    """A one-sided band, a two-sided one, and a strip whose seam is open."""
    if request.param == "open":
        return states_of(solved, "mobius", "auxiliary")[4]
    return states_of(solved, request.param)[-1]


def document_of(data: bytes) -> dict[str, Any]:
    """The JSON of a binary file, whose chunks fill it."""
    assert data[:4] == b"glTF"
    version, size, length = (int.from_bytes(data[k : k + 4], "little") for k in (4, 8, 12))
    assert (version, size, data[16:20]) == (2, len(data), b"JSON")
    rest = data[20 + length :]
    assert rest[4:8] == b"BIN\0"
    assert int.from_bytes(rest[:4], "little") == len(rest) - 8
    return json.loads(data[20 : 20 + length], parse_constant=pytest.fail)


def read(data: bytes) -> trimesh.Trimesh:
    (mesh,) = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False).geometry.values()
    return mesh


def written(data: bytes, name: str) -> np.ndarray:
    """An attribute as the file has it: trimesh makes up normals where it finds none."""
    document = document_of(data)
    (primitive,) = document["meshes"][0]["primitives"]
    accessor = document["accessors"][primitive["attributes"][name]]
    view = document["bufferViews"][accessor["bufferView"]]
    binary = data[-document["buffers"][0]["byteLength"] :][view["byteOffset"] :][: view["byteLength"]]
    return np.frombuffer(binary, "<f4").reshape(accessor["count"], -1)


def test_the_surface_is_read_back(state):
    mesh = read(glb_bytes(state, "a band", None))
    corners = facet_corners(state).astype(np.float32)
    np.testing.assert_array_equal(np.reshape(mesh.vertices, (-1, 4, 3)), corners)
    assert len(mesh.faces) == 2 * state.segments
    # No facet shares a corner with another, and its two triangles cover it.
    assert (mesh.faces // 4 == np.repeat(np.arange(state.segments), 2)[:, None]).all()
    area = 2 * state.half_width * state.length
    assert mesh.area == pytest.approx(area, rel=1e-5)


def test_normals_are_those_of_facets_and_of_their_front(state):
    data = glb_bytes(state, "a band", None)
    mesh = read(data)
    normals = np.repeat(facet_normals(state), 4, axis=0)
    np.testing.assert_array_equal(written(data, "NORMAL"), normals.astype(np.float32))
    np.testing.assert_allclose(mesh.vertex_normals, normals, atol=1e-6)
    front = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    assert (np.einsum("ij,ij->i", front, normals[mesh.faces[:, 0]]) > 0).all()


def test_both_sides_are_seen(state):
    assert read(glb_bytes(state, "a band", None)).visual.material.doubleSided is True


def test_fields_are_attributes(state):
    found = read(glb_bytes(state, "a band", None)).vertex_attributes
    closed = state.kind == "equilibrium"
    names = {*FACET_FIELDS, *(NODE_FIELDS if closed else ())}
    assert {name for name in found if name.startswith("_")} == {f"_{name.upper()}" for name in names}
    for name in names:
        # Corners are those of -b g_i, +b g_i, +b g_{i+1}, -b g_{i+1}.
        values = np.reshape(found[f"_{name.upper()}"], (-1, 4))
        near = getattr(state, name)
        far = near
        if name in NODE_FIELDS:
            far = np.roll(near, -1)
            far[-1] *= state.sigma if name in ODD_FIELDS else 1
        np.testing.assert_array_equal(values, np.column_stack((near, near, far, far)).astype(np.float32))


def test_what_is_not_known_is_left_out(solved):  # noqa: F811
    """glTF has no not-a-number: no zero stands for one."""
    state = states_of(solved, "ring")[0]
    made = replace(state, lambda_4=np.full(state.segments, np.nan), energy=np.nan)
    data = glb_bytes(made, "a band", None)
    (primitive,) = document_of(data)["meshes"][0]["primitives"]
    assert "_LAMBDA_4" not in primitive["attributes"]
    assert "_LAMBDA_1" in primitive["attributes"]
    assert document_of(data)["asset"]["extras"]["state"]["energy"] is None


def test_the_file_says_what_it_shows(state):
    asset = document_of(glb_bytes(state, "a band", "run-1"))["asset"]
    assert asset["version"] == "2.0"
    assert asset["extras"] == {"title": "a band", "state": Summary.of(state).listed("run-1")}


def test_bounds_are_those_of_the_numbers(state):
    data = glb_bytes(state, "a band", None)
    accessor = document_of(data)["accessors"][0]
    corners = facet_corners(state).reshape(-1, 3).astype(np.float32)
    assert accessor["min"] == corners.min(axis=0).tolist()
    assert accessor["max"] == corners.max(axis=0).tolist()
