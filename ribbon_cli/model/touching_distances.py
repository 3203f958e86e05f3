"""Pairs by their distance: what counts where features keep a gap that is not zero.

Each pair is taken as the features at which it is nearest, a face, an edge or an end, so that its gap is the
distance itself: no side has to be known, and at rims no gap takes over from another one.
"""

from __future__ import annotations

import numpy as np

from .band import Array
from .touching import Shape
from .touching_barrier import Neighbourhood, Surroundings, nearest
from .touching_gaps import Pairs, gap_values

ROOM = 0.01
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""


class Distances:
    """Near pairs of shapes that follow each other."""

    def __init__(self) -> None:
        self._near: Surroundings | None = None

    def near(self, shape: Shape, reach: float) -> tuple[Pairs, Array]:
        """The pairs nearer than a reach, each once, and their distances."""
        if self._near is None or reach > self._near.reach:
            self._near = Surroundings(reach, ROOM * shape.length)
        pairs = nearest(shape, self._near.of(shape).features, reach).unique()
        return pairs, np.abs(gap_values(shape, pairs))


def nearer(shape: Shape, reach: float) -> Pairs:
    """The pairs nearer than a reach, over all pairs, each once and as it is nearest."""
    return nearest(shape, Neighbourhood.of(shape, reach, 0.0).features, reach).unique()
