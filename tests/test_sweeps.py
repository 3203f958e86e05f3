"""Sweeps as they run: failures alone, nothing twice, where points stand, executors, job arrays."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from collections import Counter, deque
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cli_support import parse_json, ribbon, ribbon_json, run
from sweep_support import MIXED, RINGS, commits, hashes, workers_of

from ribbon_cli import study, sweeps
from ribbon_cli.api import names
from ribbon_cli.config import Sweep, load_sweep, parse_config
from ribbon_cli.errors import LockedError, RibbonError, StoreError, UsageError
from ribbon_cli.store import Run, SweepRecord, find_sweep, keep_sweep, mark_of
from ribbon_cli.sweeps import pool, resources
from ribbon_cli.sweeps.point import Task, solve_point


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("RIBBON_RUNS", "SLURM_ARRAY_TASK_ID"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sweep `mixed`, run by two workers; what it printed is in result.json."""
    folder = tmp_path_factory.mktemp("swept")
    (folder / "mixed.yaml").write_text(MIXED)
    words = ("sweep", folder / "mixed.yaml", "--runs", folder / "runs", "--workers", "2", "--json")
    result = ribbon(*words)
    told = {"out": result.stdout, "err": result.stderr, "code": result.exit_code}
    (folder / "result.json").write_text(json.dumps(told))
    return folder


@pytest.fixture
def mixed(swept: Path, folder: Path) -> Path:
    """A copy of that folder, as the one to work in."""
    shutil.copytree(swept, folder, dirs_exist_ok=True)
    return folder


def loaded(name: str) -> tuple[Sweep, SweepRecord]:
    sweep = load_sweep(name)
    return sweep, keep_sweep(Path("runs"), sweep)


def left(name: str, retry: bool = False) -> list[str]:
    """Names of the points that the same line would run."""
    sweep, record = loaded(name)
    found = sweeps.what_is_left(sweep, record, Path("runs"), range(len(sweep.points)), retry)
    return sorted(task.point.name for task in found.tasks)


def statuses() -> list[str]:
    return [point["status"] for point in ribbon_json("ls", "mixed")]


def test_a_point_that_fails_stops_no_other_and_is_named(swept):
    told = json.loads((swept / "result.json").read_text())
    document = parse_json(told["out"])
    assert (told["code"], document["exit_code"]) == (3, 3)
    assert document["counts"] == {"done": 3, "failed": 1, "running": 0, "unfinished": 0, "missing": 0}
    bad = document["points"][2]
    assert (bad["name"], bad["status"]) == ("mixed-n3-schoenke-b1.7", "failed")
    assert bad["failures"][0].startswith("b = 1.7, N = 24: not reached: ")
    assert bad["values"]["initial_guess.half_width"] == 1.7
    assert [point["new_states"] for point in document["points"]] == [1, 1, 0, 1]
    assert f"ribbon: {bad['run']}: b = 1.7, N = 24: not reached" in told["err"]
    assert "[4/4] " in told["err"]


def test_failures_are_not_repeated_unless_asked(mixed):
    before = commits(mixed / "runs")
    assert left("mixed.yaml") == []
    assert left("mixed.yaml", retry=True) == ["mixed-n3-schoenke-b1.7"]
    result = ribbon("sweep", "mixed.yaml")
    assert (result.exit_code, result.stdout) == (3, "mixed: 3 done, 1 failed\n")
    assert "0 new states" in result.stderr
    assert result.stderr.count("mixed-n3-schoenke-b1.7-") == 1
    assert commits(mixed / "runs") == before


def test_ls_tells_where_each_point_stands_and_why(mixed):
    result = ribbon("ls", "mixed")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == "3 done, 1 failed"
    assert "failed  b = 1.7, N = 24: not reached: " in result.stdout
    assert ribbon_json("ls", "mixed", "--status", "failed")[0]["name"] == "mixed-n3-schoenke-b1.7"
    assert ribbon("ls", "mixed", "--all").exit_code == 2
    assert ribbon("ls", "mixed-n0-cylinder-b0.1").exit_code == 0
    line = {"COMP_LINE": "ribbon ls mi", "COMP_POINT": "12", "COMP_WORDBREAKS": ":="}
    asked = {"_RIBBON_COMPLETE": "bash_complete", **line}
    assert "plain,mixed\n" in run("ls", "mi", cwd=mixed, **asked).stdout


