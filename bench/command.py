"""The whole command beside the program as it was: `ribbon solve` of Table 3.1, with spectra and files."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
BEFORE = "61ee603"
"""The commit that today's program is measured against."""
CONFIG = ROOT / "configs" / "mobius-pi.yaml"
_RUN = "import sys; from ribbon_cli.cli.main import main; sys.exit(main())"


@dataclass(frozen=True)
class Cost:
    """Seconds of one command: by the clock, and of all its processes together."""

    wall: float
    cpu: float


@dataclass(frozen=True)
class Command:
    """Costs of the same command, before and now, in turn; on how many cores."""

    before: list[Cost]
    now: list[Cost]
    cores: int

    def medians(self, name: str) -> tuple[float, float]:
        """The medians of one of the costs, before and now."""
        first, second = ([getattr(cost, name) for cost in costs] for costs in (self.before, self.now))
        return statistics.median(first), statistics.median(second)

    def ratio(self, name: str) -> float:
        """What is left of one of the costs."""
        before, now = self.medians(name)
        return now / before


def whole_command(config: Path, runs: int) -> Command:
    """Solve a config by both programs in turn, each time into an empty folder.

    Both have their byte code, as an installed package has; a first run of each, which compiles, is left out.
    Raises CalledProcessError where git or a command fails.
    """
    before, now = [], []
    with _checked_out(BEFORE) as old:
        for package in (old, ROOT):
            _solved(package, config)
        for _ in range(runs):
            before.append(_solved(old, config))
            now.append(_solved(ROOT, config))
    return Command(before, now, len(os.sched_getaffinity(0)))


@contextmanager
def _checked_out(commit: str) -> Iterator[Path]:
    """The files of a commit in a work tree of their own."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def _solved(package: Path, config: Path) -> Cost:
    """What it costs the package in a folder to solve a config."""
    with tempfile.TemporaryDirectory() as runs:
        command = [sys.executable, "-c", _RUN, "-q", "solve", str(config), "--runs", runs]
        environment = {**os.environ, "PYTHONPATH": str(package)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        began = time.perf_counter()
        process = subprocess.Popen(command, cwd=package, env=environment, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
    return Cost(seconds, used.ru_utime + used.ru_stime)
