"""Where a strip rests on itself: the places of its contacts in space and on the flat strip, and their forces.

A contact has a place on either of its features. With D from a point of the second to one of the first, the
force f pushes the first along n and the second against it, n = sign p x q / |p x q|: p and q are the
directions of two edges, or u_k and g_k of a facet that a vertex touches. Where a gap is kept, a vertex may
also be nearest to an edge or to a vertex: n leads from the second to the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.fields import AS_STORED, Window
from ribbon_cli.export.mesh import Strip, strip
from ribbon_cli.store import StateRecord

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

VERTEX, EDGE, FACET = 0, 1, 2
"""Kinds of features, as files have them."""
TOGETHER = 0.02
"""Distance on the flat strip, as a part of l, below which neighbouring contacts are at one place."""


@dataclass(frozen=True, eq=False)
class Touching:
    """The contacts of a state, in the order of its file.

    `places` (k, 2, 3) are on the first and on the second feature, `flat` (k, 2, 2) the same on the flat strip
    as (s, y), node 1 at s = 0. `normals` (k, 3) lead from the second to the first, `forces` (k,) push along.
    """

    places: Array
    flat: Array
    normals: Array
    forces: Array

    def __len__(self) -> int:
        return len(self.forces)

    @cached_property
    def arrows(self) -> tuple[Array, Array]:
        """Places (2k, 3), first and second in turn, and the forces (2k, 3) that act on the sheets there."""
        push = self.forces[:, None] * self.normals
        return self.places.reshape(-1, 3), np.stack((push, -push), axis=1).reshape(-1, 3)


NONE = Touching(np.empty((0, 2, 3)), np.empty((0, 2, 2)), np.empty((0, 3)), np.empty(0))


def touching(record: StateRecord) -> Touching:
    """What a state touches; nothing where it was computed without contact forces."""
    contacts = record.contacts
    if contacts is None or not len(contacts.force):
        return NONE
    features = _Features(record, strip(record))
    pairs = zip(contacts.first.tolist(), contacts.second.tolist(), strict=True)
    found = [features.nearest(first, second) for first, second in pairs]
    places = np.array([[one, two] for one, two, _ in found])
    owners = np.stack([features.owners(side) for side in (contacts.first, contacts.second)], axis=1)
    normals = contacts.sign[:, None] * np.array([normal for *_, normal in found])
    return Touching(places, features.flattened(places, owners), normals, contacts.force)


@dataclass(frozen=True, eq=False)
class _Features:
    """Vertices 2k and 2k + 1 at -b g_k and +b g_k; edges 3k, 3k + 1, 3k + 2: ruling k, and the lower and the
    upper side of facet k."""

    record: StateRecord
    strip: Strip

    def point(self, feature: list[int]) -> Array:
        """A point (3,) of a feature: of an edge its beginning, of a facet one of its corners."""
        kind, at = feature
        points = self.strip.points
        if kind == VERTEX:
            place: Array = points[at]
            return place
        if kind == EDGE:
            at = 2 * (at // 3) + (at % 3 == 2)
            return np.asarray(points[at])
        return np.asarray(points[2 * at])

    def direction(self, edge: int) -> Array:
        """The direction (3,) of an edge: g of a ruling, u of a side."""
        node, which = divmod(edge, 3)
        if which:
            return np.asarray(self.record.u[node])
        low, high = self.strip.points[2 * node : 2 * node + 2]
        return np.asarray(high - low)

    def nearest(self, first: list[int], second: list[int]) -> tuple[Array, Array, Array]:
        """The places (3,) at which two features are nearest, and the unit vector that their gap is along."""
        one, two = self.point(first), self.point(second)
        apart = one - two
        if first[0] == EDGE:
            p, q = self.direction(first[1]), self.direction(second[1])
            across = np.cross(p, q)
            square = across @ across
            one = one - (apart @ np.cross(q, across)) / square * p
            two = two - (apart @ np.cross(p, across)) / square * q
            return one, two, across / np.sqrt(square)
        if second[0] == FACET:
            across = np.cross(self.record.u[second[1]], self.record.g[second[1]])
            normal = across / np.linalg.norm(across)
            return one, one - (apart @ normal) * normal, normal
        if second[0] == EDGE:
            q = self.direction(second[1])
            two = two + (apart @ q) / (q @ q) * q
        normal = (one - two) / np.linalg.norm(one - two)
        return one, two, normal

    def owners(self, features: Indices) -> Indices:
        """A facet (k,) that each of the features (k, 2) belongs to."""
        number = features[:, 1] // np.array([2, 3, 1])[features[:, 0]]
        out: Indices = np.minimum(number, self.record.segments - 1)
        return out

    def flattened(self, places: Array, owners: Indices) -> Array:
        """Places (k, 2, 3) on facets (k, 2) as (s, y) (k, 2, 2): in a facet's plane u is (1, 0) and g is
        (eta, 1)."""
        record = self.record
        u, g = record.u[owners], record.g[owners]
        away = places - record.midline[owners]
        along, eta = (away * u).sum(-1), (u * g).sum(-1)
        y = (away * g).sum(-1) - eta * along
        out: Array = np.stack((record.length / record.segments * owners + along, y), axis=-1)
        return out


def counted(record: StateRecord, flat: Array, window: Window = AS_STORED) -> Array:
    """Flat places (..., 2) with s counted as `window` says, from 0 to l on a closed band: what lies beyond
    comes back at the other end, upside down on a one-sided one."""
    if record.sigma == 0:
        return flat
    s = flat[..., 0] - window.first * record.length / record.segments + window.offset
    turns = np.floor(s / record.length)
    upside = np.where(turns % 2 == 0, 1, record.sigma) * window.flip
    out: Array = np.stack((s - turns * record.length, upside * flat[..., 1]), axis=-1)
    return out


def gathered(record: StateRecord, flat: Array) -> list[Indices]:
    """Contacts (k,) in groups: neighbours on the flat strip, on both sides, are at one place.

    A chain of neighbours is one group. Groups and their members are in the order given.
    """
    count, near = len(flat), TOGETHER * record.length
    either = [
        (_between(record, flat[:, None, 0], flat[None, :, a]) < near)
        & (_between(record, flat[:, None, 1], flat[None, :, 1 - a]) < near)
        for a in (0, 1)
    ]
    joined = either[0] | either[1]
    left = list(range(count))
    groups = []
    while left:
        waiting, group = [left[0]], {left[0]}
        while waiting:
            new = set(np.flatnonzero(joined[waiting.pop()]).tolist()) - group
            group |= new
            waiting += sorted(new)
        groups.append(np.array(sorted(group)))
        left = [k for k in left if k not in group]
    return groups


def _between(record: StateRecord, one: Array, other: Array) -> Array:
    """Distances on the strip between flat places (..., 2), the shortest way round a closed one."""
    turns = (-1, 0, 1) if record.sigma else (0,)
    ways = [
        np.hypot(
            one[..., 0] - other[..., 0] - turn * record.length,
            one[..., 1] - (record.sigma if turn else 1) * other[..., 1],
        )
        for turn in turns
    ]
    out: Array = np.min(ways, axis=0)
    return out
