"""Small solved runs for pictures and exports, made once a session."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from cli_support import QUICK_MOBIUS, QUICK_RING

from ribbon_cli import solve
from ribbon_cli.config import parse_config
from ribbon_cli.export.mesh import is_closed
from ribbon_cli.store import Run, StateRecord


@pytest.fixture(scope="session")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: `mobius` at two widths and two levels, and `ring`."""
    root = tmp_path_factory.mktemp("solved")
    with np.errstate(all="raise", under="ignore"):
        for text in (QUICK_MOBIUS, QUICK_RING):
            solve(parse_config(text, "test"), runs=root)
    return root


def run_named(root: Path, name: str) -> Run:
    (path,) = root.glob(f"{name}-*")
    return Run.open(path)


def states_of(root: Path, name: str, kind: str = "equilibrium") -> list[StateRecord]:
    return list(_loaded(run_named(root, name).path, kind))


@lru_cache(maxsize=16)
def _loaded(path: Path, kind: str) -> tuple[StateRecord, ...]:
    """States of a run that no test changes, read once."""
    run = Run.open(path)
    return tuple(run.load(s.label) for s in run.states(all=True) if s.kind == kind)


def written(state: StateRecord, name: str) -> np.ndarray:
    """A field as files have it: where the seam is open there is no fold at node 1, whatever is stored."""
    values = getattr(state, name).copy()
    if not is_closed(state) and name in ("kappa_s", "tau", "eta"):
        values[0] = np.nan
    return values
