"""The folder of the runs, and the name of a run in a command that a message suggests."""

from __future__ import annotations

import os
import shlex
from pathlib import Path


def runs_root(option: str | None = None) -> Path:
    """Folder of the runs: the option, else RIBBON_RUNS, else ./runs."""
    return Path(option or os.environ.get("RIBBON_RUNS") or "runs")


def named(folder: Path) -> str:
    """What names a run in a command without `--runs`: its folder's name, or its path where it lies elsewhere.

    With the name alone, the command would find another run or none.
    """
    if os.path.abspath(folder.parent) == os.path.abspath(runs_root()):
        return folder.name

    return shlex.quote(str(folder))