def test_what_was_kept_of_a_point_is_not_believed_once_its_run_has_changed(mixed):
    record = find_sweep(Path("runs"), "mixed")
    assert record is not None
    gone, lost, refined, failed = (record.points[k].path for k in (0, 1, 3, 2))
    assert statuses() == ["done", "done", "failed", "done"]
    shutil.rmtree(gone)
    (lost / "states" / "0001.h5").unlink()
    study.refine_state(Path("runs"), f"{refined.name}:1", to=30)
    with Run(failed).writing():
        assert statuses() == ["missing", "failed", "failed", "done"]
    (point,) = ribbon_json("ls", "mixed", "--status", "missing")
    assert point["run"] == gone.name
    assert "state 1 is missing" in ribbon("ls", "mixed").stdout
    assert left("mixed.yaml") == [
        "mixed-n0-cylinder-b0.1",
        "mixed-n0-cylinder-b0.2",
        "mixed-n0-cylinder-b0.3",
    ]


def test_a_state_whose_bytes_were_changed_is_told(mixed):
    record = find_sweep(Path("runs"), "mixed")
    assert record is not None
    path = record.points[0].path / "states" / "0001.h5"
    data = path.read_bytes()
    path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    assert statuses()[0] == "failed"
    result = ribbon("sweep", "mixed.yaml", "--array-index", "0")
    assert result.exit_code == 3
    assert "damaged: not the bytes that were committed" in result.stderr
    path.write_bytes(data)
    # A damaged file is no verdict on the point: mended, it is tried again without being asked.
    assert ribbon("sweep", "mixed.yaml", "--array-index", "0").exit_code == 0


def test_points_are_the_runs_that_solve_makes_whoever_runs_them(mixed):
    """The pool's bytes are those of `ribbon solve`, and of the elements of a job array."""
    sweep, _ = loaded("mixed.yaml")
    for index, point in enumerate(sweep.points):
        result = ribbon("sweep", "mixed.yaml", "--array-index", str(index), "--runs", "array")
        assert result.exit_code == (3 if index == 2 else 0)
        study.solve_config(parse_config(point.written("mixed").text, "point.yaml"), Path("solved"))
    assert hashes(Path("array")) == hashes(Path("solved")) == hashes(Path("runs"))


def test_the_schedulers_own_variable_chooses_the_point(mixed, monkeypatch):
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "3")
    result = ribbon("sweep", "mixed.yaml", "--runs", "one")
    assert (result.exit_code, result.stdout) == (0, "mixed: 1 done\n")
    assert "SLURM_ARRAY_TASK_ID 3: mixed-n0-cylinder-b0.3-" in result.stderr
    assert list(hashes(Path("one"))) == [run for run in hashes(Path("runs")) if "b0.3" in run]
    # Who asks for workers inside of a job array runs the whole sweep there.
    assert ribbon("sweep", "mixed.yaml", "--workers", "2").stdout == "mixed: 3 done, 1 failed\n"


@pytest.mark.parametrize("index", ["4", "-1", "x", "1:2:3:4", "2:2", "0:4:00", "9:9"])
def test_indices_that_name_no_point_are_refused(mixed, index):
    result = ribbon("sweep", "mixed.yaml", "--array-index", index)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--array-index: " in result.stderr


def test_an_index_may_name_every_so_many(mixed):
    result = ribbon_json("sweep", "mixed.yaml", "--array-index", "1:4:2")
    assert [point["name"][-4:] for point in result["points"]] == ["b0.2", "b0.3"]


