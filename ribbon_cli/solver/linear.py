"""Factorisation of the KKT matrix: solutions with verified residuals, and inertia.

qdldl factors the quasi-definite matrix K - delta on the multiplier block as L D L^T; the signs of D
are its inertia (Sylvester). The regularisation is removed from solutions by iterative refinement,
whose residual is checked; where it does not fall, SuperLU with partial pivoting takes over.
"""

from __future__ import annotations

import numpy as np
import qdldl
from scipy import sparse
from scipy.sparse import linalg as sparse_linalg

from ..model.band import Array
from .kkt import KKTMatrix

DELTAS = (1e-9, 1e-8, 1e-10, 1e-7)
"""Regularisations of the scaled multiplier block, in the order tried: far above roundoff, far below the
scaled eigenvalues of the projected Hessian. Without pivoting a factorisation can be unlucky in one of
them: refinement then fails to contract, and the next is tried."""
REFINEMENTS = 6
RESIDUAL_GOAL = 1e-11
RESIDUAL_LIMIT = 1e-9
BACKWARD_LIMIT = 1e-10


class FactorisationError(ArithmeticError):
    """The KKT matrix is singular or not finite."""


class Factor:
    """LDL^T of K - shift M; solves with refinement, so that no regularisation is left in solutions.

    `surplus` is the number of negative pivots beyond one for each constraint and gauge row: a quick
    estimate of the number of eigenvalues of the projected Hessian below `shift`. The certificate's count
    is `inertia.inertia`.
    Raises FactorisationError if the matrix is not finite or a pivot is exactly zero.
    """

    def __init__(self, matrix: KKTMatrix, *, shift: float = 0.0) -> None:
        self.matrix = matrix
        self.shift = shift
        if not np.isfinite(matrix.upper.data).all():
            raise FactorisationError("the KKT matrix is not finite")
        self._shift_diagonal = shift * matrix.scale[: matrix.size] ** 2
        self._tried = 0
        self._lu: sparse_linalg.SuperLU | None = None
        self._solver = self._factor(DELTAS[0])

    def _factor(self, delta: float) -> qdldl.Solver:
        try:
            return qdldl.Solver(self.matrix.regularised(self.shift, delta), upper=True)
        except RuntimeError as error:
            raise FactorisationError(f"LDL^T factorisation failed: {error}") from error

    @property
    def surplus(self) -> int:
        """Negative pivots beyond those of the multiplier block."""
        pivots = np.asarray(self._solver.factors()[1])
        return int((pivots < 0).sum()) - self.matrix.border

    def _product(self, v: Array) -> Array:
        out = self.matrix.product(v)
        if self.shift:
            out[: self.matrix.size] -= self._shift_diagonal * v[: self.matrix.size]
        return out

    def solve(self, rhs: Array) -> Array:
        """Solve (K - shift M) z = rhs in unscaled variables, all (n+m+r,).

        Raises FactorisationError if no method solves it to roundoff.
        """
        scale = self.matrix.scale
        return scale * self._solve_scaled(scale * rhs)

    def _solve_scaled(self, rhs: Array) -> Array:
        size = float(np.abs(rhs).max())
        if size == 0.0:
            return np.zeros_like(rhs)
        while self._lu is None:
            solution, error = self._refined(rhs, size)
            if error <= RESIDUAL_LIMIT:
                return solution
            self._tried += 1
            if self._tried == len(DELTAS):
                break
            self._solver = self._factor(DELTAS[self._tried])
        return self._solve_by_pivoting(rhs, size)

    def _refined(self, rhs: Array, size: float) -> tuple[Array, float]:
        """The best of a few refinements and its residual relative to the right-hand side."""
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

    def _solve_by_pivoting(self, rhs: Array, size: float) -> Array:
        if self._lu is None:
            upper = self.matrix.regularised(self.shift, 0.0)
            try:
                self._lu = sparse_linalg.splu((upper + sparse.triu(upper, 1).T).tocsc())
            except RuntimeError as error:
                raise FactorisationError(f"the KKT matrix is singular: {error}") from error
        solution: Array = self._lu.solve(rhs)
        solution = solution + self._lu.solve(rhs - self._product(solution))
        reach = size + float(np.abs(solution).max())  # entries of the scaled matrix are of order one
        error = float(np.abs(rhs - self._product(solution)).max()) / reach
        if not error <= BACKWARD_LIMIT:
            raise FactorisationError(f"no accurate solution of the KKT system: residual {error:.1e}")
        return solution
