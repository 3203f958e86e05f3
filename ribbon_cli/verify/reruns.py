"""`ribbon rerun`: a run repeated from its stored config alone, and held against what is stored."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..report.comparison import StatePair
from ..store import Run, find_run
from ..store.atomic import temporary_name
from ..study.outcome import Outcome
from ..study.plan import by_command
from ..study.progress import Progress
from ..study.run_config import stored_config
from ..study.solve import solve_config
from .sameness import judge_runs


@dataclass(frozen=True)
class Rerun:
    """A run, what came of repeating it, and its states beside the new ones.

    `extra` are states that the config does not lead to, those of `ribbon refine` and `ribbon continue`.
    """

    run: Run
    outcome: Outcome
    pairs: tuple[StatePair, ...]
    extra: tuple[StatePair, ...]

    @property
    def equal(self) -> bool:
        """Whether every state that the config leads to is the stored one, byte for byte of its scientific
        part.
        """
        return all(pair.equal for pair in self.pairs)


def rerun(
    root: Path,
    ref: str,
    *,
    into: Path | None = None,
    progress: Progress | None = None,
    argv: Sequence[str] = (),
) -> Rerun:
    """Repeat the run that `ref` names, and compare. `into` is a folder of runs to keep the new run in.

    Raises UsageError, StoreError; what is not reached again is in the result.
    """
    run = find_run(root, ref)
    config = stored_config(run)
    folder = into if into is not None else temporary_name(root / f"rerun-{run.name}")
    try:
        outcome = solve_config(config, folder, fresh=True, progress=progress, argv=argv, references=root)
        pairs = judge_runs(run, outcome.run)
    finally:
        if into is None:
            shutil.rmtree(folder, ignore_errors=True)
    stages = {state.label: state.stage for state in run.states(all=True)}
    extra = tuple(pair for pair in pairs if pair.second is None and by_command(pair.stage, stages))
    return Rerun(run, outcome, tuple(pair for pair in pairs if pair not in extra), extra)
