"""How a solve can end, and the places that it comes by. Each status is a word for programs and a sentence for
people."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # listings of runs know the words, and do without NumPy
    from ..model.band import Array, State
    from ..model.problem import LocalDerivatives, Problem


class Status(Enum):
    """Outcomes of a solve; `value` is the word stored, `sentence` what a user reads."""

    MINIMUM = "minimum"
    SADDLE = "saddle"
    STALLED = "stalled"
    ITERATION_LIMIT = "iteration-limit"
    LEFT_TOPOLOGY = "left-topology"
    INVERTED_FACET = "inverted-facet"
    NOT_FINITE = "not-finite"
    UNDECIDED = "undecided"
    LEFT_BRANCH = "left-branch"
    CONSTRUCTED = "constructed"
    OTHER_SHAPE = "other-shape"
    GAP_LOST = "gap-lost"
    NO_REST = "no-rest"

    @property
    def sentence(self) -> str:
        """The status as a sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.MINIMUM: "Converged to a minimum: small residuals, positive definite projected Hessian.",
    Status.SADDLE: "Converged to a saddle: residuals are small, but the energy falls along some direction.",
    Status.STALLED: "Stalled: no step short enough makes progress.",
    Status.ITERATION_LIMIT: "Stopped at the limit of iterations before the residuals were small.",
    Status.LEFT_TOPOLOGY: "The band passed through itself: its linking number changed.",
    Status.INVERTED_FACET: "A facet turned inside out: the shape is no longer a folded strip.",
    Status.NOT_FINITE: "The energy or its derivatives are not finite.",
    Status.UNDECIDED: "Converged, but whether it is a minimum could not be decided.",
    Status.LEFT_BRANCH: "Converged, but not on the branch that the step began on.",
    Status.CONSTRUCTED: "Made by folding, cutting, turning or joining, and not solved for.",
    Status.OTHER_SHAPE: "Converged to a shape of the same linking number that is not the one asked for.",
    Status.GAP_LOST: "The band crosses itself: a gap between its facets was lost.",
    Status.NO_REST: "No shape was found that rests on itself.",
}

STATIONARY = (Status.MINIMUM, Status.SADDLE, Status.UNDECIDED)
"""Statuses of stationary points, certified or not."""


@dataclass(frozen=True)
class SaddleMet:
    """A stationary point of index k that was met and left."""

    x: Array
    multipliers: Array
    energy: float
    index: int
    kkt_residual: float
    constraint_residual: float


@dataclass(frozen=True)
class Result:
    """What a solve returns; nothing is raised for a solve that fails.

    `negative` is the number of negative eigenvalues of the projected Hessian, rotations left out,
    None where it was not determined. `kkt_residual` is the largest component of the Lagrangian's
    gradient over (u, g, xi), `constraint_residual` that of the constraints of (2.19). `surplus_seen` is the
    largest number of negative eigenvalues met on the way.
    """

    status: Status
    x: Array
    multipliers: Array
    state: State
    energy: float
    kkt_residual: float
    constraint_residual: float
    negative: int | None
    steps: int
    saddles: tuple[SaddleMet, ...] = ()
    detail: str = ""
    surplus_seen: int = 0

    @property
    def certified(self) -> bool:
        """True for a minimum whose residuals and inertia were verified."""
        return self.status is Status.MINIMUM

    @property
    def message(self) -> str:
        """The sentence of the status, with details where there are any."""
        return f"{self.status.sentence} {self.detail}".strip()


@dataclass(frozen=True, eq=False)
class Iterate:
    """A place x (7N,) with multipliers (5N+3,), its derivatives, with the Lagrangian's `gradient` (7N,), and
    both residuals as `Result` has them."""

    problem: Problem
    x: Array
    multipliers: Array
    local: LocalDerivatives
    gradient: Array
    kkt_residual: float
    constraint_residual: float

    @property
    def energy(self) -> float:
        """Q_h, not divided by pi b."""
        return self.local.energy

    @property
    def state(self) -> State:
        """The band's shape."""
        return self.problem.state(self.x)

    @property
    def worst(self) -> float:
        """The larger of the two residuals."""
        return max(self.kkt_residual, self.constraint_residual)

    def ended(self, status: Status, negative: int | None, **more: Any) -> Result:
        """The result of a solve that ends here; `more` are fields of `Result`, `steps` among them."""
        return Result(
            status=status,
            x=self.x,
            multipliers=self.multipliers,
            state=self.state,
            energy=self.energy,
            kkt_residual=self.kkt_residual,
            constraint_residual=self.constraint_residual,
            negative=negative,
            **more,
        )

    def met(self, index: int) -> SaddleMet:
        """The saddle of an index that this is."""
        residuals = (self.kkt_residual, self.constraint_residual)
        return SaddleMet(self.x, self.multipliers, self.energy, index, *residuals)
