"""The KKT system with a parameter as an unknown and one more row: regular at folds.

Pseudo-arclength continuation (H. B. Keller 1977) solves

    [ K   r ] [ z  ]   [ rhs ]        z = (p, -dlambda, gauge),  r = d(residual)/dv,
    [ a'  d ] [ dv ] = [ s   ]        a = M t on the unknowns x, d = m t_v,

where K is singular at a fold and the whole is not. Of a strip that rests on itself K has the rows of gaps
and the copies of `resting_kkt`, behind gauge and border. Two eliminations are at hand. The first borders K
symmetrically, [[K, a], [a', 0]], which is regular at a fold since the tangent t is K's null vector there:
the row a joins the gauge rows, with the same sparse factorisation and scaling. The second takes K itself.
Where one of the two matrices is singular on the branch the other is not, but for bifurcations, at which the
whole system is singular (Govaerts 2000, Numerical Methods for Bifurcations, 3.6). Either is refined on the
whole system, whose residual decides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..model.band import Array
from ..model.problem import LocalDerivatives, Problem
from ..model.rates import Rates
from .kkt import FactorisationError
from .linear import Factor
from .resting_kkt import kkt_matrix

REFINEMENTS = 4
GOAL = 1e-12
LIMIT = 1e-7
"""Residual of the bordered system, scaled and relative to the right-hand side, that refinement aims at, and
the largest that is accepted."""
NEGLIGIBLE = 1e-6
"""Length of the border a, as part of d, below which its direction means nothing."""


class BorderedSystem:
    """The bordered system at one point, factored.

    `covector` a (7N,) has no components along xi, `weight` is d. Raises FactorisationError if the matrices
    are not finite.
    """

    def __init__(
        self,
        problem: Problem,
        x: Array,
        local: LocalDerivatives,
        by_parameter: Rates,
        covector: Array,
        weight: float,
    ) -> None:
        self.problem, self.local = problem, local
        self.rotations = problem.rotations(x)
        length = float(np.linalg.norm(covector))
        # A band may keep its shape while the parameter grows, as the ring does: a is roundoff, and no
        # border for K.
        flat = length <= NEGLIGIBLE * abs(weight)
        self._eliminations = (self._by_plain,) if flat else (self._by_bordered, self._by_plain)
        self._length = abs(weight) if flat else length
        if not (np.isfinite(self._length) and self._length > 0.0):
            raise FactorisationError("the border is zero or not finite")
        unit = covector[:, None] / self._length
        self._bordered = kkt_matrix(problem, local, np.hstack((self.rotations, unit)))
        self._column = self._vector(by_parameter.gradient, by_parameter.constraints, weight)
        self._factor: Factor | None = None
        self._plain: Factor | None = None
        self._responses: dict[str, Array] = {}

    @property
    def _row(self) -> int:
        """Where the row a is."""
        return int(self.problem.size + self.problem.rows + self.rotations.shape[1])

    def _vector(self, gradient: Array, constraints: Array, level: float) -> Array:
        """A right-hand side in the order of the bordered matrix."""
        gauge, copies = self.rotations.shape[1], self._bordered.tail - self._bordered.gauge
        return np.concatenate(
            (gradient, constraints, np.zeros(gauge), [level / self._length], np.zeros(copies))
        )

    def solve(self, gradient: Array, constraints: Array, level: float) -> tuple[Array, Array, float]:
        """Step p (7N,), change of the multipliers (5N+3,) and of v for right-hand sides (7N,), (5N+3,) and s.

        Raises FactorisationError if neither elimination is accurate.
        """
        rhs = self._vector(gradient, constraints, level)
        best, best_error = (np.zeros_like(rhs), 0.0), np.inf
        for eliminate in self._eliminations:
            try:
                found, error = self._refined(rhs, eliminate)
            except FactorisationError:
                continue
            if error < best_error:
                best, best_error = found, error
            if best_error <= 1e-3 * LIMIT:
                break
        if not best_error <= LIMIT:
            raise FactorisationError(
                f"no accurate solution of the bordered system: residual {best_error:.1e}"
            )
        n = self.problem.size
        z, width = best
        return z[:n], -z[n : n + self.problem.rows], width

    def _refined(
        self, rhs: Array, eliminate: Callable[[Array], tuple[Array, float]]
    ) -> tuple[tuple[Array, float], float]:
        """A solution (z, db) refined on the whole system, and its scaled residual relative to rhs."""
        scale = self._bordered.scale
        size = float(np.abs(scale * rhs).max())
        if size == 0.0:
            return (np.zeros_like(rhs), 0.0), 0.0
        z, width = eliminate(rhs)
        best, best_error = (z, width), np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - self._product(z, width)
            error = float(np.abs(scale * residual).max()) / size
            if not error < best_error:
                break
            best, best_error = (z, width), error
            if error <= GOAL:
                break
            more, wider = eliminate(residual)
            z, width = z + more, width + wider
        return best, best_error

    def _product(self, z: Array, width: float) -> Array:
        """The whole matrix times (z, width); the multiplier of the row a in z is zero."""
        scale = self._bordered.scale
        out: Array = self._bordered.product(z / scale) / scale + self._column * width
        return out

    def _by_bordered(self, rhs: Array) -> tuple[Array, float]:
        """Eliminate by [[K, a], [a', 0]]: the multiplier of a must vanish, which gives db."""
        if self._factor is None:
            self._factor = Factor(self._bordered)
            self._responses["bordered"] = self._factor.solve(self._column)
        response = self._responses["bordered"]
        y = self._factor.solve(rhs)
        if response[self._row] == 0.0:
            raise FactorisationError("the bordered system is singular")
        width = float(y[self._row] / response[self._row])
        y = y - width * response
        y[self._row] = 0.0
        return y, width

    def _by_plain(self, rhs: Array) -> tuple[Array, float]:
        """Eliminate by K itself."""
        at = self._row
        if self._plain is None:
            self._plain = Factor(kkt_matrix(self.problem, self.local, self.rotations))
            self._responses["plain"] = self._plain.solve(np.delete(self._column, at))
        response, row = self._responses["plain"], self._bordered.rotations[:, -1]
        y = self._plain.solve(np.delete(rhs, at))
        n = self.problem.size
        pivot = float(self._column[at] - row @ response[:n])
        if pivot == 0.0:
            raise FactorisationError("the bordered system is singular")
        width = float(rhs[at] - row @ y[:n]) / pivot
        return np.insert(y - width * response, at, 0.0), width
