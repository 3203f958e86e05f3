"""Constrained saddle-free Newton as the thesis writes it, densely: Koldaev (2022), section 2.3.2.

The sparse solver is tested against it. W is written in the orthonormal coordinates
T = (K | range), the eigenvalues of its block W_c = K^T W K are replaced by their absolute values and
the full KKT system (2.57) is solved. Time grows as N^3 and memory as N^2: for N up to `LARGEST` only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ribbon_cli.model.band import Array
from ribbon_cli.model.problem import LocalDerivatives, Problem
from ribbon_cli.solver.kkt import FactorisationError
from ribbon_cli.solver.newton import Options
from ribbon_cli.solver.status import Iterate, Result, SaddleMet, Status
from ribbon_cli.solver.steps import change, inverted_facets

LARGEST = 200
"""Most segments accepted: beyond, one step takes seconds and the sparse solver gives the same one."""
SHORTEST = 2.0**-14
ARMIJO = 1e-4  # sufficient decrease, Nocedal & Wright (2006), (3.4)
CORRECTIONS = 4


class DenseModel:
    """The quadratic model at a point, with everything that the method needs written out.

    `normals` A (k, 7N) are the constraint, gauge and held rows; `basis` K (7N, d) and `range` (7N, k)
    are orthonormal and together T; `values` (d,) ascending and `vectors` (7N, d) are the eigenpairs
    of W_c (2.58), rotations left out.
    Raises ValueError above `LARGEST` segments, FactorisationError if the rows A are linearly dependent.
    """

    def __init__(self, problem: Problem, local: LocalDerivatives, rotations: Array) -> None:
        if problem.band.segments > LARGEST:
            raise ValueError(f"dense algebra takes at most {LARGEST} segments, got {problem.band.segments}")
        self.problem, self.local = problem, local
        jacobian = problem.jacobian_matrix(local).toarray()
        held = np.eye(problem.size)[problem.fixed]
        self.normals = np.vstack((jacobian, rotations.T, held))
        count = self.normals.shape[0]
        if not (np.isfinite(self.normals).all() and np.isfinite(local.hessian_entries).all()):
            raise FactorisationError("the derivatives are not finite")
        q, r = scipy.linalg.qr(self.normals.T)
        pivots = np.abs(np.diag(r))
        if pivots.min() <= self.normals.size * np.finfo(float).eps * pivots.max():
            raise FactorisationError("the constraints are linearly dependent")
        self.range, self.basis, self._triangle = q[:, :count], q[:, count:], r[:count]
        self.hessian = problem.hessian_matrix(local).toarray()
        self.values, y = scipy.linalg.eigh(self.basis.T @ self.hessian @ self.basis)
        self.vectors = self.basis @ y
        self._absolute = (y * np.abs(self.values)) @ y.T

    def modified_hessian(self) -> Array:
        """W (7N, 7N) with |W_c| in place of W_c in the coordinates T; its couplings stay, (2.59)."""
        t = np.hstack((self.basis, self.range))
        block = t.T @ self.hessian @ t
        d = self.basis.shape[1]
        block[:d, :d] = self._absolute
        out: Array = t @ block @ t.T
        return out

    def direction(self) -> tuple[Array, Array]:
        """Step (7N,) and multipliers (5N+3,) from the full KKT matrix (2.57) with the modified W."""
        n, k = self.problem.size, self.normals.shape[0]
        matrix = np.block([[self.modified_hessian(), self.normals.T], [self.normals, np.zeros((k, k))]])
        rhs = np.zeros(n + k)
        rhs[:n] = -self.local.gradient
        rhs[n : n + self.problem.rows] = -self.local.constraints
        factors = scipy.linalg.lu_factor(matrix)
        z = scipy.linalg.lu_solve(factors, rhs)
        z = z + scipy.linalg.lu_solve(factors, rhs - matrix @ z)
        return z[:n], -z[n : n + self.problem.rows]

    def least_multipliers(self) -> Array:
        """Multipliers (5N+3,) that minimise |grad f - A^T lambda|, in the Euclidean metric."""
        out: Array = scipy.linalg.solve_triangular(self._triangle, self.range.T @ self.local.gradient)
        return out[: self.problem.rows]

    def correction(self, constraints: Array) -> Array:
        """The least move (7N,) that takes off weighted constraint values (5N+3,), to first order."""
        rhs = np.zeros(self.normals.shape[0])
        rhs[: self.problem.rows] = -constraints
        out: Array = self.range @ scipy.linalg.solve_triangular(self._triangle, rhs, trans="T")
        return out


def dense_direction(
    problem: Problem, local: LocalDerivatives, rotations: Array
) -> tuple[Array, Array, Array]:
    """The saddle-free step (7N,), multipliers (5N+3,) and all eigenvalues of W_c, ascending.

    `rotations` (7N, r) are the gauge, `problem.rotations(x)`. Raises as `DenseModel`.
    """
    model = DenseModel(problem, local, rotations)
    return *model.direction(), model.values


@dataclass(frozen=True, eq=False)
class _Point(Iterate):
    """A place of the dense method, its residuals from the assembled Jacobian."""

    @classmethod
    def at(cls, problem: Problem, x: Array, multipliers: Array) -> _Point:
        with np.errstate(over="ignore", invalid="ignore"):  # such points are refused by their residuals
            local = problem.local_derivatives(x, multipliers)
            kkt = local.gradient - problem.jacobian_matrix(local).T @ multipliers
            constraint = float(np.abs(local.constraints / problem.weights).max())
        return cls(problem, x, multipliers, local, kkt, float(np.abs(kkt).max()), constraint)

    def merit(self, penalty: Array) -> float:
        """The exact penalty f + sum nu_k |c_k|."""
        return self.energy + float(penalty @ np.abs(self.local.constraints))


def dense_solve(
    problem: Problem, x: Array, multipliers: Array | None = None, options: Options | None = None
) -> Result:
    """Find a minimum near x (7N,) with dense algebra; multipliers (5N+3,) are estimated if absent.

    Raises ValueError above `LARGEST` segments; every other failure is a status of the `Result`.
    """
    return _DenseSolve(problem, options or Options()).run(problem.impose(x), multipliers)


class _DenseSolve:
    def __init__(self, problem: Problem, options: Options) -> None:
        self.problem = problem
        self.options = options
        self.penalty = np.zeros(problem.rows)
        self.steps = 0
        self.saddles: list[SaddleMet] = []
        self.trouble = Status.STALLED

    def run(self, x: Array, multipliers: Array | None) -> Result:
        point = _Point.at(
            self.problem, x, np.zeros(self.problem.rows) if multipliers is None else multipliers
        )
        if not np.isfinite(point.worst):
            return self._result(Status.NOT_FINITE, point)
        if (inverted_facets(self.problem, x) <= 0).any():
            return self._result(Status.INVERTED_FACET, point)
        try:
            if multipliers is None:
                point = _Point.at(self.problem, x, self._model(point).least_multipliers())
            return self._iterate(point)
        except FactorisationError as error:
            return self._result(Status.STALLED, point, detail=f"({error}.)")

    def _iterate(self, point: _Point) -> Result:
        while True:
            model = self._model(point)
            following: _Point | None = None
            if point.worst > self.options.goal and self.steps < self.options.max_steps:
                following = self._advance(point, model)
                if following and following.worst > 0.5 * point.worst <= 0.5 * self.options.tolerance:
                    following = None  # converged, and as far as roundoff lets it
            if following is None:
                if point.worst > self.options.tolerance:
                    limit = self.steps >= self.options.max_steps
                    return self._result(Status.ITERATION_LIMIT if limit else self.trouble, point)
                negative = int((model.values < 0).sum())
                if negative == 0 or len(self.saddles) >= self.options.leave_saddles:
                    status = Status.SADDLE if negative else Status.MINIMUM
                    return self._result(status, point, negative=negative)
                following = self._leave(point, model, negative)
            self.steps += 1
            if following is None:
                return self._result(self.trouble, point)
            point = following

    def _model(self, point: _Point) -> DenseModel:
        return DenseModel(self.problem, point.local, self.problem.rotations(point.x))

    def _advance(self, point: _Point, model: DenseModel) -> _Point | None:
        """The longest of the halved steps that lowers the merit enough and stays a band, or None."""
        step, multipliers = model.direction()
        self.trouble = Status.STALLED
        self.penalty = np.maximum(self.penalty, 1.5 * np.abs(multipliers))
        violation = float(self.penalty @ np.abs(point.local.constraints))
        slope = min(float(point.local.gradient @ step) - violation, 0.0)
        before = point.merit(self.penalty)
        t = min(1.0, self.options.step_limit / max(change(point.x, step), 1e-300))
        while t >= SHORTEST:
            mixed = point.multipliers + t * (multipliers - point.multipliers)
            full = _Point.at(self.problem, point.x + t * step, mixed)
            # Near a minimum merits drown in roundoff; there Newton's own measure is the residual.
            if model.values[0] > 0 and t == 1.0 and full.worst < 0.5 * point.worst and self._allowed(full):
                return full
            trial = self._drawn_back(model, full)
            if trial.merit(self.penalty) <= before + ARMIJO * t * slope and self._allowed(trial):
                return trial
            t *= 0.5
        return None

    def _drawn_back(self, model: DenseModel, point: _Point) -> _Point:
        """The point after second-order corrections towards the constraints."""
        x = point.x
        for _ in range(CORRECTIONS):
            extra = model.correction(self.problem.weighted_constraints(x))
            if not change(x, extra) <= self.options.step_limit:
                break
            x = x + extra
        return _Point.at(self.problem, x, point.multipliers)

    def _allowed(self, trial: _Point) -> bool:
        if not np.isfinite(trial.worst):
            self.trouble = Status.NOT_FINITE
            return False
        if (inverted_facets(self.problem, trial.x) <= 0).any():
            self.trouble = Status.INVERTED_FACET
            return False
        if self.options.guard is not None and self.options.guard(trial.state):
            self.trouble = Status.LEFT_TOPOLOGY
            return False
        return True

    def _leave(self, point: _Point, model: DenseModel, negative: int) -> _Point | None:
        """Leave a saddle along its lowest eigenvector, to the side of less energy; None if neither falls."""
        self.saddles.append(point.met(negative))
        v = model.vectors[:, 0] / change(point.x, model.vectors[:, 0])
        for t in (0.4, 0.1, 0.02):
            reach = t * self.options.step_limit
            ends = [
                self._drawn_back(model, _Point.at(self.problem, point.x + move, point.multipliers))
                for move in (reach * v, -reach * v)
            ]
            lower = [e for e in ends if self._allowed(e) and e.energy < point.energy]
            if lower:
                return min(lower, key=lambda end: end.energy)
        return None

    def _result(
        self, status: Status, point: _Point, *, negative: int | None = None, detail: str = ""
    ) -> Result:
        return point.ended(status, negative, steps=self.steps, saddles=tuple(self.saddles), detail=detail)
