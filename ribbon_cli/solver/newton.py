"""Constrained saddle-free Newton with local tracking, Koldaev (2022), section 2.3.2.

One loop: derivatives, factorisation, direction, a step no longer than a band can follow, acceptance.
A stationary point that is no minimum is left along its lowest eigenvector. Nothing is raised: the
outcome is a `Result`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..model.band import Array, State
from ..model.problem import LocalDerivatives, Problem
from .inertia import Inertia
from .kkt import FINE, FactorisationError, KKTMatrix
from .linear import RESIDUAL_LIMIT, Factor
from .resting_kkt import kkt_matrix
from .saddle_free import Direction, direction, newton_step
from .status import Iterate, Result, SaddleMet, Status
from .steps import change, followed, inverted_facets, turned

Guard = Callable[[State], str | None]
Way = Callable[[Array, Array], bool]
Watch = Callable[[int, float, float], None]


@dataclass(frozen=True)
class Options:
    """Tolerances and limits of one solve.

    `tolerance` bounds both residuals of a converged point; iterations go on to `goal` while it can be
    reached. `step_limit` bounds the change of tangents, of rulings relative
    to their length and of xi/4 in one step: branches are tracked locally, since longer steps jump to
    other topologies. `leave_saddles` is how many stationary points of positive index may be left.
    From a residual of `near_saddle` saddles are stepped onto, to be known and left on purpose.
    `guard` returns a sentence where a state must not be accepted (it changed its linking number), `way`
    whether a step may be taken from one x to another. Without `judged` nobody asks what a stationary point
    is: one that Newton's next step hardly moves ends a solve as it is, of undecided index, on all but fine
    grids.
    """

    tolerance: float = 1e-9
    goal: float = 1e-11
    max_steps: int = 400
    step_limit: float = 0.25
    leave_saddles: int = 6
    near_saddle: float = 1e-3
    judged: bool = True
    guard: Guard | None = None
    way: Way | None = None
    watch: Watch | None = None


SHORTEST = 2.0**-14
GUARD_FROM = 0.5
GUARD_STRICTLY = 5e-2
"""Change since the guard was last asked from which it is asked again; the end always is.

It is asked rarely first, and strictly in a second attempt where it found something to say."""
ARMIJO = 1e-4  # sufficient decrease, Nocedal & Wright (2006), (3.4)
MOST_CORRECTIONS = 4
SETTLED = 1e-5
"""Change of the next Newton step up to which a converged point is certified; Table 3.1 has at most 2e-8."""
NORMAL_DELTA = 1e-9
"""Regularisation of normal equations on fine grids, which have no small eigenvalues but those of A A^T."""
NEAR_STEP = 0.05
"""Change of the next Newton step up to which a saddle is stepped onto and left on purpose."""


def iterate_at(
    problem: Problem, x: Array, multipliers: Array | None, local: LocalDerivatives | None = None
) -> Iterate:
    """Evaluate a place x (7N,) of unknown derivatives; unknown multipliers (5N+3,) count as zero."""
    local = problem.local_derivatives(x, multipliers) if local is None else local
    if multipliers is None:
        multipliers = np.zeros(problem.rows)
    gradient = problem.lagrangian_gradient(local, multipliers)
    kkt = float(np.abs(gradient).max())
    constraint = float(np.abs(local.constraints / problem.weights).max())
    return Iterate(problem, x, multipliers, local, gradient, kkt, constraint)


def estimate_multipliers(problem: Problem, x: Array) -> Array:
    """Least-squares multipliers (5N+3,) at x: they minimise |grad f - A^T lambda| in the scaled metric.

    Raises FactorisationError if the constraints are linearly dependent at x.
    """
    local = problem.local_derivatives(x, None)
    return _estimate(problem, local, _normal_factor(problem, x, local))


def _normal_factor(problem: Problem, x: Array, local: LocalDerivatives) -> Factor:
    """Factors of (I, A^T; A, 0) in the scaled metric: identity on scaled unknowns, diag(1/s^2) on x.

    On fine grids rotations are held as well, which changes no solution, as no constraint knows of them: the
    matrix then has the pattern of Newton's, and shares its symbolic factorisation.
    """
    if problem.band.segments > FINE:
        matrix = kkt_matrix(problem, local, problem.rotations(x)).with_unit_metric()
        return Factor(matrix, regularisation=NORMAL_DELTA)
    matrix = kkt_matrix(problem, local, np.zeros((problem.size, 0))).with_unit_metric()
    return Factor(matrix, definite=True)


def _estimate(problem: Problem, local: LocalDerivatives, normal: Factor) -> Array:
    """Least-squares multipliers (5N+3,) by the normal factors."""
    n, rows = problem.size, problem.rows
    rhs = np.concatenate((-local.gradient, np.zeros(rows + normal.matrix.tail)))
    return -normal.solve(rhs)[n : n + rows]


def _newton_step(point: Iterate, factor: Factor, limit: float = RESIDUAL_LIMIT) -> tuple[Array, Array]:
    """Newton's step (7N,) from a point, and its multipliers."""
    return newton_step(point.problem, point.local, point.multipliers, factor, limit, point.gradient)


