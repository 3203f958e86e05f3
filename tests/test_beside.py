"""States that a second process makes: the same files in the same order, whatever becomes of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from cli_support import content_hashes

from ribbon_cli.store import beside

CONFIG = """\
name: small
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 12, half_width: 0.3}
widths: [0.3, 0.4, 0.5]
refinement: [12, 24]
spectrum: {modes: 4, full_up_to: 12}
"""
SOLVE = """\
import os, signal, sys
from pathlib import Path
from ribbon_cli.config import load_config
from ribbon_cli.store import beside
from ribbon_cli.study import solve_config
mode, asked = sys.argv[1], 0
beside.possible = lambda: mode != "alone"
ask = beside._Process.ask
def counted(process, make):
    global asked
    asked += 1
    if mode == "dying" and asked == 1:
        os.kill(process._pid, signal.SIGKILL)
    return ask(process, make)
beside._Process.ask = counted
outcome = solve_config(load_config("band.yaml"), Path(mode), second_process=mode != "off")
print(outcome.exit_code, outcome.new_states, asked)
"""
DIRECT = """\
import functools, os, sys, time
from ribbon_cli.store import beside
wrote = []
def publish(label, *made):
    if label == 3 and "failing" in sys.argv:
        while pair._waiting < beside.MOST_WAITING:
            time.sleep(0.001)
        raise OSError(28, "no space")
    wrote.append((label, *made))
made = functools.partial(divmod, 7, 2)
class Here:
    def __call__(self): return os.getpid(), 0
pair = beside.Beside(publish)
"""


def python(script: str, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", script, *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("beside")
    (folder / "band.yaml").write_text(CONFIG)
    assert python(SOLVE, "alone", cwd=folder).stdout.split()[::2] == ["0", "0"]
    return folder


def test_a_second_process_can_be_refused(alone: Path) -> None:
    assert python(SOLVE, "off", cwd=alone).stdout.split()[::2] == ["0", "0"]


@pytest.mark.parametrize("mode", ["beside", "dying"])
def test_files_and_their_order_are_those_of_one_process(alone: Path, mode: str) -> None:
    """Also where the second process ends."""
    code, new, asked = python(SOLVE, mode, cwd=alone).stdout.split()
    expected = content_hashes(alone / "alone")
    assert (code, new) == ("0", str(len(expected)))
    assert int(asked) > 0
    assert content_hashes(alone / mode) == expected
    (run,) = (alone / mode).iterdir()
    lines = (run / "log.jsonl").read_text().splitlines()
    labels = [line.partition('"label":')[2].partition(",")[0] for line in lines if '"label":' in line]
    assert labels == [str(k) for k in sorted(expected)]
    assert sorted(os.listdir(run)) == ["config.yaml", "lock", "log.jsonl", "resolved.yaml", "states"]


def test_states_are_committed_in_order() -> None:
    script = """
for k in range(9): pair.put(k, Here())
pair.settle()
print([label for label, *_ in wrote] == list(range(9)), os.getpid() in [m for _, m, _ in wrote], pair.behind)
for k in range(beside.MOST_WAITING): pair.put(k, functools.partial(time.sleep, 600))
print(pair.behind)
pair.end()
"""
    assert python(DIRECT + script).stdout == "True False False\nTrue\n"


def test_a_failure_is_raised_and_what_follows_is_dropped() -> None:
    script = """
try:
    for k in range(9): pair.put(k, made)
    pair.settle()
except OSError as error:
    print(error.strerror, len(wrote), pair._waiting)
pair.settle(); pair.end()
print(wrote == [(k, 3, 1) for k in range(3)])
"""
    assert python(DIRECT + script, "failing").stdout == "no space 3 0\nTrue\n"


def test_the_end_drops_what_waits() -> None:
    script = """
began = time.monotonic()
pair.put(0, functools.partial(time.sleep, 600))
for k in range(1, beside.MOST_WAITING): pair.put(k, made)
pair.end()
print(wrote, time.monotonic() - began < 60)
"""
    assert python(DIRECT + script).stdout == "[] True\n"


def test_no_process_outlives_a_kill_of_its_parent() -> None:
    script = """
pair.put(0, functools.partial(time.sleep, 600))
print(pair._process._pid, flush=True)
time.sleep(600)
"""
    command = [sys.executable, "-c", DIRECT + script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        second = int(parent.stdout.readline())
        there = os.path.exists(f"/proc/{second}")
        os.kill(parent.pid, signal.SIGKILL)
    assert there
    deadline = time.monotonic() + 30.0
    while os.path.exists(f"/proc/{second}") and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not os.path.exists(f"/proc/{second}")


def test_no_second_process_without_a_core_or_beside_other_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "listdir", lambda path: ["1"])
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    assert beside.possible()
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {1})
    assert not beside.possible()
    monkeypatch.undo()
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    try:
        assert not beside.possible()
    finally:
        stop.set()
        other.join()
