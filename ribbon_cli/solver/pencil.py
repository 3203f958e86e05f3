"""The pencil (W_c, M_c) of projected Hessian and metric at a point, on sparse matrices of any N.

What shift-invert Lanczos and its checks need: how many eigenvalues lie below a shift, by the inertia of the
block reduction; (W_c - shift M_c)^-1 on columns; and lengths of residuals in the dual metric, which bound the
distance to an eigenvalue.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import numpy as np
import scipy

from ..model.band import Array
from ..model.metrics import Metric
from ..model.problem import LocalDerivatives, Problem
from .inertia import BlockReduction, Inertia, NodeMetric
from .kkt import FINE, FactorisationError, KKTMatrix
from .linear import Factor
from .resting_kkt import kkt_matrix

CROWD = 2
"""Eigenvalues, relative to those wanted, that may lie between a shift and its mirror image."""
CLOSE_STEPS = 40
COLUMNS = 6
"""Columns that are solved for at once on fine grids, where each takes memory in a dozen arrays."""
REFINEMENTS = 2
FEW_REFINEMENTS = 1
"""Refinements of a solution, and on fine grids those of a length that is wanted to three digits."""
ROUNDOFF = 8.0
"""Roundoff of a Rayleigh quotient in units of eps |v|^T |W| |v|: nine products of two factors a row, most of
whose errors cancel."""


class Pencil:
    """Hessian W and metric M of a problem at a point, restricted to moves that keep the constraints, and
    gaps that are kept.

    `hessian` and `mass` are sparse (7N, 7N); rotations (7N, r) are held. Raises FactorisationError where the
    derivatives are not finite.
    """

    def __init__(self, problem: Problem, x: Array, local: LocalDerivatives, metric: Metric) -> None:
        self.problem, self.local = problem, local
        self.rotations = problem.rotations(x)
        self.matrix = kkt_matrix(problem, local, self.rotations)
        if not np.isfinite(self.matrix.upper.data).all():
            raise FactorisationError("the KKT matrix is not finite")
        self.hessian = problem.hessian_matrix(local)
        self._state = problem.state(x)
        self._shifted: dict[float, BlockReduction] = {}
        self._measure(metric)

    def _measure(self, metric: Metric) -> None:
        problem, self.metric = self.problem, metric
        mass = metric.matrix(self._state)
        if problem.fixed.any():
            moves = scipy.sparse.diags((~problem.fixed).astype(np.float64))
            mass = (moves @ mass @ moves).tocsr()
        self.mass = mass
        self._nodes = NodeMetric(mass)
        # That of K itself is the same in every metric.
        self._shifted = {shift: found for shift, found in self._shifted.items() if not shift}

    def beside(self, metric: Metric) -> Pencil:
        """The pencil at the same point in another metric."""
        out = copy(self)
        out._measure(metric)
        return out

    @property
    def size(self) -> int:
        """7N."""
        return self.problem.size

    def release(self) -> None:
        """Let go of reductions that would serve again, for their memory."""
        self._shifted = {}

    def _reduction(self, shift: float) -> BlockReduction:
        if shift not in self._shifted:
            self._shifted[shift] = BlockReduction(self.matrix, shift, self._nodes)
        return self._shifted[shift]

    def count_below(self, shift: float) -> Inertia:
        """Number of eigenvalues of the pencil below `shift`, rotations left out."""
        return self._reduction(shift).inertia

    def has_at_most(self, count: int, shift: float) -> bool:
        """Whether no more than `count` eigenvalues are below `shift`: by pivots where these prove it.

        On fine grids they need a symbolic factorisation, and often several regularisations in vain.
        """
        if self.matrix.size > 7 * FINE:
            found = BlockReduction(self.matrix, shift, self._nodes).inertia  # used once, and not kept
            return found.trusted and found.negative <= count
        weights = self.mass.diagonal()
        diagonal = self.mass.count_nonzero() == np.count_nonzero(weights)
        if diagonal and Factor(self.matrix.measured(weights), shift=shift).proves_at_most(count):
            return True
        found = self.count_below(shift)
        return found.trusted and found.negative <= count

    def inverse(self, shift: float, refinements: int = REFINEMENTS) -> Callable[[Array], Array]:
        """(W_c - shift M_c)^-1 as a function of forces (7N, k); its values are moves (7N, k)."""
        return _Inverse(self.matrix, self.mass, shift, self._reduction(shift), refinements).moves

    def shift_below_all(self, wanted: int = 1) -> float:
        """A negative shift with no eigenvalue below it, near enough to separate the `wanted` lowest ones.

        Its size is such that not many more than those lie in [shift, -shift]: seen from farther off, all
        low eigenvalues look alike. Raises FactorisationError if no shift is found.
        """
        size = self.metric.unit(self.problem.band)
        while size > 1e-12 * self.metric.unit(self.problem.band) and self._crowded(size, wanted):
            size *= 0.25
        for _ in range(40):
            found = self.count_below(-size)
            if found.negative == 0 and found.trusted:
                return -size
            self._shifted.pop(-size)
            size *= 4.0
        raise FactorisationError("no shift below all eigenvalues was found")

    def close_shift(self, wanted: int) -> float:
        """A shift below all eigenvalues, about as far from them as the `wanted` lowest spread.

        Where many eigenvalues are nearly equal only such a one tells them apart; it takes some twenty counts.
        Raises FactorisationError if no shift is found.
        """
        low = self.shift_below_all(wanted)
        high = -low
        while self._count_once(high) < wanted:
            high *= 4.0
        for _ in range(CLOSE_STEPS):
            middle = 0.5 * (low + high)
            count = self._count_once(middle)
            if count == 0:
                low = middle
            elif count >= wanted:
                high = middle
            else:
                break
        return low - 0.5 * (high - low)

    def _count_once(self, shift: float) -> int:
        """A count whose factorisation is not kept."""
        known = self._shifted.get(shift)
        return (known or BlockReduction(self.matrix, shift, self._nodes, keep=False)).negative

    def _crowded(self, size: float, wanted: int) -> bool:
        """Whether many more eigenvalues than wanted lie below `size`."""
        return self._count_once(size) > CROWD * wanted

    def residuals(self, values: Array, vectors: Array) -> Array:
        """Dual lengths (k,) of the residuals r = W v - mu M v of M-normalised modes (7N, k).

        |r|_* = max r.w / |w|_M over the moves w that keep the constraints. Some eigenvalue is within |r|_*
        of mu: Parlett (1998), theorem 15.9.1.
        """
        excess = self.hessian @ vectors - (self.mass @ vectors) * values
        empty = self.matrix.without_hessian()
        refinements = FEW_REFINEMENTS if self.size > 7 * FINE else REFINEMENTS
        project = _Inverse(empty, self.mass, -1.0, BlockReduction(empty, -1.0, self._nodes), refinements)
        dual = np.einsum("ij,ij->j", excess, project.moves(excess))
        # Where roundoff makes one negative, its size says how far it can be trusted.
        out: Array = np.sqrt(np.abs(dual))
        return out


def roundoff(hessian: scipy.sparse.csr_matrix, vectors: Array) -> Array:
    """What roundoff may do to the Rayleigh quotients (k,) of modes (7N, k) of unit length."""
    # A few digits of a bound will do, in half the time.
    size, entries = np.abs(vectors).astype(np.float32), abs(hessian).astype(np.float32)
    out: Array = np.einsum("ij,ij->j", size, entries @ size).astype(np.float64)
    return ROUNDOFF * np.finfo(float).eps * out


class _Inverse:
    """Solutions of (K - shift M) z = (f, 0), refined."""

    def __init__(
        self,
        matrix: KKTMatrix,
        mass: scipy.sparse.csr_matrix,
        shift: float,
        blocks: BlockReduction,
        refinements: int = REFINEMENTS,
    ) -> None:
        self.matrix, self.mass, self.shift, self.blocks = matrix, mass, shift, blocks
        self.refinements = refinements
        self.scale = matrix.scale[: matrix.size, None]

    def _product(self, z: Array) -> Array:
        out = self.matrix.product(z)
        n = self.matrix.size
        out[:n] -= self.shift * self.scale * (self.mass @ (self.scale * z[:n]))
        return out

    def moves(self, forces: Array) -> Array:
        """The moves (7N, k) of forces (7N, k). Raises FactorisationError if they are not finite."""
        some = COLUMNS if self.matrix.size > 7 * FINE else forces.shape[1]
        if forces.shape[1] > some:
            parts = range(0, forces.shape[1], some)
            return np.hstack([self.moves(forces[:, first : first + some]) for first in parts])
        n = self.matrix.size
        rhs = np.zeros((n + self.matrix.border, forces.shape[1]))
        rhs[:n] = self.scale * forces
        rhs[:n][self.matrix.fixed] = 0.0
        z = self.blocks.solve(rhs)
        for _ in range(self.refinements):
            z += self.blocks.solve(rhs - self._product(z))
        if not np.isfinite(z).all():
            raise FactorisationError("the KKT system has no finite solution")
        out: Array = self.scale * z[:n]
        return out
