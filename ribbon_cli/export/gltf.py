"""A band as a binary glTF 2.0 file (.glb), for browsers, slides and Blender.

Every facet has four vertices of its own, with the facet's normal: facets are flat and folded against each
other, and no choice of sides survives the seam of a one-sided band. The material is seen from both sides.
glTF has single precision alone, and no not-a-number.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.arrows import arrow_triangles, per_force
from ribbon_cli.export.contacts import touching
from ribbon_cli.export.mesh import ODD_FIELDS, facet_corners, facet_fields, facet_normals, node_fields, strip
from ribbon_cli.store import StateRecord, Summary

Array = NDArray[np.float64]

MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"
FLOAT, UNSIGNED_INT = 5126, 5125
VERTICES, INDICES = 34962, 34963
KINDS = {1: "SCALAR", 3: "VEC3"}
PAPER = {
    "name": "paper",
    "doubleSided": True,
    "pbrMetallicRoughness": {
        "baseColorFactor": [0.91, 0.87, 0.78, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9,
    },
}
FORCES = PAPER | {
    "name": "forces",
    "pbrMetallicRoughness": {
        "baseColorFactor": [0.45, 0.0, 0.02, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9,
    },
}


def glb_bytes(record: StateRecord, title: str, run: str | None) -> bytes:
    """The surface as triangles, two a facet, in the unit of `length`; fields as attributes `_KAPPA_S` etc.

    The front is the side to which g x u points, as in OBJ and PLY. The same state has the same bytes. Raises
    UsageError for a state with values that are not finite. Forces at contacts are a second mesh, of arrows.
    """
    n = record.segments
    corners = np.arange(4 * n).reshape(n, 4)
    attributes = {
        "POSITION": facet_corners(record).reshape(-1, 3),
        "NORMAL": np.repeat(facet_normals(record), 4, axis=0),
        **{f"_{name.upper()}": values for name, values in _fields(record).items()},
    }
    blocks: list[NDArray[Any]] = [values.astype("<f4") for values in attributes.values()]
    triangles = np.concatenate((corners[:, :3], corners[:, [0, 2, 3]]), axis=1).ravel().astype("<u4")
    extras = {"title": title, "state": Summary.of(record).listed(run)}
    numbers = {name: k for k, name in enumerate(attributes)}
    primitive = {"attributes": numbers, "indices": len(blocks), "material": 0}
    nodes = [{"mesh": 0, "name": "band"}]
    meshes = [{"name": "band", "primitives": [primitive]}]
    materials = [PAPER]
    blocks.append(triangles)
    arrows = _arrows(record)
    if len(arrows[0]):
        first = len(blocks)
        blocks += arrows
        primitive = {
            "attributes": {"POSITION": first, "NORMAL": first + 1},
            "indices": first + 2,
            "material": 1,
        }
        nodes.append({"mesh": 1, "name": "forces"})
        meshes.append({"name": "forces", "primitives": [primitive]})
        materials.append(FORCES)
    document = {
        "asset": {"version": "2.0", "generator": "ribbon", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        **_layout(blocks),
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    data = b"".join(block.tobytes() for block in blocks)
    chunks = _chunk(JSON_CHUNK, text, b" ") + _chunk(BINARY_CHUNK, data, b"\0")
    return MAGIC + _words(VERSION, 12 + len(chunks)) + chunks


def _arrows(record: StateRecord) -> list[NDArray[Any]]:
    """Positions, normals and indices of the triangles of a state's arrows; none without contacts."""
    places, forces = touching(record).arrows
    corners, normals = arrow_triangles(places, per_force([record]) * forces, record.length)
    count = 3 * len(corners)
    return [
        corners.reshape(-1, 3).astype("<f4"),
        np.repeat(normals, 3, axis=0).astype("<f4"),
        np.arange(count).astype("<u4"),
    ]


def _fields(record: StateRecord) -> dict[str, Array]:
    """Fields at the corners (4N,) of facets, each as seen from its facet.

    A field that is not known at every corner is left out.
    """
    rulings = strip(record)
    found = {}
    for name, values in node_fields(record, rulings).items():
        near, far = values[rulings.near], values[rulings.far]
        if rulings.closed and name in ODD_FIELDS:
            far[-1] *= record.sigma
        found[name] = np.column_stack((near, near, far, far)).ravel()
    found |= {name: np.repeat(values, 4) for name, values in facet_fields(record).items()}
    return {name: values for name, values in found.items() if np.isfinite(values).all()}


def _layout(blocks: list[NDArray[Any]]) -> dict[str, Any]:
    """Accessors, views and the buffer of blocks one after another; whole numbers are of triangles."""
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, Any]] = []
    start = 0
    for k, block in enumerate(blocks):
        target, number = (INDICES, UNSIGNED_INT) if block.dtype.kind == "u" else (VERTICES, FLOAT)
        views.append({"buffer": 0, "byteOffset": start, "byteLength": block.nbytes, "target": target})
        accessors.append(
            {
                "bufferView": k,
                "componentType": number,
                "count": len(block),
                "type": KINDS[1 if block.ndim == 1 else block.shape[1]],
                "min": np.atleast_1d(block.min(axis=0)).tolist(),
                "max": np.atleast_1d(block.max(axis=0)).tolist(),
            }
        )
        start += block.nbytes
    return {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": start}]}


def _chunk(kind: bytes, data: bytes, filling: bytes) -> bytes:
    """A chunk of a binary file: its length, its kind and its data, filled up to a multiple of four."""
    data += filling * (-len(data) % 4)
    return _words(len(data)) + kind + data


def _words(*numbers: int) -> bytes:
    """Unsigned 32-bit numbers, little end first."""
    return b"".join(number.to_bytes(4, "little") for number in numbers)
