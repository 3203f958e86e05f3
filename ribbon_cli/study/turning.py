"""Whether stored states say that a branch turns back in a parameter, where no step in it succeeds.

Before a fold at p* a branch is x* + c sqrt(p* - p), to leading order: |dx/dp|^-2 is linear in p, and vanishes
at p*.
A step may also end on another branch because the matrix is nearly singular in a mode that the parameter does
not move, a checkerboard of the discretisation above all. Then |dx/dp| stays as it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..store import StateRecord, Summary
from .journal import Journal

NEAR = 8.0
"""Most lengths of the shortest failed step between the last state and the place where |dx/dp|^-2 vanishes by
its last two values. Over 36 strips of many shapes from which no step went on it was below 7.3 or above 58."""


def turns_back(journal: Journal, current: Summary, name: str, beyond: float) -> bool:
    """Whether the last two steps to a state tell of a fold between it and a value where a step failed."""
    line = _line(journal, current, name)
    if len(line) < 3:
        return False
    places = [record.parameters[name] for record in line]
    (before, last), (m, n) = (
        [_distance(a, b) / abs(b.parameters[name] - a.parameters[name]) for a, b in pairwise(line)],
        [0.5 * (p + q) for p, q in pairwise(places)],
    )
    if not 0.0 < before < last:
        return False
    fold = n + (n - m) * last**-2 / (before**-2 - last**-2)
    return abs(fold - places[-1]) <= NEAR * abs(beyond - places[-1])


def soft_in_checkerboards(journal: Journal, current: Summary) -> bool:
    """Whether the softest mode stored of a state, or of the nearest one before it, is a checkerboard."""
    for state in _ancestors(journal, current):
        # From its file: the spectra of a record at hand may have been computed beside it.
        for spectrum in journal.run.load(state.label).spectra:
            modes = (label for label in spectrum.labels if label not in ("rotation", "sliding"))
            if (softest := next(modes, None)) is not None:
                return softest == "checkerboard"
    return False


def _line(journal: Journal, current: Summary, name: str) -> list[StateRecord]:
    """The ends of at most two last steps, which moved a parameter alone, the first of them first."""
    line = [journal.load(current)]
    for state in _ancestors(journal, current):
        if state.label == current.label:
            continue
        moved = {n for n, value in state.parameters.items() if value != line[-1].parameters.get(n)}
        if moved != {name} or state.segments != current.segments or len(line) == 3:
            break
        line.append(journal.load(state))
    return line[::-1]


def _ancestors(journal: Journal, state: Summary) -> Iterator[Summary]:
    """A state and those that it came from, one after the other."""
    yield state
    while state.parent is not None:
        state = journal.run.look_up(state.parent)
        yield state


def _distance(a: StateRecord, b: StateRecord) -> float:
    """The root mean square change of tangents and rulings."""
    return float(np.sqrt((np.sum((a.u - b.u) ** 2) + np.sum((a.g - b.g) ** 2)) / a.segments))
