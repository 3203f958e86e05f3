"""Single solves by both contestants from the same starts."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from ribbon_cli.model.band import State
from ribbon_cli.solver.prolongation import phase_of, smooth

from . import peer
from .compare import alternate
from .ours import SIGMA, Reached, refined, residuals, solve_options, solved, start_of, verdict


@dataclass(frozen=True)
class Single:
    """One solve from one start by both: median seconds, and for us the first time, with all that is set up.

    Residuals are (KKT, constraints) as `ribbon show` has them.
    """

    segments: int
    repeats: int
    ours: float
    ours_first: float
    steps: int
    ours_residuals: tuple[float, float]
    peer: float
    iterations: int
    peer_residuals: tuple[float, float]
    build: float
    peer_verdict: str

    @property
    def ratio(self) -> float:
        """How many times faster ours is, building left out."""
        return self.peer / self.ours


def single(start: State, repeats: int) -> Single:
    """Solve from `start`, whose band is the target's, without multipliers, several times in turn."""
    band = start.band
    built = peer.build(band.segments, SIGMA)
    given = start_of(start)

    runs = list(
        alternate(
            {"ours": lambda: solved(start), "peer": lambda: built.solve(given, band.half_width)}, repeats
        )
    )
    mine, theirs = ([r for r in runs if r[0] == name] for name in ("ours", "peer"))
    reached, found = mine[-1][2], theirs[-1][2]
    assert isinstance(reached, Reached)
    assert isinstance(found, peer.PeerResult)
    return Single(
        band.segments,
        repeats,
        statistics.median(seconds for _, seconds, _ in mine),
        mine[0][1],
        reached.result.steps,
        (reached.result.kkt_residual, reached.result.constraint_residual),
        statistics.median(seconds for _, seconds, _ in theirs),
        found.iterations,
        residuals(found, band),
        built.build_seconds,
        verdict(found, reached) if found.success else found.status,
    )


def chain(coarse: State, finest: int, say: Callable[[str], None]) -> dict[int, Reached]:
    """The state refined level by level up to `finest` segments, each for the first time in this process."""
    out: dict[int, Reached] = {}
    state = coarse
    while state.band.segments < finest:
        n = 2 * state.band.segments
        say(f"refinement to N = {n}")
        out[n] = refined(state, n, solve_options())
        state = out[n].state
    return out


def prolonged(coarse: State, segments: int) -> State:
    """The start that refinement tries first."""
    return smooth(coarse, segments, phase_of(coarse)).state
