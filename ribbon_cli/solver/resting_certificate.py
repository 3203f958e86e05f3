"""The certificate of a strip at rest on itself.

Shapes near it that do not cross fulfil clauses of gaps (`model.touching_pieces`): of those of each clause one
at least is not negative. Where every clause has a single gap these are bounds, and the shape is a minimum
if it is stationary with forces f >= 0 on them and if the Lagrangian's Hessian, with -f.g'' of the forces, is
positive definite on the null space of constraints and of gaps that push: along any move that keeps these gaps
the energy rises to second order, and along one that opens some of them to first order, by their forces.

Where a clause has several gaps, sheets can slip off each other on several sides. Each choice of one gap a
clause is a piece; the pieces cover all shapes nearby that do not cross, and the shape is a minimum if it is
one on every piece, with forces on the gaps of that piece alone.

Gaps may depend on each other. Then forces can be shared out in several ways, and any that are not negative
serve: the conditions are sufficient without independence. Rows that depend on others add nothing to the null
space and are left out of it. Where one of these things cannot be said, the state is undecided, with the
reason.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from ..model.band import Array
from ..model.touching import IntArray, Shape
from ..model.touching_audit import Audit
from ..model.touching_gaps import Pairs
from ..model.touching_pieces import Pieces, at_distance, jumps, pieces
from .inertia import inertia
from .kkt import FactorisationError
from .linear import Factor
from .resting import RestingProblem
from .resting_kkt import RestingDerivatives, kkt_matrix
from .status import Result, Status

PENETRATION = 1e-9
"""Greatest depth, as part of l, of a crossing in a certified state."""
PULLS = 1e-9
"""A force below minus this part of the largest one, or of 1, pulls."""
WEAK = 1e-6
"""A force below this part of the largest one is too weak to count on: its gap may be open as well."""
UNHELD = 1e-9
"""Part of what contacts have to hold that may be left, in the scaled metric."""
STATIONARY_TO = 1e-9
"""Largest component of the Lagrangian's gradient with the forces of a piece."""
CLOSED = 1e-10
"""Gap, as part of l, up to which it can have a force."""
DEPENDENT = 1e-7
"""Part of a row, in the scaled metric, that has to be off the others for it to be independent of them."""
SHARED = 1e-3
"""Part of the largest force that a gap without force is tried with."""
MOST_PIECES = 200
STEEPEST_XI = 12.0
"""Largest |xi| with which counts are trusted: 1 - tanh xi is 4e-11 there."""


def certified(problem: RestingProblem, result: Result, found: Audit) -> Result:
    """The result with what the certificate makes of its status: minimum, saddle, undecided or gap lost."""
    length, forces = problem.band.length, problem.split(result.multipliers)[1]
    if found.lacks(problem.gap) > PENETRATION * length:
        nearer = problem.gap and not found.penetration
        what = "Features are nearer than the gap" if nearer else "Features cross"
        return _as(result, Status.GAP_LOST, f"({what} by {found.lacks(problem.gap):.1e}.)")
    if result.status not in (Status.MINIMUM, Status.SADDLE) or not len(forces):
        return result
    if forces.min() < -PULLS * max(1.0, float(forces.max())):
        return _undecided(result, f"A force pulls: {forces.min():.1e}.")
    steepest = float(np.abs(result.state.xi).max())
    if steepest > STEEPEST_XI:
        return _undecided(result, f"|xi| is {steepest:.1f}: facets are too nearly triangles to count.")
    shape = Shape.of(result.state, problem.gap)
    if problem.gap and jumps(shape, problem.pairs):
        return _undecided(result, "At a contact one kind of distance takes over from another.")
    local = (
        at_distance(shape, problem.pairs, problem.gap)
        if problem.gap
        else pieces(shape, found.near.joined(problem.pairs))
    )
    judge = _Judge(problem, result, local.pairs)
    plain = judge.independent and all(len(clause) == 1 for clause in local.clauses)
    if result.status is Status.SADDLE:
        if not plain or set(local.pairs.names()) != set(problem.pairs.names()):
            return _undecided(result, "With the contacts kept it is a saddle, but some depend on others.")
        return _as(result, Status.SADDLE, f"(At rest on {len(forces)} contacts, which are kept.)")
    why, leaves = _on_all_pieces(judge, local)
    if why:
        return _undecided(result, why)
    detail = f"At rest on {len(forces)} contacts, with forces of {forces.sum():.6g} in all"
    if not judge.independent:
        detail += ", which can be shared out in other ways, since contacts depend on each other"
    if leaves > 1:
        detail += f"; a minimum on each of {leaves} pieces of what does not cross"
    return _as(result, Status.MINIMUM, f"({detail}.)")


