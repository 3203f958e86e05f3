"""Factorisation of the KKT matrix: solutions with verified residuals, and inertia.

qdldl factors the quasi-definite matrix K - delta on the multiplier block as L D L^T; the signs of D
are its inertia (Sylvester). The regularisation is removed from solutions by iterative refinement,
whose residual is checked; where it does not fall, block cyclic reduction takes over, which needs no
regularisation.
"""

from __future__ import annotations

import numpy as np
import qdldl

from ..model.band import Array
from .inertia import BlockReduction
from .kkt import KKTMatrix

DELTAS = (1e-8, 1e-7, 1e-9, 1e-6)
"""Regularisations of the scaled multiplier block, in the order tried: far above roundoff, far below the
scaled eigenvalues of the projected Hessian. Without pivoting a factorisation can be unlucky in one of
them: refinement then fails to contract, and the next is tried."""
REFINEMENTS = 6
RESIDUAL_GOAL = 1e-11
RESIDUAL_LIMIT = 2e-9
BACKWARD_LIMIT = 1e-10
BACKWARD_GOAL = 1e-12
BLOCK_REFINEMENTS = 2


class FactorisationError(ArithmeticError):
    """The KKT matrix is singular or not finite."""


class Factor:
    """LDL^T of K - shift M; solves with refinement, so that no regularisation is left in solutions.

    `surplus` is the number of negative pivots beyond one for each constraint and gauge row: a quick
    estimate of the number of eigenvalues of the projected Hessian below `shift`. The certificate's count
    is `inertia.inertia`.
    Raises FactorisationError if the matrix is not finite.
    """

    def __init__(self, matrix: KKTMatrix, *, shift: float = 0.0) -> None:
        self.matrix = matrix
        self.shift = shift
        if not np.isfinite(matrix.upper.data).all():
            raise FactorisationError("the KKT matrix is not finite")
        self._shift_diagonal = shift * matrix.metric
        self._tried = 0
        self._blocks: BlockReduction | None = None
        self._solver = self._factor(DELTAS[0])

    def _factor(self, delta: float) -> qdldl.Solver | None:
        """LDL^T with one regularisation; None if it meets a zero pivot."""
        try:
            return qdldl.Solver(self.matrix.regularised(self.shift, delta), upper=True)
        except RuntimeError:
            return None

    @property
    def surplus(self) -> int:
        """Negative pivots beyond those of the multiplier block."""
        if self._solver is None:
            return self._reduced().inertia.negative
        pivots = np.asarray(self._solver.factors()[1])
        return int((pivots < 0).sum()) - int(self.matrix.border)

    def _product(self, v: Array) -> Array:
        out = self.matrix.product(v)
        if self.shift:
            out[: self.matrix.size] -= self._shift_diagonal * v[: self.matrix.size]
        return out

    def solve(self, rhs: Array, *, backward: bool = False) -> Array:
        """Solve (K - shift M) z = rhs in unscaled variables, all (n+m+r,).

        `backward` accepts a small backward error, which is what Lanczos near a singular shift needs and
        all it can have: there, what is left of errors lies along the eigenvectors that are looked for.
        Raises FactorisationError if no method solves it to roundoff.
        """
        scale = self.matrix.scale
        return scale * self._solve_scaled(scale * rhs, backward)

    def _solve_scaled(self, rhs: Array, backward: bool) -> Array:
        size = float(np.abs(rhs).max())
        if size == 0.0:
            return np.zeros_like(rhs)
        while self._blocks is None:
            solution, error = self._refined(rhs, size)
            if error <= RESIDUAL_LIMIT:
                return solution
            if backward and error * size <= BACKWARD_GOAL * float(np.abs(solution).max()):
                return solution
            self._tried += 1
            if self._tried == len(DELTAS):
                break
            self._solver = self._factor(DELTAS[self._tried])
        return self._solve_by_blocks(rhs, size)

    def _refined(self, rhs: Array, size: float) -> tuple[Array, float]:
        """The best of a few refinements and its residual relative to the right-hand side."""
        if self._solver is None:
            return rhs, np.inf
        solution = np.asarray(self._solver.solve(rhs))
        best, best_error = solution, np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - self._product(solution)
            error = float(np.abs(residual).max()) / size
            if not error < 0.5 * best_error:
                return (solution, error) if error < best_error else (best, best_error)
            best, best_error = solution, error
            if error <= RESIDUAL_GOAL:
                break
            solution = solution + np.asarray(self._solver.solve(residual))
        return best, best_error

    def _reduced(self) -> BlockReduction:
        if self._blocks is None:
            self._blocks = BlockReduction(self.matrix, self.shift)
        return self._blocks

    def _solve_by_blocks(self, rhs: Array, size: float) -> Array:
        blocks = self._reduced()
        solution = blocks.solve(rhs)
        for _ in range(BLOCK_REFINEMENTS):
            solution = solution + blocks.solve(rhs - self._product(solution))
        reach = size + float(np.abs(solution).max())  # entries of the scaled matrix are of order one
        error = float(np.abs(rhs - self._product(solution)).max()) / reach
        if not error <= BACKWARD_LIMIT:
            raise FactorisationError(f"no accurate solution of the KKT system: residual {error:.1e}")
        return solution
