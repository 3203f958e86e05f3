"""Twists by more than half a turn keep their linking number or stop, and never end as another band."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ribbon_cli.config import parse_config
from ribbon_cli.study import solve_config

CONFIG = """
name: twisted
topology: {{half_twists: 1}}
initial_guess: {{recipe: twist, segments: 24, half_width: 0.1, steps: {steps}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""


@pytest.mark.parametrize(
    ("half_twists", "steps"),
    [pytest.param(2, 20, marks=pytest.mark.long), pytest.param(-3, 30, marks=pytest.mark.large)],
)
def test_a_twist_past_the_guard_stops(tmp_path: Path, half_twists: int, steps: int) -> None:
    """Beyond half a turn the band would turn over at its seam and end with another Lk: no success."""
    half_a_turn = parse_config(CONFIG.format(steps=steps), "twisted.yaml")
    config = replace(half_a_turn, half_twists=half_twists)  # which `check` refuses in a file
    outcome = solve_config(config, tmp_path)
    assert outcome.exit_code == 3
    assert "passed through itself" in outcome.failures[0]
    states = outcome.run.states(all=True)
    assert {s.kind for s in states} == {"auxiliary"}
    for k, state in enumerate(states, start=1):
        # Tw + Wr of the open band is what the seam was turned by.
        assert state.linking_number == pytest.approx(0.5 * half_twists * k / steps, abs=0.01)
    assert abs(states[-1].linking_number) >= 0.5 - 0.5 * abs(half_twists) / steps
