"""A small sweep and a run beside it, for tests of tables and of pictures over them."""

from __future__ import annotations

from pathlib import Path

from cli_support import QUICK_RING

from ribbon_cli.config import load_sweep, parse_config
from ribbon_cli.store import keep_sweep
from ribbon_cli.study import solve_config

SWEEP = """
name: fam
config:
  initial_guess: {recipe: cylinder, segments: 12, half_width: 0.1}
  topology: {half_twists: 0}
  spectrum: {modes: 3, full_up_to: 0}
vary:
  - {discretisation: [thesis, value-average], length: [6, 7.5]}
  - {initial_guess.half_width: [0.1, 0.2, 1]}
"""


def fill(root: Path) -> Path:
    """A sweep of which one point was not run, and a run beside it."""
    path = root / "fam.yaml"
    path.write_text(SWEEP)
    sweep = load_sweep(path)
    keep_sweep(root, sweep)
    for point in sweep.points[:-1]:
        solve_config(point.config, root)
    solve_config(parse_config(QUICK_RING, "ring.yaml"), root)
    return root


LEGS = """
name: legs
config:
  topology: open
  length: 1
  ends: {span: 0.6}
  initial_guess: {recipe: strip, segments: 8, half_width: 0.03}
  schedule: [{shear: 0.1}]
  spectrum: {modes: 1, full_up_to: 0, metrics: [physical]}
vary:
  - ends.span: [0.6, 0.97]
  - schedule.0.shear: [-0.1, 0.2]
"""


def walk(root: Path) -> Path:
    """A sweep whose schedule reaches its end at two points, and at a third does not; the last is not run."""
    path = root / "legs.yaml"
    path.write_text(LEGS)
    sweep = load_sweep(path)
    keep_sweep(root, sweep)
    for k in (0, 1, 3):
        solve_config(sweep.points[k].config, root)
    return root
