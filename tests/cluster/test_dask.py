"""Sweeps on Dask: the same bytes, and what of Dask's own ways must not reach users."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli_support import environment, parse_json, run, spawn
from sweep_support import BANDS, MIXED, commits, ended, hashes, workers_of
from sweep_support import undisturbed as undisturbed  # the fixture `whole`

from ribbon_cli.store import list_runs

pytestmark = pytest.mark.cluster
DASK = [sys.executable, "-m", "dask"]
ENVIRONMENT = """
import os
from ribbon_cli.sweeps.cluster import dask_executor
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.pop(name, None)
os.environ["OMP_NUM_THREADS"] = "3"
if __name__ == "__main__":
    with dask_executor("local", 1, 1 << 28) as executor:
        assert executor.workers == 1
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    print({name: os.environ.get(name) for name in names})
"""


class Cluster:
    """A scheduler and a worker process group of one's own, at an address that stays the same."""

    def __init__(self, folder: Path, workers: int, threads: int = 1) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.folder, self.workers, self.threads = folder, workers, threads
        self.processes: list[subprocess.Popen[bytes]] = []
        self.start()

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def start(self) -> None:
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
        size = ["--nworkers", str(self.workers), "--nthreads", str(self.threads)]
        self._begin(scheduler)
        self._begin(["worker", self.address, *size, "--no-dashboard", "--death-timeout", "60"])

    def _begin(self, words: list[str]) -> None:
        with (self.folder / f"dask-{words[0]}.log").open("ab") as log:
            # Not in the tests' folder: what stands there could be taken for a package.
            process = subprocess.Popen(
                [*DASK, *words], cwd=self.folder, env=environment(), stdout=log, stderr=log
            )
        self.processes.append(process)

    @property
    def scheduler(self) -> subprocess.Popen[bytes]:
        return self.processes[-2]

    @property
    def nanny(self) -> subprocess.Popen[bytes]:
        return self.processes[-1]

    def stop(self) -> None:
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Callable[..., Cluster]]:
    made: list[Cluster] = []

    def make(workers: int, threads: int = 1) -> Cluster:
        made.append(Cluster(tmp_path, workers, threads))
        return made[-1]

    yield make
    for each in made:
        each.stop()


def begun(folder: Path, text: str, states: int, *words: str) -> subprocess.Popen[str]:
    """A sweep that runs, once so many states are on disk."""
    (folder / "sweep.yaml").write_text(text)
    process = spawn("sweep", "sweep.yaml", *words, cwd=folder)
    while len(commits(folder / "runs")) < states:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    return process


def finish(folder: Path, expected: object, before: dict[Path, int], *words: str) -> None:
    result = run("sweep", "sweep.yaml", *words, cwd=folder)
    assert result.returncode == 0, result.stderr
    assert hashes(folder / "runs") == expected
    assert before.items() <= commits(folder / "runs").items()


def test_a_cluster_made_here_gives_the_same_bytes_and_fails_points_alone(tmp_path, whole):
    (tmp_path / "sweep.yaml").write_text(MIXED)
    result = run("sweep", "sweep.yaml", "--dask", "local", "--workers", "2", "--json", cwd=tmp_path)
    assert result.returncode == 3, result.stderr
    assert parse_json(result.stdout)["counts"]["done"] == 3
    assert hashes(tmp_path / "runs") == whole(MIXED)
    assert "mixed-n3-schoenke-b1.7" in result.stderr


def test_a_cluster_made_here_leaves_the_environment_as_it_was(tmp_path):
    (tmp_path / "script.py").write_text(ENVIRONMENT)
    told = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert told.stdout == (
        "{'OMP_NUM_THREADS': '3', 'MKL_NUM_THREADS': None, 'OPENBLAS_NUM_THREADS': None}\n"
    ), told.stderr


