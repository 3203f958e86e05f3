"""Sweeps on a real Slurm: job arrays, jobs at their time limit, a Dask cluster of jobs."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cli_support import environment, run
from slurm import obstacle, one_node
from sweep_support import MIXED, RINGS, commits, hashes

from ribbon_cli.config import load_sweep
from ribbon_cli.study import solve_config

pytestmark = pytest.mark.slurm
LONG = """\
config:
  topology: {half_twists: 1}
  initial_guess: {recipe: twist, segments: 200, half_width: 0.1, steps: 30}
  widths: {from: 0.1, to: 1.0, steps: 300}
  spectrum: {modes: 4, full_up_to: 0}
vary:
  - contact: [record]
"""
"""One run, of minutes."""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    stops = obstacle()
    if stops:
        pytest.fail(f"no Slurm here: {stops}", pytrace=False)
    with one_node(tmp_path_factory.mktemp("slurm")) as env:
        yield environment() | {name: env[name] for name in ("SLURM_CONF", "PATH")}


@pytest.fixture
def submit(slurm: dict[str, str], tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Submit the script of a sweep, and wait for its end."""

    def wait(*words: str) -> subprocess.CompletedProcess[str]:
        script = run("sweep", "sweep.yaml", "--script", "slurm", cwd=tmp_path)
        assert script.returncode == 0, script.stderr
        (tmp_path / "job.sh").write_text(script.stdout)
        return subprocess.run(
            ["sbatch", "--wait", *words, "job.sh"],
            cwd=tmp_path,
            env=slurm,
            capture_output=True,
            text=True,
            timeout=900,
        )

    return wait


def whole(folder: Path, text: str) -> dict[str, Any]:
    """The states of a sweep's points, each solved by itself."""
    (folder / "sweep.yaml").write_text(text)
    for point in load_sweep(folder / "sweep.yaml").points:
        solve_config(point.written("whole"), folder / "alone")
    return hashes(folder / "alone")


def test_an_array_of_eight_finishes_a_sweep(tmp_path, submit):
    expected = whole(tmp_path, RINGS.replace("steps: 5", "steps: 7"))
    done = submit()
    assert done.returncode == 0, done.stderr + logs(tmp_path)
    assert hashes(tmp_path / "runs") == expected
    assert len(expected) == 8
    assert run("sweep", "sweep.yaml", "--dry-run", cwd=tmp_path).stdout.splitlines()[-1].startswith("0 of 8")


def test_an_element_whose_point_fails_has_our_exit_code(tmp_path, submit):
    (tmp_path / "sweep.yaml").write_text(MIXED)
    assert submit().returncode == 3
    assert "not reached" in logs(tmp_path)
    before = commits(tmp_path / "runs")
    assert submit().returncode == 3
    assert commits(tmp_path / "runs") == before


def test_a_job_ended_by_its_time_limit_is_resumed_by_submitting_again(tmp_path, submit, figure):
    (tmp_path / "sweep.yaml").write_text(LONG)
    done = submit("--time=1")
    before = commits(tmp_path / "runs")
    assert done.returncode == 143, done.stderr + logs(tmp_path)
    assert "interrupted by SIGTERM: everything committed is kept" in logs(tmp_path)
    listed = run("ls", "sweep", cwd=tmp_path).stdout
    assert listed.splitlines()[-1] == "1 unfinished"
    assert submit("--time=15").returncode == 0, logs(tmp_path)
    after = commits(tmp_path / "runs")
    assert before.items() <= after.items()
    figure(f"{len(before)} states of {len(after)} before the time limit")
    assert hashes(tmp_path / "runs") == whole(tmp_path, LONG)


def test_a_dask_cluster_of_two_jobs_finishes_a_sweep(tmp_path, slurm):
    expected = whole(tmp_path, RINGS)
    (tmp_path / "slurm.yaml").write_text('jobs: 2\nwalltime: "00:10:00"\nmemory: 900\npartition: test\n')
    done = run("sweep", "sweep.yaml", "--dask", "slurm.yaml", cwd=tmp_path, **slurm)
    assert done.returncode == 0, done.stderr
    assert hashes(tmp_path / "runs") == expected


def logs(folder: Path) -> str:
    return "".join(path.read_text() for path in sorted(folder.glob("*.log")))
