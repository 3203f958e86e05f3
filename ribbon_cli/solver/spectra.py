"""Eigenvalues of the projected Hessian, Koldaev (2022), (2.58), in any metric of `model.metrics`.

In the thesis' `euclidean` metric eigenvalues scale with h; in the `physical` one they converge as N grows.
Rigid rotations, exact zero modes, are listed with the rest and labelled. Every value comes with a bound of
its error, and the lowest few are counted by inertia, so that none is missing.

Of a strip that rests on itself the Hessian has what forces add, and modes keep its gaps: `RestingProblem` and
its derivatives, with forces after the multipliers, are passed like any other. Sliding along the band is a
symmetry of the continuum there as well, but vertices that lie on facets hold it on a grid: no mode has its
name where none is that move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from ..model.band import Array, Discretisation
from ..model.metrics import lengths, metric_named
from ..model.problem import LocalDerivatives, Problem
from .kkt import FactorisationError
from .lanczos import largest_eigenpairs
from .pencil import Pencil, roundoff
from .tangent_basis import Basis, tangent_basis

SLIDING_OVERLAP = 0.9
CHECKERBOARD_SHARE = 0.5 + 1e-9
CHECKERBOARD_FACETS = 3.0
"""A mode is a checkerboard when most of its xi is hidden, over more facets than the two on which a peak of
one facet's width alternates when it moves. Waves of N/4 periods have exactly half of it hidden; rounding must
not decide."""
LABELS = ("rotation", "sliding", "checkerboard", "mode")
"""What a mode may be."""
NEAR_EQUAL = 1e-6
"""Relative difference of eigenvalues that are not told apart when they are counted."""
SEARCHES = 4
"""Starts of Lanczos before eigenvalues that the inertia counts are given up as missing."""


@dataclass(frozen=True)
class Spectrum:
    """Modes in ascending order of eigenvalue.

    `values`, `residuals` in the dual metric (an eigenvalue lies that near), `sliding_overlap` and `hidden`
    (see `hidden_share`) are (k,); `labels` are one of rotation, sliding, checkerboard, mode; `vectors`
    (m, N, 7), m <= k, are the lowest modes, of unit length in the metric. `complete` says that all are there,
    2N - 3 of a closed band. `roundoff` makes what `bounds` add to the residuals, (k,).
    """

    metric: str
    complete: bool
    values: Array
    residuals: Array
    roundoff: Callable[[], Array]
    labels: tuple[str, ...]
    sliding_overlap: Array
    hidden: Array
    vectors: Array

    @cached_property
    def bounds(self) -> Array:
        """The residuals with roundoff added (k,), made when they are first asked for: studies store none."""
        out: Array = self.residuals + self.roundoff()
        return out


def sliding_tangent(problem: Problem, x: Array) -> Array:
    """Tangent (7N,) of the shift along a closed band, by central differences with the seam's sign."""
    y = x.reshape(-1, 7)
    sign = np.array([1.0, 1.0, 1.0, *[problem.band.sigma] * 4])
    ahead, behind = np.roll(y, -1, axis=0), np.roll(y, 1, axis=0)
    ahead[-1] *= sign
    behind[0] *= sign
    out: Array = ((ahead - behind) / (2.0 * problem.band.h)).ravel()
    return out


def sliding_covector(problem: Problem, x: Array, mass: scipy.sparse.csr_matrix, rotations: Array) -> Array:
    """Covector M t / |t| (7N,) of the sliding tangent t, rotations projected out; zero if t is a rotation,
    and between ends."""
    if not problem.band.closed:
        return np.zeros(problem.size)
    tangent = sliding_tangent(problem, x)
    reach = float(np.linalg.norm(tangent) * np.sqrt(mass.diagonal().max()))
    if rotations.shape[1]:
        # Euclidean projection serves metrics in which rotations have no length; in others the rest follows.
        tangent = tangent - rotations @ (rotations.T @ tangent)
        gram = rotations.T @ (mass @ rotations)
        if gram.trace() > 1e-9 * mass.diagonal().max():
            tangent = tangent - rotations @ np.linalg.solve(gram, rotations.T @ (mass @ tangent))
    size = float(lengths(mass, tangent[:, None])[0])
    if size <= 1e-6 * reach:
        return np.zeros(problem.size)
    out: Array = (mass @ tangent) / size
    return out


def sliding_overlap(problem: Problem, x: Array, vector: Array) -> float:
    """Cosine, 0 to 1, between a move (7N,) and sliding along the band, in the physical metric."""
    mass = metric_named("physical").matrix(problem.state(x))
    covector = sliding_covector(problem, x, mass, problem.rotations(x))
    return min(1.0, abs(float(covector @ vector)) / float(lengths(mass, vector[:, None])[0]))


