"""Whether a stored point of a branch has the tangent, and the lowest eigenvalue, of its shape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.problem import Problem
from ..parts import HALF_WIDTH
from ..solver.arclength import Tangent, point_at, tangent_from
from ..solver.kkt import FactorisationError
from ..solver.singular import lowest_mode
from ..store import StateRecord
from ..study.records import all_multipliers_of

TANGENT = 1e-6
"""By how much a tangent, of length one, may be off."""
VALUE = 1e-6
"""Difference up to which the lowest eigenvalue agrees, relative where it is large."""
OVERLAP = 1e-4
"""The same of its mode's overlap with sliding, which a nearly equal eigenvalue may turn."""


def check_branch(record: StateRecord, problem: Problem, x: np.ndarray) -> Iterator[str]:
    """Check the tangent, its component in the parameter, and the lowest eigenvalue; nothing for other states.

    At branch points, where several tangents are, the stored one must be of length one.
    """
    branch = record.branch
    if branch is None:
        return
    if not branch.arclength >= 0.0:
        yield f"/branch/arclength is {branch.arclength:.10g}"
    parameter = branch.parameter or HALF_WIDTH
    if parameter not in record.parameters:
        yield f"/branch/parameter is {parameter}, which the problem does not have"
        return
    point = point_at(problem, x, all_multipliers_of(record), parameter)
    stored = Tangent(branch.tangent.ravel(), np.zeros(problem.rows), branch.half_width_rate)
    size = point.product(stored, stored)
    if not abs(size - 1.0) <= TANGENT:
        yield f"/branch/tangent has the squared length {size:.10g}, with half_width_rate"
        return
    if branch.type != "branch-point":
        try:
            found = tangent_from(point, stored)
        except FactorisationError:
            return
        off = Tangent(found.x - stored.x, stored.multipliers, found.value - stored.value)
        error = float(np.sqrt(point.product(off, off)))
        if not error <= TANGENT:
            yield f"/branch/tangent with half_width_rate is off by {error:.1e}"
    lowest = lowest_mode(point) if branch.lowest_eigenvalue is not None else None
    if lowest is None or branch.lowest_eigenvalue is None:
        return
    value, overlap = lowest
    if not abs(value - branch.lowest_eigenvalue) <= VALUE * (abs(value) + 1.0):
        yield f"/branch/lowest_eigenvalue is {branch.lowest_eigenvalue:.10g}, recomputed {value:.10g}"
    if branch.soft_mode is None and not abs(overlap - (branch.sliding_overlap or 0.0)) <= OVERLAP:
        yield f"/branch/sliding_overlap is {branch.sliding_overlap or 0.0:.6g}, recomputed {overlap:.6g}"