def _doubt(count: Inertia) -> str:
    """Why a count is not trusted."""
    return f"(Roundoff may change the count: measured {count.roundoff:.1e}, pivot gap {count.gap:.1e}.)"


class _Search:
    """Step acceptance by the exact penalty f + sum nu_k |c_k| with second-order correction."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.penalty = np.zeros(problem.rows)
        self._normal: tuple[Array, Factor] | None = None
        self.exact: Factor | None = None  # exact ones, which are kept on fine grids

    def merit(self, energy: float, constraints: Array) -> float:
        return energy + float(self.penalty @ np.abs(constraints))

    def raise_penalty(self, multipliers: Array) -> None:
        """Keep nu_k above the multipliers, which makes the penalty exact (Nocedal & Wright, 18.3)."""
        size = np.abs(multipliers)
        self.penalty = np.where(
            self.penalty < 1.1 * size, 1.5 * size, np.maximum(self.penalty * 0.9, 1.1 * size)
        )

    def keep(self, x: Array, normal: Factor) -> None:
        """Keep the normal factors of the point x."""
        self._normal = (x, normal)

    def leave(self, x: Array) -> None:
        """Let the normal factors of other points than x go where they take much memory."""
        if self.problem.band.segments > FINE and self._normal is not None and self._normal[0] is not x:
            self._normal = None

    def _normal_at(self, point: Iterate) -> Factor:
        """The normal factors of a point."""
        if self._normal is not None and self._normal[0] is point.x:
            return self._normal[1]
        self.exact = None
        normal = _normal_factor(self.problem, point.x, point.local)
        self.keep(point.x, normal)
        return normal

    def correct(self, point: Iterate, constraints: Array) -> Array:
        """Second-order correction: the least move that removes weighted constraint values near a point.

        It is least in the scaled metric, not in that of the Hessian: near-zero eigenvalues (sliding) would
        turn it into a long tangential step.
        """
        size, normal = self.problem.size, self._normal_at(point)
        rhs = np.concatenate((np.zeros(size), -constraints, np.zeros(normal.matrix.tail)))
        return normal.solve(rhs)[:size]


def solve(
    problem: Problem, x: Array, multipliers: Array | None = None, options: Options | None = None
) -> Result:
    """Find a minimum of (2.19) near x (7N,), tracking locally.

    Multipliers (5N+3,), those of (1.58), are estimated by least squares if absent.
    """
    options, x = options or Options(), problem.impose(x)
    result = _Solve(problem, options, GUARD_FROM).run(x, multipliers)
    if result.status is Status.LEFT_TOPOLOGY:
        result = _Solve(problem, options, GUARD_STRICTLY).run(x, multipliers)
    return result


class _Solve:
    def __init__(self, problem: Problem, options: Options, guard_from: float) -> None:
        self.problem = problem
        self.options = options
        self.guard_from = guard_from
        self.fine = problem.band.segments > FINE
        self.search = _Search(problem)
        self.steps = 0
        self.saddles: list[SaddleMet] = []
        self.surplus_seen = 0
        self.trouble = (Status.STALLED, "")
        self.unguarded = 0.0
        self.lowest = 0.0
        self.left = np.inf
        self.last: Iterate
        self._size: Callable[[Array, Array], float] = turned if problem.xi_follows else change
        self._moved: Callable[[Array, Array], Array] = followed if problem.xi_follows else np.add

    def run(self, x: Array, multipliers: Array | None) -> Result:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return self._run(x, multipliers)

    def _run(self, x: Array, multipliers: Array | None) -> Result:
        self.last = iterate_at(self.problem, x, multipliers)
        if not np.isfinite(self.last.worst):
            return self._result(Status.NOT_FINITE, self.last)
        if (inverted_facets(self.problem, x) <= 0).any():
            return self._result(Status.INVERTED_FACET, self.last, detail="It was so at the start.")
        try:
            if multipliers is None:
                self.last = self._estimated(self.last)
            return self._iterate(self.last)
        except FactorisationError as error:
            return self._result(Status.STALLED, self.last, detail=f"({error}.)")

    def _estimated(self, start: Iterate) -> Iterate:
        """The start with multipliers by least squares, whose normal factors are kept."""
        problem, x, local = self.problem, start.x, start.local
        normal = _normal_factor(problem, x, local)
        if not self.fine:
            self.search.keep(x, normal)
        multipliers = _estimate(problem, local, normal)
        return iterate_at(problem, x, multipliers, problem.with_multipliers(x, local, multipliers))

    def _iterate(self, point: Iterate) -> Result:
        options = self.options
        while True:
            self.last = point
            matrix = kkt_matrix(self.problem, point.local, self.problem.rotations(point.x))
            if options.watch is not None:
                options.watch(self.steps, point.energy, point.worst)
            following: Iterate | None = None
            # On fine grids the goal may be out of reach, and the last steps are those of the judgement.
            going = point.worst > (options.tolerance if self.fine else options.goal)
            if going and self.steps < options.max_steps:
                following = self._step(point, matrix)
                if following is not None and following.worst > 0.5 * point.worst <= 0.5 * options.tolerance:
                    following = None  # converged, and as far as roundoff lets it
            if following is None:
                if point.worst > options.tolerance:
                    return self._stopped(point)
                verdict, following = self._judge(point, matrix)
                if verdict is not None:
                    return verdict
            self.steps += 1
            if following is None:
                return self._stopped(point)
            point = following
            del matrix  # before the next one is made

    def _step(self, point: Iterate, matrix: KKTMatrix) -> Iterate | None:
        """One accepted step towards a stationary point, or None."""
        factor = self._regular(matrix)
        # An inexact Newton step, as accurate as quadratic convergence or the goal needs it.
        limit = max(RESIDUAL_LIMIT, 1e-3 * min(point.worst, 1.0), 0.1 * self.options.goal / point.worst)
        plain = _newton_step(point, factor, limit)
        following = self._meet_saddle(point, factor, plain)
        if following is None:
            if self.fine and factor.surplus:
                del factor
                factor = self._exact(matrix)  # regularised pivots count too many here, and know no sliding
            found = direction(
                self.problem, point.local, point.multipliers, factor, plain=plain, lowest=self.lowest
            )
            del factor
            self.lowest = float(found.negative[0]) if found.index else 0.0
            self.surplus_seen = max(self.surplus_seen, found.index)
            following = self._advance(point, found)
        return following

    def _regular(self, matrix: KKTMatrix) -> Factor:
        """Factors for a step; on fine grids no others are alive beside them."""
        self.search.exact = None
        return Factor(matrix)

    def _exact(self, matrix: KKTMatrix) -> Factor:
        """Exact factors of a fine grid: those of a point before serve again, or there are new ones."""
        if self.search.exact is None:
            matrix.pattern.forget()  # which take as much memory
            self.search.exact = Factor(matrix, exact=True)
        return self.search.exact.serving(matrix)

    def _halved(self, point: Iterate, plain: tuple[Array, Array]) -> Iterate | None:
        """The next iterate of a converged point, if it has less than half the residuals: near roundoff no
        more is gained, and on fine grids a search for it takes long."""
        trial = iterate_at(self.problem, point.x + plain[0], plain[1])
        return trial if trial.worst < 0.5 * point.worst and self._allowed(point, trial) else None

    def _judge(self, point: Iterate, matrix: KKTMatrix) -> tuple[Result | None, Iterate | None]:
        """What a stationary point is: a result, or the point to go on from if it is a saddle to leave."""
        complaint = self._complaint(point)
        if complaint:
            return self._result(Status.LEFT_TOPOLOGY, point, detail=complaint), None
        if self.fine:
            return self._judge_fine(point, matrix)
        factor = Factor(matrix, accelerated=True)
        following = self._settled(point, factor)
        if following is not None and not self.options.judged:
            return self._result(Status.UNDECIDED, point), None
        # What a settled point counts is to be true where Newton's next step leads as well, and with the
        # roundoff of the derivatives there.
        like = matrix if following is None else self._matrix_at(*following)
        negative = factor.proves_index(like)
        if negative is None:
            count = factor.counted(like)
            if not count.trusted:
                return self._result(Status.UNDECIDED, point, detail=_doubt(count)), None
            negative = count.negative
        leaves = negative > 0 and len(self.saddles) < self.options.leave_saddles
        if following is not None and not leaves:
            return self._counted(point, negative), None
        factor = Factor(matrix)  # anew: the proof may have left one with another regularisation
        if leaves:
            return None, self._left_saddle(point, factor, negative)
        step = _newton_step(point, factor)
        return self._unsettled(point, *step)

    def _judge_fine(self, point: Iterate, matrix: KKTMatrix) -> tuple[Result | None, Iterate | None]:
        """The same on fine grids, by the block reduction alone.

        There roundoff of the residuals may keep Newton's steps above what is asked for elsewhere. Where they
        fall no more, the point is as near to the stationary one as it can be, and the count decides, measured
        a step on.
        """
        try:
            factor = self._exact(matrix)
            step, multipliers = _newton_step(point, factor)
        except FactorisationError as error:
            return self._result(Status.UNDECIDED, point, detail=f"({error}.)"), None
        left = change(point.x, step)
        if left > NEAR_STEP or SETTLED < left < 0.5 * self.left:
            return self._unsettled(point, step, multipliers)
        if point.worst > self.options.goal and self.steps < self.options.max_steps:
            following = self._halved(point, (step, multipliers))
            if following is not None:
                return None, following
        like = self._matrix_at(point.x + step, multipliers)
        count = factor.counted(like)
        if factor.stale and not count.trusted:
            count = factor.anew().counted(like)
        if not count.trusted:
            return self._result(Status.UNDECIDED, point, detail=_doubt(count)), None
        if count.negative and len(self.saddles) < self.options.leave_saddles:
            return None, self._left_saddle(point, factor, count.negative)
        return self._counted(point, count.negative), None

    def _counted(self, point: Iterate, negative: int) -> Result:
        """The result with an index."""
        self.surplus_seen = max(self.surplus_seen, negative)
        return self._result(Status.SADDLE if negative else Status.MINIMUM, point, negative=negative)

    def _left_saddle(self, point: Iterate, factor: Factor, negative: int) -> Iterate | None:
        """The point to go on from beside a saddle, which is kept."""
        self.surplus_seen = max(self.surplus_seen, negative)
        found = direction(self.problem, point.local, point.multipliers, factor, negative)
        self.saddles.append(point.met(found.index))
        return self._leave(point, found)

    def _settled(self, point: Iterate, factor: Factor) -> tuple[Array, Array] | None:
        """Where the next Newton step leads, if that is as near as a certificate asks for."""
        try:
            step, multipliers = _newton_step(point, factor)
        except FactorisationError:
            return None
        return (point.x + step, multipliers) if change(point.x, step) <= SETTLED else None

    def _unsettled(
        self, point: Iterate, step: Array, multipliers: Array
    ) -> tuple[Result | None, Iterate | None]:
        """The point to go on from where the stationary point is not as near as the residuals promise.

        Where an eigenvalue is nearly zero, as that of sliding is on fine grids, a small residual allows of a
        long way to the stationary point, and the index here need not be the one there. So the way is gone, as
        long as each Newton step is less than half the one before, and what is there is judged anew.
        """
        left = change(point.x, step)
        contracts, self.left = left < 0.5 * self.left, left
        if contracts and left <= NEAR_STEP and self.steps < self.options.max_steps:
            following = iterate_at(self.problem, point.x + step, multipliers)
            if following.worst <= self.options.tolerance and self._allowed(point, following):
                return None, following
        detail = f"(The next Newton step would be a change of {left:.1e}.)"
        return self._result(Status.UNDECIDED, point, detail=detail), None

    def _matrix_at(self, x: Array, multipliers: Array) -> KKTMatrix:
        """The KKT matrix at a place."""
        local = self.problem.local_derivatives(x, multipliers)
        return kkt_matrix(self.problem, local, self.problem.rotations(x))

    def _meet_saddle(self, point: Iterate, factor: Factor, plain: tuple[Array, Array]) -> Iterate | None:
        """Close to a saddle, take the plain Newton step onto it, so that it is known and left on purpose.

        The saddle-free step moves away only as fast as the distance doubles. None if not that close.
        """
        step, multipliers = plain
        if point.worst > self.options.near_saddle or factor.surplus == 0:
            return None
        # On fine grids looking for eigenpairs takes as long as many steps: any step that leads on is taken.
        if change(point.x, step) > (self.options.step_limit if self.fine else NEAR_STEP):
            return None
        trial = iterate_at(self.problem, point.x + step, multipliers)
        if not trial.worst < (0.5 if self.fine else 0.1) * point.worst:
            return None
        return trial if self._allowed(point, trial) else None

    def _advance(self, point: Iterate, found: Direction) -> Iterate | None:
        """One accepted step, or None."""
        self.trouble = (Status.STALLED, "")
        self.search.leave(point.x)
        self.search.raise_penalty(found.multipliers)
        size = self._size(point.x, found.step)
        if not np.isfinite(size):
            self.trouble = (Status.NOT_FINITE, "")
            return None
        t = min(1.0, self.options.step_limit / max(size, 1e-300))
        shortest = SHORTEST * t  # near a singular Hessian the limit alone may leave little of a long step
        while t >= shortest:
            trial = self._trial(point, found, t)
            if trial is not None:
                return trial
            t *= 0.5
        return None

    def _trial(self, point: Iterate, found: Direction, t: float) -> Iterate | None:
        """The point at step t, drawn back to the constraints as often as it helps; None if not accepted.

        Valleys of sliding are curved: without several second-order corrections what remains of the
        constraints, times large multipliers, hides a fall of energy and only crawling steps pass.
        """
        x = self._moved(point.x, t * found.step)
        if self.options.way is not None and not self.options.way(point.x, x):
            return None
        multipliers = point.multipliers + t * (found.multipliers - point.multipliers)
        violation, trial = np.inf, None
        for _ in range(MOST_CORRECTIONS + 1):
            if trial is not None:
                extra = self.search.correct(point, trial.local.constraints)
                if not self._size(x, extra) <= self.options.step_limit:
                    return None
                x = self._moved(x, extra)
            trial = iterate_at(self.problem, x, multipliers)
            if not np.isfinite(trial.worst):
                if self.trouble[0] is Status.STALLED:
                    self.trouble = (Status.NOT_FINITE, "")
                return None
            if self._decreases(point, trial, found, t):
                return trial if self._allowed(point, trial) else None
            before, violation = violation, self.search.merit(0.0, trial.local.constraints)
            if violation > 0.25 * before:
                return None
        return None

    def _decreases(self, point: Iterate, trial: Iterate, found: Direction, t: float) -> bool:
        """Sufficient decrease of the merit; near a minimum, of the residual instead.

        Close to a solution the merit's differences drown in roundoff, and where the Hessian is positive
        definite Newton's own measure, the KKT residual, is the sharper one.
        """
        if found.index == 0 and t == 1.0 and trial.worst < 0.5 * point.worst:
            return True
        before = self.search.merit(point.energy, point.local.constraints)
        after = self.search.merit(trial.energy, trial.local.constraints)
        slope = float(point.local.gradient @ found.step) - float(
            self.search.penalty @ np.abs(point.local.constraints)
        )
        noise = 1e-14 * abs(before)
        return after <= before + ARMIJO * t * min(slope, 0.0) + noise

    def _allowed(self, point: Iterate, trial: Iterate) -> bool:
        """The traps: no facet turns over, the band does not pass through itself."""
        if (inverted_facets(self.problem, trial.x) <= 0).any():
            if self.trouble[0] is not Status.LEFT_TOPOLOGY:
                self.trouble = (Status.INVERTED_FACET, "")
            return False
        if self.options.way is not None and not self.options.way(point.x, trial.x):
            return False
        # Short steps go unchecked until together they are long enough to carry the band through itself.
        moved = self.unguarded + change(point.x, trial.x - point.x)
        if moved > self.guard_from or self.trouble[0] is Status.LEFT_TOPOLOGY:
            complaint = self._complaint(trial)
            if complaint:
                self.trouble = (Status.LEFT_TOPOLOGY, complaint)
                return False
            moved = 0.0
        self.unguarded = moved
        return True

    def _complaint(self, point: Iterate) -> str | None:
        """What the guard says of a point."""
        guard = self.options.guard
        return None if guard is None else guard(point.state)

    def _leave(self, point: Iterate, found: Direction) -> Iterate | None:
        """Leave a saddle along its lowest eigenvector, to the side and by the length of least energy."""
        v = found.vectors[:, 0]
        v = v * np.sign(v[np.argmax(np.abs(v))])
        size = change(point.x, v)
        best: Iterate | None = None
        for t in (0.4, 0.1, 0.02, 0.004):
            for side in (1.0, -1.0):
                x = point.x + (side * t * self.options.step_limit / size) * v
                for _ in range(4):
                    x = x + self.search.correct(point, self.problem.weighted_constraints(x))
                trial = iterate_at(self.problem, x, point.multipliers)
                if not np.isfinite(trial.worst) or not self._allowed(point, trial):
                    continue
                if trial.energy < (best or point).energy:
                    best = trial
            if best is not None:
                break
        return best

    def _stopped(self, point: Iterate) -> Result:
        if self.steps >= self.options.max_steps:
            return self._result(Status.ITERATION_LIMIT, point)
        status, detail = self.trouble
        return self._result(status, point, detail=detail)

    def _result(
        self, status: Status, point: Iterate, *, negative: int | None = None, detail: str = ""
    ) -> Result:
        return point.ended(
            status,
            negative,
            steps=self.steps,
            saddles=tuple(self.saddles),
            detail=detail,
            surplus_seen=self.surplus_seen,
        )


class Stepper:
    """Single steps of the method, for who changes the problem between them."""

    def __init__(self, problem: Problem, options: Options) -> None:
        self._solve = _Solve(problem, options, GUARD_FROM)

    def step(self, point: Iterate) -> Iterate | None:
        """One accepted step towards a stationary point, or None."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                return self._solve._step(point, self._matrix(point))
            except FactorisationError:
                return None

    def left(self, saddle: Iterate) -> Array | None:
        """A place (7N,) beside a saddle along its lowest eigenvector, of less energy, or None."""
        problem = self._solve.problem
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                factor = Factor(self._matrix(saddle))
                found = direction(problem, saddle.local, saddle.multipliers, factor)
                beside = self._solve._leave(saddle, found) if found.index else None
            except FactorisationError:
                return None
        return None if beside is None else beside.x

    def _matrix(self, point: Iterate) -> KKTMatrix:
        problem = self._solve.problem
        return kkt_matrix(problem, point.local, problem.rotations(point.x))
