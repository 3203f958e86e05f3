"""Start-up, and a run of 5000 states, by both builds in turn: their seconds, and the ratios of these."""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from .builds import Build

STATES = 5000
# Each build's own maker: what it stores is what it reads.
_MAKE = """\
import pathlib, sys
from bench.store import make_run
make_run(pathlib.Path(sys.argv[1]), int(sys.argv[2]))
"""
_COMMANDS = {
    "`ribbon ls`": ("ls",),
    "`ribbon ls RUN`, every file's hash compared": ("ls", "big"),
    "`ribbon solve` of the finished run": ("solve", "big.yaml", "-q"),
}


@dataclass(frozen=True)
class Pace:
    """The least that a command took in both builds, as load only adds: seconds, and seconds of processor."""

    what: str
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Seconds of processor now to those before: what others do on the machine matters least to it."""
        return self.after[1] / self.before[1]


def start_up(builds: tuple[Build, Build], repeats: int) -> Pace:
    """The start of the program, shown by its help."""
    with tempfile.TemporaryDirectory() as name:
        return _pace("`ribbon --help`", builds, (Path(name), Path(name)), ("--help",), repeats)


def store(builds: tuple[Build, Build], states: int = STATES, repeats: int = 7) -> list[Pace]:
    """Listing and resuming a finished run. Raises CalledProcessError where a build cannot."""
    with _runs(builds, states) as folders:
        return [
            _pace(f"{what}, {states} states", builds, folders, words, repeats)
            for what, words in _COMMANDS.items()
        ]


@contextmanager
def _runs(builds: tuple[Build, Build], states: int) -> Iterator[tuple[Path, Path]]:
    """A folder with such a run for each build."""
    folder = Path(tempfile.mkdtemp())
    try:
        before, after = folder / "before", folder / "after"
        for build, place in zip(builds, (before, after), strict=True):
            place.mkdir()
            subprocess.run(
                [sys.executable, "-P", "-c", _MAKE, str(place), str(states)],
                env=build.environment(),
                capture_output=True,
                check=True,
            )
        yield before, after
    finally:
        shutil.rmtree(folder)


def _pace(
    what: str, builds: tuple[Build, Build], folders: tuple[Path, Path], words: tuple[str, ...], repeats: int
) -> Pace:
    """Both builds in turn, so many times; once before, so that files are in the system's cache."""
    taken: tuple[list[tuple[float, float]], ...] = ([], [])
    for k in range(repeats + 1):
        for side in (0, 1) if k % 2 else (1, 0):
            seconds = _seconds(builds[side], folders[side], words)
            if k:
                taken[side].append(seconds)
    before, after = ((min(wall for wall, _ in side), min(busy for _, busy in side)) for side in taken)
    return Pace(what, before, after)


def _seconds(build: Build, folder: Path, words: tuple[str, ...]) -> tuple[float, float]:
    """Seconds of one command line from the start of Python to its end, and of processor in it."""
    before, started = _processor(), time.perf_counter()
    subprocess.run(
        build.command(*words), cwd=folder, env=build.environment(), capture_output=True, check=True
    )
    return time.perf_counter() - started, _processor() - before


def _processor() -> float:
    """Seconds of processor that children took so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
