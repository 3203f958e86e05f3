"""Cubic splines through values given along a closed band, with the seam's sign.

They are scipy's periodic ones to the last bit, without its `interpolate`, which takes longer to import than
the table's states of N = 50 take to solve.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from .band import Array, Band

CLEARLY = 1e-9
"""Size of Bernstein coefficients, as part of the largest, from which their common sign says that a cubic has
no root."""


class PeriodicSpline:
    """The periodic cubic spline through values (n+1, ...) at increasing knots (n+1,), n >= 3.

    The last value is the first again. `coefficients` (4, n, ...) are those of powers of s - knots[i] from the
    third down, between the knots i and i + 1.
    """

    def __init__(self, knots: Array, values: Array) -> None:
        self.knots = knots
        step = np.diff(knots)
        wide = step.reshape(-1, *[1] * (values.ndim - 1))
        rise = np.diff(values, axis=0) / wide
        slopes = _slopes(step, wide, rise)
        bend = (slopes[:-1] + slopes[1:] - 2 * rise) / wide
        self.coefficients = np.stack(
            (bend / wide, (rise - slopes[:-1]) / wide - bend, slopes[:-1], values[:-1])
        )

    def __call__(self, at: Array, derivative: int = 0) -> Array:
        """The spline at places (...), or its derivative of order up to 2."""
        start = self.knots[0]
        inside = start + (np.asarray(at) - start) % (self.knots[-1] - start)
        piece = self.knots.searchsorted(inside, side="right") - 1
        np.minimum(piece, self.knots.size - 2, out=piece)
        s = inside - self.knots[piece]
        s = s.reshape(*s.shape, *[1] * (self.coefficients.ndim - 2))
        third, second, first, value = (c[piece] for c in self.coefficients)
        if derivative == 0:
            out = value + first * s + second * (s * s) + third * (s * s * s)
        elif derivative == 1:
            out = first + second * s * 2.0 + third * (s * s) * 3.0
        else:
            out = second * 2.0 + third * s * 6.0
        return np.asarray(out)

    def roots(self) -> Array:
        """Where a spline of numbers is zero, ascending; of pieces that are zero all along, nothing."""
        found: list[float] = []
        for i in self._open_pieces():
            found += self._roots_in(int(i))
        third, second, first, value = self.coefficients
        step = np.diff(self.knots)
        end = value + first * step + second * (step * step) + third * (step * step * step)
        # Roundoff may part two pieces at the knot where they meet, and hide a root there.
        found += self.knots[1:-1][end[:-1] * value[1:] < 0.0].tolist()
        return np.unique(np.array(found, dtype=np.float64))

    def _open_pieces(self) -> NDArray[np.intp]:
        """The pieces that may have roots: a cubic lies between its least and greatest Bernstein
        coefficients."""
        third, second, first, value = self.coefficients
        step = np.diff(self.knots)
        one, two, three = first * step, second * (step * step), third * (step * step * step)
        bernstein = np.stack((value, value + one / 3, value + (2 * one + two) / 3, value + one + two + three))
        margin = CLEARLY * np.abs(self.coefficients * [step**3, step**2, step, np.ones_like(step)]).max(
            axis=0
        )
        return np.flatnonzero((bernstein.min(axis=0) <= margin) & (bernstein.max(axis=0) >= -margin))

    def _roots_in(self, piece: int) -> list[float]:
        """The roots of a piece, by the eigenvalues of its companion matrix and one step of Newton each."""
        powers: list[float] = self.coefficients[:, piece].tolist()
        third, second, first, constant = powers
        while powers and powers[0] == 0.0:
            del powers[0]
        order = len(powers) - 1
        if order < 1:
            return []
        companion = np.eye(order, k=-1)
        companion[:, -1] = [-c / powers[0] for c in powers[:0:-1]]
        real, imaginary, *_ = scipy.linalg.lapack.dgeev(companion, compute_vl=0, compute_vr=0)
        start, stop = self.knots[piece : piece + 2].tolist()
        found = []
        for s in real[imaginary == 0.0].tolist():
            value = constant + first * s + second * (s * s) + third * (s * s * s)
            slope = first + second * s * 2.0 + third * (s * s) * 3.0
            if slope != 0.0 and abs(value / slope) < abs(s):
                s -= value / slope
            if start <= s + start <= stop:
                found.append(s + start)
        return found


def _slopes(step: Array, wide: Array, rise: Array) -> Array:
    """First derivatives (n+1, ...) at the knots from the rises (n, ...) between them.

    The system is tridiagonal but for its corners: the last unknown is left out, and found after the others.
    """
    rhs = np.empty_like(rise)
    rhs[1:] = 3 * (wide[1:] * rise[:-1] + wide[:-1] * rise[1:])
    rhs[0] = 3 * (wide[0] * rise[-1] + wide[-1] * rise[0])
    diagonal = np.empty_like(step)
    diagonal[1:] = 2 * (step[:-1] + step[1:])
    diagonal[0] = 2 * (step[-1] + step[0])
    above, below = np.concatenate((step[-1:], step[:-3])), step[1:-1]
    corner = np.zeros(step.size - 1)
    corner[0], corner[-1] = -step[0], -step[-3]
    columns = np.column_stack((rhs[:-1].reshape(step.size - 1, -1), corner))
    solved = scipy.linalg.lapack.dgtsv(below, diagonal[:-1], above, columns)[3]
    one, other = solved[:, :-1].reshape(rhs[:-1].shape), solved[:, -1]
    last = (rhs[-1] - step[-2] * one[0] - step[-1] * one[-1]) / (
        2 * (step[-1] + step[-2]) + step[-2] * other[0] + step[-1] * other[-1]
    )
    out = np.empty((step.size + 1, *rise.shape[1:]))
    out[:-2] = one + last * other.reshape(-1, *[1] * (rise.ndim - 1))
    out[-2], out[-1] = last, out[0]
    return out


def seam_spline(values: Array, knots: Array, sign: int) -> PeriodicSpline:
    """Periodic cubic spline through values (N, ...) that pass the seam with the factor `sign`.

    With -1 the field has twice the band's length as its period. `knots`, (N+1,) or (2N+1,), span one period.
    """
    whole = values if sign > 0 else np.concatenate((values, -values))
    return PeriodicSpline(knots, np.concatenate((whole, whole[:1])))


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
        return self._spline(inside, derivative)
