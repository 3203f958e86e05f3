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
import scipy

from ..model.band import Array, Band, State
from ..model.touching import EDGE, FACET, VERTEX, Shape
from ..model.touching_audit import Audit, Motion, audit
from ..model.touching_gaps import Pairs, arguments, gaps, places, vectors
from ..parts import HALF_WIDTH
from .kkt import FactorisationError
from .linear import Factor
from .newton import Options, Stepper, iterate_at, solve
from .resting import RestingProblem, resting_rates
from .resting_barrier import BarrierProblem
from .resting_kkt import RestingDerivatives, kkt_matrix
from .status import STATIONARY, Result, Status

Key = tuple[int, int, int, int]
OFF = 1e-9
"""How far off its features, in their coordinates, a place of contact may be."""
DEPTH = 1e-10
"""Depth, as part of l, from which a crossing counts: a tenth of what a certificate allows."""
SLIP = 1e-4
"""Depth, as part of l, that sheets which slide on each other may have half-way between two shapes: their
straight way cuts a curve short. What passes deeper has passed through."""
MOST_ROUNDS, MOST_STEPS, MOST_STUCK, MOST_SADDLES = 12, 60, 12, 3
REACHES = (5e-4, 5e-5)
"""Reaches of the barrier, as parts of l, one after the other."""
MOST_DESCENTS = 150
BARRIER_GOAL = 1e-6
PROXIMAL = 1e-2
DEPENDENT = 1e-9
"""Eigenvalue of the gaps' compliance, relative to the largest, below which gaps depend on each other."""
MOST_CANDIDATES = 24
"""Gaps of one quadratic problem, the least ones."""
MARGIN = 0.5
ABOVE = 1e-12
"""Off its features by a margin, a gap counts where it is above minus this part of l: in a valley."""
AROUND = 2
"""Facets to either side of a place of contact whose features are its neighbours."""
FACING = 0.2
"""Least cosine between the normal of a gap and that of the contact it is a neighbour of."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A stationary shape with the gaps that it keeps; `result` has the forces after the multipliers."""

    problem: RestingProblem
    result: Result
    audit: Audit
    steps: int = 0
    changes: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """The shape."""
        return self.result.state

    @property
    def band(self) -> Band:
        """What is fixed."""
        return self.problem.band

    @property
    def pairs(self) -> Pairs:
        """The gaps that are kept."""
        return self.problem.pairs

    @property
    def multipliers(self) -> Array:
        """Those of constraints (5N+3,)."""
        return self.problem.split(self.result.multipliers)[0]

    @property
    def forces(self) -> Array:
        """The gaps' forces (k,)."""
        return self.problem.split(self.result.multipliers)[1]

    @property
    def gap(self) -> float:
        """The gap that is kept."""
        return self.problem.gap


class NoRest(Exception):
    """No active set was found; the message says why."""


def rest_at(
    state: State, multipliers: Array, pairs: Pairs | None = None, forces: Array | None = None, gap: float = 0.0
) -> Rest:
    """A stationary state as it is, with its gaps; its index is counted anew."""
    pairs = Pairs.none() if pairs is None else pairs
    forces = np.zeros(len(pairs)) if forces is None else forces
    problem = RestingProblem(state.band, pairs, gap)
    options = Options(max_steps=3, leave_saddles=0)
    result = solve(problem, state.vector(), np.concatenate((multipliers, forces)), options)
    return Rest(problem, result, audit(Shape.of(result.state, gap), DEPTH * state.band.length))


@dataclass(frozen=True)
class Slopes:
    """Derivatives by a parameter along the branch with the same gaps: of x and of multipliers with forces, and
    dE/dp."""

    x: Array
    multipliers: Array
    rise: float


def slopes(rest: Rest, name: str = HALF_WIDTH) -> Slopes:
    """The slopes at a stationary shape. Raises FactorisationError at a fold."""
    problem, x, multipliers = rest.problem, rest.result.x, rest.result.multipliers
    along = resting_rates(problem, x, multipliers, name)
    matrix = kkt_matrix(problem, problem.local_derivatives(x, multipliers), problem.rotations(x))
    z = Factor(matrix).solve(np.concatenate((-along.gradient, -along.constraints, np.zeros(matrix.tail))))
    n = problem.size
    return Slopes(z[:n], -z[n : n + problem.rows], along.lagrangian)


