"""The problem of a strip that rests on itself: gaps that are kept are rows, their forces multipliers.

L = E - lambda.c - f.(g - t): a force f pushes features apart, and f >= 0 where a gap g may not be less
than t. With the rows of gaps after those of constraints, Newton's method, its certificate and its saddles
serve as they are.
"""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import scipy

from ..model.band import Array, Band
from ..model.ends import TURNS, finish_rate
from ..model.problem import LocalDerivatives, Problem
from ..model.rates import Rates, rates
from ..model.reactions import Reactions, reactions
from ..model.touching import Shape
from ..model.touching_gaps import RULING, GapRates, Gaps, Pairs, arguments, gap_rates, gaps, vectors
from ..parts import HALF_WIDTH
from .resting_kkt import (
    Copies,
    RestingDerivatives,
    Touched,
    copy_columns,
    on_copies,
    pulled_back,
    pulled_with_data,
)

GAP = "gap"
"""Name of the kept gap among parameters."""


class RestingProblem(Problem):
    """A problem with gaps of fixed pairs kept at `gap`; its multipliers (5N+3+k,) end with the forces."""

    xi_follows = True

    def __init__(self, band: Band, pairs: Pairs, gap: float = 0.0) -> None:
        super().__init__(band)
        self.base = Problem(band)
        self.pairs, self.gap = pairs, gap
        self.what = arguments(pairs)
        self.copies = Copies.of(self.what)
        self.rows = self.base.rows + len(pairs)
        self.weights = np.concatenate((self.base.weights, np.ones(len(pairs))))

    def split(self, multipliers: Array) -> tuple[Array, Array]:
        """Multipliers of constraints (5N+3,) and forces (k,)."""
        return multipliers[: self.base.rows], multipliers[self.base.rows :]

    def gaps(self, x: Array) -> Gaps:
        """Gaps and their derivatives at x (7N,)."""
        return gaps(self._six(x), self.what, self.pairs.sign, self.band.half_width)

    def gap_rates(self, x: Array) -> GapRates:
        """Their derivatives by the half-width."""
        return gap_rates(self._six(x), self.what, self.pairs.sign, self.band.half_width)

    def _six(self, x: Array) -> Array:
        return vectors(Shape.of(self.state(x), self.gap), self.what)

    def pull(self, local: Array) -> Array:
        """The sum (7N,) of gradients (k,6,3) in the gaps' six vectors, in x."""
        return pulled_back(self.base, self.copies, on_copies(self.copies, local))

    def pull_with_data(self, local: Array) -> Array:
        """The same in unknowns that are held, and in data, as well."""
        return pulled_with_data(self.base, self.copies, on_copies(self.copies, local))

    def rows_of(self, local: Array) -> Array:
        """Each of gradients (k,6,3) in x: the rows (k,7N) of gaps."""
        alone = np.zeros((len(local), len(self.copies.kind), 3))
        row = np.repeat(np.arange(len(local)), 6)
        np.add.at(alone, (row, self.copies.slot.ravel()), local.reshape(-1, 3))
        return pulled_back(self.base, self.copies, alone)

    def constraints(self, x: Array) -> Array:
        """Constraint values as in (2.19), then gaps less what they are to be."""
        out: Array = np.concatenate((super().constraints(x), self.gaps(x).value - self.gap))
        return out

    def local_derivatives(self, x: Array, multipliers: Array | None) -> LocalDerivatives:
        """All derivatives at x for multipliers (5N+3+k,)."""
        forces = np.zeros(len(self.pairs))
        if multipliers is not None:
            multipliers, forces = self.split(multipliers)
        free = self.base.local_derivatives(x, multipliers)
        found = self.gaps(x)
        hessian = -forces[:, None, None] * found.hessian
        touched = Touched(self.copies, found.gradient, hessian) if len(self.pairs) else None
        own = {f.name: getattr(free, f.name) for f in fields(LocalDerivatives)}
        own["constraints"] = np.concatenate((free.constraints, found.value - self.gap))
        return RestingDerivatives(**own, base=self.base, free=free, touched=touched)

    def with_multipliers(self, x: Array, local: LocalDerivatives, multipliers: Array) -> LocalDerivatives:
        """The derivatives at x for other multipliers (5N+3+k,), forces among them."""
        del local
        return self.local_derivatives(x, multipliers)

    def lagrangian_gradient(self, local: LocalDerivatives, multipliers: Array) -> Array:
        """Gradient (7N,) of the Lagrangian."""
        assert isinstance(local, RestingDerivatives)
        multipliers, forces = self.split(multipliers)
        out = self.base.lagrangian_gradient(local.free, multipliers)
        if local.touched is None:
            return out
        return out - self.pull(forces[:, None, None] * local.touched.jacobian)

    def jacobian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """The Jacobian (5N+3+k, 7N): dense in the rows of gaps."""
        assert isinstance(local, RestingDerivatives)
        own = self.base.jacobian_matrix(local.free)
        if local.touched is None:
            return own
        rows = self.rows_of(local.touched.jacobian)
        return scipy.sparse.csc_matrix(scipy.sparse.vstack((own, scipy.sparse.csc_matrix(rows))))

    def hessian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """The Lagrangian's Hessian (7N, 7N), with what forces add to it."""
        assert isinstance(local, RestingDerivatives)
        own = self.base.hessian_matrix(local.free)
        if local.touched is None:
            return own
        copies, k = self.copies, len(self.pairs)
        c = self.copies_of_x()
        six = (3 * copies.slot[:, :, None] + np.arange(3)).reshape(k, 18)
        rows, columns = np.repeat(six, 18, axis=1).ravel(), np.tile(six, (1, 18)).ravel()
        s = scipy.sparse.coo_matrix(
            (local.touched.hessian.ravel(), (rows, columns)), shape=(copies.size, copies.size)
        ).tocsc()
        return own + scipy.sparse.csc_matrix(c.T @ s @ c)

    def copies_of_x(self) -> scipy.sparse.csc_matrix:
        """z by x (q, 7N), node positions summed up."""
        rows, columns, values = copy_columns(self.base, self.copies)
        own = scipy.sparse.coo_matrix((values, (rows, columns)), shape=(self.copies.size, self.size)).tocsr()
        out = own.toarray()
        nodes = np.flatnonzero(self.copies.kind == 0)
        for before, j in pairwise(nodes):
            out[3 * j : 3 * j + 3] += out[3 * before : 3 * before + 3]
        return scipy.sparse.csc_matrix(out)


