"""The discrete optimisation problem (2.19): energy, constraints and derivatives in the 7N unknowns.

A `Problem` may have prescribed rulings (the auxiliary problems of the recipes). Prescribed
components stay in the vector x but do not move: their columns vanish from every derivative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from .band import Array, Band, State
from .constraints import (
    PER_NODE,
    add_constraint_hessian,
    constraint_jacobian,
    constraint_values,
    row_weights,
)
from .energy import energy_derivatives, energy_terms
from .sparsity import Scatter
from .stencil import G1, SIZE, U0, X0, G, Stencil, U, X, stencil

CLOSURE = 3


def _hessian_structure() -> NDArray[np.bool_]:
    """Structural nonzeros (14,14) of a node's Lagrangian Hessian on and above the diagonal."""
    full = np.zeros((SIZE, SIZE), dtype=bool)
    for rows, columns in ((U, U), (G, G), (U0, G), (U, G), (U, G1), (G, G1)):
        full[rows, columns] = True
    full[U0, U0] = full[U0, U] = np.eye(3, dtype=bool)
    full[G, G1] = ~np.eye(3, dtype=bool)
    for block in (U0, U, G):
        full[block, X0:] = True
    full[X0:, X0:] = True
    return np.triu(full)


def _jacobian_structure() -> NDArray[np.bool_]:
    """Structural nonzeros (5,14) of a node's constraint rows, those of auxiliary problems included."""
    full = np.zeros((PER_NODE, SIZE), dtype=bool)
    for row, blocks in enumerate(((U,), (U, G), (U0, U, G), (U, G, G1), (U, G, G1, X))):
        for block in blocks:
            full[row, block] = True
    return full


HESSIAN_ROWS, HESSIAN_COLUMNS = np.nonzero(_hessian_structure())
JACOBIAN_ROWS, JACOBIAN_COLUMNS = np.nonzero(_jacobian_structure())


@dataclass(frozen=True)
class Prescription:
    """Rulings held fixed in an auxiliary problem, all of unit length.

    `rulings` maps node (0-based) to its vector (3,). `seam` is g_{N+1} (3,) where the seam is open,
    else None. With unit length, |g|^2 = (g.u)^2 + 1 says g.u = 0 but with zero gradient there, so
    that row is replaced by g.u = 0. With an open seam facets N and 1 share no ruling: the fold
    condition of node 1 is replaced by g_{N+1}.u_N = 0.
    Raises ValueError if a ruling is not a unit vector.
    """

    rulings: Mapping[int, Array] = field(default_factory=dict)
    seam: Array | None = None

    def __post_init__(self) -> None:
        vectors = [*self.rulings.values(), *([] if self.seam is None else [self.seam])]
        for vector in vectors:
            if abs(float(np.linalg.norm(vector)) - 1.0) > 1e-12:
                raise ValueError("prescribed rulings must be unit vectors")


FREE = Prescription()


@dataclass(frozen=True)
class LocalDerivatives:
    """Per-node derivatives with seam signs applied, ready to be scattered.

    `gradient` (7N,) of Q_h; `constraints` (5N+3,) and `jacobian` (5,14,N) weighted by (2.47);
    `hessian` (14,14,N) of the Lagrangian, on and above its diagonal.
    """

    energy: float
    gradient: Array
    constraints: Array
    jacobian: Array
    hessian: Array

    def jacobian_entries(self) -> Array:
        """Structural entries of the Jacobian, (37N,), those of one place in the stencil together."""
        return self.jacobian[JACOBIAN_ROWS, JACOBIAN_COLUMNS].ravel()

    def hessian_entries(self) -> Array:
        """Structural entries of the Hessian on and above its diagonal, (72N,), ordered likewise."""
        return self.hessian[HESSIAN_ROWS, HESSIAN_COLUMNS].ravel()