def hidden_share(problem: Problem, vectors: Array) -> tuple[Array, Array]:
    """How much of each mode's xi the energy does not see, in [0, 1], and over how many facets, both (k,).

    Under `thesis` the energy sees the averages (dxi_i + dxi_{i-1}) / 2 alone. What is hidden are the
    differences d_i = (dxi_i - dxi_{i-1}) / 2, which the checkerboard dxi_i = (-1)^i consists of; the share is
    that of their squares in the sum of both squares, and (sum d^2)^2 / sum d^4 the number of facets that take
    part. Under `value-average` the energy sees both. Modes are (7N, k).
    """
    count = vectors.shape[1]
    if problem.band.discretisation is not Discretisation.THESIS:
        return np.zeros(count), np.zeros(count)
    xi = vectors.reshape(problem.band.segments, 7, -1)[:, 6]
    before = np.roll(xi, 1, axis=0)
    before[0] = problem.band.sigma * before[0] if problem.band.closed else xi[0]
    seen, hidden = ((xi + before) ** 2).sum(axis=0), ((xi - before) ** 2).sum(axis=0)
    # Where a mode has no xi but roundoff, nothing is hidden.
    void = seen + hidden <= 1e-20 * np.einsum("ij,ij->j", vectors, vectors)
    whole, part = np.where(void, 1.0, seen + hidden), np.where(void | (hidden == 0.0), 1.0, hidden)
    spread = 1.0 / (((xi - before) ** 2 / part) ** 2).sum(axis=0).clip(min=1.0 / problem.band.segments)
    return np.where(void, 0.0, hidden / whole), np.where(void, 0.0, spread)


def mode_label(overlap: float, hidden: float, spread: float) -> str:
    """What a mode besides the rotations is, by its overlap with sliding and its `hidden_share`."""
    if overlap > SLIDING_OVERLAP:
        return "sliding"
    return "checkerboard" if hidden > CHECKERBOARD_SHARE and spread > CHECKERBOARD_FACETS else "mode"


@dataclass(frozen=True)
class _Found:
    """Modes besides rotations of a Hessian, ascending: values, residuals (k,) and vectors (7N, k)."""

    values: Array
    residuals: Array
    vectors: Array
    hessian: scipy.sparse.csr_matrix


def _assemble(
    problem: Problem,
    x: Array,
    metric: str,
    mass: scipy.sparse.csr_matrix,
    found: _Found,
    keep: int,
    complete: bool,
) -> Spectrum:
    """Join the rotations to the other modes, label and sort; the lowest `keep` others keep their vectors."""
    rotations = problem.rotations(x)
    overlaps = np.minimum(np.abs(sliding_covector(problem, x, mass, rotations) @ found.vectors), 1.0)
    hidden, spread = hidden_share(problem, found.vectors)
    figures = zip(overlaps.tolist(), hidden.tolist(), spread.tolist(), strict=True)
    names = ["rotation"] * rotations.shape[1] + [mode_label(*each) for each in figures]
    count, kept = rotations.shape[1], min(keep, found.values.size)
    order = np.argsort(np.concatenate((np.zeros(count), found.values)), kind="stable")
    norms = lengths(mass, rotations)
    norms[norms <= 1e-9 * np.sqrt(mass.diagonal().max())] = 1.0
    every = np.column_stack((rotations / norms, found.vectors[:, :kept]))
    stored = order[order < count + kept]

    def joined(others: Array) -> Array:
        out: Array = np.concatenate((np.zeros(count), others))[order]
        return out

    return Spectrum(
        metric,
        complete,
        joined(found.values),
        joined(found.residuals),
        lambda: joined(roundoff(found.hessian, found.vectors)),
        tuple(names[k] for k in order),
        joined(overlaps),
        joined(hidden),
        np.ascontiguousarray(every[:, stored].T).reshape(stored.size, problem.band.segments, 7),
    )


def full_spectra(
    problem: Problem, x: Array, local: LocalDerivatives, metrics: tuple[str, ...], keep: int
) -> list[Spectrum]:
    """All eigenvalues, 2N - 3 of a closed band, in each metric by dense algebra, with the `keep` lowest
    modes.

    Raises ValueError for an unknown metric, LinAlgError if the algebra fails.
    """
    basis = tangent_basis(problem, x, local)
    hessian = problem.hessian_matrix(local).tocsr()
    projected = basis.congruent(hessian)
    out = []
    for metric in metrics:
        mass = metric_named(metric).matrix(problem.state(x))
        found = _every(basis, hessian, mass, projected)
        out.append(_assemble(problem, x, metric, mass, found, keep, complete=True))
    return out


