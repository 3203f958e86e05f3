"""What the store keeps of a band that rests on itself: which features touch, and how hard.

Features are those of docs/contact.md, counted from 0: vertex 2k is r_k - b g_k, vertex 2k + 1 is r_k + b g_k,
edge 3k the ruling at node k, edges 3k + 1 and 3k + 2 the lower and the upper side of facet k.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ribbon_cli.doors import Later

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
else:
    np = Later("numpy")

KINDS_OF_FEATURES = ("vertex", "edge", "facet")
"""Kinds of features by their numbers in a file."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts:
    """The gaps that a state keeps, and what the audit over all pairs found; k = 0 where nothing touches.

    `first` and `second` (k,2) are kind and number of the features. `value` (k,) are the gaps g = `sign` D.n:
    `sign` (k,), +1 or -1, makes them positive where features are on the sides on which they are to stay.
    `force` (k,) is the multiplier f of the row g = `gap`, and f > 0 pushes them apart. `excluded` is the
    distance on the flat strip from which pairs count, `clearance` the least distance of such features,
    `penetration` the greatest depth of an edge through a facet. Lengths are in the unit of `length`.
    Raises ValueError for pairs that have no gap.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    sign: NDArray[np.int64]
    force: NDArray[np.float64]
    value: NDArray[np.float64]
    gap: float
    excluded: float
    clearance: float
    penetration: float

    def __post_init__(self) -> None:
        for name in ("first", "second", "sign", "force", "value"):
            given = np.asarray(getattr(self, name))
            kind = np.float64 if name in ("force", "value") else np.int64
            array = np.ascontiguousarray(given, dtype=kind)
            if kind is np.int64 and not np.array_equal(array, given):
                raise ValueError(f"{name} of contacts must be integers")
            object.__setattr__(self, name, array)
        k = len(self.force)
        if any(features.shape != (k, 2) for features in (self.first, self.second)):
            raise ValueError(f"{k} contacts need {k} pairs of features")
        if self.sign.shape != (k,) or self.value.shape != (k,) or not (np.abs(self.sign) == 1).all():
            raise ValueError(f"{k} contacts need {k} gaps and {k} signs, +1 or -1")
        kinds = np.column_stack((self.first[:, 0], self.second[:, 0]))
        if ((kinds < 0) | (kinds > 2)).any() or (kinds[:, 0] == 2).any():
            raise ValueError("contacts are of vertices and edges with features of kind 0, 1 or 2")
        if len(self.keys()) != len(set(self.keys())):
            raise ValueError("a pair of features touches twice")

    def __len__(self) -> int:
        return len(self.force)

    def keys(self) -> list[tuple[int, int, int, int]]:
        """What names each contact: kind and number of both features."""
        return [(*one, *other) for one, other in zip(self.first.tolist(), self.second.tolist(), strict=True)]

    def names(self) -> list[str]:
        """The contacts in words, as `vertex 21 with facet 49`."""
        kinds = KINDS_OF_FEATURES
        return [f"{kinds[a]} {i} with {kinds[b]} {j}" for a, i, b, j in self.keys()]

    @property
    def total_force(self) -> float:
        """The sum of the forces, dE/dgap."""
        return float(self.force.sum())

    @property
    def touching(self) -> bool:
        """Whether the band rests on itself or crosses itself."""
        return len(self) > 0 or self.penetration > 0.0

    def check(self, segments: int, closed: bool) -> None:
        """Raise ValueError for features that a band of N facets does not have."""
        nodes = segments if closed else segments + 1
        counts: dict[int, Any] = {0: 2 * nodes, 1: 3 * segments + (0 if closed else 1), 2: segments}
        for kind, number in (*self.first.tolist(), *self.second.tolist()):
            if not 0 <= number < counts[kind]:
                raise ValueError(f"a contact names {KINDS_OF_FEATURES[kind]} {number}, which the band lacks")
