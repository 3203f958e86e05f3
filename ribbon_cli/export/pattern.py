"""The fold pattern: the flat strip, the lines to fold it along, and the angles.

A discrete band is a strip folded N times, Koldaev (2022), 2.1.1. Flat, node i lies at x = (i - 1) h on the
midline y = 0, and its ruling runs from (x + b eta_i, b) to (x - b eta_i, -b). Folded by the angle
theta_i = kappa_s h sqrt(1 + eta_i^2) about (eta_i, 1), it is the state. The reader looks at the side to
which u x g points; kappa_s > 0 bends towards g x u, away from the reader, and is a mountain. Node 1 is
where the ends are glued.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import check_shape, is_closed
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pattern:
    """A flat strip, in millimetres, y upwards; angles in degrees.

    `folds` (N-1, 2, 2) are the upper and lower ends of the folds at nodes 2..N, `angles` (N-1,) their fold
    angles: positive is a mountain, seen from the printed side. `first` and `last` (2, 2) are the end
    rulings, glued to each other at the fold angle `seam`; on a one-sided band the upper end of one meets
    the lower end of the other. `tab` (4, 2) is the flap beyond `last` that takes the glue.
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

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, lower, right, upper bounds with the tab, in millimetres."""
        x = np.concatenate((self.folds[..., 0].ravel(), self.first[:, 0], self.last[:, 0], self.tab[:, 0]))
        y = np.append(self.tab[:, 1], (-self.half_width, self.half_width))
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def fold_angles(record: StateRecord) -> Array:
    """Fold angles theta (N,) in radians from the stored curvature, theta = kappa_s h sqrt(1 + eta^2)."""
    h = record.length / record.segments
    theta: Array = record.kappa_s * h * np.sqrt(1.0 + record.eta**2)
    return theta


def fold_pattern(record: StateRecord, length: float) -> Pattern:
    """The pattern of a closed band whose midline measures `length` millimetres.

    Raises UsageError for a state whose seam is open, and for a size that is not positive.
    """
    if not (math.isfinite(length) and length > 0):
        raise UsageError(f"a size must be a positive number of millimetres, got {length:g}")
    check_shape(record)
    if not is_closed(record):
        raise UsageError(f"state {record.label} has an open seam: only a closed band can be folded and glued")
    scale = length / record.length
    b = record.half_width * scale
    x = np.arange(record.segments + 1) * length / record.segments
    eta = np.append(record.eta, record.sigma * record.eta[0])
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