def test_a_dry_run_tells_the_cost_and_writes_nothing(mixed):
    document = ribbon_json("sweep", "mixed.yaml", "--dry-run", "--runs", "new")
    assert not Path("new").exists()
    costs = [point["cost_seconds"] for point in document["points"]]
    assert sum(costs) == document["cost_seconds"] > 0.0
    config = load_sweep("mixed.yaml").points[2].config
    assert costs[2] == study.plan_of(config).cost
    result = ribbon("sweep", "mixed.yaml", "--dry-run")
    assert result.stdout.splitlines()[-1].startswith("0 of 4 runs left, about 0.0 s on one core")
    one = ribbon("sweep", "mixed.yaml", "--dry-run", "--retry", "--array-index", "2").stdout
    assert one.splitlines()[1].startswith("mixed-n3-schoenke-b1.7-")
    assert "1 of 1 runs left" in one


def test_invalid_points_are_all_told_before_anything_runs(folder):
    Path("bad.yaml").write_text(MIXED.replace("[0.1, 0.2, 1.7, 0.3]", "[0.1, -1, 1.7, 9]"))
    result = ribbon("sweep", "bad.yaml")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.splitlines() == [
        "bad.yaml:8:37: initial_guess.half_width: must be > 0, got -1",
        "bad.yaml:8:46: initial_guess.half_width: must be < 6.28319, the band's length, got 9",
    ]
    Path("state.yaml").write_text(
        "config: {topology: {half_twists: 0}, initial_guess: {state: x}}\n"
        "vary: [{initial_guess.state: ['ring:1', 'no.npz']}]\n"
    )
    result = ribbon("sweep", "state.yaml")
    assert (result.exit_code, result.stdout) == (2, "")
    assert [line.split(": ")[0] for line in result.stderr.splitlines()] == [
        "state.yaml:2:31",
        "state.yaml:2:41",
    ]
    assert not Path("runs/sweeps/state").exists()


def test_options_that_do_not_go_together(mixed):
    for words in (["--dask", "tcp://x", "--workers", "2"], ["--array-index", "0", "--workers", "2"]):
        result = ribbon("sweep", "mixed.yaml", "--retry", *words)
        assert (result.exit_code, result.stdout) == (2, "")


def test_what_goes_wrong_in_one_point_is_its_result(folder, monkeypatch):
    """Of the program's own errors alone it is taken that they would come again."""
    Path("rings.yaml").write_text(RINGS)
    sweep, record = loaded("rings.yaml")
    task = Task("runs", str(record.folder), sweep.points[0], ())
    errors: list[Exception] = [
        StoreError("no space"),
        MemoryError(),
        OSError(5, "broken"),
        UsageError("no state"),
    ]
    for error in [*errors, ZeroDivisionError("oops")]:

        def fail(*_: Any, error: Exception = error, **__: Any) -> Any:
            raise error

        monkeypatch.setattr(study, "solve_config", fail)
        result, trace = solve_point(task)
        internal = isinstance(error, ZeroDivisionError)
        assert (result.status, result.again, bool(trace)) == ("failed", not internal, internal)
        assert left("rings.yaml") == sorted(p.name for p in sweep.points[int(internal) :])
    assert result.failures == ("internal error: ZeroDivisionError: oops",)
    (point,) = ribbon_json("ls", "rings", "--status", "failed")
    assert point["failures"] == list(result.failures)


def test_a_run_that_others_write_to_is_waited_for(folder, monkeypatch):
    """It comes last; the element of a job array does not wait, and says who writes."""
    Path("rings.yaml").write_text(RINGS)
    sweep, record = loaded("rings.yaml")
    everything = range(len(sweep.points))
    study.solve_config(sweep.points[0].written("rings"), Path("runs"))
    run = Run(record.points[0].path)
    told: list[Any] = []
    run.path.joinpath("log.jsonl").write_bytes(run.log_path.read_bytes().splitlines(keepends=True)[0])
    (run.path / "states" / "0001.h5").unlink()
    with run.writing():
        result = ribbon("sweep", "rings.yaml", "--array-index", "0")
        assert result.exit_code == 5
        assert f"others write to it: {run.name}" in result.stderr or f"process {os.getpid()}" in result.stderr
        assert statuses_of(record)[0] == "running"
        holding = [True]

        def sleep(_: float) -> None:
            holding.clear()
            run._lock.release()

        monkeypatch.setattr(sweeps.run.time, "sleep", sleep)
        remaining = sweeps.what_is_left(sweep, record, Path("runs"), everything, False)
        outcome = sweeps.run_sweep(record, remaining, everything, sweeps.Here(), told.append)
    assert not holding
    assert outcome.exit_code == 0
    assert [type(event).__name__ for event in told if not isinstance(event, sweeps.Within)][-2:] == [
        "Waiting",
        "Ended",
    ]
    assert told[-1].task.point is sweep.points[0]


