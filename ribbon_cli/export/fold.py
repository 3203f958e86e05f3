"""A band as a FOLD file, version 1.2, the format of computational origami: its strip flat, and in space.

Ruling k = 1..N+1 has its end at -b g in vertex 2k - 2 and its end at +b g in vertex 2k - 1, as in the other
surfaces; its edge has number k - 1. The strip is cut at the seam, so that it is orientable whatever the band
is. Faces run counterclockwise seen from the side to which u x g points. This is the upper side of the flat
strip, and the printed side of the fold pattern. FOLD counts valleys as positive, and the fold pattern
mountains: the angles differ in sign.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import check_shape, end_angle, is_closed
from ribbon_cli.export.pattern import fold_angles
from ribbon_cli.export.sheet import fold_kind
from ribbon_cli.parts import CLAMPED
from ribbon_cli.store import StateRecord, Summary

Array = NDArray[np.float64]

SPECIFICATION = 1.2
ASSIGNMENTS = {"mountain": "M", "valley": "V", "flat": "F"}


def fold_bytes(record: StateRecord, title: str, run: str | None) -> bytes:
    """The flat strip as the key frame, the same strip in space as frame 1, lengths in the unit of `length`.

    Raises UsageError for a state with values that are not finite, and for a band in two pieces.
    """
    check_shape(record)
    if record.cut_node is not None:
        raise UsageError(f"state {record.label} is in two pieces: a FOLD file takes a strip in one")
    flat, folded = _coordinates(record)
    proper = bool((np.diff(flat[:, :, 0], axis=0) > 0).all())
    shared = ["manifold", "orientable", *(["convexFaces"] if proper else [])]
    document: dict[str, Any] = {
        "file_spec": SPECIFICATION,
        "file_creator": "ribbon",
        "file_title": title,
        "file_description": _description(record),
        "file_classes": ["singleModel"],
        "file_ribbon:state": Summary.of(record).listed(run),
        "frame_title": "flat strip",
        "frame_classes": ["creasePattern"],
        "frame_attributes": ["2D", *shared],
        "frame_unit": "unit",
        **_seam(record),
        **_ends(record),
        "vertices_coords": flat.reshape(-1, 2).tolist(),
        **_faces(record.segments),
        **_edges(record),
    }
    space = {
        "frame_title": "band in space" if record.parts.ends is None else "strip in space",
        "frame_classes": ["foldedForm"],
        "frame_attributes": ["3D", *shared],
        "frame_parent": 0,
        "frame_inherit": True,
        "vertices_coords": folded.reshape(-1, 3).tolist(),
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items()]
    lines.append(f'"file_frames": [{json.dumps(space, allow_nan=False)}]')
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _coordinates(record: StateRecord) -> tuple[Array, Array]:
    """Ends (N+1, 2, 2) of the rulings on the flat strip and (N+1, 2, 3) in space, at -b g before +b g.

    Flat, ruling k runs from (x_k - b eta_k, -b) to (x_k + b eta_k, b), x_k = (k - 1) h.
    """
    b = record.half_width
    x = np.arange(record.segments + 1) * record.length / record.segments
    # Where a strip begins there is no fold, and no eta of one: the ruling leans as on the facet behind it.
    eta = np.where(np.isnan(record.eta), np.einsum("ij,ij->i", record.u, record.g), record.eta)
    lean = b * np.append(eta, record.u[-1] @ record.g_end)
    side = np.full_like(x, b)
    flat = np.stack((np.column_stack((x - lean, -side)), np.column_stack((x + lean, side))), axis=1)
    across = b * np.vstack((record.g, record.g_end))
    return flat, np.stack((record.midline - across, record.midline + across), axis=1)


def _faces(n: int) -> dict[str, Any]:
    """Facet i between rulings i and i+1."""
    low = 2 * np.arange(n)
    return {"faces_vertices": np.column_stack((low, low + 2, low + 3, low + 1)).tolist()}


def _edges(record: StateRecord) -> dict[str, Any]:
    """The N+1 rulings, then the edge at -b and the edge at +b; the two end rulings are boundary."""
    n = record.segments
    low = 2 * np.arange(n + 1)
    rulings = np.column_stack((low, low + 1))
    sides = [np.column_stack((low[:-1] + k, low[1:] + k)) for k in (0, 1)]
    degrees = np.degrees(fold_angles(record))[1:].tolist()
    kinds = [ASSIGNMENTS[fold_kind(angle)] for angle in degrees]
    angles = [0.0 if kind == "F" else -angle for kind, angle in zip(kinds, degrees, strict=True)]
    return {
        "edges_vertices": np.vstack((rulings, *sides)).tolist(),
        "edges_assignment": ["B", *kinds, "B", *(["B"] * (2 * n))],
        "edges_foldAngle": [0.0, *angles, *([0.0] * (2 * n + 1))],
    }


def _seam(record: StateRecord) -> dict[str, Any]:
    """How the two ends of a closed band are joined: which edges and vertices meet, and the fold there.

    The fold is that of the first face's upper side.
    """
    if not is_closed(record):
        return {}
    n = record.segments
    ends = (2 * n, 2 * n + 1) if record.sigma > 0 else (2 * n + 1, 2 * n)
    degrees = float(np.degrees(fold_angles(record)[0]))
    kind = ASSIGNMENTS[fold_kind(degrees)]
    return {
        "frame_ribbon:seam": {
            "edges": [0, n],
            "vertices": [[0, ends[0]], [1, ends[1]]],
            "assignment": kind,
            "foldAngle": 0.0 if kind == "F" else -degrees,
        }
    }


def _ends(record: StateRecord) -> dict[str, Any]:
    """How an open strip is held at its two ends, and its folds there against the clamps."""
    ends = record.parts.ends
    if ends is None:
        return {}
    found = {}
    for name, held, edge, angle in (
        ("start", ends.start, 0, float(fold_angles(record)[0])),
        ("end", ends.end, record.segments, end_angle(record)),
    ):
        degrees = math.degrees(angle)
        kind = ASSIGNMENTS[fold_kind(degrees)]
        found[name] = {"edge": edge, "held": held}
        if held == CLAMPED:
            found[name] |= {"assignment": kind, "foldAngle": 0.0 if kind == "F" else -degrees}
    return {"frame_ribbon:ends": found}


def _description(record: StateRecord) -> str:
    """Which side is up, and what the seam does."""
    words = (
        "The strip of a discrete elastic band: flat in the key frame, in space in frame 1. Faces are "
        "counterclockwise seen from the side to which tangent x ruling points, the printed side of ribbon's "
        "fold pattern; valleys and mountains are seen from there."
    )
    if record.parts.ends is not None:
        return f"{words} The strip is open: frame_ribbon:ends says how it is held, and its folds at clamps."
    if not is_closed(record):
        return f"{words} The strip is open."
    words += " The band is cut at its seam: frame_ribbon:seam says which edges and vertices are joined."
    if record.sigma < 0:
        words += (
            " The band is one-sided: across the seam, the upper side of the last face meets the lower side "
            "of the first."
        )
    return words
