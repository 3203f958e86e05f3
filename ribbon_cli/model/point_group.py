"""Names of orthogonal maps and of the finite groups they form, after Schoenflies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from .band import Array

ANGLE_TOLERANCE = 1e-5
"""Radians up to which the angle of an exact symmetry is taken for a fraction of a turn."""
LARGEST_ORDER = 100_000
SMALLEST_TURN = 1e-4


def nearest_orthogonal(correlation: Array) -> dict[int, tuple[Array, Array]]:
    """By determinant, the orthogonal Q (k,3,3) that maximise tr(Q^T C), and the maxima (k,); Kabsch (1976).

    C (k,3,3) = sum_i y_i x_i^T makes Q the best map of the vectors x onto y.
    """
    left, singular, right = np.linalg.svd(correlation)
    hand = np.where(np.linalg.det(left @ right) >= 0.0, 1.0, -1.0)
    found = {}
    for determinant in (1, -1):
        sign = hand * determinant
        turned = left.copy()
        turned[:, :, 2] *= sign[:, None]
        found[determinant] = (turned @ right, singular[:, 0] + singular[:, 1] + sign * singular[:, 2])
    return found


def rotation_angle(rotation: Array) -> float:
    """Angle in [0, pi] of a proper rotation (3,3)."""
    sine = 0.5 * math.sqrt(
        (rotation[2, 1] - rotation[1, 2]) ** 2
        + (rotation[0, 2] - rotation[2, 0]) ** 2
        + (rotation[1, 0] - rotation[0, 1]) ** 2
    )
    return math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))


def axis_of(rotation: Array) -> Array:
    """Unit axis (3,) of a proper rotation, its first component that is not small positive."""
    symmetric = 0.5 * (rotation + rotation.T)
    axis: Array = np.linalg.eigh(symmetric)[1][:, 2]
    lead = axis[np.flatnonzero(np.abs(axis) > 1e-6)[0]]
    out: Array = axis * np.sign(lead)
    return out


def turn_of(angle: float, tolerance: float) -> Fraction:
    """An angle in [0, pi] as the simplest fraction of a full turn within a tolerance in radians."""
    turn = angle / (2.0 * math.pi)
    for order in range(1, 200):
        part = round(turn * order)
        if abs(turn - part / order) * 2.0 * math.pi <= tolerance:
            return Fraction(part, order)
    return Fraction(turn).limit_denominator(LARGEST_ORDER)


def element_name(matrix: Array, tolerance: float = ANGLE_TOLERANCE) -> str:
    """Schoenflies' word for an orthogonal map (3,3): E, C2, C3, i, sigma, S4, ...

    The power of a rotation is left out: C5 stands for turns by 1/5 and by 2/5.
    """
    proper = bool(np.linalg.det(matrix) > 0)
    angle = rotation_angle(matrix if proper else -matrix)
    if proper:
        turn = turn_of(angle, tolerance)
        return "E" if turn == 0 else f"C{turn.denominator}"
    # An improper map is a turn by angle' + pi about the axis of -Q, with a reflection across it.
    turn = turn_of(abs(math.pi - angle), tolerance)
    if turn == 0:
        return "sigma"
    return "i" if turn == Fraction(1, 2) else f"S{turn.denominator}"


def distinct(matrices: Sequence[Array], tolerance: float = 1e-2) -> list[Array]:
    """The matrices (3,3) that differ from each other by more than a tolerance in some entry."""
    found: list[Array] = []
    for matrix in matrices:
        if not any(np.abs(matrix - other).max() < tolerance for other in found):
            found.append(matrix)
    return found


def group_name(matrices: Sequence[Array]) -> str:
    """Schoenflies' symbol of the group that orthogonal maps form, among the axial groups.

    Strips have no others: relabelling a closed strip is a dihedral matter. The maps must be distinct, with
    the identity among them.
    """
    proper = [q for q in matrices if np.linalg.det(q) > 0]
    improper = [q for q in matrices if np.linalg.det(q) <= 0]
    main = _main_axis(proper)
    if main is None:
        return _without_rotations(improper)
    axis, order = main
    across = [q for q in proper if abs(axis @ axis_of(q)) < 0.1 and rotation_angle(q) > 3.0]
    letter = "D" if across else "C"
    if not improper:
        return f"{letter}{order}"
    normals = [axis_of(-q) for q in improper if rotation_angle(-q) > 3.0]
    if any(abs(axis @ normal) > 0.9 for normal in normals):
        return f"{letter}{order}h"
    if not normals:
        return f"S{2 * order}"
    return f"D{order}d" if across else f"C{order}v"


def _main_axis(proper: Sequence[Array]) -> tuple[Array, int] | None:
    """The axis with the most rotations and their number with the identity; None without rotations."""
    turned = [q for q in proper if rotation_angle(q) > SMALLEST_TURN]
    axes: list[Array] = []
    counts: list[int] = []
    for q in turned:
        axis = axis_of(q)
        for k, other in enumerate(axes):
            if abs(other @ axis) > 0.99:
                counts[k] += 1
                break
        else:
            axes.append(axis)
            counts.append(1)
    if not axes:
        return None
    best = int(np.argmax(counts))
    return axes[best], counts[best] + 1


def _without_rotations(improper: Sequence[Array]) -> str:
    if not improper:
        return "C1"
    return "Ci" if element_name(improper[0]) == "i" else "Cs"
