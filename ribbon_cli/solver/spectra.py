"""Eigenvalues of the projected Hessian, Koldaev (2022), (2.58), in two metrics.

`euclidean` weighs all 7N unknowns alike, as in the thesis. `physical` is the pencil (W_c, M_c) with
M = h (|du|^2 + |dg|^2) and no weight on xi, which is slaved to g; its eigenvalues converge as N grows.
Rigid rotations, exact zero modes, are listed with the rest and labelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import linalg as sparse_linalg

from ..model.band import Array
from ..model.problem import LocalDerivatives, Problem
from .kkt import KKTMatrix
from .linear import Factor, FactorisationError
from .saddle_free import null_space, shift_below, start_vector

METRICS = ("euclidean", "physical")
SLIDING_OVERLAP = 0.9


@dataclass(frozen=True)
class Spectrum:
    """Modes in ascending order of eigenvalue.

    `values`, `residuals` |K^T (W - mu M) v| of metric-normalised modes v, and `sliding_overlap` are (k,);
    `labels` are one of rotation, sliding, mode; `vectors` (m, N, 7), m <= k, are the lowest modes.
    `complete` says that all 2N - 3 are there.
    """

    metric: str
    complete: bool
    values: Array
    residuals: Array
    labels: tuple[str, ...]
    sliding_overlap: Array
    vectors: Array


def metric_diagonal(problem: Problem, metric: str) -> Array:
    """Diagonal (7N,) of the metric. Raises ValueError for an unknown one."""
    if metric == "euclidean":
        return np.ones(problem.size)
    if metric == "physical":
        weights = np.full((problem.band.segments, 7), problem.band.h)
        weights[:, 6] = 0.0
        return weights.ravel()
    raise ValueError(f"unknown metric {metric!r}; known are {', '.join(METRICS)}")


def sliding_tangent(problem: Problem, x: Array) -> Array:
    """Tangent (7N,) of the shift along the band, by central differences with the seam's sign."""
    y = x.reshape(-1, 7)
    sign = np.array([1.0, 1.0, 1.0, *[problem.band.sigma] * 4])
    ahead, behind = np.roll(y, -1, axis=0), np.roll(y, 1, axis=0)
    ahead[-1] *= sign
    behind[0] *= sign
    out: Array = ((ahead - behind) / (2.0 * problem.band.h)).ravel()
    return out


def sliding_covector(problem: Problem, x: Array, weights: Array, rotations: Array) -> Array:
    """Covector M t / |t| (7N,) of the sliding tangent t, rotations projected out; zero if t is a rotation."""
    tangent = sliding_tangent(problem, x)
    if rotations.shape[1]:
        gram = rotations.T @ (weights[:, None] * rotations)
        tangent = tangent - rotations @ np.linalg.solve(gram, rotations.T @ (weights * tangent))
    size = np.sqrt(tangent @ (weights * tangent))
    if size < 1e-6 * np.sqrt(problem.band.segments * weights.max()):
        return np.zeros(problem.size)
    out: Array = weights * tangent / size
    return out


def _assemble(
    metric: str,
    rotations: Array,
    weights: Array,
    values: Array,
    residuals: Array,
    overlaps: Array,
    vectors: Array,
    complete: bool,
) -> Spectrum:
    """Join the rotations to the other modes, label and sort; `vectors` (7N, m) are the lowest m's."""
    overlaps = np.minimum(np.abs(overlaps), 1.0)
    labels = ["sliding" if o > SLIDING_OVERLAP else "mode" for o in overlaps]
    count, kept = rotations.shape[1], vectors.shape[1]
    values = np.concatenate((np.zeros(count), values))
    order = np.argsort(values, kind="stable")
    norms = np.sqrt(np.einsum("ij,i,ij->j", rotations, weights, rotations))
    every = np.column_stack((rotations / norms, vectors))
    stored = order[order < count + kept][: count + kept]
    return Spectrum(
        metric,
        complete,
        values[order],
        np.concatenate((np.zeros(count), residuals))[order],
        tuple((["rotation"] * count + labels)[k] for k in order),
        np.concatenate((np.zeros(count), overlaps))[order],
        np.ascontiguousarray(every[:, stored].T).reshape(stored.size, -1, 7),
    )


