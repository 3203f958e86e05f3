"""The discrete optimisation problem (2.19): energy, constraints and derivatives in the 7N unknowns.

A `Problem` may have prescribed rulings (the auxiliary problems of the recipes). Prescribed
components stay in the vector x but do not move: their columns vanish from every derivative.

On a strip with ends the rows are those of a band but for three things. The end says where the midline ends,
h sum u = displacement, in place of closure; a free end does not. Node 1, whose ruling is held, has no row for
that ruling's length; its place is taken by the end's own row, (t_B - u_N).g_{N+1} where the end is held and
|g_{N+1}|^2 - (g_{N+1}.u_N)^2 - 1 where it is free.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import numpy as np
import scipy
from numpy.typing import NDArray

from ..parts import CLAMPED
from ..parts import CLOSED as PLAIN
from ..parts import FREE as FREE_END
from .band import Array, Band, State
from .bending import Bending
from .constraints import NodeConstraints, row_weights
from .ends import displacement, finish_frame, start_frame
from .energy import NodeEnergy
from .entries import (
    HESSIAN_ENTRIES,
    IN_SQUARE,
    JACOBIAN,
    JACOBIAN_COLUMNS,
    JACOBIAN_PIECES,
    JACOBIAN_ROWS,
    PER_NODE,
    U_G,
    hessian_places,
    signed_hessian,
    signed_jacobian,
)
from .sparsity import Scatter
from .stencil import SIZE, U0, G, IntArray, Seam, Stencil, U, indices, stencil
from .term import Couplings
from .terms import terms_of

END_ROW = 1
"""The row of a strip's end, in the place of node 1's second."""


@dataclass(frozen=True)
class Layout:
    """What the sparsity of a problem's matrices depends on."""

    segments: int
    seam: Seam
    couplings: Couplings = ()

    @property
    def rows(self) -> int:
        """Number of constraint rows."""
        return PER_NODE * self.segments + self.seam.closing

    def row_places(self) -> IntArray:
        """The constraint row (5, M) of each of a local vector's five."""
        n = self.segments
        places = PER_NODE * np.arange(n) + np.arange(PER_NODE)[:, None]
        if self.seam.strip:
            places = np.column_stack((places, np.full(PER_NODE, END_ROW)))
        return places


@lru_cache(maxsize=4)
def _jacobian_scatter(layout: Layout) -> Scatter:
    n, closing, index = layout.segments, layout.seam.closing, indices(layout.segments, layout.seam)[0]
    rows = layout.row_places()[JACOBIAN_ROWS]
    closing_rows = PER_NODE * n + np.tile(np.arange(closing), n)
    closing_columns = (7 * np.arange(n)[:, None] + np.arange(closing)).ravel()
    return Scatter.build(
        np.concatenate((rows.ravel(), closing_rows)),
        np.concatenate((index[JACOBIAN_COLUMNS].ravel(), closing_columns)),
        (layout.rows, 7 * n + layout.seam.data),
    )


@lru_cache(maxsize=4)
def _hessian_scatter(layout: Layout) -> Scatter:
    places, index = hessian_places(layout.couplings), indices(layout.segments, layout.seam)[0]
    rows, columns = index[places[0]], index[places[1]]
    off = places[0] != places[1]
    total = 7 * layout.segments + layout.seam.data
    return Scatter.build(
        np.concatenate((rows.ravel(), columns[off].ravel())),
        np.concatenate((columns.ravel(), rows[off].ravel())),
        (total, total),
    )


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
    """Per-node derivatives with seam signs applied, ready to be scattered; M is N, on strips N+1.

    `gradient` (7N,) of the energy; `constraints` (5N+3,) and `jacobian_entries` (37,M) weighted by (2.47);
    `hessian_at` makes the Lagrangian's Hessian for multipliers, zero without them, of which those
    entries are given that stand at `places` (E,), on and above the diagonal.
    """

    energy: float
    gradient: Array
    constraints: Array
    jacobian_entries: Array
    places: tuple[NDArray[np.intp], NDArray[np.intp]]
    multipliers: Array | None
    hessian_at: Callable[[Array | None], Array]

    @cached_property
    def hessian_entries(self) -> Array:
        """Those of the Lagrangian's Hessian (E,M), made when they are first asked for: a point that is
        passed over needs none."""
        return self.hessian_at(self.multipliers)


