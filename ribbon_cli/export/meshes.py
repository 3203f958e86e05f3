"""Surfaces as OBJ and PLY, solids as STL."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import (
    FACET_FIELDS,
    NODE_FIELDS,
    facet_normals,
    node_values,
    strip,
    surface,
)
from ribbon_cli.store import content_sha256

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ribbon_cli.store import StateRecord

    Array = NDArray[np.float64]


def obj_bytes(record: StateRecord, title: str) -> bytes:
    """The surface as a Wavefront OBJ file of flat quadrilaterals, in the unit of `length`."""
    mesh = surface(record)
    out = io.StringIO()
    out.write(f"# {title}\n")
    for x, y, z in mesh.points.tolist():
        out.write(f"v {x!r} {y!r} {z!r}\n")
    for quad in (mesh.quads + 1).tolist():
        out.write("f {} {} {} {}\n".format(*quad))
    return out.getvalue().encode()


def ply_bytes(record: StateRecord, title: str) -> bytes:
    """The surface as a binary PLY file: fields at nodes belong to vertices, those at facets to faces."""
    mesh = surface(record)
    vertex = np.zeros(len(mesh.points), dtype=[(name, "<f8") for name in ("x", "y", "z", *NODE_FIELDS)])
    for k, name in enumerate("xyz"):
        vertex[name] = mesh.points[:, k]
    for name in NODE_FIELDS:
        vertex[name] = np.repeat(node_values(record, name, mesh.strip), 2)
    face = np.zeros(
        len(mesh.quads),
        dtype=[("count", "u1"), ("vertices", "<i4", (4,)), *((name, "<f8") for name in FACET_FIELDS)],
    )
    face["count"], face["vertices"] = 4, mesh.quads
    for name in FACET_FIELDS:
        face[name] = getattr(record, name)
    header = ["ply", "format binary_little_endian 1.0", f"comment {title}", f"element vertex {len(vertex)}"]
    header += [f"property double {name}" for name in ("x", "y", "z", *NODE_FIELDS)]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices"]
    header += [f"property double {name}" for name in FACET_FIELDS]
    return "\n".join([*header, "end_header\n"]).encode() + vertex.tobytes() + face.tobytes()


def solid(record: StateRecord, thickness: float) -> tuple[Array, Array]:
    """Vertices (4R, 3) and triangles (n, 3) of the band thickened by `thickness` / 2 to either side.

    At each ruling four corners are offset along the bisector of the two facets, so that flat facets keep
    their thickness. The surface is closed and oriented outwards also on a one-sided band, where the four
    corners are joined after half a turn: the solid's skin is one torus. On the inner side of a sharp bend the
    offset facets pass through each other, as they do in thick paper. Raises UsageError where the thickness
    is not positive or not below the band's width, or where a fold is sharper than 120 degrees.
    """
    if not (np.isfinite(thickness) and thickness > 0):
        raise UsageError(f"a thickness must be positive, got {thickness:g}")
    if thickness >= 2.0 * record.half_width:
        part = 0.5 * thickness / record.half_width
        raise UsageError(f"a thickness must be less than the band's width 2 b, got {part:.3g} times as much")
    n, rulings = record.segments, strip(record)
    after = facet_normals(record)
    before = np.roll(after, 1, axis=0)
    before[0] *= record.sigma
    before[list(rulings.first)] = after[list(rulings.first)]
    ends = after[list(rulings.last)]
    before, after = np.vstack((before, ends)), np.vstack((after, ends))
    cosine = np.einsum("ij,ij->i", before, after)
    if cosine.min() < -0.5:
        raise UsageError(
            "two facets are folded by more than 120 degrees: refine the state before thickening it"
        )
    offset = 0.5 * thickness * (before + after) / (1.0 + cosine)[:, None]
    low, high = rulings.low, rulings.high
    points = np.stack((high + offset, low + offset, low - offset, high - offset), axis=1).reshape(-1, 3)
    ring = 4 * rulings.near[:, None] + np.arange(4)
    following = 4 * rulings.far[:, None] + np.arange(4)
    if rulings.closed and record.sigma < 0:
        # g and the normal both change sign across the seam: half a turn of the four corners.
        following[-1] = following[-1, [2, 3, 0, 1]]
    a, b = ring, np.roll(ring, -1, axis=1)
    c, d = np.roll(following, -1, axis=1), following
    triangles = np.concatenate((np.stack((a, d, c), axis=2), np.stack((a, c, b), axis=2))).reshape(-1, 3)
    for start, end in zip(rulings.first, (n + k for k in range(len(rulings.last))), strict=True):
        p, q = 4 * start, 4 * end
        caps = [[p, p + 1, p + 2], [p, p + 2, p + 3], [q, q + 2, q + 1], [q, q + 3, q + 2]]
        triangles = np.vstack((triangles, np.array(caps)))
    return points, triangles


def stl_bytes(record: StateRecord, title: str, size: float, thickness: float) -> bytes:
    """The thickened band as a binary STL file for printing, in millimetres.

    `size` is the length of the midline and `thickness` the wall's, both in millimetres.
    """
    if not (np.isfinite(size) and size > 0):
        raise UsageError(f"a size must be a positive number of millimetres, got {size:g}")
    scale = size / record.length
    points, triangles = solid(record, thickness / scale)
    corners = (points * scale)[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    rows = np.zeros(
        len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")]
    )
    rows["normal"], rows["corners"] = normal, corners
    # Readers take a file that begins with "solid", as a run's name may, for one in text. The hash and what a
    # printer should know come first since 80 bytes are few.
    contact = "self-contact, " if record.self_contact else ""
    words = f"mm, sha256 {content_sha256(record)[:12]}, {contact}{title}"
    header = words.encode("ascii", "replace")[:79].ljust(80)
    return header + len(rows).to_bytes(4, "little") + bytes(rows.tobytes())
