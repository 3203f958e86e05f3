"""Dense bases of the moves that keep the constraints and are no rotation: K of Koldaev (2022), (2.57).

Of closed bands they are given by the strip's own coordinates, in which quadratic forms and moves take O(N^2)
operations; of other problems by a QR factorisation of the constraints' normals, O(N^3). Gaps that are kept
take out of either the moves that change them, O(N^3) as well.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy

from ..model.band import Array
from ..model.problem import LocalDerivatives, Problem
from ..model.stencil import Seam
from ..model.tangents import Tangents
from .inertia import NodeMetric
from .resting_kkt import RestingDerivatives
from .saddle_free import null_space

DEPENDENT = 1e-9
"""Sine of the angle between a gap's gradient and the space of others below which it depends on them."""


class Basis(Protocol):
    """Some basis of d moves; Euclidean projection takes the rotations out of them."""

    def moves(self, coordinates: Array) -> Array:
        """The moves (7N, k) of coordinates (d, k)."""

    def pull(self, forces: Array) -> Array:
        """Forces (7N, k) on the coordinates, (d, k)."""

    def congruent(self, matrix: scipy.sparse.spmatrix) -> Array:
        """A symmetric matrix (7N, 7N) as a quadratic form in the coordinates, (d, d)."""


def tangent_basis(problem: Problem, x: Array, local: LocalDerivatives) -> Basis:
    """A basis at x (7N,). Raises LinAlgError if there is none."""
    if isinstance(local, RestingDerivatives):
        free = tangent_basis(local.base, x, local.free)
        return free if local.touched is None else RestingBasis(problem, local, free)
    if problem.stencil.seam is Seam.CLOSED and not problem.fixed.any():
        return FoldedBasis(problem, x, local)
    return NormalBasis(problem, x, local)


class NormalBasis:
    """An orthonormal basis from the constraints' normals."""

    def __init__(self, problem: Problem, x: Array, local: LocalDerivatives) -> None:
        self._basis = null_space(problem, local, problem.rotations(x))

    def moves(self, coordinates: Array) -> Array:
        """See `Basis`."""
        out: Array = self._basis @ coordinates
        return out

    def pull(self, forces: Array) -> Array:
        """See `Basis`."""
        out: Array = self._basis.T @ forces
        return out

    def congruent(self, matrix: scipy.sparse.spmatrix) -> Array:
        """See `Basis`."""
        out: Array = self._basis.T @ (matrix @ self._basis)
        return out


class RestingBasis(NormalBasis):
    """The moves of a basis that keep gaps as well, which may depend on each other."""

    def __init__(self, problem: Problem, local: RestingDerivatives, free: Basis) -> None:
        rows = problem.jacobian_matrix(local)[local.base.rows :].toarray()
        normals = free.pull(rows.T)
        normals /= np.linalg.norm(normals, axis=0)
        q, r, _ = scipy.linalg.qr(normals, pivoting=True, check_finite=False)
        rank = int((np.abs(np.diag(r)) > DEPENDENT).sum())
        self._basis = free.moves(q[:, rank:])


class FoldedBasis:
    """A basis by the coordinates of a strip; what closes the band is left of them by a QR of six columns."""

    def __init__(self, problem: Problem, x: Array, local: LocalDerivatives) -> None:
        self._tangents = Tangents(problem, x, local)
        self._rotations = problem.rotations(x)
        self._turned = self._tangents.pull(self._rotations).T
        normals = np.asfortranarray(self._tangents.closure.T)
        self._rank = normals.shape[1]
        (self._qr, self._tau), _ = scipy.linalg.qr(normals, mode="raw", check_finite=False)
        self._multiply = scipy.linalg.get_lapack_funcs("ormqr", (self._qr,))

    def moves(self, coordinates: Array) -> Array:
        """See `Basis`."""
        every = np.zeros((self._tangents.size, coordinates.shape[1]), order="F")
        every[self._rank :] = coordinates
        every = self._reflected(every, "N")
        out = self._tangents.moves(every)
        out -= self._rotations @ (self._turned @ every)
        return out

    def pull(self, forces: Array) -> Array:
        """See `Basis`."""
        every = self._tangents.pull(forces)
        every -= self._turned.T @ (self._rotations.T @ forces)
        return self._reflected(every, "T")[self._rank :]

    def congruent(self, matrix: scipy.sparse.spmatrix) -> Array:
        """See `Basis`: coordinates turn the whole band as well, which is taken out of both factors."""
        blocks, turned, spun = NodeMetric(matrix), self._turned, matrix @ self._rotations
        form = self._tangents.congruent(blocks.diagonal, blocks.coupling)
        crossed = self._tangents.pull(spun) - turned.T @ (0.5 * self._rotations.T @ spun)
        form -= np.hstack((crossed, turned.T)) @ np.vstack((turned, crossed.T))
        half = self._reflected(form, "T")[self._rank :]
        return self._reflected(half.T, "T")[self._rank :]

    def _reflected(self, columns: Array, transposed: str) -> Array:
        """Q or its transpose times columns (2N, k)."""
        work = 64 * max(1, columns.shape[1])
        # LAPACK changes the reflectors for a while and puts them back: threads that share them spoil them.
        own = self._qr.copy(order="F")
        out: Array = self._multiply("L", transposed, own, self._tau, np.asfortranarray(columns), work)[0]
        return out
