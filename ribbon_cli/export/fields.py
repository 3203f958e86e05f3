"""Fields along the midline, counted from where the inflections lie evenly.

Where the strip's seam lies is a matter of labels. For comparison and for the eye, alpha is measured so that n
inflections lie about l/(2n), 3 l/(2n), ...: one at l/2, two at l/4 and 3 l/4, three at l/6, l/2, 5 l/6. On a
one-sided band, fields that are odd in g change sign across the seam, so that moving it turns some of them
over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.mesh import FACET_FIELDS, ODD_FIELDS, field_values, is_closed
from ribbon_cli.model import staggered
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]


def inflections(record: StateRecord) -> Array:
    """Places alpha (k,) in [0, l), ascending, where a state's kappa_s changes sign; node 1 is at 0."""
    return staggered.inflections(record.kappa_s, record.length, record.sigma)


@dataclass(frozen=True)
class Window:
    """A way to count along the band: from node `first` (0-based), which lies at `alpha` = `offset`; sign
    `flip`.
    """

    first: int
    offset: float
    flip: int


AS_STORED = Window(0, 0.0, 1)


def even_window(record: StateRecord) -> Window:
    """The window in which the inflections lie about the odd multiples of l/(2n); as stored where there are
    none.

    The sign is such that kappa_s is positive before the first inflection. Of several places to begin, the one
    nearest to the stored seam is taken.
    """
    found = inflections(record)
    if not found.size or not is_closed(record):
        return AS_STORED
    h = record.length / record.segments
    # With the first inflection given, the start that puts all of them where they belong on average.
    places = (np.arange(found.size) + 0.5) * record.length / found.size
    starts = []
    for k in range(found.size):
        turned = np.roll(found, -k)
        turned = turned + record.length * (np.arange(found.size) >= found.size - k)
        starts.append(float((turned - places).mean()))
    start = min(starts, key=lambda s: min(s % record.length, -s % record.length))
    first = int(np.ceil(start / h - 1e-9))
    offset = first * h - start
    _, kappa = field(record, "kappa_s", Window(first % record.segments, offset, 1))
    early = kappa[: max(1, record.segments // (4 * found.size))]
    return Window(first % record.segments, offset, -1 if early.mean() < 0 else 1)


def field(record: StateRecord, name: str, window: Window = AS_STORED) -> tuple[Array, Array]:
    """Places alpha (N,) and values (N,) of a field, counted as `window` says; not-a-number at cuts."""
    return placed(record, name, field_values(record, name), window)


def placed(record: StateRecord, name: str, values: Array, window: Window) -> tuple[Array, Array]:
    """The same for `values` (N,) that stand where the field of that name does and change signs as it does."""
    n = record.segments
    h = record.length / n
    values = np.roll(values, -window.first)
    if name in ODD_FIELDS:
        values = values * window.flip
        if record.sigma < 0 and window.first:
            values[n - window.first :] *= -1.0
    half = 0.5 * h if name in FACET_FIELDS else 0.0
    alpha: Array = window.offset + half + h * np.arange(n, dtype=np.float64)
    return alpha, values
