"""Curves over the number of segments: time and memory of a level and of a step, ours and the peer's.

Each level is a process of its own, which begins with the stored state of the level before: its memory is that
of the level alone, and what one level leaves behind costs the next nothing.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ribbon_cli.model.band import State
from ribbon_cli.study.process import ONE_THREAD

from .level import keep

FIT_FROM = 400
"""Segments from which exponents are fitted."""
PEER_SECONDS = 20.0
"""The peer goes on to the next level while a level takes it less; one that takes it three times as long is
ended."""
SECONDS, GIB, EXPONENT, KIB, KIB_FROM = 75.0, 4.0, 1.1, 36.0, 12800
"""What is required at most: seconds of all levels, memory of any process, exponents of a step's time and of
memory, and memory in KiB a segment on grids of so many."""


@dataclass(frozen=True)
class Level:
    """What a level costs: `seconds` with start and certificate, `step` those of a Newton step, MiB by which
    peak memory `grown` and the `whole` of the process. `failed` is the peer's status where it failed. `modes`
    are the seconds of the lowest modes, on one grid."""

    segments: int
    seconds: float
    step: float
    steps: int
    grown: float
    whole: float
    energy: float
    failed: str = ""
    modes: float | None = None

    @property
    def share(self) -> float:
        """Memory in KiB a segment."""
        return 1024.0 * self.grown / self.segments


@dataclass(frozen=True)
class Scaling:
    """Both curves at one half-width; the peer's ends where it failed or took too long: `peer_end`."""

    half_width: float
    ours: list[Level]
    peer: list[Level]
    peer_end: str

    def exponent(self, name: str) -> float | None:
        """The slope of a quantity of ours in logarithms, from `FIT_FROM` segments on.

        None for less than three levels.
        """
        found = [(level.segments, getattr(level, name)) for level in self.ours if level.segments >= FIT_FROM]
        if len(found) < 3:
            return None
        n, values = np.log(np.array(found)).T
        return float(np.polyfit(n, values, 1)[0])

    def limit(self) -> tuple[float, float]:
        """The energy for N to infinity, by Richardson's extrapolation of the two finest levels, and how far
        that of the two before is from it."""
        energies = [level.energy for level in self.ours[-3:]]
        ends = [(4.0 * fine - coarse) / 3.0 for coarse, fine in pairwise(energies)]
        return ends[-1], abs(ends[-1] - ends[-2])


def scaling(state: State, finest: int, peers_finest: int, say: Callable[[str], None]) -> Scaling:
    """Refine a state level by level up to `finest` segments; by the peer from the same states, if it can."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "{}.npz"
        keep(state, Path(str(path).format(state.band.segments)))
        ours, theirs, end, n = [], [], "", 2 * state.band.segments
        while n <= finest:
            say(f"refinement to N = {n}")
            files = [str(path).format(m) for m in (n // 2, n)]
            ours.append(_level("ours", n, files, None))
            if not end and n <= peers_finest:
                level = _level("peer", n, files, 3.0 * PEER_SECONDS)
                theirs += [] if level is None else [level]
                end = _peers_end(level, n)
            n *= 2
    return Scaling(state.band.half_width, [level for level in ours if level], theirs, end)


def _peers_end(level: Level | None, segments: int) -> str:
    """Why the peer goes no further, if it does not."""
    if level is None:
        return f"at N = {segments} it was ended after {3 * PEER_SECONDS:.0f} s"
    if level.failed:
        return f"at N = {segments} it failed: {level.failed}"
    return f"at N = {segments} it took {level.seconds:.0f} s" if level.seconds > PEER_SECONDS else ""


def _level(who: str, segments: int, files: list[str], most: float | None) -> Level | None:
    """One level in a process of its own; None where that took more than so many seconds."""
    command = [sys.executable, "-m", "bench.level", who, files[0], str(segments), files[1]]
    try:
        answer = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=most, env=os.environ | ONE_THREAD
        )
    except subprocess.TimeoutExpired:
        return None
    facts = json.loads(answer.stdout.splitlines()[-1])
    before = facts.pop("before")
    after = facts.pop("after")
    return Level(segments=segments, grown=after - before, whole=after, **facts)
