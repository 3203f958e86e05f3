"""Surveys with contact forces: nothing passes through itself, from the start to the finest mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ribbon_cli.config import parse_config
from ribbon_cli.errors import UsageError
from ribbon_cli.model.band import Band
from ribbon_cli.solver.resting_exchange import NoRestError, pushing
from ribbon_cli.store import Run
from ribbon_cli.study.resting import crosses
from ribbon_cli.surveys import Request, findings, survey_config
from ribbon_cli.surveys.resting import GAP_LOST, descend, open_start
from ribbon_cli.surveys.text import contact

CONFIG = """
name: eight
topology: {half_twists: 2}
initial_guess: {recipe: figure-eight, segments: 20, half_width: 0.1}
contact: forces
spectrum: {modes: 0, full_up_to: 0}
"""


def hashes(run: Run) -> list[str]:
    return [state.content_sha256 for state in run.states(all=True)]


def test_starts_cross_nothing() -> None:
    state = open_start(Band(16, 0.3, sigma=-1), 1, np.random.default_rng(5), 0.0)
    assert state is not None
    assert not crosses(state, 0.0)


def test_a_way_from_a_shape_that_crosses_itself_has_no_end() -> None:
    rng = np.random.default_rng(5)
    wide = open_start(Band(16, 0.3, sigma=-1), 1, rng, 0.0)
    assert wide is not None
    crossing = replace(wide, band=wide.band.with_half_width(1.6))
    assert crosses(crossing, 0.0)
    assert descend(crossing, 1, 0.0) == (GAP_LOST, None, None)


def test_forces_that_close_nothing_are_told() -> None:
    with pytest.raises(NoRestError, match="no gap gives way"):
        pushing(np.diag([-1.0, -2.0]), np.ones(2))


def test_saddles_at_rest_are_not_climbed_to(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--climb: .* leave it out, or contact forces of eight\.yaml"):
        survey_config(parse_config(CONFIG, "eight.yaml"), tmp_path, Request(starts=1, climb=1))


@pytest.mark.long
def test_a_survey_finds_bands_at_rest_whatever_the_number_of_workers(tmp_path: Path) -> None:
    config = parse_config(CONFIG, "eight.yaml")
    one = survey_config(config, tmp_path / "one", Request(starts=4)).run
    two = survey_config(config, tmp_path / "two", Request(starts=4, workers=2)).run
    assert hashes(one) == hashes(two)
    found = findings(one).equilibria
    assert found == findings(two).equilibria
    assert any(row.contacts and contact(row).startswith("rests on itself at ") for row in found)
    states = one.states(all=True)
    assert states
    for state in states:
        assert state.contacts is not None
        assert state.penetration is not None
        assert state.penetration <= 1e-9 * state.length
    assert any(state.contacts for state in states)