def resting_rates(problem: RestingProblem, x: Array, multipliers: Array, name: str) -> Rates:
    """The derivatives by a parameter, or by the gap that is kept; dE/db has -f.dg/db, and dE/dt is the sum of
    forces. See `model.rates`."""
    own, forces = problem.split(multipliers)
    if name == GAP:
        rows = np.concatenate((np.zeros(own.size), np.full(forces.size, -1.0)))
        return Rates(float(forces.sum()), np.zeros(problem.size), rows, 0.0)
    energy_gradient = problem.base.local_derivatives(x, None).gradient
    found = rates(problem.base, x, own, energy_gradient, name)
    by_gap = np.zeros(len(forces))
    lagrangian, gradient, second = found.lagrangian, found.gradient, found.second
    if name == HALF_WIDTH and forces.size:
        by_width = problem.gap_rates(x)
        by_gap = by_width.rate
        lagrangian -= float(forces @ by_width.rate)
        gradient = gradient - problem.pull(forces[:, None, None] * by_width.gradient)
        second -= float(forces @ by_width.second)
    if name in TURNS and forces.size:
        by_gap, pushed, bent = _turning(problem, x, name)
        lagrangian -= float(forces @ by_gap)
        gradient = gradient - problem.pull(forces[:, None, None] * pushed)
        second -= float(forces @ bent)
    return Rates(lagrangian, gradient, np.concatenate((found.constraints, by_gap)), second)


def _turning(problem: RestingProblem, x: Array, name: str) -> tuple[Array, Array, Array]:
    """Derivatives of gaps by an angle of a strip's end: (k,), of their gradients (k,6,3), and twice, (k,).
    They depend on it where they touch the end's ruling."""
    at, ends = problem.gaps(x), problem.band.parts.ends
    assert ends is not None
    held = (problem.what.kind == RULING) & (problem.what.number == problem.band.segments)
    once, twice = (held[..., None] * finish_rate(ends, name, order).ruling for order in (1, 2))
    pushed = np.einsum("kst,kt->ks", at.hessian, once.reshape(-1, 18)).reshape(-1, 6, 3)
    bent = (pushed * once).sum(axis=(1, 2)) + (at.gradient * twice).sum(axis=(1, 2))
    return (at.gradient * once).sum(axis=(1, 2)), pushed, bent


def resting_reactions(problem: RestingProblem, x: Array, multipliers: Array) -> Reactions:
    """The reactions of a strip that rests on itself, with forces after the multipliers.

    Contact forces balance each other: they are in a reaction only where a clamp's own ruling is touched.
    """
    own, forces = problem.split(multipliers)
    pull = problem.pull_with_data(forces[:, None, None] * problem.gaps(x).gradient)
    return reactions(problem.base, x, own, pull)
