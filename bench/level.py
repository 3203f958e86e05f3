"""A process that takes one state to one finer grid, and prints what that costs in time and memory.

`python -m bench.level ours|peer COARSE.npz N FINE.npz`: by us with the certificate, or by the peer from the
same prolongation.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.newton import Options
from ribbon_cli.solver.prolongation import phase_of, smooth
from ribbon_cli.solver.spectra import lowest_spectrum
from ribbon_cli.solver.status import Result
from ribbon_cli.study.memory import hold_memory

Facts = dict[str, float | str]

REPEATS = {800: 5, 3200: 3}
"""How often a level is repeated up to so many segments; it is done once on finer grids."""
MODES, MODES_AT = 12, 3200
"""How many of the lowest modes are looked for, and on which grid."""


def peak() -> float:
    """Peak resident memory of this program so far, in MiB.

    From Linux's own count for the program, since that of `resource` starts from what the parent had.
    Raises RuntimeError where there is no such count.
    """
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError("/proc/self/status has no VmHWM: peak memory cannot be measured here")


def kept(path: Path) -> State:
    """The state in a file of `keep`."""
    with np.load(path) as z:
        band = Band(len(z["u"]), float(z["half_width"]), sigma=int(z["sigma"]))
        return State(band, z["u"], z["g"], z["xi"])


def keep(state: State, path: Path) -> None:
    """Keep a state of a closed band in a file."""
    band = state.band
    np.savez(path, u=state.u, g=state.g, xi=state.xi, half_width=band.half_width, sigma=band.sigma)


def ours(coarse: State, segments: int, fine: Path) -> Facts:
    """Refine with certificate, and keep the state found; memory is that of the first time."""
    from .ours import certified, solve_options

    to_segments(cylinder(Band(12, 0.3)), 24, Options())  # everything is loaded
    before, after = peak(), 0.0
    steps: list[float] = []
    seconds: list[float] = []
    for repeat in range(_repeats(segments)):
        times: list[float] = []
        options = replace(solve_options(), watch=_watch(times))
        began = time.perf_counter()
        move = to_segments(coarse, segments, options)
        result = certified(move.result, Problem(move.band))
        seconds.append(time.perf_counter() - began)
        steps += [later - earlier for earlier, later in pairwise(times)]
        if repeat == 0:
            after = peak()
    keep(result.state, fine)
    modes = {"modes": _modes(result)} if segments == MODES_AT else {}
    return {
        "before": before,
        "after": after,
        "seconds": statistics.median(seconds),
        "step": statistics.median(steps),
        "steps": move.steps,
        "energy": result.energy,
        **modes,
    }


def _modes(result: Result) -> float:
    """Median seconds of a state's lowest modes in one metric, with the count that none is missing."""
    seconds = []
    for _ in range(REPEATS[MODES_AT]):
        problem = Problem(result.state.band)
        began = time.perf_counter()
        local = problem.local_derivatives(result.x, result.multipliers)
        lowest_spectrum(problem, result.x, local, "physical", MODES)
        seconds.append(time.perf_counter() - began)
    return statistics.median(seconds)


def _watch(times: list[float]) -> Callable[[int, float, float], None]:
    def watch(*_: float) -> None:
        times.append(time.perf_counter())

    return watch


def _repeats(segments: int) -> int:
    return next((times for most, times in REPEATS.items() if segments <= most), 1)


def peers(coarse: State, segments: int) -> Facts:
    """Solve by the peer from our prolongation; its building is left out of seconds, not of memory."""
    from . import peer

    band = coarse.band
    start = smooth(coarse, segments, phase_of(coarse)).state
    peer.build(12, band.sigma)
    before = peak()
    found = peer.build(segments, band.sigma).solve(peer.Start(start.u, start.g, start.xi), band.half_width)
    return {
        "before": before,
        "after": peak(),
        "seconds": found.seconds,
        "step": found.seconds / max(found.iterations, 1),
        "steps": found.iterations,
        "energy": found.energy,
    } | ({} if found.success else {"failed": found.status})


def main(who: str, coarse: str, segments: str, fine: str) -> None:
    """Do it and print the facts as JSON; memory is held as commands hold it, for both."""
    hold_memory()
    state, n = kept(Path(coarse)), int(segments)
    facts = ours(state, n, Path(fine)) if who == "ours" else peers(state, n)
    sys.stdout.write(json.dumps(facts) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
