"""The exact saddle-free Newton step at sparse cost, Koldaev (2022), section 2.3.2.

With W_c = K^T W K the projected Hessian, the method replaces its negative eigenvalues by their
absolute values and leaves the blocks that couple to the constraints' range alone. In eigenvectors
v_j of W_c the tangential Newton component is -r_j / mu_j, and the saddle-free one is -r_j / |mu_j|: the
same but for a change of sign where mu_j < 0. The normal component is orthogonal to all v_j. Hence
  p_sf = p_N - 2 sum_j v_j (v_j . p_N),     lambda_sf = lambda_N - 2 sum_j nu_j (v_j . p_N),
over the k negative eigenpairs alone, where W v_j = mu_j v_j + A^T nu_j.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from ..model.band import Array
from ..model.problem import LocalDerivatives, Problem
from .inertia import count_below, inertia, start_of_probes
from .kkt import FactorisationError, KKTMatrix
from .linear import RESIDUAL_LIMIT, Factor
from .resting_kkt import RestingDerivatives, kkt_matrix

LANCZOS_LIMIT = 60
"""Above this number of negative eigenpairs, or a sixth of all, the dense method is the cheaper one."""
DENSE_SEGMENTS = 400
QUICK_STEPS = 80
"""Lanczos steps without a shift, ten more for each eigenpair, before a shift is looked for."""
EXACT_STEPS = 20
"""The same where the block reduction solves, as on fine grids: a step takes a second at N = 100 000."""
BENT_FROM = 1e-5
"""Largest component of a step, with gaps, up to which it is the exact one."""
ADDED = (0.0, *(10.0**k for k in (-10, -8, -6, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5)))
"""What is added to the Hessian there, one after the other."""
FIRST_SHIFT = -1e-2
"""Where a search for a shift begins if nothing is known of the eigenvalues."""
SHIFTED_STEPS = 240
LANCZOS_TOLERANCE = 1e-9
SHIFTED_TOLERANCE = 1e-12
ROUGH_TOLERANCE = 1e-6
"""Residual of an eigenpair of the inverse, relative to its eigenvalue; that with a shift; that where factors
are not refined.

Without a shift all other eigenvalues of the inverse have the other sign, and the residual bounds the error of
the eigenvector. With one the nearest may be close."""
LANCZOS_CHECKS = 3
"""Lanczos steps from one test of convergence to the next."""


@dataclass(frozen=True)
class Direction:
    """A step p (7N,), the multipliers to go with it (5N+3,), and what is known of W_c.

    `negative` eigenvalues (k,) ascending and `vectors` (7N, k) span the negative eigenspace. `newton_step`
    (7N,) is the plain Newton step.
    """

    step: Array
    multipliers: Array
    negative: Array
    vectors: Array
    newton_step: Array

    @property
    def index(self) -> int:
        """Number of negative eigenvalues of the projected Hessian."""
        return int(self.negative.size)


def start_vector(size: int, fixed: np.ndarray) -> Array:
    """A fixed start (n,) for Lanczos, zero where `fixed`, so that runs repeat bit for bit."""
    v = start_of_probes(size).copy()
    v[fixed] = 0.0
    return v


def shift_below(matrix: KKTMatrix, count: int) -> Factor:
    """Factor K - sigma M for a sigma below all negative eigenvalues and at most a third below the lowest.

    With such a shift the negative eigenvalues mu have 1 / (mu - sigma) above 1 / |sigma| and all others
    below: Lanczos separates them at once, whatever the spread of the rest. Quick counts find the shift, the
    block reduction confirms it; it searches again by itself where they were wrong.
    Raises FactorisationError if no such shift is found.
    """
    try:
        quick = _search_shift(lambda sigma: Factor(matrix, shift=sigma).surplus > 0, count)
        if count_below(matrix, quick) == 0:
            return Factor(matrix, shift=quick)
    except FactorisationError:
        pass  # unregularised counts decide
    return Factor(matrix, shift=_search_shift(lambda sigma: count_below(matrix, sigma) > 0, count))


def _search_shift(any_below: Callable[[float], bool], count: int) -> float:
    """Bracket the lowest eigenvalue by powers of 8, then halve the bracket's logarithm three times."""
    below, above = FIRST_SHIFT, 0.0
    while any_below(below):
        below, above = 8.0 * below, below
        if below < -1e12:
            raise FactorisationError(f"no shift below the {count} negative eigenvalues was found")
    while not above:
        if any_below(below / 8.0):
            above = below / 8.0
        else:
            below /= 8.0
            if below > -1e-14:
                raise FactorisationError(f"the {count} negative eigenvalues are too small to separate")
    for _ in range(3):
        middle = -float(np.sqrt(below * above))
        if any_below(middle):
            above = middle
        else:
            below = middle
    return below


