"""`ribbon rerun`: a run repeated from its stored config alone, and held against what is stored."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..config import Config, load_config
from ..errors import RibbonError, StoreError
from ..report.comparison import StatePair
from ..store import Run, configs, find_run
from ..store.atomic import temporary_name
from ..store.folder import CONFIG, RESOLVED
from .outcome import Outcome
from .progress import Progress
from .sameness import judge_runs
from .solve import solve_config

_CROSSING = re.compile(r"branch from (\d{1,12}) side ")


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


def by_command(stage: str, stages: Mapping[int, str]) -> bool:
    """Whether a stage is one of `ribbon refine` or `ribbon continue`, and no config leads to it.

    `stages` are those of the run by label: a branch that crosses another is of whoever asked for that one.
    """
    left = dict(stages)  # each is looked at once, whatever a log says
    while crossing := _CROSSING.match(stage):
        stage = left.pop(int(crossing[1]), "")
    return stage.startswith(("state ", "from ", "branch from "))


def stored_config(run: Run) -> Config:
    """The config of a run as written, with paths as they were resolved.

    Raises StoreError if it is damaged, or was changed since the run was made.
    """
    configs.require(run.path, run.events())
    try:
        resolved = load_config(run.path / RESOLVED)
        written = load_config(run.path / CONFIG)
    except RibbonError as error:
        raise StoreError(f"{run.path}: its stored config cannot be read: {error}") from error
    return replace(written, name=resolved.name, guess=replace(written.guess, state=resolved.guess.state))
