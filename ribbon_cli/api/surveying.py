"""Surveys for programs: random starts explored, and what was found."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import Any

from ribbon_cli import config as configs
from ribbon_cli import surveys
from ribbon_cli.api.opening import config_of, runs_text
from ribbon_cli.api.watching import Watcher, watched
from ribbon_cli.store import runs_root


def survey(
    config: str | os.PathLike[str] | Mapping[str, Any] | configs.Config,
    runs: str | os.PathLike[str] | None = None,
    *,
    starts: int = 100,
    seed: int = 1,
    climb: int = 0,
    workers: int = 1,
    progress: Watcher = None,
) -> surveys.Findings:
    """The equilibria that random starts lead to, at the first place that a config names; see `ribbon survey`.

    What is stored is not computed again. The states are in a run, whose name the result bears. With more
    than one of `workers` the calling script needs `if __name__ == "__main__":` around what it does. Raises
    UsageError, ConfigError, StoreError, LockedError, WorkerDiedError, ValueError for numbers out of range.
    """
    if starts < 1 or seed < 0 or climb < 0 or workers < 1:
        raise ValueError("starts and workers must be 1 or more, seed and climb 0 or more")
    request = surveys.Request(starts, seed, climb, workers)
    root = runs_root(runs_text(runs))
    with watched(progress) as shown:
        outcome = surveys.survey_config(config_of(config), root, request, progress=shown, argv=sys.argv)
    return surveys.findings(outcome.run)
