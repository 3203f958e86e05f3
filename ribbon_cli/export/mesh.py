"""A stored state as a surface: vertices, flat quadrilaterals and the fields on them.

Facet i is the flat quadrilateral between rulings i and i+1; ruling i runs from the edge d_i - b g_i to
the edge d_i + b g_i, so that x(alpha, s) = d(alpha) + s g(alpha), |s| <= b, Koldaev (2022), (1.11), (2.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.errors import UsageError
from ribbon_cli.parts import CLAMPED
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CLOSED = 1e-6
"""Largest gap at the seam, in units of the length, of a band that counts as closed."""

NODE_FIELDS = ("kappa_s", "tau", "eta", "lambda_2", "lambda_3")
"""Fields (N,) of a state that sit at nodes, that is on rulings."""
FACET_FIELDS = ("eta_prime", "xi", "lambda_1", "lambda_4", "lambda_5")
"""Fields (N,) of a state that sit on facets."""
ODD_FIELDS = ("kappa_s", "eta", "eta_prime", "xi", "lambda_3", "lambda_5")
"""Fields that change sign with g, and so across the seam of a one-sided band."""
FOLD_FIELDS = ("kappa_s", "tau", "eta")
"""Fields of the fold between two facets, of which a cut has none."""


@dataclass(frozen=True)
class Strip:
    """The rulings of a band and the facets between them.

    `low`, `high` (R, 3) are the rulings' ends at -b g and +b g. Facet i lies between rulings `near[i]` and
    `far[i]` (N,); on a one-sided band that is closed, the last facet meets the first ruling turned round.
    Facets `first` begin a piece and facets `last` end one: a closed band has neither, an open strip one of
    each, a band in two pieces two. Rulings 0..N-1 are the near ones; the far ones of `last` follow in that
    order.
    """

    low: Array
    high: Array
    near: Indices
    far: Indices
    first: tuple[int, ...]
    last: tuple[int, ...]

    sigma: int

    @property
    def closed(self) -> bool:
        """Whether the band is closed."""
        return not self.last

    @property
    def points(self) -> Array:
        """Vertices (2R, 3): ruling r has its end at -b g in row 2r and at +b g in row 2r + 1."""
        return np.stack((self.low, self.high), axis=1).reshape(-1, 3)

    @property
    def quads(self) -> Indices:
        """Vertices (N, 4) round each facet, joined at the seam of a closed band."""
        near, far = self.near, self.far
        quads = np.column_stack((2 * near, 2 * near + 1, 2 * far + 1, 2 * far)).astype(np.int64)
        if self.closed and self.sigma < 0:
            quads[-1, 2:] = quads[-1, [3, 2]]
        return quads


_FARTHEST = 1e12
"""Bound of coordinates, far beyond those of the strips that a config may ask for (1e9)."""


def is_closed(record: StateRecord) -> bool:
    """Whether the two ends of the strip meet: closed midline, g_{N+1} = sigma g_1, not cut elsewhere."""
    if record.parts.ends is not None:
        return False
    gap = np.abs(record.midline[-1] - record.midline[0]).max() / record.length
    turn = np.abs(record.g_end - record.sigma * record.g[0]).max()
    return bool(gap <= CLOSED and turn <= CLOSED and record.cut_node is None)


def check_shape(record: StateRecord) -> None:
    """Raise UsageError for a state that went wrong, and has no shape to show."""
    fields = (record.u, record.g, record.g_end, record.midline)
    if not all(np.isfinite(values).all() for values in fields):
        what = "values that are not finite"
    elif not all((np.abs(values) < _FARTHEST).all() for values in fields):
        what = "values beyond any length"
    elif not (record.u.any(axis=1).all() and record.g.any(axis=1).all()):
        what = "tangents or rulings of no length"
    else:
        return
    raise UsageError(f"state {record.label} holds {what} ({record.status}): there is no shape")


def strip(record: StateRecord) -> Strip:
    """The rulings and facets of a state, closed, open at its seam, or in two pieces.

    Raises UsageError for a state with values that are not finite.
    """
    check_shape(record)
    n, b, h = record.segments, record.half_width, record.length / record.segments
    near = np.arange(n)
    if is_closed(record):
        start = record.midline[:-1]
        return Strip(start - b * record.g, start + b * record.g, near, (near + 1) % n, (), (), record.sigma)
    ends = {n - 1: record.g_end}
    if record.cut_node is not None and record.g_cut is not None:
        ends = {record.cut_node - 2: record.g_cut} | ends
    last = tuple(ends)
    places = np.vstack((record.midline[:-1], *(record.midline[i] + h * record.u[i] for i in last)))
    g = np.vstack((record.g, *ends.values()))
    far = near + 1
    far[list(last)] = n + np.arange(len(last))
    return Strip(places - b * g, places + b * g, near, far, cuts(record), last, record.sigma)


def cuts(record: StateRecord) -> tuple[int, ...]:
    """Nodes, from 0, at which a piece of the strip begins; none of a closed band."""
    if is_closed(record):
        return ()
    return (0,) if record.cut_node is None or record.g_cut is None else (0, record.cut_node - 1)


def facet_corners(record: StateRecord) -> Array:
    """Corners (N, 4, 3) of the facets: -b g_i, +b g_i, +b g_{i+1}, -b g_{i+1}."""
    rulings = strip(record)
    corners: Array = rulings.points[rulings.quads]
    return corners


def facet_normals(record: StateRecord) -> Array:
    """Unit normals (N, 3) of the facets, g x u normed: the side towards which kappa_s > 0 bends."""
    n = np.cross(record.g, record.u)
    unit: Array = n / np.linalg.norm(n, axis=1)[:, None]
    return unit


def field_values(record: StateRecord, name: str) -> Array:
    """A field (N,) of a state, not-a-number where a band is cut and the field is one of folds.

    What is stored there is of the strip as if it were closed. At the ends of an open strip there are folds.
    """
    values: Array = getattr(record, name)
    if record.parts.ends is None and name in FOLD_FIELDS and (places := cuts(record)):
        values = values.copy()
        values[list(places)] = np.nan
    return values


def node_fields(record: StateRecord, rulings: Strip) -> dict[str, Array]:
    """Node fields (R,) at the rulings, not-a-number at those that end a piece: these are no nodes.

    An open strip has a fold at its end ruling.
    """
    found = {}
    for name in NODE_FIELDS:
        ends = np.full(len(rulings.last), end_value(record, name))
        found[name] = np.append(field_values(record, name), ends)
    return found


def end_angle(record: StateRecord) -> float:
    """The fold angle in radians of an open strip against its end's clamp, over half a cell; 0 without one."""
    ends = record.parts.ends
    if ends is None or ends.end != CLAMPED:
        return 0.0
    cosine = math.cos(ends.tilt)
    after = np.array([-math.sin(ends.tilt), cosine * math.cos(ends.twist), cosine * math.sin(ends.twist)])
    before = facet_normals(record)[-1]
    axis = record.g_end / np.linalg.norm(record.g_end)
    return math.atan2(float(np.cross(before, after) @ axis), float(before @ after))


def end_value(record: StateRecord, name: str) -> float:
    """A node field at the end ruling of an open strip; not-a-number where it has none, or there is no end."""
    ends = record.parts.ends
    if ends is None or name not in FOLD_FIELDS:
        return math.nan
    eta = float(record.u[-1] @ record.g_end)
    kappa = record.parts.material.natural_curvature
    if ends.end == CLAMPED:
        kappa = 2.0 * end_angle(record) * record.segments / (record.length * math.sqrt(1.0 + eta * eta))
    return {"kappa_s": kappa, "tau": kappa * eta, "eta": eta}[name]


def facet_fields(record: StateRecord) -> dict[str, Array]:
    """Facet fields (N,)."""
    return {name: getattr(record, name) for name in FACET_FIELDS}
