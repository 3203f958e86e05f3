"""How forces are shared out among contacts that depend on each other.

Where vertices meet more gaps touch than are independent, and any shares f >= 0 in balance hold the same
shape. The gaps that were kept may come to depend on each other along a branch: their forces grow without
bound, or pull. Then others are kept, those whose forces have the least sum.
"""

from __future__ import annotations

import numpy as np
import scipy

from ..model.band import Array
from ..model.touching import Shape
from ..model.touching_audit import audit
from ..model.touching_gaps import Pairs
from ..model.touching_pieces import pieces
from .newton import Options, solve
from .resting import RestingProblem
from .resting_exchange import DEPENDENT, NoRestError, compliance
from .status import STATIONARY, Result

NEAR = 1e-10
"""Distance, as part of l, up to which features may share in the forces."""
MOST_STEPS = 20


def shared_anew(problem: RestingProblem, result: Result) -> tuple[RestingProblem, Result]:
    """A stationary shape with forces that push and have the least sum, on gaps that touch there. Raises
    NoRestError where these do not depend on each other, or none push."""
    shape = Shape.of(result.state, problem.gap)
    touching = _touching(shape, problem)
    if problem.gap or len(touching) == len(problem.pairs):
        raise NoRestError("forces cannot be shared out in other ways")
    own, forces = problem.split(result.multipliers)
    known = np.concatenate((forces, np.zeros(len(touching) - len(forces))))
    every = RestingProblem(problem.band, touching)
    share = least(compliance(every, result.x, own, known).m, known)
    keep = share > 0.0
    other = RestingProblem(problem.band, touching.take(keep))
    options = Options(leave_saddles=0, max_steps=MOST_STEPS)
    found = solve(other, result.x, np.concatenate((own, share[keep])), options)
    if found.status not in STATIONARY:
        raise NoRestError(f"{found.status.value} with forces shared out anew")
    return other, found


def _touching(shape: Shape, problem: RestingProblem) -> Pairs:
    """The gaps kept, and those of all that touches but for those that touch from both sides."""
    near = audit(shape, NEAR * shape.length).near
    touching = pieces(shape, near.joined(problem.pairs)).pairs
    names = touching.names()
    kept = set(problem.pairs.names())
    once = [k for k, name in enumerate(names) if names.count(name) == 1 and name not in kept]
    return problem.pairs.joined(touching.take(np.array(once, dtype=np.int64)))


def least(m: Array, forces: Array) -> Array:
    """Forces f >= 0 (k,) of the least sum that move what gives way as m (k,k) like other forces do. Raises
    NoRestError where there are none."""
    values, axes = np.linalg.eigh(0.5 * (m + m.T))
    clear = values > DEPENDENT * values[-1]
    rows = np.sqrt(values[clear] / values[-1])[:, None] * axes[:, clear].T
    pushed = rows @ forces
    size = max(float(np.abs(pushed).max(initial=0.0)), np.finfo(float).tiny)
    found = scipy.optimize.linprog(np.ones(len(forces)), A_eq=rows, b_eq=pushed / size, method="highs-ds")
    if found.x is None:
        raise NoRestError("no forces that push hold what touches")
    out: Array = size * found.x
    return out