def full_spectra(
    problem: Problem, x: Array, local: LocalDerivatives, metrics: tuple[str, ...], keep: int
) -> list[Spectrum]:
    """All 2N - 3 eigenvalues in each metric by dense algebra, with the `keep` lowest modes."""
    rotations = problem.rotations(x)
    basis = null_space(problem, local, rotations)
    projected = basis.T @ (problem.hessian_matrix(local) @ basis)
    out = []
    for metric in metrics:
        weights = metric_diagonal(problem, metric)
        common = float(weights.max())
        odd = np.flatnonzero(weights != common)  # the basis is orthonormal: only these rows differ
        gram = common * np.eye(basis.shape[1]) + basis[odd].T @ (
            (weights[odd] - common)[:, None] * basis[odd]
        )
        pencil = gram if odd.size else None
        values, y = linalg.eigh(projected, pencil, check_finite=False)
        residuals = np.linalg.norm(projected @ y - (gram @ y if odd.size else common * y) * values, axis=0)
        overlaps = (sliding_covector(problem, x, weights, rotations) @ basis) @ y
        vectors = basis @ y[:, :keep]
        out.append(_assemble(metric, rotations, weights, values, residuals, overlaps, vectors, complete=True))
    return out


def lowest_spectrum(
    problem: Problem, x: Array, local: LocalDerivatives, metric: str, count: int, index: int = 0
) -> Spectrum:
    """The `count` lowest modes besides rotations by shift-invert Lanczos with a fixed start.

    `index` is the number of negative eigenvalues by inertia; with any, the shift lies below them.
    Raises FactorisationError if they do not converge.
    """
    n = problem.size
    rotations = problem.rotations(x)
    matrix = KKTMatrix(problem, local, rotations)
    weights = metric_diagonal(problem, metric)
    factor = shift_below(matrix.with_metric(weights), index) if index else Factor(matrix)
    rhs = np.zeros(matrix.size + matrix.border)

    def inverse(w: Array) -> Array:
        rhs[:n] = np.where(problem.fixed, 0.0, w)
        return factor.solve_backward(rhs)[:n]

    operator = sparse_linalg.LinearOperator((n, n), matvec=inverse, dtype=np.float64)
    hessian = problem.hessian_matrix(local)
    start = inverse(weights * start_vector(n, problem.fixed))
    try:
        values, vectors = sparse_linalg.eigsh(
            hessian,
            k=count,
            M=sparse.diags(weights).tocsc(),
            sigma=factor.shift,
            OPinv=operator,
            v0=start,
            ncv=min(n - 1, 2 * count + 16),
            which="LM",
            tol=1e-12,
        )
    except sparse_linalg.ArpackError as error:
        raise FactorisationError(f"Lanczos: {error}") from error
    # One application of the inverse puts vectors back into the null space to roundoff.
    for j in range(count):
        vectors[:, j] = inverse(weights * vectors[:, j]) * (values[j] - factor.shift)
        vectors[:, j] /= np.sqrt(vectors[:, j] @ (weights * vectors[:, j]))
    values = np.einsum("ij,ij->j", vectors, hessian @ vectors)
    excess = hessian @ vectors - (weights[:, None] * vectors) * values
    residuals = projected_norms(matrix, excess)
    overlaps = sliding_covector(problem, x, weights, rotations) @ vectors
    return _assemble(metric, rotations, weights, values, residuals, overlaps, vectors, complete=False)


def projected_norms(matrix: KKTMatrix, excess: Array) -> Array:
    """Euclidean norms (k,) of the tangential parts of vectors (7N, k)."""
    projector = Factor(matrix.with_unit_metric(scaled=False))
    rhs = np.zeros(matrix.size + matrix.border)
    out = np.empty(excess.shape[1])
    for j in range(out.size):
        rhs[: matrix.size] = excess[:, j]
        out[j] = np.linalg.norm(projector.solve(rhs)[: matrix.size])
    return out
