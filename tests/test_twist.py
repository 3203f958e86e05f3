"""Twists by more than half a turn keep their linking number or stop, and never end as another band."""

from __future__ import annotations

from pathlib import Path

import pytest

from ribbon_cli.config import parse_config
from ribbon_cli.study import plan_of, solve_config

CONFIG = """
name: twisted
topology: {{half_twists: {half_twists}}}
initial_guess: {{recipe: twist, segments: 24, half_width: 0.1, steps: {steps}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""


@pytest.mark.parametrize(("half_twists", "steps"), [(2, 20), (3, 30), (-3, 30), (3, 7)])
def test_a_twist_past_the_guard_stops(tmp_path: Path, half_twists: int, steps: int) -> None:
    """Beyond half a turn the band would turn over at its seam and end with another Lk: no success."""
    config = parse_config(CONFIG.format(half_twists=half_twists, steps=steps), "twisted.yaml")
    outcome = solve_config(config, tmp_path)
    assert outcome.exit_code == 3
    assert "passed through itself" in outcome.failures[0]
    states = outcome.run.states(all=True)
    assert {s["kind"] for s in states} == {"auxiliary"}
    for k, state in enumerate(states, start=1):
        # Tw + Wr of the open band is what the seam was turned by.
        assert state["linking_number"] == pytest.approx(0.5 * half_twists * k / steps, abs=0.01)
    assert abs(states[-1]["linking_number"]) >= 0.5 - 0.5 * abs(half_twists) / steps


@pytest.mark.parametrize(("half_twists", "schoenke"), [(2, False), (3, True), (-4, True)])
def test_who_asks_for_more_than_half_a_turn_is_told(half_twists: int, schoenke: bool) -> None:
    (note,) = plan_of(parse_config(CONFIG.format(half_twists=half_twists, steps=20), "twisted.yaml")).notes
    assert note.startswith("beyond half a turn the twist tends to turn over")
    assert (f"schoenke makes bands of {abs(half_twists)} half-twists" in note) is schoenke
