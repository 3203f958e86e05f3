"""A dead force on the end's midpoint: a point force at the end of the midline."""

from __future__ import annotations

from ..parts import Loads, Vector
from .point_force import PointForce


class EndForce(PointForce):
    """The potential of a dead force (3,) on the midpoint of the end."""

    parameters = ("end_force_x", "end_force_y", "end_force_z")

    @staticmethod
    def acting(loads: Loads) -> tuple[Vector, float]:
        """The force, and 1 for the end."""
        return loads.end_force, 1.0