def _undecided(result: Result, why: str) -> Result:
    return replace(result, status=Status.UNDECIDED, detail=f"({why})", negative=None)


def _as(result: Result, status: Status, detail: str) -> Result:
    return replace(result, status=status, detail=detail)


def _on_all_pieces(judge: _Judge, local: Pieces) -> tuple[str, int]:
    """Why it is not known to be a minimum on one of the pieces, empty where it is on all; and their number.

    What is a minimum with the gaps of some clauses is one on all pieces that have these gaps. Where it is
    none with them, the next clause to choose of is the one that the way downhill breaks most.
    """
    todo: list[tuple[frozenset[int], list[frozenset[int]]]] = [(frozenset(), list(local.clauses))]
    leaves = 0
    while todo:
        chosen, clauses = todo.pop()
        while single := [clause for clause in clauses if len(clause) == 1]:
            chosen |= frozenset().union(*single)
            clauses = [clause for clause in clauses if not clause & chosen]
        why, open_gaps = judge.doubt(chosen)
        broken = {clause: max(open_gaps[k] for k in clause) for clause in clauses}
        broken = {clause: most for clause, most in broken.items() if most < 0.0}
        if not why:
            leaves += 1
        elif not broken:
            return why, leaves
        elif leaves + len(todo) > MOST_PIECES:
            return f"More than {MOST_PIECES} pieces of what does not cross meet there.", leaves
        else:
            worst = min(broken, key=lambda clause: (broken[clause], sorted(clause)))
            todo += [(chosen | {k}, [c for c in clauses if k not in c]) for k in sorted(worst)]
    return "", leaves