def _quick_shift(matrix: KKTMatrix, guess: float) -> Factor:
    """A shift below all negative eigenvalues by regularised pivots, less than four times the lowest.

    Raises FactorisationError if no such shift is found.
    """
    factor = Factor(matrix, shift=guess)
    while factor.surplus > 0 and factor.shift > -1e12:
        factor = Factor(matrix, shift=4.0 * factor.shift)
    while factor.shift < -1e-14:
        above = Factor(matrix, shift=0.25 * factor.shift)
        if above.surplus > 0:
            return factor
        factor = above
    raise FactorisationError("no shift below the negative eigenvalues was found")


def negative_eigenpairs(
    problem: Problem, factor: Factor, count: int, near: Array | None = None
) -> tuple[Array, Array, Array]:
    """The `count` negative eigenpairs of the projected Hessian, Euclidean metric.

    Returns values (k,) ascending, vectors (7N, k), and nu (5N+3, k) with W v = mu v + A^T nu, by Lanczos on
    the inverse KKT operator restricted to x, started near `near` (7N,) if there is something to go by.
    A factor shifted by `shift_below` serves always; one of K itself has the negative 1/mu at its lower end,
    which is enough where they are not hidden among large eigenvalues, and is given up soon if they are.
    Raises FactorisationError if it does not find as many as it should.
    """
    n = problem.size
    rhs = np.zeros(factor.matrix.size + factor.matrix.border)

    def inverse(w: Array, solve: Callable[[Array], Array] = factor.solve_backward) -> Array:
        rhs[:n] = w
        if problem.any_fixed:
            rhs[:n][problem.fixed] = 0.0
        out = solve(rhs)
        if problem.any_fixed:
            out[:n][problem.fixed] = 0.0
        return out

    start = start_vector(n, problem.fixed)
    start = start / np.linalg.norm(start)
    if near is not None and near.any():
        start = start + near / np.linalg.norm(near)
    # Largest of the shifted inverse, or smallest of the inverse itself: largest of its negative.
    shifted = factor.shift < 0
    steps = EXACT_STEPS if factor.exact else QUICK_STEPS
    sign, limit = (1.0, SHIFTED_STEPS) if shifted else (-1.0, steps + 10 * count)
    limit, tolerance = min(limit, n - 1), SHIFTED_TOLERANCE if shifted else LANCZOS_TOLERANCE
    # Without refinement an application costs a fourth; what it finds is a start a few steps from the end.
    found = _lanczos(
        lambda w: sign * inverse(w, factor.solve_roughly)[:n], start, count, limit, ROUGH_TOLERANCE
    )
    if found is not None:
        start = found[1].sum(axis=1)
        found = _lanczos(lambda w: sign * inverse(w)[:n], start, count, limit, tolerance, every=1)
    if found is None or not (found[0] > 0).all():
        raise FactorisationError("Lanczos found too few negative eigenvalues")
    values, vectors = factor.shift + sign / found[0], found[1]
    if not (values < 0).all():
        raise FactorisationError("Lanczos and the inertia disagree on the number of negative eigenvalues")
    nu = np.empty((problem.rows, count))
    for j in range(count):
        # (K - sigma M) [v; -nu] = (mu - sigma) [v; 0]
        nu[:, j] = -inverse(vectors[:, j])[n : n + problem.rows] * (values[j] - factor.shift)
    order = np.argsort(values)
    return values[order], vectors[:, order], nu[:, order]


