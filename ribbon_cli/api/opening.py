"""For notebooks and scripts: solve a config, open a state."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ribbon_cli import api, study
from ribbon_cli import config as configs
from ribbon_cli.api.watching import Watcher, watched
from ribbon_cli.errors import UsageError
from ribbon_cli.store import Run, StateRecord, decode, resolve_state, runs_root


def solve(
    config: str | os.PathLike[str] | Mapping[str, Any] | configs.Config,
    runs: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    *,
    progress: Watcher = None,
) -> study.Outcome:
    """Run all stages of a config, or those that its run still lacks; `fresh` starts over.

    `config` is a path, a `Config`, or a mapping laid out as a config file, whose `name` defaults to "config".
    `runs` is the folder of the runs, by default RIBBON_RUNS, else ./runs. `progress` is a callable that gets
    every `Stage`, `Step` and `Note`, True for the progress of the command line, None for silence; what the
    callable raises ends the solve, and what is stored by then stays. Targets that were not reached are in the
    outcome and raise nothing; ConfigError, StoreError and LockedError are raised, and TypeError for arguments
    of other types.
    """
    root = runs_root(runs_text(runs))
    with watched(progress) as shown:
        return study.solve_config(config_of(config), root, fresh=fresh, progress=shown, argv=sys.argv)


def config_of(source: str | os.PathLike[str] | Mapping[str, Any] | configs.Config) -> configs.Config:
    """The config that a user hands over. Raises ConfigError, TypeError."""
    if isinstance(source, str | os.PathLike):
        return configs.load_config(path_text("config", source))
    if isinstance(source, Mapping):
        import yaml

        return configs.parse_config(yaml.safe_dump(_plain(source), sort_keys=False), "config")
    if not isinstance(source, configs.Config):
        raise TypeError(f"config must be a path, a mapping or a Config, got {type(source).__name__}")
    return source


def path_text(name: str, value: object) -> str:
    """An argument as text. Raises TypeError, naming it."""
    text = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(text, str):
        raise TypeError(f"{name} must be text or a path, got {type(value).__name__}")
    return text


def runs_text(runs: object) -> str | None:
    """The folder of the runs as given. Raises TypeError."""
    return None if runs is None else path_text("runs", runs)


def _plain(value: Any) -> Any:
    """A copy in YAML's types: NumPy's scalars and arrays, tuples and paths as Python's own."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def load_state(ref: str | os.PathLike[str], runs: str | os.PathLike[str] | None = None) -> api.OpenState:
    """Read the state that `ref` names: RUN:LABEL, RUN@b=0.5,N=400, or the path of its HDF5 file.

    Where N is left out the finest certified state is meant, and of several with one N the latest. Raises
    UsageError when it names none, StoreError when the file is damaged, TypeError where `ref` or `runs` is
    neither text nor a path.
    """
    taken: list[str] = []
    run, record, path = open_state(ref, runs, taken.append)
    choice = taken[0].removeprefix(f"{ref}: ") if taken else ""
    return api.OpenState.of(record, run, path, choice)


def open_state(
    ref: str | os.PathLike[str],
    runs: str | os.PathLike[str] | None = None,
    tell: Callable[[str], object] | None = None,
) -> tuple[Run | None, StateRecord, Path]:
    """Read a state as `load_state` does; return its run (None outside of one) and its file as well.

    `tell` is called with a sentence on which state was taken, where the reference leaves a choice.
    """
    run, label, path = resolve_state(runs_root(runs_text(runs)), path_text("ref", ref), tell)
    if path.suffix == ".npz":
        raise UsageError(f"{path}: an npz file holds no certificate or provenance: name the state it is from")
    if run is None or label is None:
        return None, decode(path), path
    return run, run.load(label), path