def test_a_killed_scheduler_leaves_what_is_committed(tmp_path, cluster, whole):
    """Its workers end with it; once there is another, the same line finishes."""
    dask = cluster(2)
    line = ("--dask", dask.address)
    process = begun(tmp_path, BANDS, 4, *line)
    runs = workers_of(dask.nanny.pid)
    assert len(runs) == 2
    dask.scheduler.kill()
    _, told = process.communicate(timeout=120)
    assert process.returncode == 3, told
    assert "ribbon: the Dask scheduler has gone: what is committed is kept" in told
    assert all(map(ended, runs))
    dask.nanny.wait(60)
    before = commits(tmp_path / "runs")
    dask.start()
    finish(tmp_path, whole(BANDS), before, *line)


def test_a_killed_sweep_leaves_runs_to_the_cluster_and_its_next_line_waits_for_them(tmp_path, cluster, whole):
    dask = cluster(2)
    line = ("--dask", dask.address)
    process = begun(tmp_path, BANDS, 4, *line)
    process.kill()
    process.communicate()
    finish(tmp_path, whole(BANDS), {}, *line)


def test_an_interrupted_sweep_ends_its_runs_on_the_cluster(tmp_path, cluster, whole):
    """Cancelling a task that runs would say that it had ended, and let it run on."""
    dask = cluster(2)
    line = ("--dask", dask.address)
    process = begun(tmp_path, BANDS, 4, *line)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 130, told
    until = time.monotonic() + 10
    while any(run.holder() for run in list_runs(tmp_path / "runs")):
        assert time.monotonic() < until
        time.sleep(0.05)
    states = len(commits(tmp_path / "runs"))
    time.sleep(1.0)
    assert len(commits(tmp_path / "runs")) == states
    finish(tmp_path, whole(BANDS), commits(tmp_path / "runs"), *line)


def test_what_dies_on_a_dask_worker_harms_its_point_alone(tmp_path, cluster, whole):
    """Two runs are side by side in the threads of one worker; one of their processes is killed."""
    dask = cluster(1, threads=2)
    process = begun(tmp_path, BANDS, 4, "--dask", dask.address)
    victims = workers_of(dask.nanny.pid)
    assert len(victims) == 2
    os.kill(victims[0], signal.SIGKILL)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    finish(tmp_path, whole(BANDS), commits(tmp_path / "runs"))


def test_a_dask_worker_that_is_killed_is_replaced(tmp_path, cluster, whole):
    dask = cluster(2)
    process = begun(tmp_path, BANDS, 4, "--dask", dask.address)
    victim = workers_of(dask.nanny.pid)[0]
    parent = int(Path(f"/proc/{victim}/stat").read_text().rpartition(")")[2].split()[1])
    os.kill(parent, signal.SIGKILL)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    assert ended(victim)
    finish(tmp_path, whole(BANDS), commits(tmp_path / "runs"))


def test_a_retry_on_the_same_scheduler_is_no_result_from_before(tmp_path, cluster):
    dask = cluster(1)
    (tmp_path / "sweep.yaml").write_text(MIXED)
    assert run("sweep", "sweep.yaml", "--dask", dask.address, cwd=tmp_path).returncode == 3
    (kept,) = (tmp_path / "runs/sweeps/mixed/points").glob("*b1.7*.json")
    before = kept.stat().st_mtime_ns
    result = run("sweep", "sweep.yaml", "--dask", dask.address, "--retry", cwd=tmp_path)
    assert result.returncode == 3
    assert "[1/1] mixed-n3-schoenke-b1.7: failed" in result.stderr
    assert kept.stat().st_mtime_ns > before


def test_no_scheduler_is_a_usage_error(tmp_path):
    (tmp_path / "sweep.yaml").write_text(MIXED)
    result = run("sweep", "sweep.yaml", "--dask", "tcp://127.0.0.1:1", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert "ribbon: --dask: no scheduler answers at tcp://127.0.0.1:1" in result.stderr
