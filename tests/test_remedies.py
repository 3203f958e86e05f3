"""Messages that say what to do next, and what is mended at once: a given band that is open."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json

from ribbon_cli.solver.status import Status
from ribbon_cli.study.failure import Failure

SECOND = Path(__file__).parent / "data" / "pi-b0.1-N50-second-minimum.npz"
CONFIG = "name: band\ntopology: {half_twists: 1}\ninitial_guess: {state: open.npz}\n"


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Writes a config that starts from a band with its ends so far apart, in parts of its length."""
    monkeypatch.chdir(tmp_path)

    def write(gap: float) -> None:
        arrays = dict(np.load(SECOND))
        u = arrays["u"] + gap * np.array([0.0, 0.6, 0.8])
        arrays["u"] = u / np.linalg.norm(u, axis=1)[:, None]
        np.savez("open.npz", **arrays)
        Path("band.yaml").write_text(CONFIG)

    return write


def test_a_band_that_is_open_by_a_thousandth_is_closed_and_that_is_said(opened):
    opened(1e-3)
    result = ribbon("solve", "band.yaml")
    assert result.exit_code == 0, result.output
    assert "of its length apart: closed by fold angles, which turn facets by up to" in result.stderr
    (note,) = (line for line in result.stderr.splitlines() if "closed by fold angles" in line)
    assert note.strip() in ribbon("check", "band.yaml").stderr.splitlines()
    state = ribbon_json("show", "band:1")
    assert any("closed by fold angles" in event for event in state["events"])
    assert state["certified"]
    assert state["energy"] == pytest.approx(0.972161015, abs=1e-8)


def test_a_band_that_closes_is_taken_as_it_is(opened):
    opened(0.0)
    result = ribbon("solve", "band.yaml")
    assert result.exit_code == 0, result.output
    assert "closed by" not in result.stderr


def test_a_band_that_is_wide_open_is_refused_with_the_number(opened):
    opened(0.03)
    result = ribbon("check", "band.yaml")
    assert result.exit_code == 2
    assert (
        "open.npz: not a closed band: its ends are 0.025 of its length apart, and up to 0.01 is closed"
        in result.stderr
    )
    assert "band.yaml:3:24: initial_guess.state: " in result.stderr


@pytest.mark.long
def test_a_fold_in_a_schedule_names_the_command_that_goes_around_it(opened):
    opened(0.0)
    with Path("band.yaml").open("a") as config:
        config.write("widths: [0.1, 0.12]\nspectrum: {modes: 0, full_up_to: 0}\n")
    result = ribbon("solve", "band.yaml", "-q")
    assert result.exit_code == 3
    assert "the branch seems to turn back (fold) near b = 0.112" in result.stderr
    assert "`widths: {arclength: {to: 0.12}}` in a config" in result.stderr
    (command,) = re.findall("`ribbon (continue [^`]*)`", result.stderr)
    assert command.endswith("--to 0.12 --arclength")
    document = ribbon_json(*command.split(), "--stop-at", "fold")
    assert document["end"]["reason"] == "fold"


@pytest.mark.parametrize("status", [s for s in Status if s not in (Status.MINIMUM, Status.CONSTRUCTED)])
def test_every_status_that_is_no_success_says_what_to_do(status):
    message = Failure("solve", status, "", {"stage": "b = 0.5"}, "`steps` of the recipe").sentence
    assert message.startswith(f"b = 0.5: {status.sentence} ")
    assert message.endswith(".")


def test_passing_through_itself_names_steps_mesh_and_recipe():
    failure = Failure("solve", Status.LEFT_TOPOLOGY, "", {"stage": "b = 0.5"}, "`steps` of the recipe")
    for word in ("smaller steps (`steps` of the recipe)", "more segments N", "another recipe"):
        assert word in failure.sentence


def test_a_recipe_without_steps_is_not_told_to_take_smaller_ones(tmp_path, monkeypatch):
    """The construction passes through itself where nothing keeps it apart; what does is named, before too."""
    monkeypatch.chdir(tmp_path)
    Path("five.yaml").write_text(
        "topology: {half_twists: 5}\ninitial_guess: {recipe: schoenke, segments: 60, half_width: 0.05}\n"
    )
    assert (
        "with 5 half-twists are saddles; `contact: forces` looks for" in ribbon("check", "five.yaml").stderr
    )
    result = ribbon("solve", "five.yaml", "-q")
    assert result.exit_code == 3
    assert "Take more segments N" in result.stderr
    assert "with `contact: forces` a band rests on itself" in result.stderr
    assert "smaller steps" not in result.stderr


def test_a_strip_followed_without_arclength_ends_at_the_range_of_its_parameter(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("shelf.yaml").write_text(
        "topology: open\nlength: 1\nends: {end: free}\nloads: {gravity: 2}\n"
        "initial_guess: {recipe: strip, segments: 10, half_width: 0.05}\n"
        "spectrum: {modes: 0, full_up_to: 0}\n"
    )
    assert ribbon("solve", "shelf.yaml", "-q").exit_code == 0
    branch = ribbon_json("continue", "shelf:1", "--in", "gravity", "--to", "3")
    assert branch["end"]["message"] == "The end of the range of gravity."
