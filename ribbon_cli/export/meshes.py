"""Surfaces as OBJ and PLY, solids as STL."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.mesh import facet_fields, node_fields, strip
from ribbon_cli.export.solid import Solid
from ribbon_cli.store import StateRecord, content_sha256

Array = NDArray[np.float64]


def obj_bytes(record: StateRecord, title: str) -> bytes:
    """The surface as a Wavefront OBJ file of flat quadrilaterals, in the unit of `length`."""
    mesh = strip(record)
    out = io.StringIO()
    out.write(f"# {title}\n")
    for x, y, z in mesh.points.tolist():
        out.write(f"v {x!r} {y!r} {z!r}\n")
    for quad in (mesh.quads + 1).tolist():
        out.write("f {} {} {} {}\n".format(*quad))
    return out.getvalue().encode()


def ply_bytes(record: StateRecord, title: str) -> bytes:
    """The surface as a binary PLY file: fields at nodes belong to vertices, those at facets to faces."""
    mesh = strip(record)
    at_vertices = dict(zip("xyz", mesh.points.T, strict=True))
    at_vertices |= {name: np.repeat(values, 2) for name, values in node_fields(record, mesh).items()}
    at_faces = facet_fields(record)
    corners = [("count", "u1"), ("vertices", "<i4", (4,))]
    vertex = np.zeros(len(mesh.points), dtype=[(name, "<f8") for name in at_vertices])
    face = np.zeros(len(mesh.quads), dtype=[*corners, *((name, "<f8") for name in at_faces)])
    face["count"], face["vertices"] = 4, mesh.quads
    for rows, columns in ((vertex, at_vertices), (face, at_faces)):
        for name, values in columns.items():
            rows[name] = values
    header = ["ply", "format binary_little_endian 1.0", f"comment {title}", f"element vertex {len(vertex)}"]
    header += [f"property double {name}" for name in at_vertices]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices"]
    header += [f"property double {name}" for name in at_faces]
    return "\n".join([*header, "end_header\n"]).encode() + vertex.tobytes() + face.tobytes()


def stl_bytes(record: StateRecord, title: str, body: Solid) -> bytes:
    """A printed solid of a state as a binary STL file, in millimetres."""
    corners = body.points[body.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["normal"], rows["corners"] = normal, corners
    # Readers take a file that begins with "solid", as a run's name may, for one in text. The hash and what a
    # printer should know come first since 80 bytes are few.
    contact = "self-contact, " if record.self_contact else ""
    words = f"mm, sha256 {content_sha256(record)[:12]}, {contact}{title}"
    header = words.encode("ascii", "replace")[:79].ljust(80)
    return header + len(rows).to_bytes(4, "little") + bytes(rows.tobytes())
