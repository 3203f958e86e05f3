"""Forces and moments at the ends of a strip in equilibrium.

What a clamp exerts on the strip is the derivative of the Lagrangian by its place: the end's force is the
multiplier of h sum u = displacement, and its moment about its midpoint that of turning its tangent and
ruling, M = t x dL/dt + g x dL/dg. The start's moment comes likewise from its own tangent and ruling, and its
force from the rows of the first facet: what is left there of the gradient without loads and end is h times
the force that the facet passes on. So balance of both with the loads is a test, not an identity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .band import Array
from .problem import Problem
from .stencil import Seam, U


@dataclass(frozen=True)
class Reactions:
    """Forces (3,), in 1/length, and moments (3,) about the ends' midpoints, on the strip.

    In the start's frame; of a free end both are zero.
    """

    force: Array
    moment: Array
    start_force: Array
    start_moment: Array


def reactions(problem: Problem, x: Array, multipliers: Array, contacts: Array | None = None) -> Reactions:
    """The reactions of a strip at x (7N,) with multipliers (5N+3,). Raises ValueError for a closed band.

    `contacts` is what contact forces pull with on unknowns and data, their gaps' gradients times forces.
    """
    if not problem.stencil.seam.strip:
        raise ValueError("a closed band has no ends")
    local, n = problem.local(x), problem.band.segments
    _, gradient, jacobian, _ = problem.unmasked(local, None)
    pull = gradient - np.einsum("kji,ki->ji", jacobian, problem.local_multipliers(multipliers))
    slots = problem.gathered_with_data(pull)
    if contacts is not None:
        slots = slots - contacts
    moment, force = np.zeros(3), np.zeros(3)
    if problem.stencil.seam is Seam.HELD:
        tangent = local[U, n]
        moment = np.cross(tangent, slots[-3:]) + np.cross(problem.end_ruling(x), slots[3:6])
        force = multipliers[-3:].copy()
    start_moment = np.cross(np.array([1.0, 0.0, 0.0]), slots[-9:-6]) + np.cross(
        problem.rulings(x)[0], slots[-6:-3]
    )
    loads = sum((term.resultant() for term in problem.terms if term.load), np.zeros(3))
    return Reactions(force, moment, -(slots[:3] / problem.band.h + loads), start_moment)
