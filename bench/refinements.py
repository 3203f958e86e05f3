"""Newton steps by smooth prolongation beside those by splitting facets, Koldaev (2022), section 3.1."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.prolongation import phase_of, split

from .ours import Table, refined, solve_options, surplus_at
from .single import prolonged


@dataclass(frozen=True)
class Way:
    """One way to a finer grid: surplus negative eigenvalues at its start and the most seen, steps, seconds.

    `end` says what it ended on: "minimum", "another minimum", or the status in its word.
    """

    at_start: int
    most: int
    steps: int
    seconds: float
    end: str


@dataclass(frozen=True)
class Refinement:
    """One refinement by both ways; `phases` are the grid phases tried by smooth prolongation, in order."""

    half_width: float
    segments: int
    phases: tuple[str, ...]
    smooth: Way
    split: Way


def refinements(reached: Table, levels: tuple[int, ...], say: Callable[[str], None]) -> list[Refinement]:
    """All refinements of a table, from its own coarse states."""
    out = []
    for half_width, segments in reached:
        if segments == levels[0]:
            continue
        coarse = reached[half_width, segments // 2].state
        say(f"refinement at b = {half_width:g} to N = {segments} by both ways")
        found = refined(coarse, segments, solve_options())
        first = phase_of(coarse).value
        second = found.start.band.segments == segments and phase_of(found.start).value
        phases = (first,) if not found.events else (first, second or "")
        smooth = Way(
            surplus_at(prolonged(coarse, segments)),
            found.result.surplus_seen,
            found.steps,
            found.seconds,
            "minimum",
        )
        out.append(
            Refinement(half_width, segments, phases, smooth, _by_splitting(reached, half_width, segments))
        )
    return out


def _by_splitting(reached: Table, half_width: float, segments: int) -> Way:
    coarse, wanted = reached[half_width, segments // 2].state, reached[half_width, segments].result.energy
    began = time.perf_counter()
    move = to_segments(coarse, segments, solve_options(), splitting=True)
    seconds = time.perf_counter() - began
    end = move.result.status.value
    if move.result.certified and abs(move.result.energy - wanted) > 1e-6 * wanted:
        end = "another minimum"
    return Way(surplus_at(split(coarse).state), move.result.surplus_seen, move.steps, seconds, end)
