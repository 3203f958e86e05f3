"""A run killed at any moment and resumed ends with the same states, byte for byte, as one left alone."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from cli_support import QUICK_MOBIUS, content_hashes, parse_json, run, spawn, states_on_disk

from ribbon_cli.store import list_runs

KILLS = 3
SMALL = QUICK_MOBIUS.replace("24", "12").replace("48", "24")


def solve(folder: Path, *words: str) -> dict[int, str]:
    """Solve to the end; the content hash of every state by label, checked against the files."""
    done = run("solve", "mobius.yaml", "--json", "-q", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert parse_json(done.stdout)["failures"] == []
    return content_hashes(folder / "runs")


@pytest.fixture(scope="module")
def left_alone(tmp_path_factory):
    """Hashes of a run that nothing interrupted, and the seconds it took."""
    folder = tmp_path_factory.mktemp("alone")
    (folder / "mobius.yaml").write_text(SMALL)
    started = time.monotonic()
    return solve(folder), time.monotonic() - started


def interrupt(folder: Path, number: int, wanted: int, delay: float) -> int:
    """Solve, and send a signal some time after `wanted` states are on disk; the exit code."""
    with spawn("solve", "mobius.yaml", "-q", cwd=folder) as process:
        while states_on_disk(folder) < wanted and process.poll() is None:
            time.sleep(0.002)
        time.sleep(delay)
        process.send_signal(number)
        _, stderr = process.communicate(timeout=60)
    if number != signal.SIGKILL and process.returncode:
        assert "everything committed is kept, and the same command resumes" in stderr
    return process.returncode


@pytest.mark.faults
def test_killed_again_and_again(left_alone, tmp_path):
    """Each kill comes some states further on, at another moment between two of them."""
    expected, seconds = left_alone
    (tmp_path / "mobius.yaml").write_text(SMALL)
    between = seconds / len(expected)
    codes = []
    for kill in range(KILLS):
        wanted = min(states_on_disk(tmp_path) + 1 + kill % 3, len(expected) - 1)
        before = states_on_disk(tmp_path)
        codes.append(interrupt(tmp_path, signal.SIGKILL, wanted, between * kill / KILLS))
        assert states_on_disk(tmp_path) >= before
    assert -signal.SIGKILL in codes
    assert solve(tmp_path) == expected


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), pytest.param(signal.SIGINT, 130, marks=pytest.mark.long)]
)
def test_stopped_by_a_signal(left_alone, tmp_path, number, code):
    expected, _ = left_alone
    (tmp_path / "mobius.yaml").write_text(SMALL)
    assert interrupt(tmp_path, number, 2, 0.0) == code
    kept = content_hashes(tmp_path / "runs")
    assert 0 < len(kept) < len(expected)
    assert kept.items() <= expected.items()
    assert solve(tmp_path) == expected


@pytest.mark.long
def test_a_finished_run_is_left_as_it_is(left_alone, tmp_path):
    (tmp_path / "mobius.yaml").write_text(SMALL)
    expected = solve(tmp_path)
    assert expected == left_alone[0]
    files = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/states/*")}
    assert solve(tmp_path) == expected
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/states/*")} == files


def test_a_fresh_start_sets_the_run_aside(left_alone, tmp_path):
    (tmp_path / "mobius.yaml").write_text(SMALL)
    assert interrupt(tmp_path, signal.SIGKILL, 2, 0.0) == -signal.SIGKILL
    assert solve(tmp_path, "--fresh") == left_alone[0]
    assert len(list_runs(tmp_path / "runs", aside=True)) == 2


def test_a_second_process_is_locked_out(left_alone, tmp_path):
    (tmp_path / "mobius.yaml").write_text(SMALL)
    with spawn("solve", "mobius.yaml", "-q", cwd=tmp_path) as process:
        while states_on_disk(tmp_path) < 1 and process.poll() is None:
            time.sleep(0.002)
        process.send_signal(signal.SIGSTOP)
        other = run("solve", "mobius.yaml", "-q", "--json", cwd=tmp_path)
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
    assert process.returncode == 143
    assert (other.returncode, other.stdout) == (5, "")
    assert f"locked by process {process.pid} on {os.uname().nodename}" in other.stderr
