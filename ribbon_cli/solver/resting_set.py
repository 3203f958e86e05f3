"""Which gaps are kept: the active set of a strip that rests on itself, at one place of its parameters.

From a shape that does not cross itself, Newton's method goes to a stationary point with some gaps kept. Then, one
change at a time: a gap whose force pulls is given up; one whose place is off its features is given up for its
neighbours; of the neighbours of a place of contact that are crossed the deepest is kept; and what else the audit
over all pairs finds crossed, on the way from the first shape or at its end, is kept from then on. A set that
comes back ends the attempt, as do steps that do not converge: the caller takes a shorter step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..model.band import Array, Band, State
from ..model.problem import Problem
from ..model.rates import rates
from ..model.touching import EDGE, FACET, VERTEX, Shape
from ..model.touching_audit import Audit, audit, passages
from ..model.touching_gaps import Pairs, arguments, gaps, places, vectors
from ..parts import HALF_WIDTH
from .kkt import FactorisationError
from .linear import Factor
from .resting import RestingPoint, Touching, newton

PULLS = 1e-9
"""A force below minus this part of the largest one, or of 1, pulls."""
OFF = 1e-9
"""How far off its features, in their coordinates, a place of contact may be."""
DEPTH = 1e-10
"""Depth, as part of l, from which a crossing counts: a tenth of what a certificate allows."""
SLIP = 1e-4
"""Depth, as part of l, that sheets which slide on each other may have half-way between two shapes: their
straight way cuts a curve short. What passes deeper has passed through."""
MOST_CHANGES = 60
AROUND = 2
"""Facets to either side of a place of contact whose features are its neighbours."""
FACING = 0.2
"""Least cosine between the normal of a gap and that of the contact it is a neighbour of."""
SAMPLES = 9


@dataclass(frozen=True, eq=False)
class Rest:
    """A stationary shape with the gaps that it keeps, forces (k,) and multipliers (5N+3,)."""

    point: RestingPoint
    audit: Audit
    steps: int = 0
    changes: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """The shape."""
        return self.point.state

    @property
    def band(self) -> Band:
        """What is fixed."""
        return self.point.problem.band

    @property
    def pairs(self) -> Pairs:
        """The gaps that are kept."""
        return self.point.touching.pairs

    @property
    def forces(self) -> Array:
        """Their forces."""
        return self.point.forces

    @property
    def gap(self) -> float:
        """The gap that is kept."""
        return self.point.touching.gap


class NoRest(Exception):
    """No active set was found; the message says why."""


def rest_at(state: State, multipliers: Array, pairs: Pairs | None = None, forces: Array | None = None, gap: float = 0.0) -> Rest:
    """A state as it is, with its gaps."""
    pairs = Pairs.none() if pairs is None else pairs
    forces = np.zeros(len(pairs)) if forces is None else forces
    touching = Touching(Problem(state.band), pairs, gap)
    point = RestingPoint.at(touching, state.vector(), multipliers, forces)
    return Rest(point, audit(Shape.of(state, gap), DEPTH * state.band.length))


@dataclass(frozen=True)
class Slopes:
    """Derivatives by a parameter along the branch with the same gaps: of x, multipliers and forces, and dE/dp."""

    x: Array
    multipliers: Array
    forces: Array
    rise: float


def slopes(rest: Rest, name: str = HALF_WIDTH) -> Slopes:
    """The slopes at a stationary shape. Raises FactorisationError at a fold."""
    point, problem = rest.point, rest.point.problem
    along = rates(problem, point.x, point.multipliers, point.local.gradient, name)
    gradient, rise = along.gradient, along.lagrangian
    by_gap = np.zeros(len(point.forces))
    if name == HALF_WIDTH and by_gap.size:
        gradient = gradient - point.touching.pull(point.forces[:, None, None] * point.gaps.rate_gradient)
        by_gap = point.gaps.rate
        rise -= float(point.forces @ by_gap)
    x, by_lambda, by_force = point.solve(Factor(point.matrix), -gradient, -along.constraints, -by_gap)
    return Slopes(x, -by_lambda, -by_force, rise)


def moved(rest: Rest, band: Band, by: float, along: Slopes | None) -> Rest:
    """The next shape, with a band of other parameters, from a shape that does not cross itself."""
    point = rest.point
    x, multipliers, forces = point.x, point.multipliers, point.forces
    if along is not None:
        x, multipliers, forces = x + by * along.x, multipliers + by * along.multipliers, forces + by * along.forces
    return _Search(rest, Problem(band)).run(x, multipliers, forces)


class _Search:
    """One search for an active set."""

    def __init__(self, before: Rest, problem: Problem) -> None:
        self.before, self.problem, self.gap = before, problem, before.gap
        self.length = problem.band.length
        self.shape_before = Shape.of(before.state, before.gap)
        self.seen: set[tuple[tuple[int, int, int, int], ...]] = set()
        self.changes: list[str] = []
        self.steps = 0

    def run(self, x: Array, multipliers: Array, forces: Array) -> Rest:
        pairs = self.before.pairs
        for _ in range(MOST_CHANGES):
            key = tuple(sorted(pairs.keys()))
            if key in self.seen:
                raise NoRest(f"gaps come back ({'; '.join(self.changes[-6:])})")
            self.seen.add(key)
            point = self._newton(pairs, x, multipliers, forces)
            following = self._changed(point)
            if following is None:
                end = self._accepted(point)
                if isinstance(end, Rest):
                    return end
                following = end
            pairs, forces = following
            x, multipliers = point.x, point.multipliers
        raise NoRest("too many changes of gaps")

    def _newton(self, pairs: Pairs, x: Array, multipliers: Array, forces: Array) -> RestingPoint:
        touching = Touching(self.problem, pairs, self.gap)
        try:
            end = newton(RestingPoint.at(touching, x, multipliers, forces))
        except FactorisationError as error:
            raise NoRest(str(error)) from error
        self.steps += end.steps
        if not end.converged:
            raise NoRest(f"Newton's method does not converge with {len(pairs)} gaps: {end.why} ({end.point.worst:.1e})")
        return end.point

    def _changed(self, point: RestingPoint) -> tuple[Pairs, Array] | None:
        """The gaps after one change that forces, places and neighbours ask for; None where they ask for none."""
        pairs, forces = point.touching.pairs, point.forces
        if not len(pairs):
            return None
        shape = Shape.of(point.state, self.gap)
        at = places(shape, pairs)
        off = np.maximum(-at, at - 1.0).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > OFF:
            keep = np.arange(len(pairs)) != worst
            self.changes.append(f"off {pairs.keys()[worst]} {off[worst]:.1e}")
            extra = crossed_neighbours(shape, pairs, self.length * DEPTH, without=pairs)
            return self._with(pairs.take(keep), forces[keep], extra, point)
        least = int(np.argmin(forces))
        if forces[least] < -PULLS * max(1.0, float(np.abs(forces).max())):
            keep = np.arange(len(pairs)) != least
            self.changes.append(f"lift {pairs.keys()[least]} {forces[least]:.2e}")
            return pairs.take(keep), forces[keep]
        extra = crossed_neighbours(shape, pairs, self.length * DEPTH, without=pairs)
        if len(extra):
            return self._with(pairs, forces, extra, point)
        return None

    def _with(self, pairs: Pairs, forces: Array, extra: Pairs, point: RestingPoint) -> tuple[Pairs, Array]:
        if len(extra):
            self.changes += [f"keep {key}" for key in extra.keys()]
        return pairs.joined(extra), np.concatenate((forces, np.zeros(len(extra))))

    def _accepted(self, point: RestingPoint) -> Rest | tuple[Pairs, Array]:
        """The shape, if neither it nor the way to it crosses anything; else the gaps to go on with."""
        shape = Shape.of(point.state, self.gap)
        found = audit(shape, DEPTH * self.length)
        met = passages(self.shape_before, shape)
        pairs = point.touching.pairs
        if found.penetration > DEPTH * self.length:
            known = set(pairs.keys())
            new = [k for k, key in enumerate(met.pairs.keys()) if key not in known]
            new = [k for k in new if self._violated(shape, met.pairs.take(np.array([k])))]
            if not new:
                raise NoRest(f"a crossing of depth {found.penetration:.1e} that no passage explains")
            first = met.when[new[0]]
            chosen = [k for k in new if met.when[k] <= first + 1e-6]
            unique = {met.pairs.keys()[k]: k for k in chosen}
            return self._with(pairs, point.forces, met.pairs.take(np.array(sorted(unique.values()))), point)
        if len(met):
            depth = depth_between(self.before.state, point.state, self.gap)
            if depth > SLIP * self.length:
                raise NoRest(f"the way passes through itself, {depth:.1e} deep")
        return Rest(point, found, self.steps, tuple(self.changes))

    def _violated(self, shape: Shape, pair: Pairs) -> bool:
        what = arguments(pair)
        value = gaps(vectors(shape, what), what, pair.sign, shape.half_width).value
        return bool(value[0] < -0.1 * DEPTH * self.length)


def depth_between(before: State, after: State, gap: float) -> float:
    """The greatest depth of a crossing at a few places of the straight way between two shapes."""
    deepest = 0.0
    x, y = before.vector(), after.vector()
    for part in np.linspace(0.0, 1.0, SAMPLES + 2)[1:-1]:
        b = (1.0 - part) * before.band.half_width + part * after.band.half_width
        middle = State.from_vector(before.band.with_half_width(b), (1.0 - part) * x + part * y)
        deepest = max(deepest, audit(Shape.of(middle, gap), DEPTH * before.band.length).penetration)
    return deepest


def crossed_neighbours(shape: Shape, pairs: Pairs, depth: float, without: Pairs) -> Pairs:
    """Gaps beside places of contact that are crossed, the deepest at each place.

    The normal of a contact, from its second feature to its first, says on which side the sheets are to stay.
    """
    known = set(without.keys())
    found: dict[tuple[int, int, int, int], tuple[float, int, float]] = {}
    what = arguments(pairs)
    six = vectors(shape, what)
    for k in range(len(pairs)):
        c = np.cross(six[k, 4], six[k, 5])
        normal = pairs.sign[k] * c / np.linalg.norm(c)
        near = _neighbours(shape, pairs.take(np.array([k])))
        if not len(near[0]):
            continue
        around, outward = near
        their = arguments(around)
        theirs = vectors(shape, their)
        cross = np.cross(theirs[:, 4], theirs[:, 5])
        size = np.maximum(np.linalg.norm(cross, axis=1), np.finfo(float).tiny)
        facing = outward * (cross @ normal) / size
        value = gaps(theirs, their, np.sign(facing), shape.half_width).value
        at = places(shape, around)
        inside = (np.maximum(-at, at - 1.0).max(axis=1) <= 0.0) & (np.abs(facing) > FACING)
        keys = around.keys()
        bad = [m for m in np.flatnonzero(inside & (value < -depth)) if keys[m] not in known]
        if bad:
            m = min(bad, key=lambda m: (value[m], keys[m]))
            found.setdefault(keys[m], (float(np.sign(facing[m])), k, float(value[m])))
    if not found:
        return Pairs.none()
    names = np.array(sorted(found), dtype=np.int64)
    sign = np.array([found[tuple(row)][0] for row in names.tolist()])
    return Pairs(names[:, :2], names[:, 2:], sign)


def _home(features: np.ndarray) -> int:
    """A facet at which a feature (2,) is."""
    kind, number = int(features[0]), int(features[1])
    return number if kind == FACET else number // 2 if kind == VERTEX else number // 3


def _facets_around(shape: Shape, home: int) -> np.ndarray:
    n = shape.segments
    span = np.arange(home - AROUND - 1, home + AROUND + 1)
    return np.unique(span % n) if shape.closed else span[(span >= 0) & (span < n)]


def _neighbours(shape: Shape, pair: Pairs) -> tuple[Pairs, Array]:
    """Pairs of features around a contact, and for each 1 where its first feature is on the contact's first side,
    else -1."""
    one, other = _facets_around(shape, _home(pair.first[0])), _facets_around(shape, _home(pair.second[0]))
    first, second, outward = [], [], []
    for a, b, side in ((one, other, 1.0), (other, one, -1.0)):
        vertices = np.unique(shape.corner_numbers[a])
        v, f = (g.ravel() for g in np.meshgrid(vertices, b, indexing="ij"))
        first.append(np.column_stack((np.full(v.size, VERTEX), v)))
        second.append(np.column_stack((np.full(v.size, FACET), f)))
        outward.append(np.full(v.size, side))
    p, q = (g.ravel() for g in np.meshgrid(np.unique(shape.edge_numbers[one]), np.unique(shape.edge_numbers[other]), indexing="ij"))
    p, q = (g[(p != q) & ~shape.slivers[p] & ~shape.slivers[q]] for g in (p, q))
    first.append(np.column_stack((np.full(p.size, EDGE), np.minimum(p, q))))
    second.append(np.column_stack((np.full(p.size, EDGE), np.maximum(p, q))))
    outward.append(np.where(p < q, 1.0, -1.0))
    around = Pairs(np.vstack(first), np.vstack(second), np.ones(sum(len(f) for f in first)))
    apart = np.concatenate(
        (
            shape.flat_distance(shape.flat_of_vertices(around.first[: -p.size, 1]), shape.flat_of_facets(around.second[: -p.size, 1])),
            shape.flat_distance(shape.flat_of_edges(around.first[-p.size :, 1]), shape.flat_of_edges(around.second[-p.size :, 1])),
        )
    )
    counts = apart >= shape.excluded
    return around.take(counts), np.concatenate(outward)[counts]


def with_forces(rest: Rest, forces: Array) -> Rest:
    """The same with other forces."""
    point = rest.point
    return replace(rest, point=RestingPoint.at(point.touching, point.x, point.multipliers, forces))
