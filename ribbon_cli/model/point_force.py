"""A dead force at a point of the midline: E = -F.r(s), r(s) = h sum_i w_i u_i.

The worked example of docs/terms.md: an energy term in one file.
"""

from __future__ import annotations

import numpy as np

from ..parts import Loads, Vector
from .band import Array, Band
from .stencil import SIZE, U
from .term import Term


class PointForce(Term):
    """The potential of a dead force (3,) on the midline, at a part of its length from the start."""

    parameters = ("point_force_x", "point_force_y", "point_force_z")
    load = True

    def __init__(self, band: Band) -> None:
        super().__init__(band)
        force, at = self.acting(band.parts.loads)
        self.force = np.asarray(force, dtype=np.float64)
        facet, n = np.arange(band.segments if band.closed else band.segments + 1), band.segments
        # How much of each facet lies before the point.
        self.arms = band.h * np.clip(n * at - facet, 0.0, 1.0) * (facet < n)

    @staticmethod
    def acting(loads: Loads) -> tuple[Vector, float]:
        """The force, and the part of the length at which it acts."""
        return loads.point_force, loads.point_at

    @property
    def active(self) -> bool:
        """Whether there is a force."""
        return bool(self.force.any())

    def values(self, local: Array) -> Array:
        """Energies (M,) by facet."""
        out: Array = -self.arms * (self.force @ local[U])
        return out

    def gradient(self, local: Array) -> Array:
        """Their gradients (14, M)."""
        return self._pull(self.force, local)

    def _pull(self, force: Array, local: Array) -> Array:
        out = np.zeros((SIZE, local.shape[1]))
        out[U] = -force[:, None] * self.arms
        return out

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """By a component of the force."""
        if parameter not in self.parameters:
            return super().rate(parameter, local)
        force = np.eye(3)[self.parameters.index(parameter)]
        return -float(self.arms @ (force @ local[U])), self._pull(force, local)

    def resultant(self) -> Array:
        """The force (3,)."""
        return self.force
