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

from dataclasses import dataclass, replace

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
PROVED = 1e-5
"""Eigenvalue above which the Hessian is shown to be on one piece, so that others need no count."""
OPENS = 1e-9
"""Part of the fastest opening on a way downhill above which a gap opens."""
FAR, NO_MOVE = 1e-8, 1e-12
MOST_PIECES = 5000


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
    rests = f"At rest on {len(forces)} contact{'s' * (len(forces) > 1)}"
    if result.status is Status.SADDLE:
        if not plain or set(local.pairs.names()) != set(problem.pairs.names()):
            return _undecided(result, "With the contacts kept it is a saddle, but some depend on others.")
        return _as(result, Status.SADDLE, f"({rests}, which are kept.)")
    why, leaves = _on_all_pieces(judge, local)
    if why:
        return _undecided(result, why)
    detail = f"{rests}, with forces of {forces.sum():.6g} in all"
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
    none with them, the next clause to choose of is the one that the way downhill breaks most, or does not
    keep with a gap that opens.
    """
    todo: list[tuple[frozenset[int], list[frozenset[int]]]] = [(frozenset(), list(local.clauses))]
    leaves = 0
    while todo:
        chosen, clauses = _settled(*todo.pop(), local.void)
        if frozenset() in clauses:
            continue  # no shape has all these gaps positive
        why, opening = judge.doubt(chosen)
        broken = {clause: max(opening[k] for k in clause) for clause in clauses}
        level = OPENS * float(np.abs(opening).max(initial=0.0))
        broken = {clause: most for clause, most in broken.items() if most <= level}
        if not why:
            leaves += 1
        elif not broken:
            return why, leaves
        elif leaves + len(todo) > MOST_PIECES:
            return f"More than {MOST_PIECES} pieces of what does not cross meet there.", leaves
        else:
            worst = min(broken, key=lambda clause: (broken[clause], sorted(clause)))
            todo += [(chosen | {k}, clauses) for k in sorted(worst)]
    return "", leaves


def _settled(
    chosen: frozenset[int], clauses: list[frozenset[int]], void: tuple[frozenset[int], ...]
) -> tuple[frozenset[int], list[frozenset[int]]]:
    """The gaps chosen with those that are the only ones left in a clause, and the clauses that are left: an
    empty one where the gaps chosen are nowhere all positive."""
    while True:
        left = [some - chosen for some in void]
        if frozenset() in left:
            return chosen, [frozenset()]
        against = frozenset().union(*(some for some in left if len(some) == 1))
        clauses = [clause - against for clause in clauses if not clause & chosen]
        single = frozenset().union(*(clause for clause in clauses if len(clause) == 1))
        if not single or frozenset() in clauses:
            return chosen, clauses
        chosen = chosen | single


@dataclass(frozen=True)
class _Proved:
    """A piece with a positive definite Hessian, whose rows span those of all gaps: its forces (K,), and what
    they leave of the gradient; what the force of each gap (K,) adds to that, and to the Hessian on the null
    space, while others keep the balance: near the contacts (K,r,r), and at most elsewhere (K,)."""

    forces: Array
    left: float
    off: Array
    forms: Array
    elsewhere: Array


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
        self.axes = axes = axes[:, values > DEPENDENT * values.max(initial=0.0)]
        self.columns, self.needed = axes.T @ off, axes.T @ self._projected(self.free.gradient)[0]
        self.scale = matrix.scale[: self.base.size]
        self.jacobian = self.base.jacobian_matrix(self.free)
        self.proved: _Proved | None = None

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
        if self._like_one_proved(which, forces, off):
            return "", unknown
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
            spans = self.proved is None and len(first) == len(self.axes.T) < len(self.rows)
            if spans and Factor(matrix, shift=PROVED).proves_minimum():
                every = self._every(which, forces)
                left = self.base.lagrangian_gradient(self.free, multipliers) - forces @ self.rows[which]
                self.proved = self._proof(every, float(np.abs(left).max()), which[first])
                return True
            if Factor(matrix).proves_minimum():
                return True
            count = inertia(matrix)
        except FactorisationError:
            return False
        return count.trusted and count.negative == 0

    def _like_one_proved(self, which: IntArray, forces: Array, off: float) -> bool:
        """Whether the shape is stationary with these forces as it is on a piece where the Hessian is known to
        be above `PROVED`, with rows that span the same, and the Hessian changes by less."""
        known = self.proved
        strong = np.flatnonzero(forces > WEAK * forces.max(initial=0.0))
        if known is None or len(self._independent(which[strong])) < len(self.axes.T):
            return False
        more, smallest = self._every(which, forces) - known.forces, float(self.scale.min())
        if known.left + np.abs(more) @ known.off + off / smallest > STATIONARY_TO:
            return False
        near = float(np.linalg.norm(np.tensordot(more, known.forms, axes=1))) / smallest**2
        most = near + float(np.abs(more) @ known.elsewhere)
        return most <= 0.5 * PROVED

    def _proof(self, forces: Array, left: float, first: IntArray) -> _Proved:
        """What is known from a piece: how the Hessian changes on the null space with the force of each gap,
        while forces of the gaps `first`, which span all, and multipliers keep the balance."""
        share = np.linalg.solve(self.columns[:, first], self.columns)
        every = np.eye(len(self.rows))
        every[:, first] -= share.T
        changes, off = [], []
        none = self._hessian(np.zeros(self.base.rows), np.zeros(len(self.rows)))
        for own in every:
            row = own @ self.rows
            multipliers = self._projected(row)[1]
            off.append(np.abs(row - self.jacobian.T @ multipliers).max())
            changes.append(self._hessian(-multipliers, own) - none)
        size = np.array([abs(change).sum(axis=1).A1 for change in changes])
        at = np.flatnonzero(size.max(axis=0) > FAR * size.max())
        size[:, at] = 0.0
        moves = np.array([self._projected(row)[0] for row in np.eye(self.base.size)[at]])
        moves = moves - (moves @ self.axes) @ self.axes.T
        u, values, _ = np.linalg.svd(moves, full_matrices=False)
        root = (u * values)[:, values > NO_MOVE * values.max(initial=0.0)]
        forms = [root.T @ change[np.ix_(at, at)].toarray() @ root for change in changes]
        return _Proved(forces, left, np.array(off), np.array(forms), size.max(axis=1))

    def _hessian(self, multipliers: Array, forces: Array) -> scipy.sparse.csc_matrix:
        """The Lagrangian's Hessian for multipliers and forces (K,) of all gaps."""
        local = self.gaps.local_derivatives(self.x, np.concatenate((multipliers, forces)))
        return self.gaps.hessian_matrix(local).tocsc()

    def _every(self, which: IntArray, forces: Array) -> Array:
        """Forces (K,) of all gaps."""
        out = np.zeros(len(self.rows))
        out[which] = forces
        return out

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
