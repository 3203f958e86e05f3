"""How far a step goes, and whether facets keep their side."""

from __future__ import annotations

import math

import numpy as np

from ..model.band import Array
from ..model.problem import Problem

MOST_XI = 1.0
"""Change of xi in one step, where it limits no other."""


def inverted_facets(problem: Problem, x: Array) -> Array:
    """(u_i x g_i).(u_i x g_{i+1}) (N,): positive where a facet keeps its side."""
    y = x.reshape(-1, 7)
    u, g, following = y[:, :3], problem.rulings(x), problem.next_rulings(x)
    # Lagrange's identity: (u x g).(u x g') = (u.u)(g.g') - (u.g)(u.g')
    uu, gg = np.einsum("ij,ij->i", u, u), np.einsum("ij,ij->i", g, following)
    out: Array = uu * gg - np.einsum("ij,ij->i", u, g) * np.einsum("ij,ij->i", u, following)
    return out


def change(x: Array, step: Array) -> float:
    """Size of a step (7N,): the largest change of a tangent, of a ruling over its length, or of xi/4."""
    s, y = (step * step).reshape(-1, 7), (x * x).reshape(-1, 7)
    tangents = s[:, 0] + s[:, 1] + s[:, 2]
    rulings = (s[:, 3] + s[:, 4] + s[:, 5]) / (y[:, 3] + y[:, 4] + y[:, 5])
    return math.sqrt(max(tangents.max(), rulings.max(), 0.0625 * s[:, 6].max()))


def turned(x: Array, step: Array) -> float:
    """The same without xi, which in flat fans says nothing of the shape."""
    s, y = (step * step).reshape(-1, 7), (x * x).reshape(-1, 7)
    rulings = (s[:, 3] + s[:, 4] + s[:, 5]) / (y[:, 3] + y[:, 4] + y[:, 5])
    return math.sqrt(max((s[:, 0] + s[:, 1] + s[:, 2]).max(), rulings.max()))


def followed(x: Array, step: Array) -> Array:
    """The place (7N,) a step away, with each xi changed by `MOST_XI` at most.

    Where a facet is nearly a triangle xi hardly shows in the shape, and steps in it are too long by orders of
    magnitude. They are cut short one by one, and the rest of the shape does not wait for them.
    """
    out: Array = x + step
    out[6::7] = x[6::7] + np.clip(step[6::7], -MOST_XI, MOST_XI)
    return out
