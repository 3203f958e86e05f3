"""A strip kept off itself by a barrier, with collision detection on every step."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ..model.band import Array, Band
from ..model.problem import LocalDerivatives, Problem
from ..model.touching import Shape
from ..model.touching_barrier import Neighbourhood, barrier, nearest
from ..model.touching_gaps import Pairs, arguments, gaps, vectors
from .resting_kkt import Copies, RestingDerivatives, Touched, pulled_back

STIFFNESS = 10.0
"""kappa over the reach: the force of a pair at half of the reach is 1.2 times this."""
ROOM = 0.004
"""Motion of a vertex, as part of l, that a list of neighbours allows of before it is made anew."""


class BarrierProblem(Problem):
    """A problem with the barrier over pairs nearer than `reach`, beyond the gap that they are to keep, in its
    energy."""

    def __init__(self, band: Band, reach: float, gap: float = 0.0) -> None:
        super().__init__(band)
        self.base = Problem(band)
        self.reach, self.gap = reach, gap
        self.kappa = STIFFNESS * reach
        self._near: Neighbourhood | None = None

    def shape(self, x: Array) -> Shape:
        """The features at x (7N,)."""
        return Shape.of(self.state(x), self.gap)

    def _around(self, *shapes: Shape) -> Neighbourhood:
        """Neighbours that cover shapes; made anew, about the first, where the bound on motion is passed."""
        near = self._near
        if near is None or not all(near.covers(shape) for shape in shapes):
            room = ROOM * self.band.length
            far = max(float(np.linalg.norm(s.vertices - shapes[0].vertices, axis=1).max()) for s in shapes)
            near = self._near = Neighbourhood.of(shapes[0], self.gap + self.reach, max(room, 1.001 * far))
        return near

    def allows(self, x: Array, y: Array) -> bool:
        """Whether nothing meets on the straight way from x to y (7N,), and nothing is nearer than the gap
        there."""
        before, after = self.shape(x), self.shape(y)
        around = self._around(before, after)
        if self.gap and len(nearest(after, around.features, self.gap)):
            return False
        return not around.passes(before, after)

    def near(self, x: Array) -> Pairs:
        """The pairs within the reach."""
        shape = self.shape(x)
        return nearest(shape, self._around(shape).features, self.gap + self.reach)

    def forces(self, x: Array, pairs: Pairs) -> Array:
        """What pairs within the reach push with."""
        what = arguments(pairs)
        value = gaps(vectors(self.shape(x), what), what, pairs.sign, self.band.half_width).value
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
        found = gaps(vectors(self.shape(x), what), what, pairs.sign, self.band.half_width)
        value, first, second = barrier(np.maximum((found.value - self.gap) / self.reach, 1e-300))
        first, second = self.kappa / self.reach * first, self.kappa / self.reach**2 * second
        copies = Copies.of(what)
        on_copies = np.zeros((len(copies.kind), 3))
        np.add.at(on_copies, copies.slot.ravel(), (first[:, None, None] * found.gradient).reshape(-1, 3))
        own["energy"] = free.energy + self.kappa * float(value.sum())
        own["gradient"] = free.gradient + pulled_back(self.base, copies, on_copies)
        flat = found.gradient.reshape(-1, 18)
        hessian = (
            second[:, None, None] * flat[:, :, None] * flat[:, None, :] + first[:, None, None] * found.hessian
        )
        touched = Touched(copies, found.gradient[:0], hessian)
        return RestingDerivatives(**own, base=self.base, free=free, touched=touched)

    def lagrangian_gradient(self, local: LocalDerivatives, multipliers: Array) -> Array:
        """Gradient (7N,) of the Lagrangian."""
        assert isinstance(local, RestingDerivatives)
        out: Array = (
            self.base.lagrangian_gradient(local.free, multipliers) + local.gradient - local.free.gradient
        )
        return out
