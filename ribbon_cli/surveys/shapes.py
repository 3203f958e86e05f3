"""What an equilibrium is told from others by, up to rotation, sliding and mirror image.

On a mesh sliding has two stationary places, with the inflections on nodes or on facets' middles. They are one
equilibrium: that which becomes the other when it is slid by half a facet and settled. Its index is then the
lower of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model import strip_folding
from ..model.band import Array, State
from ..model.folding import ClosureError
from ..model.geometry import geometry
from ..model.staggered import inflections
from ..model.strip_symmetry import strip_images, strip_symmetries
from ..model.symmetry import find_image, find_symmetries
from ..solver.arclength import nearest
from ..solver.newton import Guard
from ..solver.prolongation import Phase, smooth
from ..solver.status import STATIONARY, Result
from ..study.resting import crosses

SAME_ENERGY = 1e-6
"""Relative difference of energies up to which shapes are compared: both are converged to 1e-9 and less."""
SAME_SHAPE = 1e-3
"""Root mean square of (u, g) up to which two converged states are one; those of one mesh that differ by one
facet's fold are 0.07 and more apart (pi bands at b = 0.1, N = 48)."""
TWIN_ENERGY = 0.02
"""Relative difference of energies of one band's two places on a mesh: 0.0065 where a facet is longer than the
band is wide, less on others."""
FLAT = 1e-6
"""Fold angle, in parts of the largest, below which its sign is rounding."""


@dataclass(frozen=True, eq=False)
class Shape:
    """An equilibrium on a mesh: its state, energy, index (rotations left out) and number of inflections.

    `gap` is the least distance that contact forces keep, None where contact has no forces.
    """

    state: State
    energy: float
    index: int
    gap: float | None = None

    @classmethod
    def of(cls, result: Result, gap: float | None = None) -> Shape | None:
        """The shape that a result is; None of what is not stationary, or whose index is not known."""
        if result.status not in STATIONARY or result.negative is None:
            return None
        return cls(result.state, result.energy, result.negative, gap)

    @cached_property
    def inflections(self) -> int:
        """How often the curvature changes its sign along the strip."""
        band = self.state.band
        if band.closed:
            return int(inflections(geometry(self.state).kappa_s, band.length, band.sigma).size)
        theta = strip_folding.from_state(self.state).theta[1:-1]
        sides = np.sign(theta[np.abs(theta) > FLAT * np.abs(theta).max()])
        return int((sides[1:] != sides[:-1]).sum())

    @cached_property
    def symmetry(self) -> str:
        """Schoenflies' symbol, of those symmetries as well that the mesh breaks."""
        return (find_symmetries if self.state.band.closed else strip_symmetries)(self.state).near_name

    def is_(self, other: Shape) -> bool:
        """Whether two states are one up to rotation, relabelling and mirror image."""
        if abs(self.energy - other.energy) > SAME_ENERGY * abs(self.energy):
            return False
        return apart(self.state, other.state) < SAME_SHAPE

    def may_be(self, other: Shape) -> bool:
        """Whether two states may be one band's two places on a mesh."""
        return (
            self.inflections == other.inflections
            and abs(self.index - other.index) <= 1
            and abs(self.energy - other.energy) <= TWIN_ENERGY * abs(self.energy)
        )

    def slid(self, guard: Guard | None) -> list[Shape]:
        """What becomes of it slid to either place on the mesh and settled, if that may be the same band.

        With contact forces on, only where nothing crosses there: a band at rest on itself is not slid.
        """
        if not self.state.band.closed:
            return []
        found = []
        for phase in Phase:
            try:
                start = smooth(self.state, self.state.band.segments, phase).state
            except (ClosureError, np.linalg.LinAlgError):
                continue
            twin = Shape.of(nearest(start, guard))
            if twin is None or not twin.may_be(self) or twin.is_(self):
                continue
            if self.gap is None or not crosses(twin.state, self.gap):
                found.append(twin)
        return found


def apart(state: State, other: State) -> float:
    """Root mean square of (u, g) between two states of one band, brought as near to each other as can be."""
    if state.band.closed:
        return find_image(state, other).residual
    return min(image.residual for image in strip_images(state, other))


def coarsened(state: State, offset: int = 0) -> State:
    """A state seen on every other node, from node `offset` on, with mean tangents: for comparisons alone."""
    band = state.band
    coarse = band.with_segments(band.segments // 2)
    if band.closed:
        u, g = _from(state.u, offset, 1), _from(state.g, offset, band.sigma)
    else:
        u, g = state.u, state.g
    u = u[0::2] + u[1::2]
    u /= np.linalg.norm(u, axis=1)[:, None]
    return State(coarse, u, g[0::2], np.zeros(coarse.segments), state.g_end)


def _from(values: Array, offset: int, sign: int) -> Array:
    """Values along a closed band from another node on."""
    out: Array = np.roll(values, -offset, axis=0)
    if offset:
        out[-offset:] *= sign
    return out


def distance(coarse: State, fine: State) -> float:
    """How far a state is from another of the same band with twice as many facets."""
    offsets = (0, 1) if coarse.band.closed else (0,)
    return min(apart(coarse, coarsened(fine, offset)) for offset in offsets)


@dataclass(eq=False)
class Kind:
    """One equilibrium on a mesh: of its stored states the one of the lowest index, with its label `best`, and
    others that it becomes when it is slid.

    `label` is that of the state that was found first.
    """

    label: int
    best: int
    shape: Shape
    twins: list[Shape]

    def holds(self, shape: Shape) -> bool:
        """Whether a state is this one."""
        return any(shape.is_(mine) for mine in (self.shape, *self.twins))


class Kinds:
    """The equilibria found so far on a mesh; `guard` says of a state that slides what is wrong with it."""

    def __init__(self, guard: Guard | None) -> None:
        self.known: list[Kind] = []
        self._guard = guard

    def of(self, shape: Shape) -> Kind | None:
        """The equilibrium that a state is, None for a new one."""
        for kind in self.known:
            if kind.holds(shape):
                return kind
        near = [kind for kind in self.known if kind.shape.may_be(shape)]
        twins = shape.slid(self._guard) if near else []
        for kind in near:
            if any(kind.holds(twin) for twin in twins):
                return kind
        return None

    def add(self, label: int, shape: Shape) -> Kind:
        """A new equilibrium, of which a state is stored under a label."""
        kind = Kind(label, label, shape, shape.slid(self._guard))
        self.known.append(kind)
        return kind

    def improve(self, kind: Kind, label: int, shape: Shape) -> None:
        """Another state of a known equilibrium, of a lower index."""
        kind.twins += [kind.shape, *shape.slid(self._guard)]
        kind.best, kind.shape = label, shape
