"""Factorisation of the KKT matrix: solutions with verified residuals, and inertia.

qdldl factors the quasi-definite matrix K - delta on the multiplier block as L D L^T; the signs of D
are its inertia (Sylvester). The regularisation is removed from solutions by iterative refinement,
whose residual is checked; where it does not fall, block cyclic reduction takes over, which needs no
regularisation.
"""

from __future__ import annotations

import weakref

import numpy as np
import qdldl

from ..model.band import Array
from .inertia import BlockReduction
from .kkt import KKTMatrix

DELTA = 1e-8
DELTA_GRID = 400
DELTA_FACTORS = (1.0, 10.0, 0.1, 100.0)
"""Regularisation of the scaled multiplier block, and factors on it in the order tried: far above roundoff,
far below the scaled eigenvalues of the projected Hessian. Without pivoting a factorisation can be unlucky in
one of them: refinement then fails to contract, and the next is tried. Roundoff grows with N, and beyond
`DELTA_GRID` segments the regularisation with it."""
REFINEMENTS = 6
RESIDUAL_GOAL = 1e-11
RESIDUAL_LIMIT = 1e-7
"""Relative residual of a solution that is accepted: it bounds how far one Newton step can converge."""
LANCZOS_LIMIT = 2e-9
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
        idle = matrix.pattern.idle
        self._solver: qdldl.Solver | None = idle.pop() if idle else None
        self._factor()
        if self._solver is not None:
            # Its symbolic part, four fifths of the work, serves the next matrix of this pattern.
            weakref.finalize(self, idle.append, self._solver).atexit = False

    @property
    def _delta(self) -> float:
        grid = max(1.0, self.matrix.size / (7 * DELTA_GRID))
        return DELTA * grid * DELTA_FACTORS[self._tried]

    def _factor(self) -> None:
        """LDL^T with the regularisation of this try; no pivots are kept if it meets a zero one."""
        upper = self.matrix.regularised(self.shift, self._delta)
        try:
            if self._solver is None:
                self._solver = qdldl.Solver(upper, upper=True)
            else:
                self._solver.update(upper, upper=True)
        except RuntimeError:
            self._pivots = None
            return
        pivots = np.asarray(self._solver.factors()[1])
        self._pivots = pivots if pivots.all() else None

    @property
    def surplus(self) -> int:
        """Negative pivots beyond those of the multiplier block."""
        if self._pivots is None or self._solver is None:
            return self._reduced().inertia.negative
        return int((self._pivots < 0).sum()) - int(self.matrix.border)

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
        limit = LANCZOS_LIMIT if backward else RESIDUAL_LIMIT
        while self._blocks is None:
            solution, error = self._refined(rhs, size)
            if error <= limit:
                return solution
            if backward and error * size <= BACKWARD_GOAL * float(np.abs(solution).max()):
                return solution
            if self._tried + 1 == len(DELTA_FACTORS):
                break
            self._tried += 1
            self._factor()
        return self._solve_by_blocks(rhs, size)

    def _refined(self, rhs: Array, size: float) -> tuple[Array, float]:
        """The best of a few refinements and its residual relative to the right-hand side."""
        if self._pivots is None or self._solver is None:
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