def statuses_of(record: SweepRecord) -> list[str]:
    return [point.status for point in sweeps.standings(record)]


def test_a_worker_that_dies_harms_its_point_alone(folder):
    """And not even that: it is tried once more. Killed twice, it is given up until the next time."""
    Path("rings.yaml").write_text(RINGS)
    sweep, record = loaded("rings.yaml")
    everything, killed = range(len(sweep.points)), Counter[str]()
    deaths = {sweep.points[1].run: 1, sweep.points[2].run: pool.MOST_DEATHS}

    def kill(event: sweeps.SweepEvent) -> None:
        if isinstance(event, sweeps.Within) and killed[event.task.run] < deaths.get(event.task.run, 0):
            killed[event.task.run] += 1
            (worker,) = workers_of(os.getpid())
            os.kill(worker, signal.SIGKILL)

    remaining = sweeps.what_is_left(sweep, record, Path("runs"), everything, False)
    outcome = sweeps.run_sweep(record, remaining, everything, sweeps.Processes(1), kill)
    assert killed == deaths
    assert [point.status for point in outcome.points] == ["done", "done", "failed", "done", "done", "done"]
    assert outcome.failures[0][1].startswith("its worker was killed by SIGKILL (out of memory?)")
    assert workers_of(os.getpid()) == []
    assert left("rings.yaml") == [sweep.points[2].name]
    assert ribbon("sweep", "rings.yaml", "-q").stdout == "rings: 6 done\n"


def test_workers_that_do_not_start_end_the_sweep(monkeypatch):
    ours, theirs = Pipe()
    theirs.close()
    child = SimpleNamespace(
        obituary=lambda: "its worker ended with exit code 1", connection=ours, ready=False
    )
    with pytest.raises(RibbonError, match="worker processes do not start: its worker ended with exit code 1"):
        list(pool._died(child, SimpleNamespace(run="x"), Counter(), deque()))


def test_workers_are_bounded_by_processors_memory_and_runs(folder, monkeypatch):
    Path("rings.yaml").write_text(RINGS)
    configs = [point.config for point in load_sweep("rings.yaml").points]
    need = resources.memory_of(configs)
    monkeypatch.setattr(resources, "cores", lambda: 4)
    monkeypatch.setattr(resources, "free_memory", lambda: 100 * need)
    assert resources.workers_for(None, configs) == (4, "")
    assert resources.workers_for(2, configs) == (2, "")
    assert resources.workers_for(9, configs) == (4, "9 workers asked for, 4 taken: there are 4 processors")
    assert resources.workers_for(None, configs[:1]) == (1, "")
    monkeypatch.setattr(resources, "free_memory", lambda: 2 * need + 1)
    taken, why = resources.workers_for(4, configs)
    assert (taken, why.partition(": ")[2]) == (2, f"there are memory for 2, of {need >> 20} MiB each")
    large = parse_config(configs[0].text or sweep_text(3200), "large.yaml")
    full = parse_config(sweep_text(400, "spectrum: {full_up_to: 400}\n"), "full.yaml")
    assert resources.memory_of([large]) > need + 200 * 2**20
    assert resources.memory_of([full]) > need + 300 * 2**20


def sweep_text(segments: int, more: str = "") -> str:
    guess = f"initial_guess: {{recipe: cylinder, segments: {segments}, half_width: 0.1}}\n"
    return f"topology: {{half_twists: 0}}\n{guess}{more}"


