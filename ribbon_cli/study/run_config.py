"""The config of a run, as resolved and as written, from its folder."""

from __future__ import annotations

from dataclasses import replace

from ..config import Config, load_config
from ..errors import RibbonError, StoreError
from ..store import Run, configs
from ..store.folder import CONFIG, RESOLVED
from ..store.hdf5 import read_bytes


def resolved_config(run: Run) -> Config:
    """Read a run's resolved config. Raises StoreError where there is none, ConfigError where it is wrong."""
    path = run.path / RESOLVED
    read_bytes(path)  # of a pipe, a config's reader would wait for the writer
    return load_config(path)


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