class _Judge:
    """What the gaps of touching features (K,) make of a stationary shape.

    `columns` are their rows off those of the constraints, in the scaled metric, in axes that span them;
    `needed` is in these axes what they have to hold.
    """

    def __init__(self, problem: RestingProblem, result: Result, pairs: Pairs) -> None:
        self.gaps = RestingProblem(problem.band, pairs, problem.gap)
        self.base, self.x = problem.base, result.x
        self.free = self.base.local_derivatives(self.x, None)
        matrix = kkt_matrix(self.base, self.free, np.zeros((self.base.size, 0)))
        self.normal = Factor(matrix.with_unit_metric())
        at = self.gaps.gaps(self.x)
        self.rows = self.gaps.rows_of(at.gradient)
        self.closed = np.abs(at.value - problem.gap) <= CLOSED * problem.band.length
        off = np.array([self._projected(row)[0] for row in self.rows]).reshape(len(pairs), -1).T
        axes, values, _ = np.linalg.svd(off, full_matrices=False)
        axes = axes[:, values > DEPENDENT * values.max(initial=0.0)]
        self.columns, self.needed = axes.T @ off, axes.T @ self._projected(self.free.gradient)[0]

    @property
    def independent(self) -> bool:
        """Whether no row depends on the others."""
        across, along = self.columns.shape
        return int(across) == int(along)

    def doubt(self, chosen: frozenset[int]) -> tuple[str, Array]:
        """Why the shape is not known to be a minimum among those where the chosen gaps are not negative; and
        how fast gaps (K,) open on a way downhill that opens these, all negative where there is none."""
        which = np.array([k for k in sorted(chosen) if self.closed[k]], dtype=np.int64)
        forces, off = _pushing(self.columns[:, which], self.needed)
        if off > UNHELD * np.linalg.norm(self.needed):
            down = self.columns[:, which] @ forces - self.needed
            why = "No forces hold it on a piece of what does not cross: sheets slip off."
            return why, down @ self.columns
        why, unknown = "", np.full(len(self.rows), -1.0)
        for shared in (forces, self._shared(which, forces)):
            multipliers, left = self._balanced(which, shared)
            if left > STATIONARY_TO:
                why = f"Forces on a piece of what does not cross leave {left:.1e} of the gradient."
            elif self._definite(which, shared, multipliers):
                return "", unknown
            else:
                why = "The energy is not known to rise along all moves that keep the contacts that push."
        return why, unknown

    def _projected(self, row: Array) -> tuple[Array, Array]:
        """What of a row (7N,) is off the constraints' rows, in the scaled metric, and its multipliers."""
        n, rows = self.base.size, self.base.rows
        found = self.normal.solve(np.concatenate((row, np.zeros(rows))))
        return found[:n] / self.normal.matrix.scale[:n], found[n : n + rows]

    def _balanced(self, which: IntArray, forces: Array) -> tuple[Array, float]:
        """The constraints' multipliers that go with forces, and the largest component that is left."""
        row = self.free.gradient - forces @ self.rows[which]
        multipliers = np.zeros(self.base.rows)
        left = row
        for _ in range(2):
            multipliers = multipliers + self._projected(left)[1]
            gradient = self.base.lagrangian_gradient(self.free, multipliers)
            left = gradient - forces @ self.rows[which]
        return multipliers, float(np.abs(left).max())

    def _shared(self, which: IntArray, forces: Array) -> Array:
        """The same forces in all, on as many of the gaps as can push."""
        part = SHARED * float(forces.max(initial=0.0))
        every = [forces]
        for k in np.flatnonzero(forces == 0.0):
            own = np.zeros(len(forces))
            own[k] = part
            columns = self.columns[:, which]
            other, off = _pushing(columns, self.needed - part * columns[:, k])
            if off <= UNHELD * np.linalg.norm(self.needed):
                every.append(other + own)
        out: Array = np.mean(every, axis=0)
        return out

    def _definite(self, which: IntArray, forces: Array, multipliers: Array) -> bool:
        """Whether the Hessian is positive definite on the null space of what pushes."""
        strong = np.flatnonzero(forces > WEAK * forces.max(initial=0.0))
        first = strong[self._independent(which[strong])]
        order = np.concatenate((first, np.setdiff1d(np.flatnonzero(forces > 0.0), first)))
        pushing = RestingProblem(self.gaps.band, self.gaps.pairs.take(which[order]), self.gaps.gap)
        local = pushing.local_derivatives(self.x, np.concatenate((multipliers, forces[order])))
        assert isinstance(local, RestingDerivatives)
        matrix = kkt_matrix(pushing, local.keeping(len(first)), pushing.rotations(self.x))
        try:
            if Factor(matrix).proves_minimum():
                return True
            count = inertia(matrix)
        except FactorisationError:
            return False
        return count.trusted and count.negative == 0

    def _independent(self, which: IntArray) -> IntArray:
        """Places in a list of gaps (k,) of some whose rows span those of all, and are independent."""
        columns = self.columns[:, which]
        size = np.linalg.norm(columns, axis=0)
        r, order = scipy.linalg.qr(columns / np.maximum(size, 1e-300), mode="r", pivoting=True)
        clear = np.abs(np.diag(r)) > DEPENDENT
        out: IntArray = np.sort(order[: len(clear)][clear])
        return out


def _pushing(columns: Array, needed: Array) -> tuple[Array, float]:
    """Forces f >= 0 (k,) that hold as much as they can of what is needed, and how much is left."""
    if not columns.shape[1]:
        return np.empty(0), float(np.linalg.norm(needed))
    forces, off = scipy.optimize.nnls(columns, needed)
    return forces, float(off)
