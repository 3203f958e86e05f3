"""A twist by more than half a turn, followed without the guard that stops it: Koldaev (2022), 3.4.1.

The recipe makes half a turn and no more: beyond it the band turns over at the seam, which its guard sees
(`recipes.twist`). Here the same auxiliary problems are solved on to their end, to see what band they lead to;
nothing of this is stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ribbon_cli.model.problem import Problem
from ribbon_cli.model.topology import linking_number, open_turn
from ribbon_cli.recipes.twist import twist_stage
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.status import Status
from ribbon_cli.study.records import multipliers_of, state_of

if TYPE_CHECKING:
    from ribbon_cli.store import StateRecord


@dataclass(frozen=True)
class Overturn:
    """What a twist led to: the last stage solved, Tw + Wr after each, and Lk if the seam closed.

    `stopped` is what the guard says first, and `turned_over` the first stage at which the tangent at the seam
    points backwards.
    """

    last: int
    turns: tuple[float, ...]
    stopped: str | None
    turned_over: int | None
    linking_number: float | None


def follow(record: StateRecord, first: int, half_twists: int, steps: int) -> Overturn:
    """Twist on from a stored stage, solving stages `first` to `steps` of a twist by half_twists * pi.

    Ends early at a stage that leads to no minimum.
    """
    state, multipliers = state_of(record), multipliers_of(record)
    turns: list[float] = []
    stopped = turned_over = None
    for k in range(first, steps + 1):
        stage = twist_stage(half_twists, steps, k)
        problem = Problem(state.band, stage.prescription)
        result = solve(problem, state.vector(), multipliers, Options())
        if result.status is not Status.MINIMUM:
            return Overturn(k - 1, tuple(turns), stopped, turned_over, None)
        state, multipliers = result.state, result.multipliers
        turns.append(open_turn(state.u, state.g, state.band.h))
        refused = stage.guard(state)
        if stopped is None and refused is not None:
            stopped = f"{stage.name}: {refused}"
        if turned_over is None and state.u[0, 0] < 0:
            turned_over = k
    found = linking_number(state.u, state.g, state.band.sigma, state.band.h)
    return Overturn(steps, tuple(turns), stopped, turned_over, found.linking_number)
