"""Small solved runs of open strips, made once a session: `sheared`, `cantilever` and `branch`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ribbon_cli import solve
from ribbon_cli.config import parse_config

SHEARED = """
name: sheared
topology: open
length: 1
discretisation: value-average
ends: {span: 0.75}
initial_guess: {recipe: strip, segments: 20, half_width: 0.05}
schedule:
  - {shear: {to: 0.06, steps: 2}}
  - {half_width: 0.06}
refinement: [20, 40]
spectrum: {modes: 4, full_up_to: 20}
"""
CANTILEVER = """
name: cantilever
topology: open
length: 1
discretisation: value-average
ends: {end: free}
loads: {end_force: [0, 0.1, 0]}
initial_guess: {recipe: strip, segments: 20, half_width: 0.05}
schedule: [{end_force_y: {to: 0.2, steps: 2}}]
spectrum: {modes: 4, full_up_to: 0}
"""
BRANCH = """
name: branch
topology: open
length: 1
discretisation: value-average
ends: {start: hinged, end: hinged, span: 0.7}
initial_guess: {recipe: strip, segments: 20, half_width: 0.05}
schedule: [{arclength: {parameter: span, to: 0.65}}]
spectrum: {modes: 4, full_up_to: 0}
"""


@pytest.fixture(scope="session")
def strips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of these runs."""
    root = tmp_path_factory.mktemp("strips")
    with np.errstate(all="raise", under="ignore"):
        for text in (SHEARED, CANTILEVER, BRANCH):
            solve(parse_config(text, "test"), runs=root)
    return root
