"""Factorisation of the KKT matrix: solutions with verified residuals, and inertia.

qdldl factors the quasi-definite matrix K - delta on the multiplier block as L D L^T; the signs of D
are its inertia (Sylvester). The regularisation is removed from solutions by iterative refinement,
whose residual is checked; where it does not fall, block cyclic reduction takes over, which needs no
regularisation.

On fine grids one mode, sliding, has an eigenvalue far below the regularisation, and refinement alone leaves
it as it is. There the residual is made least over the last few corrections.
"""

from __future__ import annotations

import weakref

import numpy as np

from ..model.band import Array
from .inertia import CONTRACTION, BlockReduction, Inertia, radius
from .kkt import FINE, FactorisationError, KKTMatrix
from .ldl import Ldl, factored_again, factors

DELTA = 1e-8
DELTA_GRID = 400
DELTA_FACTORS = (1.0, 10.0, 0.1, 100.0)
"""Regularisation of the scaled multiplier block, and factors on it in the order tried: far above roundoff,
far below the scaled eigenvalues of the projected Hessian. Without pivoting a factorisation can be unlucky in
one of them: refinement then fails to contract, and the next is tried. Roundoff grows with N, and beyond
`DELTA_GRID` segments the regularisation with it."""
REFINEMENTS = 6
RESIDUAL_LIMIT = 1e-7
"""Relative residual of a solution that is accepted; refinement goes on to a thousandth of it if it can."""
BACKWARD_RESIDUAL = 1e-8
BACKWARD_LIMIT = 1e-10
BACKWARD_GOAL = 1e-12
BLOCK_REFINEMENTS = 2
DIRECTIONS = 3
ACCELERATED = 8
LONGER = 16
"""Corrections over which a residual is made least on grids of more than `DELTA_GRID` segments, how many are
tried, and how many on fine grids, where the block reduction takes as long as thirty."""
EXTENDED_REFINEMENTS = 4
FORWARD_LIMIT = 1e-6
"""Refinements with residuals in extended precision where the backward error is above its limit, and the last
correction, as part of the solution, up to which that is trusted: what is left is smaller still."""
PROOFS = 4
"""Regularisations tried for a proof."""


