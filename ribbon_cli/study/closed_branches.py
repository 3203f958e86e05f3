"""Whether a branch has begun to repeat itself.

A branch that never leaves a range of widths turns again and again. The equations know neither how nodes are
numbered nor which hand is which: where a branch passes the image of a stretch that it has passed, in the same
order, its course from there is the image of its course from then. Two turns in a row tell stretch and order.
One alone may be the image of another on the far side of a symmetric shape, with something new behind it.
The branch that crosses at a sliding mode's bifurcation is of this kind: on it the band slides along itself,
half a facet from turn to turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..store import StateRecord

TURNING = 1e-4
"""Rate db/ds below which a branch turns; where K is nearly singular, as for sliding, 2e-5 has been seen."""
SAME = 1e-8
"""Relative difference of b and E at turns that are images of each other; 3e-9 has been seen."""
SAME_CURVATURE = 1e-3
"""Difference of their curvatures, sorted by size, in parts of the largest; 4e-4 has been seen. Shapes are
located less sharply than b and E, which are stationary there."""


def turns(record: StateRecord) -> bool:
    """Whether a branch turns at a point: a fold, or the vertex of a pitchfork."""
    branch = record.branch
    return (
        branch is not None
        and branch.type in ("fold", "branch-point")
        and abs(branch.half_width_rate) <= TURNING
    )


def repeated(met: Sequence[StateRecord]) -> StateRecord | None:
    """The earlier turn that the last of a branch's turns repeats, if the one before it did so too.

    A vertex counts once where its fold and the mode that crosses there are located apart by rounding.
    """
    met = [state for k, state in enumerate(met) if k == 0 or not _alike(met[k - 1], state)]
    if len(met) < 4:
        return None
    for k in range(1, len(met) - 2):
        if _alike(met[k], met[-1]) and _alike(met[k - 1], met[-2]):
            return met[k]
    return None


def _alike(one: StateRecord, other: StateRecord) -> bool:
    """Whether two states are the same shape, but for numbering and handedness."""
    for a, b in ((one.half_width, other.half_width), (one.energy, other.energy)):
        if abs(a - b) > SAME * abs(a):
            return False
    first, second = (np.sort(np.abs(state.kappa_s)) for state in (one, other))
    return float(np.abs(first - second).max()) <= SAME_CURVATURE * float(first.max())
