"""The weight of the corner beyond the last ruling of a free end.

The strip is a rectangle and ends at right angles to its midline, whatever ruling passes through the end's
midpoint. Beyond that ruling its corner is flat. Rulings are g = e + eta u with e across the midline, and the
part between the ruling and the edge has, counted with its sign, the area 0 and the first moment

    int_{-b}^{b} (-v eta)(v e + v eta u / 2) dv = (b^3 / 3)(eta^2 u - 2 eta g),      eta = g.u.

Without it the strip would be cut along its last ruling, and would gain height by slanting the cut.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..parts import FREE, HALF_WIDTH
from .band import Array, Band
from .stencil import SIZE, U0, G
from .term import Couplings, Term


class FreeCorner(Term):
    """The potential of the corner's weight, at the last node."""

    parameters = ("gravity",)
    load = True
    couplings: ClassVar[Couplings] = (("U0", "U0"), ("U0", "G"))

    def __init__(self, band: Band) -> None:
        super().__init__(band)
        loads, ends = band.parts.loads, band.parts.ends
        direction = np.asarray(loads.gravity_direction, dtype=np.float64)
        size = float(np.linalg.norm(direction))
        self.down = direction / size if size else direction
        self.free = ends is not None and ends.end == FREE
        self.weight = loads.gravity if self.free else 0.0

    @property
    def active(self) -> bool:
        """Whether there is a weight, and a free end."""
        return self.weight != 0.0

    @property
    def _factor(self) -> float:
        return self.weight * self._per_weight

    @property
    def _per_weight(self) -> float:
        return self.free * self.band.half_width**3 / 3.0

    def values(self, local: Array) -> Array:
        """Energies (M,), zero but at the last node."""
        out = np.zeros(local.shape[1])
        out[-1] = self._factor * self._depth(local)
        return out

    def _depth(self, local: Array) -> float:
        """2 eta d.g - eta^2 d.u with the direction d of the weight."""
        u, g = local[U0, -1], local[G, -1]
        eta = float(u @ g)
        return 2.0 * eta * float(self.down @ g) - eta**2 * float(self.down @ u)

    def gradient(self, local: Array) -> Array:
        """Their gradients (14, M)."""
        return self._factor * self._slope(local)

    def _slope(self, local: Array) -> Array:
        u, g, d = local[U0, -1], local[G, -1], self.down
        eta, across = u @ g, d @ g - (u @ g) * (d @ u)
        out = np.zeros((SIZE, local.shape[1]))
        out[U0, -1] = 2.0 * across * g - eta**2 * d
        out[G, -1] = 2.0 * across * u + 2.0 * eta * d
        return out

    def add_hessian(self, local: Array, hessian: Array) -> None:
        """Add their Hessians."""
        u, g, d = local[U0, -1], local[G, -1], self.down
        eta, along, factor = u @ g, d @ u, 2.0 * self._factor
        mixed = np.outer(g, d) - along * np.outer(g, u) - eta * np.outer(d, u)
        mixed += (d @ g - eta * along) * np.eye(3)
        hessian[U0, U0, -1] -= factor * (along * np.outer(g, g) + eta * (np.outer(g, d) + np.outer(d, g)))
        hessian[U0, G, -1] += factor * mixed
        hessian[G, G, -1] += factor * (np.outer(u, d) + np.outer(d, u) - along * np.outer(u, u))

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """By the half-width and by the weight."""
        if parameter not in (HALF_WIDTH, *self.parameters):
            return super().rate(parameter, local)
        per = self._factor * 3.0 / self.band.half_width if parameter == HALF_WIDTH else self._per_weight
        return per * self._depth(local), per * self._slope(local)

    def second_rate(self, parameter: str, local: Array) -> float:
        """By the half-width."""
        if parameter != HALF_WIDTH:
            return 0.0
        return 6.0 * self._factor / self.band.half_width**2 * self._depth(local)