class Factor:
    """LDL^T of K - shift M; solves with refinement, so that no regularisation is left in solutions.

    `surplus` is the number of negative pivots beyond one for each constraint and gauge row: a quick
    estimate of the number of eigenvalues of the projected Hessian below `shift`. The certificate's count
    is `inertia.inertia`.
    With `exact` nothing is regularised: the block reduction solves and counts from the beginning.
    `regularisation` stands for the usual one. With a `definite` Hessian and nothing but multipliers beside it
    no pivot is zero, and none is looked at. The residual of `accelerated` solutions is made least, as on
    large grids, before another regularisation is tried.
    Raises FactorisationError if the matrix is not finite.
    """

    def __init__(
        self,
        matrix: KKTMatrix,
        *,
        shift: float = 0.0,
        exact: bool = False,
        regularisation: float | None = None,
        definite: bool = False,
        accelerated: bool = False,
    ) -> None:
        self.matrix = matrix
        self.shift = shift
        if not np.isfinite(matrix.upper.data).all():
            raise FactorisationError("the KKT matrix is not finite")
        self._shift_diagonal = shift * matrix.metric
        self._fine = accelerated or matrix.size > 7 * DELTA_GRID
        self._base = regularisation or DELTA * max(1.0, matrix.size / (7 * DELTA_GRID))
        self._blocks: BlockReduction | None = None
        self._solver: Ldl | None = None
        self._found = False
        self._definite = definite and matrix.duals == matrix.border
        self._large = matrix.size > 7 * FINE
        self.exact, self.stale = exact, False
        if exact:
            self._reduced()
            return
        idle = matrix.pattern.idle
        self._solver = idle.pop() if idle else None
        self._factor(self._base)
        # On the finest grids another one takes as long as the block reduction, which is sure.
        self._untried = [] if self._large else [self._base * f for f in DELTA_FACTORS[1:]]
        if self._solver is not None:
            # Its symbolic part, four fifths of the work, serves the next matrix of this pattern.
            weakref.finalize(self, idle.append, self._solver).atexit = False

    def _factor(self, delta: float) -> None:
        """LDL^T with one regularisation; there is none if it meets a zero pivot."""
        self._delta = delta
        upper = self.matrix.regularised(self.shift, delta)
        try:
            known = self.matrix.pattern.symbolic
            if self._solver is None:
                self._solver = factors(upper, known, again=self._large)
            else:
                self._solver = factored_again(self._solver, upper, known)
            # Counting pivots may take a copy of L.
            self._found = self._definite or self._solver.positive() is not None
        except RuntimeError:
            self._found = False

    @property
    def _negative(self) -> int | None:
        """How many pivots are negative, None if one is zero."""
        if not self._found:
            return None
        assert self._solver is not None
        positive = self._solver.positive()
        self._found = positive is not None
        return None if positive is None else self.matrix.size + self.matrix.border - positive

    def serving(self, matrix: KKTMatrix) -> Factor:
        """The same exact factors for another matrix of the pattern and the scaling, at a place nearby.

        Solutions are refined by that matrix, and the factors made anew where they are too far from it; the
        count is that of the matrix factored.
        """
        self.stale = matrix is not self.matrix
        self.matrix = matrix
        return self

    def anew(self) -> Factor:
        """Exact factors of the present matrix in place of those of another."""
        self._blocks, self.stale = None, False
        self._reduced()
        return self

    def counted(self, like: KKTMatrix | None = None) -> Inertia:
        """The count by block reduction, its roundoff measured against `like` as in `proves_at_most`."""
        return self._reduced().measured(like or self.matrix)

    @property
    def surplus(self) -> int:
        """Negative pivots beyond those of the multiplier block."""
        negative = None if self.exact else self._negative
        return self._reduced().negative if negative is None else negative - int(self.matrix.duals)

    def proves_minimum(self, like: KKTMatrix | None = None) -> bool:
        """Whether the pivots prove that the projected Hessian has no eigenvalue below `shift`."""
        return self.proves_at_most(0, like)

    def proves_at_most(self, count: int, like: KKTMatrix | None = None) -> bool:
        """Whether the pivots prove that the projected Hessian has at most `count` eigenvalues below `shift`.

        With delta > 0 on the multipliers the surplus of negative eigenvalues is that of W + A^T A / delta,
        at least that of W_c, which is its restriction to A v = 0: no more there, no more here. That roundoff
        E did not change the pivots' signs follows from rho((L D L^T)^-1 E) < 1, as no eigenvalue then passes
        zero on the way from L D L^T to K - delta. Power iterations show how small rho is. With `like`, a
        matrix of the same pattern at a place that counts as the same one, E is taken to that one.
        """
        low, high = 0.0, np.inf
        for _ in range(PROOFS):
            if self._negative is None:
                return False
            sharp, few = self._contraction(like or self.matrix) < CONTRACTION, self.surplus <= count
            if sharp and few:
                return True
            # More regularisation has less roundoff, less of it fewer negative eigenvalues.
            if sharp:
                high = self._delta
            elif few:
                low = self._delta
            else:
                return False
            self._factor(
                10.0 * low if high == np.inf else 0.1 * high if low == 0.0 else float(np.sqrt(low * high))
            )
        return False

    def proves_index(self, like: KKTMatrix | None = None) -> int | None:
        """How many eigenvalues of the projected Hessian the pivots prove to be below `shift`; None if they do
        not.

        Of none it is as in `proves_minimum`. Otherwise the surplus is at least their number, as there. With
        -delta there are as many negative eigenvalues as W - A^T A / delta has: beyond one for each row no
        more than W_c has, to which that is restricted by so many conditions. So that surplus is at most their
        number, and where both are the same, and roundoff changed neither, they are it.
        """
        like, most = like or self.matrix, 0 if self._negative is None else self.surplus
        if most and self._contraction(like) < CONTRACTION:
            self._factor(-self._delta)
            least = 0 if self._negative is None else self.surplus
            if least == most and self._contraction(like) < CONTRACTION:
                return most
            self._factor(-self._delta)
        return 0 if self.proves_minimum(like) else None

    def _contraction(self, like: KKTMatrix) -> float:
        """Spectral radius of (L D L^T)^-1 E, E what L D L^T lacks of a matrix, by power iterations."""
        size = like.size

        def image(v: Array) -> Array:
            out = like.product(v)
            if self.shift:
                out[:size] -= self._shift_diagonal * v[:size]
            out[size:] -= self._delta * v[size:]
            return self._inverse(out) - v

        return radius(image, size + like.border)

    def _inverse(self, v: Array) -> Array:
        """Apply (L D L^T)^-1."""
        assert self._solver is not None
        return self._solver.solve(v)

    def _product(self, v: Array) -> Array:
        out = self.matrix.product(v)
        if self.shift:
            out[: self.matrix.size] -= self._shift_diagonal * v[: self.matrix.size]
        return out

    def solve(self, rhs: Array, *, limit: float = RESIDUAL_LIMIT) -> Array:
        """Solve (K - shift M) z = rhs in unscaled variables, all (n+m+r,), to a relative residual `limit`.

        Raises FactorisationError if no method solves it to that, or to roundoff.
        """
        scale = self.matrix.scale
        return scale * self._solve_scaled(scale * rhs, False, limit)

    def solve_backward(self, rhs: Array) -> Array:
        """Solve where a small backward error will do, in place of a residual.

        That is what Lanczos near a singular shift needs and all it can have: there, what is left of errors
        lies along the eigenvectors that are looked for. Raises as `solve`.
        """
        scale = self.matrix.scale
        return scale * self._solve_scaled(scale * rhs, True, BACKWARD_RESIDUAL)

    def solve_roughly(self, rhs: Array) -> Array:
        """Solve for rhs (n+m+r,) with regularised factors as they are, unrefined; in full where a pivot is
        zero."""
        scale = self.matrix.scale
        if self.exact:
            return scale * self._reduced().solve(scale * rhs)
        if not self._found:
            return self.solve_backward(rhs)
        return scale * self._inverse(scale * rhs)

    def _solve_scaled(self, rhs: Array, backward: bool, limit: float) -> Array:
        size = float(np.abs(rhs).max())
        if size == 0.0:
            return np.zeros_like(rhs)
        while self._blocks is None:
            solution, error = self._refined(rhs, size, backward, 1e-3 * limit)
            if not error <= limit and self._fine and self._found:
                solution, error = self._accelerated(rhs, solution, size, 0.1 * limit)
            if error <= limit:
                return solution
            if backward and error * size <= BACKWARD_GOAL * float(np.abs(solution).max()):
                return solution
            if not self._untried:
                break
            self._factor(self._untried.pop(0))
        try:
            return self._solve_by_blocks(rhs, size)
        except FactorisationError:
            if not self.stale:
                raise
        self.anew()
        return self._solve_by_blocks(rhs, size)

    def _refined(self, rhs: Array, size: float, backward: bool, goal: float) -> tuple[Array, float]:
        """The best of a few refinements and its residual relative to the right-hand side."""
        if not self._found:
            return rhs, np.inf
        solution = self._inverse(rhs)
        best, best_error = solution, np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - self._product(solution)
            error = float(np.abs(residual).max()) / size
            if not error < 0.5 * best_error:
                return (solution, error) if error < best_error else (best, best_error)
            best, best_error = solution, error
            if error <= goal:
                break
            if backward and error * size <= BACKWARD_GOAL * float(np.abs(solution).max()):
                break
            solution = solution + self._inverse(residual)
        return best, best_error

    def _accelerated(self, rhs: Array, solution: Array, size: float, goal: float) -> tuple[Array, float]:
        """A refined solution with its residual made least over the last few corrections, again and again:
        ORTHOMIN, Saad (2003), Iterative Methods for Sparse Linear Systems, 6.9."""
        residual = rhs - self._product(solution)
        best, best_error = solution, float(np.abs(residual).max()) / size
        moves: list[Array] = []
        images: list[Array] = []
        for _ in range(LONGER if self._large else ACCELERATED):
            move = self._inverse(residual)
            image = self._product(move)
            for known, seen in zip(moves, images, strict=True):
                along = float(seen @ image)
                move, image = move - along * known, image - along * seen
            length = float(np.linalg.norm(image))
            if not (np.isfinite(length) and length > 0.0):
                break
            move, image = move / length, image / length
            solution = solution + float(image @ residual) * move
            residual = rhs - self._product(solution)
            error = float(np.abs(residual).max()) / size
            if error < best_error:
                best, best_error = solution, error
            if best_error <= goal:
                break
            moves, images = [*moves, move][-DIRECTIONS:], [*images, image][-DIRECTIONS:]
        return best, best_error

    def _reduced(self) -> BlockReduction:
        if self._blocks is None:
            self._blocks = BlockReduction(self.matrix, self.shift)
        return self._blocks

    def _solve_by_blocks(self, rhs: Array, size: float) -> Array:
        blocks = self._reduced()
        solution, error = blocks.solve(rhs), np.inf
        if not self._large:
            for _ in range(BLOCK_REFINEMENTS):
                solution = solution + blocks.solve(rhs - self._product(solution))
            reach = size + float(np.abs(solution).max())  # entries of the scaled matrix are of order one
            error = float(np.abs(rhs - self._product(solution)).max()) / reach
            if error <= BACKWARD_LIMIT:
                return solution
        last = np.inf
        for _ in range(EXTENDED_REFINEMENTS):
            correction = blocks.solve(self._extended_residual(rhs, solution))
            before, last = last, float(np.abs(correction).max() / np.abs(solution).max())
            if not last < 0.5 * before:
                break
            solution = solution + correction
            if last <= FORWARD_LIMIT:
                return solution
        raise FactorisationError(f"no accurate solution of the KKT system: corrections of {last:.1e}")

    def _extended_residual(self, rhs: Array, solution: Array) -> Array:
        """rhs - (K - shift M) z, added up in extended precision where there is such a one."""
        out = rhs - self.matrix.extended_product(solution)
        if self.shift:
            n, diagonal = self.matrix.size, self._shift_diagonal.astype(np.longdouble)
            out[:n] -= diagonal * solution[:n]
        return out.astype(np.float64)
