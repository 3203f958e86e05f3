"""How branches end: an event that is off, too few steps, contact, a saddle among a run's equilibria."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cli_support import ribbon, ribbon_json

from ribbon_cli.solver import branch_events
from ribbon_cli.solver.arclength import TOLERANCE, CorrectorError
from ribbon_cli.study import branch

BAND = """\
name: my-band
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 40, half_width: 0.2, steps: 10}
widths: [0.2, 0.5]
spectrum: {modes: 0, full_up_to: 0}
"""
COARSE = """\
name: coarse
topology: {half_twists: 1}
discretisation: value-average
initial_guess: {recipe: twist, segments: 16, half_width: 0.4, steps: 10}
spectrum: {modes: 0, full_up_to: 0}
"""
LONG_STEPS = BAND.replace("[0.2, 0.5]", "{arclength: {to: 1.6, max_step: 0.3}}")


@pytest.fixture(scope="module")
def band(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs with the README's band at two widths."""
    folder = tmp_path_factory.mktemp("ends")
    (folder / "my-band.yaml").write_text(BAND)
    ribbon_json("solve", folder / "my-band.yaml", "--runs", folder / "runs", "-q")
    return folder / "runs"


def branch_points(document: dict[str, Any]) -> list[float]:
    return [point["half_width"] for point in document["points"] if point["type"] == "branch-point"]


def check_long_steps(points: list[dict[str, Any]], end: tuple[str, float]) -> None:
    """The branch from b = 0.2 in steps of up to 0.3."""
    met = {point["type"]: point for point in points}
    assert met["branch-point"]["half_width"] == pytest.approx(1.324422874, abs=1e-9)
    assert (met["branch-point"]["index_before"], met["branch-point"]["index_after"]) == (1, 0)
    assert met["branch-point"]["energy"] == pytest.approx(24.511228895, abs=2e-9)
    assert met["contact"]["half_width"] == pytest.approx(1.54277, abs=1e-5)
    assert end == ("range", 1.6)
    assert met["width"]["energy"] == pytest.approx(50.671457411, abs=1e-9)


@pytest.mark.large  # the next test follows the same branch from a config
def test_a_branch_goes_on_past_a_branch_point_with_long_steps(band: Path) -> None:
    """It ended in an internal error at b = 1.3244, where interpolation left residuals of 1.15e-9."""
    words = ("my-band@b=0.2,N=40", "--to", "1.6", "--arclength", "--max-step", "0.3", "--runs", band, "-q")
    document = ribbon_json("continue", *words)
    check_long_steps(document["points"], (document["end"]["reason"], document["end"]["half_width"]))
    labels = [point["label"] for point in document["points"]]
    for state in ribbon_json("ls", "my-band", "--all", "--runs", band, "-q"):
        if state["label"] in labels:
            assert max(state["kkt_residual"], state["constraint_residual"]) <= TOLERANCE


@pytest.mark.long
def test_the_same_as_a_config(tmp_path: Path) -> None:
    (tmp_path / "my-band.yaml").write_text(LONG_STEPS)
    document = ribbon_json("solve", tmp_path / "my-band.yaml", "--runs", tmp_path / "runs", "-q")
    (course,) = document["branches"]
    check_long_steps(course["points"], (course["reason"], course["half_width"]))


@pytest.mark.branches
def test_a_branch_goes_on_past_a_branch_point_far_up(band: Path) -> None:
    """It ended in an internal error at b = 1.6369, where interpolation left residuals of 7.1e-9."""
    words = ("my-band@b=0.5,N=40", "--to", "1.7", "--arclength", "--runs", band, "-q")
    document = ribbon_json("continue", *words)
    assert (document["end"]["reason"], document["end"]["half_width"]) == ("range", 1.7)
    nearest = min(branch_points(document), key=lambda b: abs(b - 1.637))
    assert nearest == pytest.approx(1.6369321848, abs=1e-9)


@pytest.mark.branches
def test_a_coarse_band_with_averaged_values(tmp_path: Path) -> None:
    """It ended in an internal error near b = 1.3539."""
    (tmp_path / "coarse.yaml").write_text(COARSE)
    options = ("--runs", tmp_path / "runs", "-q")
    ribbon_json("solve", tmp_path / "coarse.yaml", *options)
    document = ribbon_json("continue", "coarse@b=0.4,N=16", "--to", "1.5", "--arclength", *options)
    assert document["end"]["reason"] == "range"
    assert min(abs(b - 1.3539) for b in branch_points(document)) < 1e-3


def test_no_change_of_the_index_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A branch point not located, in a bracket whose middle is singular, was no event and no error."""
    monkeypatch.setattr(branch_events, "_branch_point", lambda *bracket: None)

    class Step:
        def at(self, s: float) -> SimpleNamespace:
            return SimpleNamespace(negative=None if abs(s - 0.3) < 1e-4 else int(s > 0.3))

    with pytest.raises(branch_events.LocationError, match="from 0 to 1 where it cannot be told"):
        branch_events._changes(Step(), 0.0, 1.0)


def test_an_event_that_is_another_band_ends_its_branch(band: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = branch.checked

    def suspicious(result, half_twists, **more):
        if result.state.band.half_width > 1.0 and "bifurcation" in result.detail:
            return replace(result, status=type(result.status).LEFT_TOPOLOGY, detail="")
        return honest(result, half_twists, **more)

    monkeypatch.setattr(branch, "checked", suspicious)
    words = ("my-band@b=0.5,N=40", "--to", "1.2", "--arclength", "--max-step", "0.22", "--runs", band, "-q")
    document = ribbon_json("continue", *words, code=3)
    assert document["end"]["reason"] == "step-too-small"
    assert "its linking number changed" in document["end"]["message"]


@pytest.mark.parametrize("error", [CorrectorError("no"), ZeroDivisionError("no"), OverflowError("no")])
def test_no_arithmetic_error_passes_a_branch(
    band: Path, monkeypatch: pytest.MonkeyPatch, error: ArithmeticError
) -> None:
    def fails(*args, **kwargs):
        raise error

    monkeypatch.setattr(branch, "advance", fails)
    words = ("my-band@b=0.5,N=40", "--to", "0.9", "--arclength", "--max-step", "0.23", "--runs", band, "-q")
    document = ribbon_json("continue", *words, code=3)
    assert document["end"]["reason"] == "step-too-small"


def test_a_root_that_is_none_is_a_step_too_long() -> None:
    for f in (lambda s: 1.0, lambda s: float("nan")):
        with pytest.raises(branch_events.LocationError, match="no zero was found"):
            branch_events._root(f, 0.0, 1.0, 1e-9)


def test_a_saddle_on_a_branch_is_no_failure_of_its_run(band: Path, tmp_path: Path) -> None:
    (tmp_path / "my-band.yaml").write_text(BAND)
    shutil.copytree(band, tmp_path / "runs")
    options = ("--runs", tmp_path / "runs", "-q")
    words = ("my-band@b=0.5,N=40", "--to", "1.3", "--arclength", *options)
    assert ribbon_json("continue", *words)["points"][-1]["status"] == "saddle"
    table = ribbon("convergence-table", "my-band", *options)
    assert (table.exit_code, table.stderr) == (0, "")
    assert "no certificate: E_40" in table.stdout
    assert ribbon("convergence-table", tmp_path / "my-band.yaml", *options).exit_code == 0
    for command in (("verify", "my-band", "--continuum"), ("solve", tmp_path / "my-band.yaml")):
        assert ribbon(*command, *options).exit_code == 0, command
    (run,) = ribbon_json("ls", *options)
    assert (run["status"], run["failed"]) == ("complete", 0)
