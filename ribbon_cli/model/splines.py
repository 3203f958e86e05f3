"""Cubic splines through values given along a closed band, with the seam's sign."""

from __future__ import annotations

import numpy as np
import scipy

from .band import Array, Band


def seam_spline(values: Array, knots: Array, sign: int) -> scipy.interpolate.CubicSpline:
    """Periodic cubic spline through values (N, ...) that pass the seam with the factor `sign`.

    With -1 the field has twice the band's length as its period. `knots`, (N+1,) or (2N+1,), span one period.
    """
    whole = values if sign > 0 else np.concatenate((values, -values))
    return scipy.interpolate.CubicSpline(knots, np.concatenate((whole, whole[:1])), bc_type="periodic")


class BandSpline:
    """The twice differentiable cubic spline through values (N, ...) at alpha = (i + offset) h, i = 0..N-1.

    `sign` is the factor by which the field passes the seam: 1, or sigma for fields odd in the rulings. With
    -1 the field has the period 2l. alpha may be any number.
    """

    def __init__(self, band: Band, values: Array, offset: float, sign: int) -> None:
        count = len(values) if sign > 0 else 2 * len(values)
        knots = band.h * (np.arange(count + 1, dtype=np.float64) + offset)
        self._spline = seam_spline(values, knots, sign)
        self._start = knots[0]
        self._period = knots[-1] - knots[0]

    def __call__(self, alpha: Array, derivative: int = 0) -> Array:
        """The field (n, ...) at arclengths alpha (n,), or its derivative of order up to 2."""
        inside = self._start + np.mod(np.asarray(alpha) - self._start, self._period)
        out: Array = self._spline(inside, derivative)
        return out