def _lanczos(
    operator: Callable[[Array], Array],
    start: Array,
    count: int,
    limit: int,
    tolerance: float,
    every: int = LANCZOS_CHECKS,
) -> tuple[Array, Array] | None:
    """The `count` largest eigenpairs of a symmetric operator, values (k,) and vectors (n, k).

    Lanczos with full orthogonalisation, which looks `every` few steps whether they have converged; None if
    they have not within `limit` steps, or if the Krylov space ends before.
    """
    basis = np.empty((limit + 1, start.size))
    diagonal, beside = np.empty(limit), np.empty(limit)
    first = operator(start)
    basis[0] = first / np.linalg.norm(first)
    for j in range(limit):
        known = basis[: j + 1]
        image = operator(basis[j])
        diagonal[j] = basis[j] @ image
        for _ in range(2):  # twice is enough
            image = image - (known @ image) @ known
        beside[j] = math.sqrt(image @ image)
        if j >= count and (j - count) % every == every - 1:
            values, y = _largest_of(diagonal[: j + 1], beside[:j], count)
            if (beside[j] * np.abs(y[-1]) <= tolerance * np.abs(values)).all():
                return values, known.T @ y
        basis[j + 1] = image / beside[j]
    return None


def _largest_of(diagonal: Array, beside: Array, count: int) -> tuple[Array, Array]:
    """The `count` largest eigenpairs of a tridiagonal matrix, ascending: what `scipy.linalg.eigh_tridiagonal`
    calls, which checks its arguments for longer."""
    n = diagonal.size
    lapack = scipy.linalg.lapack
    found, values, blocks, ends, wrong = lapack.dstebz(
        diagonal, beside, 2, 0.0, 1.0, n - count + 1, n, 0.0, "B"
    )
    vectors, failed = lapack.dstein(diagonal, beside, values[:found], blocks, ends)
    if wrong or failed:
        raise FactorisationError("Lanczos found no eigenvectors of its tridiagonal matrix")
    order = np.argsort(values[:found])
    return values[order], vectors[:, order]


def newton_step(
    problem: Problem,
    local: LocalDerivatives,
    multipliers: Array,
    factor: Factor,
    limit: float = RESIDUAL_LIMIT,
    gradient: Array | None = None,
) -> tuple[Array, Array]:
    """Newton's step (7N,) from a point, and its multipliers (5N+3,).

    The system is solved for the change of multipliers: its right-hand side is then the KKT residual, and the
    accuracy of the solution grows with that of the point. `limit` bounds its relative residual. `gradient`
    (7N,) is the Lagrangian's, where it is known.
    Raises FactorisationError if the system cannot be solved.
    """
    n = problem.size
    if gradient is None:
        gradient = problem.lagrangian_gradient(local, multipliers)
    z = factor.solve(
        np.concatenate((-gradient, -local.constraints, np.zeros(factor.matrix.tail))), limit=limit
    )
    return z[:n], multipliers - z[n : n + problem.rows]


def direction(
    problem: Problem,
    local: LocalDerivatives,
    multipliers: Array,
    factor: Factor,
    index: int | None = None,
    plain: tuple[Array, Array] | None = None,
    lowest: float = 0.0,
) -> Direction:
    """The saddle-free step from the derivatives at a point and their factorisation.

    `index` is the number of negative eigenvalues, `plain` the Newton step, where they are known; `lowest` is
    the lowest eigenvalue nearby, at the step before, if that was negative.
    Raises FactorisationError if the systems cannot be solved.
    """
    step, new = plain or newton_step(problem, local, multipliers, factor)
    bent = _bent_up(problem, local, multipliers, factor, step) if index is None else None
    if bent is not None:
        return Direction(*bent, np.empty(0), np.empty((problem.size, 0)), step)
    found = _negative_space(problem, local, factor, index, step, min(2.0 * lowest, 0.0) or FIRST_SHIFT)
    if found is None:
        return Direction(step, new, np.empty(0), np.empty((problem.size, 0)), step)
    values, vectors, nu = found
    along = vectors.T @ step
    return Direction(step - 2.0 * vectors @ along, new - 2.0 * nu @ along, values, vectors, step)


