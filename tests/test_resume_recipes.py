"""Eversion, construction and `continue` killed by SIGKILL and resumed end with the same bytes."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path

import pytest
from cli_support import content_hashes, ribbon_json, spawn, states_on_disk, stop_after

from ribbon_cli.config import parse_config
from ribbon_cli.store import Run, Summary
from ribbon_cli.study import solve_config

# The only step of the eversion fails, and its halves do not.
EVERSION = """\
name: band
topology: {half_twists: 0}
initial_guess: {recipe: eversion, segments: 40, half_width: 0.03, steps: 1}
widths: [0.03, 0.032]
spectrum: {modes: 4, full_up_to: 0, metrics: [physical]}
"""

# There and back, with a level at one of the widths.
TWIST = """\
name: band
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 20, half_width: 0.3, steps: 3}
widths: [0.3, 0.4, 0.3]
refinement: {levels: [20, 40], at: [0.4]}
spectrum: {modes: 2, full_up_to: 0, metrics: [physical]}
"""

CONSTRUCTION = """\
name: band
topology: {half_twists: -3}
initial_guess: {recipe: schoenke, segments: 60, half_width: 0.1}
widths: [0.1, 0.2, 0.3]
refinement: [60, 120]
spectrum: {modes: 4, full_up_to: 0, metrics: [physical]}
"""

GIVEN = f"""\
name: band
topology: {{half_twists: 1}}
initial_guess: {{state: {Path(__file__).parent / "data" / "pi-b0.1-N50-second-minimum.npz"}}}
spectrum: {{modes: 2, full_up_to: 0, metrics: [physical]}}
"""

CONTACT = """\
name: band
topology: {half_twists: 3}
initial_guess: {recipe: schoenke, segments: 60, half_width: 0.5}
widths: [0.65, 0.68]
refinement: [60]
spectrum: {modes: 0, full_up_to: 0}
contact: stop
"""

SOLVE = ("solve", "band.yaml")
AROUND_THE_FOLD = ("continue", "band:1", "--to", "0.12", "--back-to", "0.105", "--arclength")


@pytest.mark.parametrize(
    ("config", "words", "kills"),
    [
        pytest.param(EVERSION, SOLVE, (2, 6), id="eversion", marks=pytest.mark.faults),
        pytest.param(CONSTRUCTION, SOLVE, (1, 4), id="schoenke", marks=pytest.mark.faults),
        pytest.param(GIVEN, AROUND_THE_FOLD, (3, 7), id="continue-arclength", marks=pytest.mark.faults),
        pytest.param(CONTACT, SOLVE, (2, 3), id="contact", marks=pytest.mark.long),
    ],
)
def test_killed_and_resumed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    config: str,
    words: tuple[str, ...],
    kills: tuple[int, ...],
) -> None:
    """Killed after so many states are on disk, and killed again, then left to end."""
    alone, killed = tmp_path / "alone", tmp_path / "killed"
    for folder in (alone, killed):
        folder.mkdir()
        monkeypatch.chdir(folder)
        (folder / "band.yaml").write_text(config)
        if words is not SOLVE:
            ribbon_json(*SOLVE, "-q")
    monkeypatch.chdir(alone)
    ribbon_json(*words, "-q")
    expected = content_hashes(alone / "runs")
    monkeypatch.chdir(killed)
    for wanted in kills:
        with spawn(*words, "-q", cwd=killed) as process:
            stop_after(process, killed, wanted, signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        kept = states_on_disk(killed)
        assert wanted <= kept < len(expected)
    ended = ribbon_json(*words, "-q")
    assert ended["new_states"] == len(expected) - kept
    assert content_hashes(killed / "runs") == expected


EACH = pytest.mark.parametrize(
    "config", [TWIST, EVERSION, CONSTRUCTION], ids=["twist", "eversion", "schoenke"]
)
ONE_AND_EACH = pytest.mark.parametrize(
    "config",
    [
        pytest.param(TWIST, id="twist"),
        pytest.param(EVERSION, id="eversion", marks=pytest.mark.long),
        pytest.param(CONSTRUCTION, id="schoenke", marks=pytest.mark.long),
    ],
)


@ONE_AND_EACH
def test_ended_after_some_commits_and_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, config: str
) -> None:
    ended_after_commits(tmp_path, monkeypatch, config, every=5)


@pytest.mark.faults
@EACH
def test_ended_after_any_commit_and_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, config: str
) -> None:
    ended_after_commits(tmp_path, monkeypatch, config, every=1)


def ended_after_commits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, config: str, every: int) -> None:
    """The folder as it is after a commit, and from there on: the same states, targets and failures."""
    asked, write = parse_config(config, "band.yaml"), Run.write_state

    def copied(run: Run, label: int, data: bytes, summary: Summary) -> None:
        write(run, label, data, summary)
        shutil.copytree(run.path, tmp_path / f"after-{label}" / run.name)

    with monkeypatch.context() as patch:
        patch.setattr(Run, "write_state", copied)
        alone = solve_config(asked, tmp_path / "alone")
    expected = content_hashes(tmp_path / "alone")
    for label in list(expected)[every // 2 :: every]:
        outcome = solve_config(asked, tmp_path / f"after-{label}")
        assert content_hashes(tmp_path / f"after-{label}") == expected
        assert outcome.new_states == len(expected) - label
        assert (outcome.targets, outcome.failures) == (alone.targets, alone.failures)