class Problem:
    """Energy and constraints of one band, Koldaev (2022), (2.19), on vectors x (7N,).

    Constraint values are returned weighted by (2.47) in `weighted_constraints` (so that multipliers
    are those of (1.58)) and as written in (2.19) in `constraints`.
    """

    def __init__(self, band: Band, prescription: Prescription = FREE) -> None:
        self.band = band
        self.prescription = prescription
        self.stencil: Stencil = stencil(band, open_seam=prescription.seam is not None)
        self.size = 7 * band.segments
        self.rows = PER_NODE * band.segments + CLOSURE
        self._end = np.zeros(3) if prescription.seam is None else np.asarray(prescription.seam, dtype=float)
        self.fixed = np.zeros(self.size, dtype=bool)
        for node in prescription.rulings:
            self.fixed[7 * node + 3 : 7 * node + 6] = True
        self._has_fixed = bool(self.fixed.any())
        weights = np.tile(row_weights(band), band.segments)
        self.weights = np.concatenate((weights, np.full(CLOSURE, band.h)))

    def impose(self, x: Array) -> Array:
        """Return x (7N,) with the prescribed rulings written into it."""
        out = x.copy()
        for node, vector in self.prescription.rulings.items():
            out[7 * node + 3 : 7 * node + 6] = vector
        return out

    def state(self, x: Array) -> State:
        """Return x (7N,) as a state of this problem's band."""
        return State.from_vector(self.band, x)

    def end_ruling(self, x: Array) -> Array:
        """g_{N+1} (3,): sigma g_1 where the seam is closed, the prescribed one where it is open."""
        end: Array = self.band.sigma * x[3:6] if self.prescription.seam is None else self._end.copy()
        return end

    def next_rulings(self, x: Array) -> Array:
        """g_{i+1} (N,3) at each facet's far node."""
        g = x.reshape(-1, 7)[:, 3:6]
        out: Array = np.vstack((g[1:], self.end_ruling(x)))
        return out

    def _local(self, x: Array) -> Array:
        return self.stencil.gather(np.concatenate((x, self._end)))

    def energy(self, x: Array) -> float:
        """Q_h, not divided by pi b."""
        return float(self.energy_terms(x).sum())

    def energy_terms(self, x: Array) -> Array:
        """The nodes' parts (N,) of Q_h."""
        return energy_terms(self.band, self._local(x))

    def constraints(self, x: Array) -> Array:
        """Constraint values (5N+3,) as written in (2.19), node by node, sum u last."""
        return self._constraints(self._local(x))

    def _constraints(self, local: Array) -> Array:
        values = constraint_values(self.band, local)
        for node in self.prescription.rulings:
            values[1, node] = local[G, node] @ local[U, node]
        if self.prescription.seam is not None:
            values[2, 0] = self._end @ local[U0, 0]
        return np.concatenate((values.T.ravel(), local[U].sum(axis=1)))

    def weighted_constraints(self, x: Array) -> Array:
        """Constraint values (5N+3,) weighted by (2.47)."""
        out: Array = self.constraints(x) * self.weights
        return out

    def local_derivatives(self, x: Array, multipliers: Array | None) -> LocalDerivatives:
        """All derivatives at x for multipliers (5N+3,), node by node; without, the Hessian is left zero."""
        band = self.band
        local = self._local(x)
        terms, gradient, hessian = energy_derivatives(band, local, with_hessian=multipliers is not None)
        if hessian is None:
            hessian = np.zeros((SIZE, SIZE, band.segments))
        jacobian = constraint_jacobian(band, local)
        weights = row_weights(band)[:, None]
        curvature = np.zeros((PER_NODE, band.segments))
        if multipliers is not None:
            curvature -= weights * multipliers[:-CLOSURE].reshape(-1, PER_NODE).T
        for node in self.prescription.rulings:
            self._replace_unit_length_row(node, local, jacobian, hessian, curvature)
        if self.prescription.seam is not None:
            jacobian[2, :, 0] = 0.0
            jacobian[2, U0, 0] = self._end
            curvature[2, 0] = 0.0
        if multipliers is not None:
            add_constraint_hessian(band, local, curvature, hessian)
        jacobian *= weights[:, None]
        seam = self.stencil
        for values in (gradient, jacobian, hessian, hessian.transpose(1, 0, 2)):
            seam.apply_signs(values)
        if self._has_fixed or self.prescription.seam is not None:
            moves = ~np.concatenate((self.fixed, np.ones(3, dtype=bool)))[seam.index]
            jacobian *= moves
            hessian *= moves[:, None] & moves
            gradient *= moves
        return LocalDerivatives(
            float(terms.sum()),
            self.gathered(gradient),
            self._constraints(local) * self.weights,
            jacobian,
            hessian,
        )

    def gathered(self, values: Array) -> Array:
        """Sum local values (14,N) into a vector (7N,)."""
        total = np.bincount(self.stencil.index.ravel(), weights=values.ravel(), minlength=self.size + 3)
        return total[: self.size].astype(np.float64, copy=False)

    @staticmethod
    def _replace_unit_length_row(
        node: int, local: Array, jacobian: Array, hessian: Array, curvature: Array
    ) -> None:
        """Put g.u = 0 in place of |g|^2 = (g.u)^2 + 1 at a prescribed node; (2.19), second."""
        jacobian[1, :, node] = 0.0
        jacobian[1, U, node] = local[G, node]
        jacobian[1, G, node] = local[U, node]
        hessian[U, G, node] += curvature[1, node] * np.eye(3)
        curvature[1, node] = 0.0

    @cached_property
    def _jacobian_scatter(self) -> Scatter:
        n, index = self.band.segments, self.stencil.index
        rows = PER_NODE * np.arange(n) + JACOBIAN_ROWS[:, None]
        closing_rows = PER_NODE * n + np.tile(np.arange(CLOSURE), n)
        closing_columns = (7 * np.arange(n)[:, None] + np.arange(3)).ravel()
        return Scatter.build(
            np.concatenate((rows.ravel(), closing_rows)),
            np.concatenate((index[JACOBIAN_COLUMNS].ravel(), closing_columns)),
            (self.rows, self.size + 3),
        )

    @cached_property
    def _hessian_scatter(self) -> Scatter:
        rows, columns = self.stencil.index[HESSIAN_ROWS], self.stencil.index[HESSIAN_COLUMNS]
        off = HESSIAN_ROWS != HESSIAN_COLUMNS
        return Scatter.build(
            np.concatenate((rows.ravel(), columns[off].ravel())),
            np.concatenate((columns.ravel(), rows[off].ravel())),
            (self.size + 3, self.size + 3),
        )

    def jacobian(self, x: Array) -> scipy.sparse.csc_matrix:
        """Weighted constraint Jacobian (5N+3, 7N), sparse."""
        return self.jacobian_matrix(self.local_derivatives(x, np.zeros(self.rows)))

    def jacobian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """Assemble the weighted Jacobian (5N+3, 7N) from local derivatives."""
        closing = np.full(CLOSURE * self.band.segments, self.band.h)
        values = np.concatenate((local.jacobian_entries(), closing))
        return self._jacobian_scatter.matrix(values)[:, : self.size]

    def hessian(self, x: Array, multipliers: Array) -> scipy.sparse.csc_matrix:
        """Hessian (7N, 7N) of the Lagrangian, (2.55), sparse and symmetric."""
        return self.hessian_matrix(self.local_derivatives(x, multipliers))

    def hessian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """Assemble the Lagrangian's Hessian (7N, 7N) from local derivatives."""
        off = local.hessian[HESSIAN_ROWS, HESSIAN_COLUMNS][HESSIAN_ROWS != HESSIAN_COLUMNS].ravel()
        values = np.concatenate((local.hessian_entries(), off))
        return self._hessian_scatter.matrix(values)[: self.size, : self.size]

    def gradient(self, x: Array) -> Array:
        """Gradient (7N,) of Q_h; zero at prescribed components."""
        return self.local_derivatives(x, np.zeros(self.rows)).gradient

    def rotations(self, x: Array) -> Array:
        """Tangents (7N, r) of the rigid rotations that keep all prescribed rulings, r <= 3.

        Columns are orthonormal in the Euclidean metric.
        """
        held = [*self.prescription.rulings.values()]
        if self.prescription.seam is not None:
            held.append(self._end)
        axes = np.eye(3)
        if held:
            stacked = np.vstack([-_cross(v) for v in held])
            singular, rows = np.linalg.svd(stacked)[1:]
            axes = rows[singular < 1e-9].T
        y = x.reshape(-1, 7)
        spun = np.zeros((self.band.segments, 7, 3))
        for first in (0, 3):
            # Columns are e_k x v, that is -[v]x.
            v = y[:, first : first + 3]
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                spun[:, first + i, j] = v[:, k]
                spun[:, first + j, i] = -v[:, k]
        out = spun @ axes if held else spun
        flat = out.reshape(self.size, -1)
        flat[self.fixed] = 0.0
        try:
            factor = np.linalg.cholesky(flat.T @ flat)
        except np.linalg.LinAlgError:
            return np.linalg.qr(flat)[0]
        return flat @ np.linalg.inv(factor).T


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
