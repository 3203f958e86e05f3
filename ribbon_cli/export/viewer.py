"""States as one HTML file that shows them in the round: no network, no other files.

The page is `data/viewer.html` with the states put in as JSON. Coordinates and fields are single precision,
which is finer than any screen, in base64.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.align import turn_between, turned_alike
from ribbon_cli.export.arrows import arrow_triangles, per_force
from ribbon_cli.export.contacts import touching
from ribbon_cli.export.fields import even_window, field
from ribbon_cli.export.mesh import FACET_FIELDS, ODD_FIELDS, facet_corners, strip
from ribbon_cli.export.view import chosen_view, strip_axes
from ribbon_cli.export.words import verdict
from ribbon_cli.store import StateRecord, content_sha256
from ribbon_cli.text import visible

Array = NDArray[np.float64]

FIELDS = ("kappa_s", "tau", "eta", "eta_prime", "lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5")
"""Fields that the page can colour a surface by."""


def viewer_html(records: Sequence[StateRecord], title: str, run: str | None) -> bytes:
    """The page for states in the order of its slider."""
    shapes = [facet_corners(record) for record in records]
    axes = [strip_axes(record) for record in records]
    placed = [corners - corners.reshape(-1, 3).mean(axis=0) for corners in shapes]
    if any(own is None for own in axes):
        placed = turned_alike(shapes)
    each = per_force(records)
    document = {
        "title": title,
        "turn": chosen_view(placed[-1], None, axes[-1]).axes.ravel().tolist(),
        "run": run,
        "facetFields": [name for name in FIELDS if name in FACET_FIELDS],
        "oddFields": [name for name in FIELDS if name in ODD_FIELDS],
        "states": [
            _state(record, corners, _arrows(record, shape, corners, each))
            for record, shape, corners in zip(records, shapes, placed, strict=True)
        ],
    }
    # "</" would end the script that holds the data, and "<!--" begin what ends elsewhere.
    data = json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    page = resources.files("ribbon_cli.export").joinpath("data/viewer.html").read_text(encoding="utf-8")
    # In one go: a title may read like a place of the page.
    filled = {"{{title}}": escape(visible(title)), "{{data}}": data}
    return re.sub(r"\{\{\w+\}\}", lambda place: filled[place[0]], page).encode()


def _arrows(record: StateRecord, shape: Array, placed: Array, each: float) -> Array:
    """Corners (t, 3, 3) of the triangles of a state's arrows, placed as its shape was."""
    places, forces = touching(record).arrows
    if not len(places):
        return np.empty((0, 3, 3))
    corners = arrow_triangles(places, each * forces, record.length)[0]
    turned: Array = (corners - shape.reshape(-1, 3).mean(axis=0)) @ turn_between(shape, placed).T
    return turned


def _state(record: StateRecord, placed: Array, arrows: Array) -> dict[str, Any]:
    """One state for the page: the corners -b g_i, +b g_i, +b g_{i+1}, -b g_{i+1} of its facets and its
    fields.
    """
    window, pieces = even_window(record), strip(record)
    found = {name: field(record, name, window)[1] for name in FIELDS}
    return {
        "label": record.label,
        "b": record.half_width,
        "N": record.segments,
        "length": record.length,
        "energy": _number(record.energy),
        "Lk": _number(record.linking_number),
        "verdict": verdict(record),
        "sigma": record.sigma,
        "starts": list(pieces.first),
        "ends": list(pieces.last),
        "sha256": content_sha256(record),
        "first": window.first,
        "offset": window.offset,
        "corners": _packed(placed),
        "arrows": _packed(arrows),
        "forces": None if record.contacts is None else record.contacts.force.tolist(),
        "fields": {name: _packed(values) for name, values in found.items()},
    }


def _packed(values: Array) -> str:
    """Numbers as little-endian float32 in base64; the page shows not-a-number as unknown."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")


def _number(value: float) -> float | None:
    """A number for JSON, None where it is not finite."""
    return float(value) if np.isfinite(value) else None