def moved(rest: Rest, band: Band, by: float, along: Slopes | None) -> Rest:
    """The next shape by quadratic programming, with a band of other parameters. Raises NoRest."""
    x, multipliers = rest.result.x, rest.result.multipliers
    if along is not None:
        x, multipliers = x + by * along.x, multipliers + by * along.multipliers
    own, forces = rest.problem.split(multipliers)
    return _Search(rest.state, band, rest.gap, SLIP).run(x, own, rest.pairs, forces)


def found(rest: Rest, band: Band, by: float, along: Slopes | None) -> Rest:
    """The next shape by a barrier, then without it. Raises NoRest.

    From the shape its gaps are opened to half of the reach, by the least move, and nothing meets on the way;
    nor does it on any step of the descents, which end a thirtieth of the first reach apart.
    """
    length = band.length
    start, own = _opened(rest, band, by, along, 0.5 * REACHES[0] * length)
    _clean(rest.state, start, 10.0 * DEPTH * length)
    steps, x = 0, start.vector()
    for reach in REACHES:
        problem = BarrierProblem(band, reach * length)
        options = Options(way=problem.allows, leave_saddles=MOST_SADDLES, max_steps=MOST_DESCENTS, goal=BARRIER_GOAL, tolerance=BARRIER_GOAL)
        result = solve(problem, x, own, options)
        steps += result.steps
        if result.status not in (*STATIONARY, Status.STALLED, Status.ITERATION_LIMIT):
            raise NoRest(f"{result.status.value} at reach {reach:g}")
        x, own = result.x, result.multipliers
    near = problem.near(x)
    forces = problem.forces(x, near)
    facing = ~((near.first[:, 0] == VERTEX) & (near.second[:, 0] != FACET))
    search = _Search(result.state, band, 0.0, 10.0 * DEPTH)
    end = search.run(x, own, near.take(facing), forces[facing])
    return replace(end, steps=end.steps + steps, changes=("barrier", *end.changes))


def _opened(rest: Rest, band: Band, by: float, along: Slopes | None, gap: float) -> tuple[State, Array]:
    """A shape beside one at rest whose gaps are open, and multipliers of its constraints."""
    x, multipliers = rest.result.x, rest.result.multipliers
    if along is not None:
        x, multipliers = x + by * along.x, multipliers + by * along.multipliers
    problem = RestingProblem(band, rest.pairs, gap)
    try:
        x = Stepper(problem, Options()).restored(x)
    except FactorisationError as error:
        raise NoRest("gaps cannot be opened all at once") from error
    return problem.state(x), rest.problem.split(multipliers)[0]


def _clean(before: State, after: State, depth: float) -> None:
    """Raise NoRest if anything passes through anything deeper than this between two shapes, or at the end."""
    motion = Motion(Shape.of(before), Shape.of(after))
    met = motion.passages()
    if audit(motion.after, 0.0).penetration > 0.0:
        raise NoRest("the start crosses itself")
    if len(met) and motion.depth(met) > depth:
        raise NoRest("the way to the start passes through itself")


