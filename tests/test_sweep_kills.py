"""Sweeps that are killed: the same line finishes with the same bytes, and solves nothing twice."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from cli_support import ribbon, run, spawn
from sweep_support import BANDS, RINGS, commits, ended, hashes, workers_of
from sweep_support import undisturbed as undisturbed  # the fixture `whole`

from ribbon_cli.solver.threads import cores
from ribbon_cli.store import Run, list_runs


def begun(folder: Path, text: str, states: int, *words: str):
    """A sweep that runs, once so many states are on disk and all workers are there; with these."""
    (folder / "sweep.yaml").write_text(text)
    process = spawn("sweep", "sweep.yaml", *words, cwd=folder)
    count = int(words[words.index("--workers") + 1]) if "--workers" in words else 0
    while len(commits(folder / "runs")) < states or len(workers_of(process.pid)) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.005)
    return process, workers_of(process.pid)


def finish(folder: Path, expected, before: dict[Path, int], *words: str) -> None:
    """The same line ends well, with the bytes of an undisturbed sweep, and leaves committed states alone."""
    result = run("sweep", "sweep.yaml", *words, cwd=folder)
    assert result.returncode == 0, result.stderr
    assert hashes(folder / "runs") == expected
    after = commits(folder / "runs")
    assert before.items() <= after.items()
    assert run("sweep", "sweep.yaml", cwd=folder).stderr.startswith("0 new states")
    assert commits(folder / "runs") == after


def committed(folder: Path) -> dict[Path, int]:
    """States that logs name, with their times; a file without its line is adopted, as it is."""
    return {
        run.state_path(label): run.state_path(label).stat().st_mtime_ns
        for run in list_runs(folder / "runs")
        for label in Run(run.path).entries()
    }


@pytest.mark.skipif(cores() < 2, reason="two workers take two cores")
def test_a_killed_sweep_is_finished_by_the_same_line(tmp_path, whole):
    process, workers = begun(tmp_path, RINGS, 2, "--workers", "2")
    process.kill()
    process.communicate()
    before = committed(tmp_path)
    assert len(workers) == 2
    assert all(map(ended, workers))
    assert ribbon("sweep", tmp_path / "sweep.yaml", "--runs", tmp_path / "runs", "-q").exit_code == 0
    assert hashes(tmp_path / "runs") == whole(RINGS)
    assert before.items() <= commits(tmp_path / "runs").items()


@pytest.mark.long
@pytest.mark.parametrize("states", [1, 17])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_sweep_that_is_ended_anywhere_is_finished(tmp_path, whole, states, number):
    process, workers = begun(tmp_path, BANDS, states, "--workers", "2")
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    before = committed(tmp_path)
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        name = signal.Signals(number).name
        kept = "everything committed is kept, and the same command resumes"
        assert told.splitlines()[-1] == f"ribbon: interrupted by {name}: {kept}"
        assert not any(run.holder() for run in list_runs(tmp_path / "runs"))
    assert all(map(ended, workers))
    finish(tmp_path, whole(BANDS), before, "--workers", "2")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("states", [1, 12])
def test_a_worker_that_is_ended_leaves_a_run_that_goes_on(tmp_path, whole, states, number):
    """In the same sweep, by another worker."""
    process, workers = begun(tmp_path, BANDS, states, "--workers", "2")
    before = committed(tmp_path)
    os.kill(workers[0], number)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    finish(tmp_path, whole(BANDS), before)


@pytest.mark.long
def test_two_sweeps_of_one_file_share_the_work(tmp_path, whole):
    """Each waits for what the other has in hand, so that both end with the whole sweep done."""
    first, _ = begun(tmp_path, BANDS, 1, "--workers", "1")
    second = run("sweep", "sweep.yaml", "--workers", "1", cwd=tmp_path)
    _, told = first.communicate(timeout=120)
    assert (first.returncode, second.returncode) == (0, 0), (told, second.stderr)
    finish(tmp_path, whole(BANDS), committed(tmp_path))


@pytest.mark.long
def test_an_element_of_a_job_array_at_its_time_limit_is_resumed_by_the_same_element(tmp_path, whole):
    process, workers = begun(tmp_path, BANDS, 3, "--array-index", "2")
    assert workers == []
    before = committed(tmp_path)
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == 143
    assert run("sweep", "sweep.yaml", "--array-index", "2", cwd=tmp_path).returncode == 0
    finish(tmp_path, whole(BANDS), before)
