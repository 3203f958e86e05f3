"""Singular points of a branch: the smooth test function that finds them, and the mode that turns soft there.

With a fixed vector c near the null vector of the projected Hessian, solve

    [ K   c ] [ v ]   [ 0 ]
    [ c'  0 ] [ g ] = [ 1 ].

Then K v = -g c, so that g = -1/(c' K^-1 c) is smooth and passes zero exactly where K is singular, and there
v is the null vector. The matrix stays regular (Griewank & Reddien 1984; Govaerts 2000, 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.band import Array
from .arclength import GOAL, Point, Tangent, point_at, shape_weights
from .kkt import FactorisationError
from .linear import Factor
from .resting_kkt import kkt_matrix
from .saddle_free import start_vector
from .spectra import SLIDING_OVERLAP, lowest_spectrum, sliding_overlap

INVERSE_ITERATIONS = 12
SETTLING_STEPS = 3


@dataclass(frozen=True)
class Mode:
    """A direction along which the energy is flat at a singular point, of length one in the metric of
    arclength.

    `overlap` (0 to 1) is its cosine with sliding the shape along the band.
    """

    tangent: Tangent
    overlap: float

    @property
    def word(self) -> str:
        """`sliding` or `shape`."""
        return "sliding" if self.overlap > SLIDING_OVERLAP else "shape"


def soft_direction(point: Point) -> Array:
    """A covector c (7N,) on u and g along the eigenvector nearest to zero, by inverse iteration."""
    inner = shape_weights(point.problem.band)
    factor = Factor(point.matrix)
    n = point.problem.size
    rhs = np.zeros(point.matrix.size + point.matrix.border)
    v = start_vector(n, point.problem.fixed)
    for _ in range(INVERSE_ITERATIONS):
        rhs[:n] = inner * v
        v = factor.solve_backward(rhs)[:n]
        v /= np.sqrt(v @ (inner * v))
    out: Array = inner * v
    return out


def soft_value(point: Point, c: Array) -> tuple[float, Tangent]:
    """g and v (with b = 0) at a point. Raises FactorisationError if c is no border that makes K regular."""
    n, rows = point.problem.size, point.problem.rows
    z = _bordered_solution(point, c, np.zeros(n), np.zeros(rows), 1.0)
    return float(z[-1]), Tangent(z[:n], -z[n : n + rows], 0.0)


def settled(point: Point, c: Array) -> Point:
    """The place next to one that is nearly singular and nearly stationary, by Newton steps at its half-width.

    The steps do not move along the soft direction, whose covector c (7N,) borders the KKT matrix as in
    `soft_value`: along it the place is as good as the interpolation that it comes from. Raises
    FactorisationError as `soft_value`.
    """
    for _ in range(SETTLING_STEPS):
        if point.worst <= GOAL:
            break
        gradient = point.problem.lagrangian_gradient(point.local, point.multipliers)
        z = _bordered_solution(point, c, -gradient, -point.local.constraints, 0.0)
        n = point.problem.size
        x, multipliers = point.x + z[:n], point.multipliers - z[n : n + point.problem.rows]
        following = point_at(point.problem, x, multipliers, point.parameter)
        if not following.worst < point.worst:
            break
        point = following
    return point


def _bordered_solution(point: Point, c: Array, gradient: Array, constraints: Array, level: float) -> Array:
    """z = (p, -dlambda, gauge, g |c|) of the system bordered by c / |c|, without copies for gaps.

    The right-hand sides are (7N,), (5N+3,) and that of the last row.
    """
    rotations = point.problem.rotations(point.x)
    matrix = kkt_matrix(point.problem, point.local, np.hstack((rotations, c[:, None] / np.linalg.norm(c))))
    copies = np.zeros(matrix.tail - matrix.gauge)
    rhs = np.concatenate((gradient, constraints, np.zeros(rotations.shape[1]), [level], copies))
    return Factor(matrix).solve(rhs)[: rhs.size - copies.size]


def with_multipliers(point: Point, x: Array) -> Tangent:
    """The null vector at a singular point near x (7N,), multipliers included."""
    inner = shape_weights(point.problem.band)
    return mode_of(point, soft_value(point, inner * x)[1]).tangent


def mode_of(point: Point, v: Tangent) -> Mode:
    """A direction as a mode: of length one, its largest component positive, with its overlap with sliding."""
    inner = shape_weights(point.problem.band)
    size = float(np.sqrt(v.x @ (inner * v.x)))
    size *= float(np.sign(v.x[np.argmax(np.abs(v.x))]))
    tangent = Tangent(v.x / size, v.multipliers / size, v.value / size)
    return Mode(tangent, sliding_overlap(point.problem, point.x, v.x))


def lowest_mode(point: Point) -> tuple[float, float] | None:
    """The lowest eigenvalue in the physical metric and its mode's overlap with sliding; None if not found."""
    try:
        found = lowest_spectrum(point.problem, point.x, point.local, "physical", 1)
    except FactorisationError:
        return None
    for value, label, overlap in zip(found.values, found.labels, found.sliding_overlap, strict=True):
        if label != "rotation":
            return float(value), float(overlap)
    return None
