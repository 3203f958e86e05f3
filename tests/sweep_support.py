"""Small sweeps for tests, and the worker processes of one that runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from ribbon_cli.config import load_sweep
from ribbon_cli.store import list_runs
from ribbon_cli.study import solve_config

Hashes = dict[str, list[tuple[str, str, str]]]
"""Stage, kind and content hash of every state, by run."""

RINGS = """\
name: rings
config:
  topology: {half_twists: 0}
  initial_guess: {recipe: cylinder, segments: 12}
  spectrum: {modes: 2, full_up_to: 0}
vary:
  - initial_guess.half_width: {from: 0.1, to: 0.4, steps: 5}
"""
"""Six runs of one state, quickly done."""
BANDS = """\
name: bands
config:
  topology: {half_twists: 1}
  initial_guess: {recipe: twist, segments: 24, half_width: 0.1, steps: 8}
  spectrum: {modes: 2, full_up_to: 0}
vary:
  - widths: [[0.1], [0.11], [0.12]]
"""
"""Three runs of ten states and more, which take a second each."""
MIXED = """\
name: mixed
config:
  initial_guess: {segments: 24}
  spectrum: {modes: 2, full_up_to: 0}
vary:
  - topology.half_twists: [0, 0, 3, 0]
    initial_guess.recipe: [cylinder, cylinder, schoenke, cylinder]
    initial_guess.half_width: [0.1, 0.2, 1.7, 0.3]
"""
"""Four quick runs, the third of which fails."""


@pytest.fixture(scope="module", name="whole")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Hashes]:
    """The states of a sweep by its text, each of its points solved by itself, once."""
    found: dict[str, Hashes] = {}

    def states(text: str) -> Hashes:
        if text not in found:
            folder = tmp_path_factory.mktemp("whole")
            (folder / "sweep.yaml").write_text(text)
            for point in load_sweep(folder / "sweep.yaml").points:
                solve_config(point.written("whole"), folder / "runs")
            found[text] = hashes(folder / "runs")
        return found[text]

    return states


def hashes(root: Path) -> Hashes:
    """Stage, kind and content hash of every state by run, in the order stored; each file is checked."""
    found = {}
    for run in list_runs(root):
        for label in run.entries():
            run.load(label)
        found[run.name] = [(s.stage, s.kind, s.content_sha256) for s in run.states(all=True)]
    return found


def commits(root: Path) -> dict[Path, int]:
    """Every state's file and when it was written: a state that is solved again gets another file."""
    return {path: path.stat().st_mtime_ns for path in root.glob("*/states/*.h5")}


def workers_of(pid: int) -> list[int]:
    """Worker processes of a process, and of its children."""
    found: list[int] = []
    with suppress(OSError):
        # Of each thread, since a process is its thread's child.
        for children in Path(f"/proc/{pid}/task").glob("*/children"):
            for child in map(int, children.read_text().split()):
                words = Path(f"/proc/{child}/cmdline").read_bytes()
                found += ([child] if b"sweeps.worker" in words else []) + workers_of(child)
    return found


def ended(pid: int, seconds: float = 30.0) -> bool:
    """Whether a process that is not ours has ended within so many seconds."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False
