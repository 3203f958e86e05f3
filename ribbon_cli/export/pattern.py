"""The fold pattern: the flat strip, the lines to fold it along, and the angles.

A discrete band is a strip folded N times, Koldaev (2022), 2.1.1. Flat, node i lies at x = (i - 1) h on the
midline y = 0, and its ruling runs from (x + b eta_i, b) to (x - b eta_i, -b). Folded by the angle
theta_i = kappa_s h sqrt(1 + eta_i^2) about (eta_i, 1), it is the state. The reader looks at the side to
which u x g points; kappa_s > 0 bends towards g x u, away from the reader, and is a mountain. Node 1 is
where the ends are glued. A strip with ends is folded at its clamps as well, by the fold of half a cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import check_shape, end_angle, is_closed
from ribbon_cli.parts import CLAMPED
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pattern:
    """A flat strip, in millimetres, y upwards; angles in degrees.

    `folds` (N-1, 2, 2) are the upper and lower ends of the folds at nodes 2..N, `angles` (N-1,) their fold
    angles: positive is a mountain, seen from the printed side. `first` and `last` (2, 2) are the end
    rulings, glued to each other at the fold angle `seam`; on a one-sided band the upper end of one meets
    the lower end of the other. `tab` (4, 2) is the flap beyond `last` that takes the glue.

    Of an open strip `held` says how its start and its end are; `tab` and `start_tab` (4, 2) are the flaps
    that clamps take, at the fold angles `seam` of the start and `end`; without a clamp there is none, (0, 2).
    """

    length: float
    half_width: float
    folds: Array
    angles: Array
    first: Array
    last: Array
    seam: float
    tab: Array
    sigma: int
    half_twists: int | None
    held: tuple[str, str] | None = None
    start_tab: Array = field(default_factory=lambda: np.empty((0, 2)))
    end: float = 0.0

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, lower, right, upper bounds with the tab, in millimetres."""
        tabs = np.concatenate((self.start_tab[:, 0], self.tab[:, 0]))
        x = np.concatenate((self.folds[..., 0].ravel(), self.first[:, 0], self.last[:, 0], tabs))
        y = np.append(self.tab[:, 1], (-self.half_width, self.half_width))
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def fold_angles(record: StateRecord) -> Array:
    """Fold angles theta (N,) in radians from the stored curvature, theta = kappa_s h sqrt(1 + eta^2).

    A clamp's fold spans half a cell; where a strip begins without a clamp there is none.
    """
    h = record.length / record.segments
    theta: Array = record.kappa_s * h * np.sqrt(1.0 + record.eta**2)
    if record.parts.ends is not None:
        theta[0] *= 0.5 if record.parts.ends.start == CLAMPED else 0.0
    return theta


def fold_pattern(record: StateRecord, length: float) -> Pattern:
    """The pattern of a closed band, or of a strip with ends, whose midline measures `length` millimetres.

    Raises UsageError for a state whose seam is open, and for a size that is not positive.
    """
    if not (math.isfinite(length) and length > 0):
        raise UsageError(f"a size must be a positive number of millimetres, got {length:g}")
    check_shape(record)
    held = record.parts.ends
    if held is None and not is_closed(record):
        raise UsageError(f"state {record.label} has an open seam: only a closed band can be folded and glued")
    scale = length / record.length
    b = record.half_width * scale
    x = np.arange(record.segments + 1) * length / record.segments
    last_eta = record.sigma * record.eta[0] if held is None else record.u[-1] @ record.g_end
    eta = np.append(record.eta, last_eta)
    ends = np.stack(
        (
            np.column_stack((x + b * eta, np.full_like(x, b))),
            np.column_stack((x - b * eta, np.full_like(x, -b))),
        ),
        axis=1,
    )
    angles = np.degrees(fold_angles(record))
    last = ends[-1]
    depth = min(12.0, 0.25 * length, max(4.0, 0.4 * b))
    if held is not None:
        kinds, degrees = (held.start, held.end), math.degrees(end_angle(record))
        start_tab, tab = (
            _flap(ends[k], way * depth) if kind == CLAMPED else np.empty((0, 2))
            for k, way, kind in ((0, -1.0, kinds[0]), (-1, 1.0, kinds[1]))
        )
        seam = float(angles[0])
        return Pattern(
            length, b, ends[1:-1], angles[1:], ends[0], last, seam, tab, 0, None, kinds, start_tab, degrees
        )
    inset = min(0.25 * b, depth)
    along = (last[0] - last[1]) / np.linalg.norm(last[0] - last[1])
    outward = np.array([along[1], -along[0]])
    tab = np.array(
        [
            last[0],
            last[0] + depth * outward - inset * along,
            last[1] + depth * outward + inset * along,
            last[1],
        ]
    )
    lk = record.linking_number
    twists = round(2.0 * lk) if math.isfinite(lk) else None
    seam = float(angles[0])
    return Pattern(length, b, ends[1:-1], angles[1:], ends[0], last, seam, tab, record.sigma, twists)


def _flap(ruling: Array, depth: float) -> Array:
    """The strip's continuation (4, 2) beyond an end ruling, which lies flat in a clamp."""
    beyond = ruling + np.array([depth, 0.0])
    return np.array([ruling[0], beyond[0], beyond[1], ruling[1]])