def test_limits_of_control_groups_are_heeded(tmp_path, monkeypatch):
    monkeypatch.setattr(resources, "_GROUP", tmp_path)
    plain, memory = resources.cores(), resources.free_memory()
    assert memory is None or memory > 0
    (tmp_path / "cpu.max").write_text("100000 100000\n")
    (tmp_path / "memory.max").write_text("1000\n")
    (tmp_path / "memory.current").write_text("900\n")
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 50\n")
    assert (resources.cores(), resources.free_memory()) == (1, 150)
    (tmp_path / "cpu.max").write_text("max 100000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert resources.cores() == plain


def test_the_script_for_slurm_is_a_shell_script_that_runs_points(mixed):
    """Run by sh with an index, it is the point of that index, and keeps its exit code."""
    assert names.SCRIPTS == sweeps.SCRIPTS
    text = ribbon("sweep", "mixed.yaml", "--script", "slurm").stdout
    assert "#SBATCH --array=0-3\n" in text
    # The signal is for the job's own process, and what it wrote stays when it is requeued.
    assert "#SBATCH --signal=B:TERM@60\n" in text
    assert "#SBATCH --open-mode=append\n" in text
    assert text.splitlines()[-1].startswith("exec ")
    Path("job.sh").write_text(text)
    shutil.rmtree("runs")
    job = subprocess.run(
        ["sh", "job.sh"], env=os.environ | {"SLURM_ARRAY_TASK_ID": "2"}, capture_output=True, text=True
    )
    assert job.returncode == 3, job.stderr
    assert statuses() == ["missing", "missing", "failed", "missing"]


def test_the_script_shares_points_where_there_are_more_than_an_array_may_have(folder):
    Path("rings.yaml").write_text(RINGS.replace("steps: 5", "steps: 2499"))
    text = ribbon("sweep", "rings.yaml", "--script", "slurm").stdout
    assert "#SBATCH --array=0-999\n" in text
    assert text.endswith('--retry --array-index "$SLURM_ARRAY_TASK_ID:2500:1000"\n')
    assert "2500 points, up to 3 an element" in text


def test_the_mark_of_a_run_changes_with_each_of_its_files(mixed):
    record = find_sweep(Path("runs"), "mixed")
    assert record is not None
    path = record.points[0].path
    marks = {mark_of(path)}
    (path / "states" / "0002.h5").write_bytes(b"")
    marks.add(mark_of(path))
    with open(path / "log.jsonl", "ab") as log:
        log.write(b"\n")
    marks.add(mark_of(path))
    (path / "lock.holder").write_text("nobody")
    assert len(marks) == 3
    assert mark_of(path) in marks
    assert mark_of(path / "nowhere") == ""


def test_a_bug_is_shown_to_those_who_debug(folder, monkeypatch):
    Path("rings.yaml").write_text(RINGS)

    def fail(*_: Any, **__: Any) -> Any:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(study, "solve_config", fail)
    result = ribbon("sweep", "rings.yaml", "--array-index", "0", "--debug")
    assert result.exit_code == 3
    assert "Traceback" in result.stderr
    assert "ribbon: rings-b0.1-" in result.stderr


def test_the_progress_names_failures_and_the_time_left():
    lines: list[str] = []
    from ribbon_cli.api.sweep_console import SweepLines
    from ribbon_cli.store import Result

    def task(name: str) -> Any:
        return SimpleNamespace(point=SimpleNamespace(name=name), cost=1.0)

    shown = SweepLines(False, lines.append)
    shown(sweeps.Began(10, 3, 3.0, 2))
    shown(sweeps.Within(task("a"), study.Note("unheard") if hasattr(study, "Note") else None))
    shown(sweeps.Ended(task("a"), Result("a", "done", seconds=1.0), ""))
    shown(sweeps.Ended(task("b"), Result("b", "failed", ("b = 1: no",)), ""))
    shown(sweeps.Waiting(("c",), "process 1 on x"))
    shown(sweeps.Ended(task("c"), Result("c", "held", (str(LockedError("locked")),)), ""))
    assert lines[0].startswith("[1/3] a: done, 1.0 s; about ")
    assert lines[1].startswith("[2/3] b: failed: b = 1: no; about ")
    assert lines[2] == "waiting for 1 run that others write to, first c: process 1 on x"
    assert lines[3] == "[3/3] c: held: locked"
