"""The discrete right-circular cylinder, Koldaev (2022), (3.4)-(3.5)."""

from __future__ import annotations

import math

import numpy as np

from ..model.band import Band, State


def cylinder(band: Band) -> State:
    """The ring: rulings along z, tangents on a regular polygon; its energy is pi b to second order."""
    angle = 2.0 * math.pi * (np.arange(band.segments) + 0.5) / band.segments
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(band.segments)))
    g = np.tile(np.array([0.0, 0.0, 1.0]), (band.segments, 1))
    return State(band, u, g, np.zeros(band.segments))
