"""Pairs by their distance: what counts where features keep a gap that is not zero.

Each pair is taken as the features at which it is nearest, a face, an edge or an end, so that its gap is the
distance itself: no side has to be known, and at rims no gap takes over from another one.
"""

from __future__ import annotations

import numpy as np

from .band import Array
from .touching import Shape
from .touching_barrier import Neighbourhood, nearest
from .touching_gaps import Pairs, arguments, gaps, vectors

ROOM = 0.01
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""


class Distances:
    """Near pairs of shapes that follow each other."""

    def __init__(self) -> None:
        self._near: Neighbourhood | None = None

    def near(self, shape: Shape, reach: float) -> tuple[Pairs, Array]:
        """The pairs nearer than a reach, each once, and their distances."""
        if self._near is None or not self._near.covers(shape):
            self._near = Neighbourhood.of(shape, reach, ROOM * shape.length)
        pairs = nearest(shape, self._near.features, reach).unique()
        return pairs, np.abs(_distances(shape, pairs))


def nearer(shape: Shape, reach: float) -> Pairs:
    """The pairs nearer than a reach, over all pairs, each once and as it is nearest."""
    return nearest(shape, Neighbourhood.of(shape, reach, 0.0).features, reach).unique()


def _distances(shape: Shape, pairs: Pairs) -> Array:
    what = arguments(pairs)
    return gaps(vectors(shape, what), what, pairs.sign, shape.half_width).value
