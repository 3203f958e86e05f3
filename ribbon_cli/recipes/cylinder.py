"""The discrete right-circular cylinder, Koldaev (2022), (3.4)-(3.5)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..doors import Later
from .recipe import Recipe, Settings, Way

if TYPE_CHECKING:
    import numpy as np

    from ..model import band as bands
    from ..model.band import Band, State
else:
    np, bands = Later("numpy"), Later("ribbon_cli.model.band")


def cylinder(band: Band) -> State:
    """The ring: rulings along z, tangents on a regular polygon; its energy is pi b to second order."""
    angle = 2.0 * math.pi * (np.arange(band.segments) + 0.5) / band.segments
    u = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(band.segments)))
    g = np.tile(np.array([0.0, 0.0, 1.0]), (band.segments, 1))
    return bands.State(band, u, g, np.zeros(band.segments))


def _way(band: Band, _half_twists: int, _settings: Settings) -> Way:
    return Way("discrete cylinder, (3.4)-(3.5)", ready=cylinder(band))


CARD = Recipe(
    name="cylinder",
    about="a regular polygon with rulings along the axis",
    half_twists="0",
    fits=lambda n: n == 0,
    passes="nothing, it is exact",
    freed="cylinder",
    way=_way,
)