def _every(
    basis: Basis, hessian: scipy.sparse.csr_matrix, mass: scipy.sparse.csr_matrix, projected: Array
) -> _Found:
    """All eigenpairs of the Hessian, which is `projected` in a basis, in a metric.

    Modes come from forms in the basis, values and residuals from the modes: roundoff of forms enters values
    squared, and residuals as it is.
    """
    gram = basis.congruent(mass)
    _, y = scipy.linalg.eigh(projected, gram, check_finite=False)
    vectors = basis.moves(y)
    forces, momenta = hessian @ vectors, mass @ vectors
    squares = np.einsum("ij,ij->j", vectors, momenta)
    values = np.einsum("ij,ij->j", vectors, forces) / squares
    momenta *= values
    forces -= momenta
    root = scipy.linalg.cholesky(gram, lower=True, overwrite_a=True, check_finite=False)
    excess = scipy.linalg.solve_triangular(root, basis.pull(forces), lower=True, check_finite=False)
    size = 1.0 / np.sqrt(squares)
    residuals = np.linalg.norm(excess, axis=0) * size
    vectors *= size
    order = np.argsort(values, kind="stable")
    if (np.diff(order) < 0).any():
        values, residuals, vectors = values[order], residuals[order], vectors[:, order]
    return _Found(values, residuals, vectors, hessian)


def lowest_spectra(
    problem: Problem, x: Array, local: LocalDerivatives, metrics: tuple[str, ...], count: int
) -> list[Spectrum]:
    """The `count` lowest modes besides rotations, in each metric, by shift-invert Lanczos with fixed starts.

    A count of the eigenvalues below the last of them confirms that none is missing. Raises ValueError for an
    unknown metric, FactorisationError if they do not converge or some stay missing.
    """
    known = [metric_named(metric) for metric in metrics]
    pencil = Pencil(problem, x, local, known[0]) if known else None
    out = []
    for metric in known:
        assert pencil is not None
        pencil = pencil if metric is pencil.metric else pencil.beside(metric)
        found = _lowest(pencil, count, last=metric is known[-1])
        out.append(_assemble(problem, x, metric.name, pencil.mass, found, count, complete=False))
    return out


def lowest_spectrum(problem: Problem, x: Array, local: LocalDerivatives, metric: str, count: int) -> Spectrum:
    """`lowest_spectra` in one metric."""
    return lowest_spectra(problem, x, local, (metric,), count)[0]


def _lowest(pencil: Pencil, count: int, *, last: bool) -> _Found:
    """The lowest eigenpairs, verified; after the `last` metric reductions are let go.

    At a minimum those of the inverse itself are the largest, and one reduction of K serves in every metric.
    Elsewhere, and where many are nearly equal, a shift below all of them is looked for.
    """
    problem = pencil.problem
    dimension = problem.size - problem.rows - pencil.matrix.gauge - int(problem.fixed.sum())
    count = min(count, dimension)
    here = pencil.count_below(0.0)
    minimum = here.trusted and here.negative == 0
    shift = 0.0 if minimum else pencil.shift_below_all(count)
    vectors: Array | None = None
    for search in range(SEARCHES):
        if search == 1:
            shift = pencil.close_shift(count)
        known = 0 if vectors is None else vectors.shape[1]
        try:
            new = largest_eigenpairs(
                pencil.inverse(shift, refinements=0),
                pencil.mass,
                count,
                dimension=dimension - known,
                known=vectors,
                seed=search,
            )[1]
        except FactorisationError:
            continue  # too many nearly equal ones, seen from this shift
        values, vectors = _polished(pencil, shift, new if vectors is None else np.hstack((vectors, new)))
        if vectors.shape[1] >= dimension or _none_missing(pencil, values, count):
            values, vectors = values[:count], vectors[:, :count]
            if last:
                pencil.release()
            residuals = pencil.residuals(values, vectors)
            return _Found(values, residuals, vectors, pencil.hessian)
    raise FactorisationError(f"Lanczos misses some of the {count} lowest eigenvalues")


def _polished(pencil: Pencil, shift: float, vectors: Array) -> tuple[Array, Array]:
    """One refined application of the inverse, and Ritz pairs: tangential to roundoff, M-orthonormal."""
    vectors = pencil.inverse(shift, refinements=1)(pencil.mass @ vectors)
    gram = vectors.T @ (pencil.mass @ vectors)
    values, y = scipy.linalg.eigh(vectors.T @ (pencil.hessian @ vectors), gram)
    return values, vectors @ y


def _none_missing(pencil: Pencil, values: Array, count: int) -> bool:
    """Whether as many eigenvalues as were found lie below the last, those equal to it left out."""
    last = float(values[count - 1])
    apart = max(NEAR_EQUAL * abs(last), 1e-3 * NEAR_EQUAL * pencil.metric.unit(pencil.problem.band))
    lower = values[values < last - apart]
    floor = float(lower[-1]) if lower.size else last - 2.0 * max(apart, abs(last))
    return pencil.has_at_most(lower.size, 0.5 * (floor + last))