def _bent_up(
    problem: Problem, local: LocalDerivatives, multipliers: Array, factor: Factor, step: Array
) -> tuple[Array, Array] | None:
    """A long step with a positive definite Hessian; None without gaps, and where it is so as it is.

    What gaps bring into the Hessian is left out as far as it is negative, and as much is added as is left to
    be made good. Far from a minimum gaps that push, or a barrier's, have many negative directions, hidden
    among stiff ones, whose eigenvectors take longer to find than many steps; this one is downhill as well.
    """
    if not isinstance(local, RestingDerivatives) or np.abs(step).max() < BENT_FROM or not factor.surplus:
        return None
    convex = local.convex()
    matrix = kkt_matrix(problem, convex, factor.matrix.rotations)
    for added in ADDED:
        other = Factor(matrix, shift=-added)
        if not other.surplus:
            return newton_step(problem, convex, multipliers, other)
    return None


def _negative_space(
    problem: Problem,
    local: LocalDerivatives,
    factor: Factor,
    index: int | None,
    near: Array,
    guess: float,
) -> tuple[Array, Array, Array] | None:
    """The negative eigenpairs, None without any; `index` is their number where it is known.

    Pivots regularised by delta > 0 count at least as many as there are, and Lanczos finds at most as many:
    where it finds them all, both are right. Otherwise the matrix is ill-conditioned, and the block reduction,
    which needs no regularisation, counts again.
    """
    matrix, few = factor.matrix, 2 * problem.band.segments // 6
    count = factor.surplus if index is None else index
    if count and index is None and not factor.exact and problem.band.segments > DENSE_SEGMENTS:
        # The finer the grid, the more often pivots count too many; a vain search takes longer than a count.
        count = count_below(matrix, 0.0)
    if count <= 0:
        return None
    if count <= min(LANCZOS_LIMIT, few):
        try:
            return negative_eigenpairs(problem, factor, count, near)
        except FactorisationError:
            if factor.exact:
                raise  # a shift cannot be looked for in a reasonable time
        try:
            return negative_eigenpairs(problem, _quick_shift(matrix, guess), count, near)
        except FactorisationError:
            pass
    if index is None:
        confirmed = inertia(matrix)
        count = confirmed.negative if confirmed.trusted else 0
    if count <= 0:
        return None
    if count <= min(LANCZOS_LIMIT, few):
        try:
            return negative_eigenpairs(problem, shift_below(matrix, count), count, near)
        except FactorisationError:
            if problem.band.segments > DENSE_SEGMENTS:
                raise
    return dense_negative_eigenpairs(problem, local, matrix)


def null_space(problem: Problem, local: LocalDerivatives, rotations: Array) -> Array:
    """Orthonormal basis (7N, d) of the moves that keep constraints, gauge and prescribed rulings.

    From a full QR of the constraint normals, K below (2.57); dense, O(N^3).
    """
    rows = problem.jacobian_matrix(local).toarray()
    held = np.eye(problem.size)[problem.fixed]
    normals = np.vstack((rows, rotations.T, held)).T
    (qr, tau), _ = scipy.linalg.qr(normals, mode="raw", check_finite=False)
    rank = normals.shape[1]
    basis = np.zeros((problem.size, problem.size - rank), order="F")
    basis[np.arange(rank, problem.size), np.arange(problem.size - rank)] = 1.0
    multiply = scipy.linalg.get_lapack_funcs("ormqr", (qr,))
    work = int(multiply("L", "N", qr, tau, basis, -1)[1][0])
    out: Array = multiply("L", "N", qr[:, :rank], tau, basis, work)[0]
    return out


def dense_negative_eigenpairs(
    problem: Problem, local: LocalDerivatives, matrix: KKTMatrix
) -> tuple[Array, Array, Array]:
    """All negative eigenpairs by dense algebra, for many of them; same returns as Lanczos."""
    rotations = matrix.rotations
    basis = null_space(problem, local, rotations)
    hessian = problem.hessian_matrix(local)
    values, y = scipy.linalg.eigh(basis.T @ (hessian @ basis))
    keep = values < 0
    if not keep.any():
        return values[keep], basis @ y[:, keep], np.empty((problem.rows, 0))
    vectors = basis @ y[:, keep]
    excess = hessian @ vectors - vectors * values[keep]
    rows = np.vstack((problem.jacobian_matrix(local).toarray(), rotations.T))
    # With gaps there are several such problems in a search, and a QR takes a tenth of an SVD.
    driver = "gelsy" if isinstance(local, RestingDerivatives) else None
    nu = scipy.linalg.lstsq(rows.T, excess, lapack_driver=driver)[0][: problem.rows]
    return values[keep], vectors, nu
