"""The certificate of a strip at rest on itself.

It is a minimum if it is stationary with forces, constraints and kept gaps below tolerance; if no force
pulls; if the audit over all pairs finds no crossing, so that every other gap is open; and if the
Lagrangian's Hessian, with -f.g'' of the forces, is positive definite on the null space of constraints and
of the gaps that push. That is sufficient: along any move that keeps these gaps the energy rises to second
order, and along one that opens some of them it rises to first order, by their forces. Where one of these
cannot be said, the state is undecided, with the reason.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..model.band import Array
from ..model.touching import EDGE, FACET, VERTEX, Shape
from ..model.touching_audit import Audit
from ..model.touching_barrier import sides_at
from ..model.touching_gaps import (
    G_FIRST,
    G_SECOND,
    ONE,
    R_FIRST,
    R_SECOND,
    TWO,
    Pairs,
    arguments,
    places,
    vectors,
)
from .inertia import inertia
from .kkt import FactorisationError
from .resting import RestingProblem
from .resting_kkt import kkt_matrix
from .status import Result, Status

PENETRATION = 1e-9
"""Greatest depth, as part of l, of a crossing in a certified state."""
PULLS = 1e-9
"""A force below minus this part of the largest one, or of 1, pulls."""
WEAK = 1e-6
"""A force below this part of the largest one is too weak to count on: its gap may be open as well."""
RIM = 1e-6
"""Distance from the rim of a feature, in its coordinates, within which a contact is on the rim."""
STEEPEST_XI = 12.0
"""Largest |xi| with which counts are trusted: 1 - tanh xi is 4e-11 there."""


def certified(problem: RestingProblem, result: Result, found: Audit) -> Result:
    """The result with what the certificate makes of its status: minimum, saddle, undecided or gap lost."""
    length, forces = problem.band.length, problem.split(result.multipliers)[1]
    if found.lacks(problem.gap) > PENETRATION * length:
        crosses = found.penetration > 0.0 or not problem.gap
        what = "Features cross" if crosses else "Features are nearer than the gap"
        return _as(result, Status.GAP_LOST, f"({what} by {found.lacks(problem.gap):.1e}.)")
    if result.status not in (Status.MINIMUM, Status.SADDLE) or not len(forces):
        return result
    why = _doubt(problem, result, forces)
    if why:
        return _as(result, Status.UNDECIDED, f"({why})", None)
    if result.status is Status.SADDLE:
        return _as(result, Status.SADDLE, f"(At rest on {len(forces)} contacts, which are kept.)")
    return _as(
        result,
        Status.MINIMUM,
        f"(At rest on {len(forces)} contacts, with forces of {forces.sum():.6g} in all.)",
    )


def _as(result: Result, status: Status, detail: str, negative: int | None = -1) -> Result:
    count = result.negative if negative == -1 else negative
    return replace(result, status=status, detail=detail, negative=count)


def _doubt(problem: RestingProblem, result: Result, forces: Array) -> str:
    """Why it cannot be said what a stationary state is; empty where it can."""
    largest = float(forces.max())
    if forces.min() < -PULLS * max(1.0, largest):
        return f"A force pulls: {forces.min():.1e}."
    steepest = float(np.abs(result.state.xi).max())
    if steepest > STEEPEST_XI:
        return f"|xi| is {steepest:.1f}: facets are too nearly triangles to count."
    lost = on_rim(Shape.of(result.state, problem.gap), problem.pairs, problem.gap)
    if lost is not None:
        return f"A contact, {_name(lost)}, is on the rim of its features, where gaps have kinks."
    weak = forces < WEAK * largest
    if weak.any() and result.status is Status.MINIMUM and not _holds_without(problem, result, weak):
        return f"The force of {int(weak.sum())} contacts is too near zero, and without them it is no minimum."
    return ""


def _holds_without(problem: RestingProblem, result: Result, weak: np.ndarray) -> bool:
    """Whether the Hessian is positive definite without the rows of weak contacts."""
    own, forces = problem.split(result.multipliers)
    fewer = RestingProblem(problem.band, problem.pairs.take(~weak), problem.gap)
    local = fewer.local_derivatives(result.x, np.concatenate((own, forces[~weak])))
    try:
        count = inertia(kkt_matrix(fewer, local, fewer.rotations(result.x)))
    except FactorisationError:
        return False
    return count.trusted and count.negative == 0


def on_rim(shape: Shape, pairs: Pairs, gap: float = 0.0) -> tuple[int, int, int, int] | None:
    """The name of a contact on the rim of its features whose gap is no bound there, None where there is none.

    At a rim another feature's gap takes over. Where that one is the less of the two beyond, shapes that do
    not cross have both gaps open, and either is a bound that a force may push on. So it is with a vertex
    over a ruling in a valley, and with sides that meet at a vertex and bend towards the other sheet. Where
    the gap beyond is the larger one, over ridges and at the strip's own rim, sheets may slip off each other.

    With a gap that is not zero gaps are distances, which have kinks nowhere; but second derivatives jump
    where one kind of distance takes over from another.
    """
    if gap:
        return _changes(shape, pairs)
    at, names = places(shape, pairs), pairs.names()
    what = arguments(pairs)
    six = vectors(shape, what)
    for k, (name, place) in enumerate(zip(names, at, strict=True)):
        if min(place.min(), 1.0 - place.max()) > RIM:
            continue
        c = np.cross(six[k, ONE], six[k, TWO])
        normal = pairs.sign[k] * c / np.linalg.norm(c)
        if name[2] == FACET:
            bound = min(place[3], 1.0 - place[3]) > RIM and _rises(shape, name[3], place[2], normal)
        else:
            bound = all(
                min(part, 1.0 - part) > RIM or _bends(shape, edge, part, toward)
                for edge, part, toward in ((name[1], place[0], -normal), (name[3], place[2], normal))
            )
        if not bound:
            return name
    return None


def _changes(shape: Shape, pairs: Pairs) -> tuple[int, int, int, int] | None:
    """The name of a contact at which its distance becomes one of another kind."""
    at, names = places(shape, pairs), pairs.names()
    what = arguments(pairs)
    b = shape.half_width
    for k, (name, place, six) in enumerate(zip(names, at, vectors(shape, what), strict=True)):
        if min(place.min(), 1.0 - place.max()) <= RIM:
            return name
        if name[0] != VERTEX or name[2] == FACET:
            continue
        lean = b * what.reach[k]
        apart = six[R_FIRST] + lean[0] * six[G_FIRST] - six[R_SECOND] - lean[1] * six[G_SECOND]
        ends = [(name[1], apart)]
        if name[2] == EDGE:
            apart -= (apart @ six[TWO]) / (six[TWO] @ six[TWO]) * six[TWO]
        else:
            ends.append((name[3], -apart))
        if any(_leads_away(shape, *end) <= RIM for end in ends):
            return name
    return None


def _leads_away(shape: Shape, vertex: int, apart: Array) -> float:
    """The least cosine between the edges at a vertex and a direction."""
    edges = np.array([3 * (vertex // 2), *sides_at(shape, vertex)])
    first, last = shape.edge_ends(edges)
    other = shape.vertices[np.where(first == vertex, last, first)] - shape.vertices[vertex]
    out = other @ apart / (np.linalg.norm(other, axis=1) * np.linalg.norm(apart))
    return float(out.min())


def _rises(shape: Shape, facet: int, place: float, normal: Array) -> bool:
    """Whether the facet beyond a facet's ruling rises towards a normal."""
    ahead = place > 0.5
    beyond = facet + (1 if ahead else -1)
    if not shape.closed and not 0 <= beyond < shape.segments:
        return False
    u = shape.u[beyond % shape.segments]
    return bool((u if ahead else -u) @ normal > 0.0)


def _bends(shape: Shape, edge: int, place: float, toward: Array) -> bool:
    """Whether the strip's side bends towards a direction at an end of an edge; a ruling's end is no such
    place."""
    if edge % 3 == 0:
        return False
    node = edge // 3 + (1 if place > 0.5 else 0)
    if not shape.closed and not 0 < node < shape.segments:
        return False
    turn = shape.u[node % shape.segments] - shape.u[node - 1]
    return bool(turn @ toward > 0.0)


def _name(name: tuple[int, int, int, int]) -> str:
    kinds = ("vertex", "edge", "facet")
    return f"{kinds[name[0]]} {name[1]} with {kinds[name[2]]} {name[3]}"
