"""A strip kept off itself by a barrier, with collision detection on every step."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ..model.band import Array, Band
from ..model.problem import LocalDerivatives, Problem
from ..model.touching import Shape
from ..model.touching_barrier import Surroundings, barrier, nearest
from ..model.touching_gaps import Arguments, Pairs, arguments, gap_values, gaps, vectors
from .resting_kkt import Copies, RestingDerivatives, Touched, on_copies, pulled_back

STIFFNESS = 10.0
"""kappa over the reach: the force of a pair at half of the reach is 1.2 times this."""
SPARE = 2.0
"""Reach, as a multiple of the barrier's, up to which pairs have places in the matrix before they push."""
MOST_SPARE = 4
"""How many times as many entries as are needed may be kept in the matrix."""
ROUNDING, SHY = 4e-15, 1e-6
"""How far off another step's line, as part of x, a step may be by rounding, and how much short of where that
one meets something it has to end."""
ROOM = 0.004
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""


class BarrierProblem(Problem):
    """A problem with the barrier over pairs nearer than `reach`, beyond the gap that they are to keep, in its
    energy.

    `near_by` are the lists of another barrier in whose place this one comes, of a longer reach.
    """

    xi_follows = True

    def __init__(
        self, band: Band, reach: float, gap: float = 0.0, near_by: Surroundings | None = None
    ) -> None:
        super().__init__(band)
        self.base = Problem(band)
        self.reach, self.gap = reach, gap
        self.kappa = STIFFNESS * reach
        self.near_by = near_by or Surroundings(self.gap + SPARE * self.reach, ROOM * band.length)
        self._spare: Copies | None = None
        self._last: tuple[Array, Shape] | None = None
        self._ray: tuple[Array, Array, float] | None = None
        self._way: tuple[Array, Array, bool] | None = None

    def shape(self, x: Array) -> Shape:
        """The features at x (7N,), which are kept for the last one."""
        if self._last is None or self._last[0] is not x:
            self._last = x, Shape.of(self.state(x), self.gap)
        return self._last[1]

    def allows(self, x: Array, y: Array) -> bool:
        """Whether nothing meets on the straight way from x to y (7N,), and nothing is nearer than the gap
        there."""
        if self._way is None or self._way[0] is not x or self._way[1] is not y:
            self._way = x, y, self._looked(x, y)
        return self._way[2]

    def _looked(self, x: Array, y: Array) -> bool:
        before, after = self.shape(x), self.shape(y)
        if self.gap and len(nearest(after, self.near_by.of(after).features, self.gap)):
            return False
        # Vertices are linear in x: a part of a way meets nothing if all of it does so later only.
        move, ray = y - x, self._ray
        move[6::7] = 0.0
        if ray is not None and ray[0] is x and ray[1].any():
            part = float(move @ ray[1]) / float(ray[1] @ ray[1])
            off = np.abs(move - part * ray[1]).max()
            if 0.0 < part <= 1.0 and off <= ROUNDING * np.abs(x).max():
                return part < (1.0 - SHY) * ray[2]
        when = self.near_by.first_meeting(before, after)
        self._ray = x, move, when
        return when > 1.0

    def near(self, x: Array) -> Pairs:
        """The pairs within the reach."""
        shape = self.shape(x)
        return nearest(shape, self.near_by.of(shape).features, self.gap + self.reach)

    def forces(self, x: Array, pairs: Pairs) -> Array:
        """What pairs within the reach push with."""
        value = gap_values(self.shape(x), pairs)
        out: Array = -self.kappa / self.reach * barrier((value - self.gap) / self.reach)[1]
        return out

    def local_derivatives(self, x: Array, multipliers: Array | None) -> LocalDerivatives:
        """All derivatives at x, with those of the barrier."""
        free = self.base.local_derivatives(x, multipliers)
        own = {f.name: getattr(free, f.name) for f in fields(LocalDerivatives)}
        pairs = self.near(x)
        if not len(pairs):
            return RestingDerivatives(**own, base=self.base, free=free, touched=None)
        what = arguments(pairs)
        shape = self.shape(x)
        found = gaps(vectors(shape, what), what, pairs.sign, self.band.half_width)
        value, first, second = barrier(np.maximum((found.value - self.gap) / self.reach, 1e-300))
        first, second = self.kappa / self.reach * first, self.kappa / self.reach**2 * second
        copies = self._copied(shape, what)
        pushed = on_copies(copies, first[:, None, None] * found.gradient)
        own["energy"] = free.energy + self.kappa * float(value.sum())
        own["gradient"] = free.gradient + pulled_back(self.base, copies, pushed)
        flat = found.gradient.reshape(-1, 18)
        hessian = (
            second[:, None, None] * flat[:, :, None] * flat[:, None, :] + first[:, None, None] * found.hessian
        )
        touched = Touched(copies, found.gradient[:0], hessian)
        return RestingDerivatives(**own, base=self.base, free=free, touched=touched)

    def with_multipliers(self, x: Array, local: LocalDerivatives, multipliers: Array) -> LocalDerivatives:
        """The derivatives at x for other multipliers (5N+3,); the barrier's own stay."""
        assert isinstance(local, RestingDerivatives)
        free = self.base.with_multipliers(x, local.free, multipliers)
        return replace(local, multipliers=multipliers, free=free)

    def _copied(self, shape: Shape, what: Arguments) -> Copies:
        """Copies for pairs within the reach, with those for pairs that are soon to be there, or were before:
        so the matrix keeps its pattern."""
        known = self._spare
        copies = Copies.of(what, known)
        if known is None or copies.extent != known.extent:
            own = Copies.of(what)
            if copies.extent[1] > MOST_SPARE * own.extent[1]:
                copies = own
            soon = nearest(shape, self.near_by.of(shape).features, self.gap + SPARE * self.reach)
            self._spare = Copies.of(arguments(soon), copies)
            copies = Copies.of(what, self._spare)
        return copies

    def lagrangian_gradient(self, local: LocalDerivatives, multipliers: Array) -> Array:
        """Gradient (7N,) of the Lagrangian."""
        assert isinstance(local, RestingDerivatives)
        out: Array = (
            self.base.lagrangian_gradient(local.free, multipliers) + local.gradient - local.free.gradient
        )
        return out