class _Search:
    """Sequential quadratic programming with gaps as inequalities, from one shape to the next."""

    def __init__(self, before: State, band: Band, gap: float, slip: float) -> None:
        self.band, self.gap, self.slip = band, gap, slip
        self.length = band.length
        self.shape_before = Shape.of(before, gap)
        self.changes: list[str] = []
        self.steps = 0
        self.saddles = 0
        self.options = Options(leave_saddles=0)

    def run(self, x: Array, own: Array, pairs: Pairs, forces: Array) -> Rest:
        """The next shape, from x with multipliers of constraints, contacts and forces. Raises NoRest."""
        known = dict(zip(pairs.keys(), forces.tolist(), strict=True))
        parents = pairs
        for _ in range(MOST_ROUNDS):
            problem, result = self._converged(x, own, parents, known)
            end = self._accepted(problem, result)
            x, (own, forces) = result.x, problem.split(result.multipliers)
            known = dict(zip(problem.pairs.keys(), forces.tolist(), strict=True))
            if isinstance(end, Rest):
                if result.status is not Status.SADDLE or self.saddles >= MOST_SADDLES:
                    return end
                left = self._left(problem, result)
                if left is None:
                    return end
                x, parents = left, problem.pairs
            else:
                parents = end
        raise NoRest(f"no end of new contacts ({'; '.join(self.changes[-4:])})")

    def _converged(
        self, x: Array, own: Array, parents: Pairs, known: dict[Key, float]
    ) -> tuple[RestingProblem, Result]:
        """A stationary point whose gaps push and are not crossed beside its contacts."""
        best, stuck = np.inf, 0
        working = parents
        for _ in range(MOST_STEPS):
            shape = Shape.of(State.from_vector(self.band, x), self.gap)
            candidates = beside(shape, parents, self.gap)
            forces = np.array([known.get(key, 0.0) for key in candidates.keys()])
            working, own_forces = self._working(x, own, candidates, forces)
            problem = RestingProblem(self.band, working, self.gap)
            point = iterate_at(problem, x, np.concatenate((own, own_forces)))
            at_rest = point.worst <= self.options.goal or (point.worst <= self.options.tolerance and stuck > 1)
            if at_rest:
                result = solve(problem, x, point.multipliers, replace(self.options, max_steps=4))
                if result.status not in STATIONARY:
                    raise NoRest(f"{result.status.value} at the end")
                self.steps += result.steps
                return problem, result
            stuck, best = (0, point.worst) if point.worst < 0.5 * best else (stuck + 1, best)
            if stuck > MOST_STUCK:
                raise NoRest(f"residuals do not fall ({point.worst:.1e}, {len(working)} gaps)")
            following = Stepper(problem, self.options).step(point)
            self.steps += 1
            if following is None:
                raise NoRest(f"no step makes progress ({point.worst:.1e}, {len(working)} gaps)")
            x = following.x
            own, own_forces = problem.split(following.multipliers)
            known = dict(zip(working.keys(), own_forces.tolist(), strict=True))
            if len(working):
                parents = working
        raise NoRest(f"too many steps ({best:.1e}, {len(working)} gaps)")

    def _working(self, x: Array, own: Array, candidates: Pairs, forces: Array) -> tuple[Pairs, Array]:
        """The candidates that push in the quadratic problem at x, and their forces.

        With p = p_0 + V f for forces f, V = K^-1 G^T, linearised gaps are q + M f with M = G V, and f >= 0
        minimises f.M f / 2 + q.f: a problem of non-negative least squares, of which M may be singular. K has
        `PROXIMAL` added to W: at a stationary point that changes no force, and soft modes would drown all
        differences between gaps.
        """
        if not len(candidates):
            return candidates, forces
        problem = RestingProblem(self.band, candidates, self.gap)
        local = problem.local_derivatives(x, np.concatenate((own, forces)))
        assert isinstance(local, RestingDerivatives) and local.touched is not None
        rows = np.array([problem.pull(_only(k, local.touched.jacobian)) for k in range(len(candidates))])
        matrix = kkt_matrix(problem, local.pushed(), problem.rotations(x))
        factor = Factor(matrix, shift=-PROXIMAL)
        n, tail = problem.size, np.zeros(matrix.tail)
        # From the forces as they are: with soft modes M is large, and what is left of a force by rounding too.
        gradient = problem.base.lagrangian_gradient(local.free, own) - forces @ rows
        p = factor.solve(np.concatenate((-gradient, -local.free.constraints, tail)))[:n]
        none = np.zeros(problem.base.rows)
        v = np.array([factor.solve(np.concatenate((row, none, tail)))[:n] for row in rows])
        m = rows @ v.T
        away = problem.gaps(x).value - self.gap + rows @ p - m @ forces
        keep = pushing(m, away) > 0.0
        return candidates.take(keep), forces[keep]

    def _left(self, problem: RestingProblem, result: Result) -> Array | None:
        """A place beside a saddle, along its lowest direction, from which energy falls."""
        self.saddles += 1
        self.changes.append(f"leave saddle {result.negative} {result.energy:.9g}")
        return Stepper(problem, self.options).left(iterate_at(problem, result.x, result.multipliers))

    def _accepted(self, problem: RestingProblem, result: Result) -> Rest | Pairs:
        """The shape, if neither it nor the way to it crosses anything; else contacts to go on with."""
        shape = Shape.of(result.state, self.gap)
        found = audit(shape, DEPTH * self.length)
        motion = Motion(self.shape_before, shape)
        met = motion.passages()
        pairs = problem.pairs
        if found.penetration > DEPTH * self.length:
            known = set(pairs.keys())
            new = [k for k, key in enumerate(met.pairs.keys()) if key not in known]
            new = [k for k in new if self._violated(shape, met.pairs.take(np.array([k])))]
            if not new:
                raise NoRest(f"a crossing of depth {found.penetration:.1e} that no passage explains")
            first = met.when[new[0]]
            chosen = [k for k in new if met.when[k] <= first + 1e-6]
            unique = {met.pairs.keys()[k]: k for k in chosen}
            extra = met.pairs.take(np.array(sorted(unique.values())))
            self.changes += [f"touch {key}" for key in extra.keys()]
            return pairs.joined(extra)
        if len(met):
            depth = motion.depth(met)
            if depth > self.slip * self.length:
                raise NoRest(f"the way passes through itself, {depth:.1e} deep")
        return Rest(problem, result, found, self.steps, tuple(self.changes))

    def _violated(self, shape: Shape, pair: Pairs) -> bool:
        what = arguments(pair)
        value = gaps(vectors(shape, what), what, pair.sign, shape.half_width).value
        return bool(value[0] < -0.1 * DEPTH * self.length)