class Problem:
    """Energy and constraints of one band or strip, Koldaev (2022), (2.19), on vectors x (7N,).

    Constraint values are returned weighted by (2.47) in `weighted_constraints` (so that multipliers
    are those of (1.58)) and as written in (2.19) in `constraints`. `closing` is the number of rows that say
    where the midline ends, 3 but for a free end, and `target` (3,) where that is.
    """

    xi_follows = False
    """Whether steps in xi are taken as steps in tanh xi, and limit no step; see `solver.steps.followed`."""

    def __init__(self, band: Band, prescription: Prescription = FREE) -> None:
        self.band = band
        self.prescription = prescription
        self.stencil: Stencil = stencil(band, open_seam=prescription.seam is not None)
        self.size = 7 * band.segments
        ends = band.parts.ends
        self.bending = Bending(band)
        self.terms = tuple(term for term in terms_of(band) if term.active) if band.parts != PLAIN else ()
        couplings = tuple(sorted({pair for term in self.terms for pair in term.couplings}))
        self.layout = Layout(band.segments, self.stencil.seam, couplings)
        self.rows, self.closing = self.layout.rows, self.stencil.seam.closing
        self.fixed = np.zeros(self.size, dtype=bool)
        self.target = np.zeros(3)
        if ends is None:
            seam = prescription.seam
            self._data = np.zeros(3) if seam is None else np.asarray(seam, dtype=float)
            for node in prescription.rulings:
                self.fixed[7 * node + 3 : 7 * node + 6] = True
        else:
            start, finish = start_frame(ends), finish_frame(ends)
            self._data = np.concatenate((start.tangent, start.ruling, finish.tangent))
            if ends.end != FREE_END:
                self.fixed[3:6] = True
                self.target = displacement(ends)
        self.any_fixed = bool(self.fixed.any())
        self._masked = self.any_fixed or self.stencil.seam is not Seam.CLOSED
        weights = np.tile(row_weights(band), band.segments)
        if self.stencil.seam is Seam.HELD:
            weights[END_ROW] = 1.0
        self.weights = np.concatenate((weights, np.full(self.closing, band.h)))

    def impose(self, x: Array) -> Array:
        """Return x (7N,) with the prescribed rulings written into it."""
        out = x.copy()
        for node, vector in self.prescription.rulings.items():
            out[7 * node + 3 : 7 * node + 6] = vector
        if self.stencil.seam is Seam.HELD:
            assert self.band.parts.ends is not None
            out[3:6] = finish_frame(self.band.parts.ends).ruling
        return out

    def state(self, x: Array) -> State:
        """Return x (7N,) as a state of this problem's band."""
        return State.from_vector(self.band, x)

    def end_ruling(self, x: Array) -> Array:
        """g_{N+1} (3,): sigma g_1 where the seam is closed, the prescribed one where it is open, a strip's
        own."""
        if self.stencil.seam is Seam.OPEN:
            return self._data.copy()
        end: Array = x[3:6].copy() if self.stencil.seam.strip else self.band.sigma * x[3:6]
        return end

    def rulings(self, x: Array) -> Array:
        """g_i (N,3) at each facet's near node; g_1 of a strip is its start's."""
        g = x.reshape(-1, 7)[:, 3:6]
        if not self.stencil.seam.strip:
            return g
        out: Array = np.vstack((self._data[3:6], g[1:]))
        return out

    def next_rulings(self, x: Array) -> Array:
        """g_{i+1} (N,3) at each facet's far node."""
        g = x.reshape(-1, 7)[:, 3:6]
        out: Array = np.empty((self.band.segments, 3))
        out[:-1], out[-1] = g[1:], self.end_ruling(x)
        return out

    def local(self, x: Array) -> Array:
        """The local vectors (14, M) at x (7N,)."""
        closed = self.stencil.seam is Seam.CLOSED
        return self.stencil.gather(x if closed else np.concatenate((x, self._data)))

    def energy(self, x: Array) -> float:
        """Q_h, not divided by pi b, with the potential of loads where there are any."""
        return float(self.energy_terms(x).sum())

    def energy_terms(self, x: Array) -> Array:
        """The local vectors' parts (M,) of the energy."""
        local = self.local(x)
        total = self.bending.values(local)
        for term in self.terms:
            total = total + term.values(local)
        return total

    def bending_energy(self, x: Array) -> float:
        """The energy without the potential of loads."""
        local = self.local(x)
        elastic = (term for term in self.terms if not term.load)
        return float(self.bending.values(local).sum()) + sum(
            float(term.values(local).sum()) for term in elastic
        )

    def constraints(self, x: Array) -> Array:
        """Constraint values (5N+3,) as written in (2.19), node by node, sum u last."""
        return self._constraints(self.local(x))

    def _constraints(self, local: Array, shared: NodeConstraints | None = None) -> Array:
        values = (shared or NodeConstraints(self.band, local)).values()
        for node in self.prescription.rulings:
            values[1, node] = local[G, node] @ local[U, node]
        if self.prescription.seam is not None:
            values[2, 0] = self._data @ local[U0, 0]
        n = self.band.segments
        out = values[:, :n].T.ravel()
        if self.stencil.seam.strip:
            out[END_ROW] = values[self._end_kind, n]
        if not self.closing:
            return out
        total = local[U, :n].sum(axis=1)
        if self.stencil.seam.strip:
            total = total - self.target / self.band.h
        return np.concatenate((out, total))

    @property
    def _end_kind(self) -> int:
        """Which of the five rows of the end node is the end's."""
        return 2 if self.stencil.seam is Seam.HELD else 1

    def weighted_constraints(self, x: Array) -> Array:
        """Constraint values (5N+3,) weighted by (2.47)."""
        out: Array = self.constraints(x) * self.weights
        return out

    def local_multipliers(self, multipliers: Array) -> Array:
        """Multipliers (5N+3,) by node, (5, M)."""
        n = self.band.segments
        out: Array = multipliers[: PER_NODE * n].reshape(n, PER_NODE).T
        if self.stencil.seam.strip:
            end = np.zeros((PER_NODE, 1))
            end[self._end_kind] = multipliers[END_ROW]
            out = np.hstack((out, end))
            out[1, 0] = 0.0
        return out

    def local_derivatives(self, x: Array, multipliers: Array | None) -> LocalDerivatives:
        """All derivatives at x for multipliers (5N+3,), node by node; without, the Hessian is zero."""
        local = self.local(x)
        shared = NodeConstraints(self.band, local)
        bent = self.bending.at(local, shared)
        energy, gradient = self._energy(local, bent)
        jacobian = self._jacobian_entries(local, shared)
        if self._masked:
            gradient *= self._moves
            jacobian *= self._moves[JACOBIAN_COLUMNS]
        return LocalDerivatives(
            energy,
            self.gathered(gradient),
            self._constraints(local, shared) * self.weights,
            jacobian,
            hessian_places(self.layout.couplings),
            multipliers,
            partial(self._hessian_entries, local, shared, bent),
        )

    def with_multipliers(self, x: Array, local: LocalDerivatives, multipliers: Array) -> LocalDerivatives:
        """The derivatives at x for other multipliers (5N+3,) than those of `local`."""
        del x
        return replace(local, multipliers=multipliers)

    def unmasked(self, local: Array, multipliers: Array | None) -> tuple[float, Array, Array, Array]:
        """Derivatives in the local vectors (14,M), of what is held and of data as well as of unknowns.

        The energy, its gradient (14,M), the weighted Jacobian (5,14,M), the Lagrangian's Hessian (14,14,M).
        """
        shared = NodeConstraints(self.band, local)
        bent = self.bending.at(local, shared)
        jacobian = np.zeros((PER_NODE, SIZE, local.shape[1]))
        jacobian[JACOBIAN_ROWS, JACOBIAN_COLUMNS] = self._jacobian_entries(local, shared)
        entries = self._unmasked_hessian(local, shared, bent, multipliers)
        hessian = _full(entries, hessian_places(self.layout.couplings))
        return *self._energy(local, bent), jacobian, hessian

    @cached_property
    def _row_weights(self) -> tuple[Array, Array]:
        """Weights of a node's constraints (5,1), and of the entries of its Jacobian (37,1)."""
        weights = row_weights(self.band)[:, None]
        return weights, weights[JACOBIAN_ROWS]

    @cached_property
    def _moves(self) -> NDArray[np.bool_]:
        """Which components of the local vectors (14,M) are unknowns that move."""
        held = np.concatenate((self.fixed, np.ones(self.stencil.seam.data, dtype=bool)))
        moves: NDArray[np.bool_] = ~held[self.stencil.index]
        return moves

    def _energy(self, local: Array, bent: NodeEnergy) -> tuple[float, Array]:
        """The energy and its gradient (14,M)."""
        energy, gradient = float(bent.values().sum()), bent.gradient()
        for term in self.terms:
            energy += float(term.values(local).sum())
            gradient += term.gradient(local)
        if self.stencil.seam.strip:
            self.stencil.fold_back(gradient)
        self.stencil.apply_signs(gradient)
        return energy, gradient

    def _jacobian_entries(self, local: Array, shared: NodeConstraints) -> Array:
        """Entries (37,M) of the weighted Jacobian."""
        out = shared.jacobian()
        for node in self.prescription.rulings:
            # g.u = 0 in place of |g|^2 = (g.u)^2 + 1, (2.19), second
            out[JACOBIAN[1], node] = np.concatenate((local[G, node], local[U, node]))
        if self.prescription.seam is not None:
            out[JACOBIAN[2], 0] = np.concatenate((self._data, np.zeros(6)))
        if self.stencil.seam.strip:
            out[JACOBIAN_ROWS == 1, 0] = 0.0
            out[self._end_kind != JACOBIAN_ROWS, -1] = 0.0
        out *= self._row_weights[1]
        self.stencil.apply_signs(out, *signed_jacobian())
        return out

    def _hessian_entries(
        self, local: Array, shared: NodeConstraints, bent: NodeEnergy, multipliers: Array | None
    ) -> Array:
        """Entries (E,M) of the Lagrangian's Hessian."""
        out = self._unmasked_hessian(local, shared, bent, multipliers)
        if self._masked and multipliers is not None:
            rows, columns = hessian_places(self.layout.couplings)
            out *= self._moves[rows] & self._moves[columns]
        return out

    def _unmasked_hessian(
        self, local: Array, shared: NodeConstraints, bent: NodeEnergy, multipliers: Array | None
    ) -> Array:
        """The same of what is held and of data, too."""
        places = hessian_places(self.layout.couplings)
        if multipliers is None:
            return np.zeros((places[0].size, local.shape[1]))
        out = np.empty((places[0].size, local.shape[1]))
        bent.fill_hessian(out[-HESSIAN_ENTRIES:])
        if self.terms:
            out[:-HESSIAN_ENTRIES] = 0.0
            full = _full(out, places)
            for term in self.terms:
                term.add_hessian(local, full)
            out = full[places]
        curvature = self._row_weights[0] * -self.local_multipliers(multipliers)
        for node in self.prescription.rulings:
            out[-HESSIAN_ENTRIES:][U_G][IN_SQUARE, node] += curvature[1, node]
            curvature[1, node] = 0.0
        if self.prescription.seam is not None:
            curvature[2, 0] = 0.0
        shared.add_hessian(curvature, out[-HESSIAN_ENTRIES:])
        if self.stencil.seam.strip:
            full = _full(out, places)
            self.stencil.fold_back_hessian(full)
            out = full[places]
        self.stencil.apply_signs(out, *signed_hessian(self.layout.couplings))
        return out

    def gathered(self, values: Array) -> Array:
        """Sum local values (14,M) into a vector (7N,)."""
        return self.gathered_with_data(values)[: self.size]

    def gathered_with_data(self, values: Array) -> Array:
        """Sum local values (14,M) into a vector of unknowns and data: g_{N+1}, or t_A, g_1, t_B of a
        strip."""
        slots = self.size + self.stencil.seam.data
        total = np.bincount(self.stencil.index.ravel(), weights=values.ravel(), minlength=slots)
        return total.astype(np.float64, copy=False)

    def jacobian(self, x: Array) -> scipy.sparse.csc_matrix:
        """Weighted constraint Jacobian (5N+3, 7N), sparse."""
        return self.jacobian_matrix(self.local_derivatives(x, np.zeros(self.rows)))

    def jacobian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """Assemble the weighted Jacobian (5N+3, 7N) from local derivatives."""
        closing = np.full(self.closing * self.band.segments, self.band.h)
        values = np.concatenate((local.jacobian_entries.ravel(), closing))
        return _jacobian_scatter(self.layout).matrix(values)[:, : self.size]

    def hessian(self, x: Array, multipliers: Array) -> scipy.sparse.csc_matrix:
        """Hessian (7N, 7N) of the Lagrangian, (2.55), sparse and symmetric."""
        return self.hessian_matrix(self.local_derivatives(x, multipliers))

    def hessian_matrix(self, local: LocalDerivatives) -> scipy.sparse.csc_matrix:
        """Assemble the Lagrangian's Hessian (7N, 7N) from local derivatives."""
        entries = local.hessian_entries
        values = np.concatenate((entries.ravel(), entries[local.places[0] != local.places[1]].ravel()))
        return _hessian_scatter(self.layout).matrix(values)[: self.size, : self.size]

    def gradient(self, x: Array) -> Array:
        """Gradient (7N,) of the energy; zero at prescribed components."""
        return self.local_derivatives(x, np.zeros(self.rows)).gradient

    def lagrangian_gradient(self, local: LocalDerivatives, multipliers: Array) -> Array:
        """Gradient (7N,) of the Lagrangian (2.53) in x, by gathering local Jacobians."""
        products = self.local_multipliers(multipliers).take(JACOBIAN_ROWS, axis=0)
        products *= local.jacobian_entries
        pulled = np.zeros((SIZE, products.shape[1]))
        for rows, columns in JACOBIAN_PIECES:
            pulled[columns] += products[rows]
        out = local.gradient - self.gathered(pulled)
        if self.closing:
            out.reshape(-1, 7)[:, :3] -= self.band.h * multipliers[-self.closing :]
        return out

    def _held(self) -> list[Array]:
        """Vectors that a rigid rotation must keep."""
        ends = self.band.parts.ends
        if ends is None:
            prescribed = [*self.prescription.rulings.values()]
            return prescribed if self.prescription.seam is None else [*prescribed, self._data]
        held = [self._data[3:6]]
        if ends.start == CLAMPED:
            held.append(self._data[:3])
        if ends.end != FREE_END:
            finish = finish_frame(ends)
            held += [finish.ruling, self.target / self.band.length]
            if ends.end == CLAMPED:
                held.append(finish.tangent)
        forces = (term.resultant() for term in self.terms if term.load)
        return held + [force / np.linalg.norm(force) for force in forces if force.any()]

    @cached_property
    def _axes(self) -> Array | None:
        """Axes (3, r) of the rigid rotations that keep what is held, None where nothing is."""
        held = self._held()
        if not held:
            return None
        singular, rows = np.linalg.svd(np.vstack([-_cross(v) for v in held]))[1:]
        axes: Array = rows[singular < 1e-9].T
        return axes

    def rotations(self, x: Array) -> Array:
        """Tangents (7N, r) of the rigid rotations that keep all prescribed rulings, r <= 3.

        Columns are orthonormal in the Euclidean metric.
        """
        axes = self._axes
        if axes is not None and not axes.shape[1]:
            return np.zeros((self.size, 0))
        flat = np.concatenate((x, -x, _ZERO)).take(_spins(self.band.segments))
        if axes is not None:
            flat = flat @ axes
        if self.any_fixed:
            flat[self.fixed] = 0.0
        try:
            factor = np.linalg.cholesky(flat.T @ flat)
        except np.linalg.LinAlgError:
            return np.linalg.qr(flat)[0]
        return flat @ np.linalg.inv(factor).T


def _full(entries: Array, places: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Array:
    """Local Hessians (14,14,M) from their entries (E,M)."""
    out = np.zeros((SIZE, SIZE, entries.shape[1]))
    out[places] = entries
    return out


@lru_cache(maxsize=4)
def _spins(segments: int) -> IntArray:
    """Which of (x, -x, 0) the moves by unit rotations are, (7N,3): columns are e_k x v, that is -[v]x, of u
    and of g."""
    size = 7 * segments
    out = np.full((segments, 7, 3), 2 * size)
    node = 7 * np.arange(segments)
    for first in (0, 3):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            out[:, first + i, j] = node + first + k
            out[:, first + j, i] = node + first + k + size
    return out.reshape(size, 3)


_ZERO = np.zeros(1)


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
