"""The config of a run as resolved, from its folder."""

from __future__ import annotations

from ..config import Config, load_config
from ..store import Run
from ..store.folder import RESOLVED
from ..store.hdf5 import read_bytes


def resolved_config(run: Run) -> Config:
    """Read a run's resolved config. Raises StoreError where there is none, ConfigError where it is wrong."""
    path = run.path / RESOLVED
    read_bytes(path)  # of a pipe, a config's reader would wait for the writer
    return load_config(path)