def _only(k: int, jacobian: Array) -> Array:
    out = np.zeros_like(jacobian)
    out[k] = jacobian[k]
    return out


def pushing(m: Array, away: Array) -> Array:
    """Forces f >= 0 (k,) with m f + away >= 0 where f = 0 and = 0 where f > 0, m (k,k) symmetric; of gaps that
    depend on each other some stay without force."""
    values, axes = np.linalg.eigh(0.5 * (m + m.T))
    clear = values > DEPENDENT * float(values[-1])
    root, axes = np.sqrt(values[clear]), axes[:, clear]
    found: Array = scipy.optimize.nnls(root[:, None] * axes.T, -(axes.T @ away) / root)[0]
    return found


def beside(shape: Shape, contacts: Pairs, gap: float) -> Pairs:
    """Gaps that count around places of contact: of features that face each other there, or nearly do and are
    not crossed.

    The normal of a contact, from its second feature to its first, says on which side the sheets are to stay. A
    vertex that slides over a ruling passes from one facet's gap to the next one's. In a valley both count; over
    a ridge the plane of the facet that it left is no bound, as its gap's sign tells.
    """
    if not len(contacts):
        return contacts
    found: dict[Key, tuple[float, float]] = {}
    what = arguments(contacts)
    six = vectors(shape, what)
    reach = max(1e-3 * shape.length, 2.0 * gap)
    for k in range(len(contacts)):
        c = np.cross(six[k, 4], six[k, 5])
        normal = contacts.sign[k] * c / np.linalg.norm(c)
        around, outward = _neighbours(shape, contacts.take(np.array([k])))
        if not len(around):
            continue
        their = arguments(around)
        theirs = vectors(shape, their)
        cross = np.cross(theirs[:, 4], theirs[:, 5])
        size = np.maximum(np.linalg.norm(cross, axis=1), np.finfo(float).tiny)
        facing = outward * (cross @ normal) / size
        value = gaps(theirs, their, np.sign(facing), shape.half_width).value
        at = places(shape, around)
        off = np.maximum(-at, at - 1.0).max(axis=1)
        counts = (off <= OFF) | ((off <= MARGIN) & (value > -ABOVE * shape.length))
        counts &= (np.abs(facing) > FACING) & (np.abs(value) <= reach)
        keys = around.keys()
        for m in np.flatnonzero(counts):
            found.setdefault(keys[m], (float(np.sign(facing[m])), float(value[m])))
    names = sorted(sorted(found, key=lambda key: (found[key][1], key))[:MOST_CANDIDATES])
    if not names:
        return Pairs.none()
    table = np.array(names, dtype=np.int64)
    return Pairs(table[:, :2], table[:, 2:], np.array([found[name][0] for name in names]))


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
