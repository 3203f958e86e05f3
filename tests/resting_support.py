"""Bands that rest on themselves, found by other means: a log barrier on node positions, then Newton's
method."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.touching_gaps import Pairs

DATA = Path(__file__).parent / "data" / "resting"


@lru_cache
def resting(name: str) -> tuple[State, Pairs, np.ndarray, float]:
    """A state, the gaps that it keeps, their forces and its energy."""
    with np.load(DATA / f"{name}.npz") as kept:
        band = Band(len(kept["u"]), float(kept["half_width"]), sigma=-1)
        state = State(band, kept["u"], kept["g"], kept["xi"])
        return state, Pairs(kept["first"], kept["second"], kept["sign"]), kept["force"], float(kept["energy"])
