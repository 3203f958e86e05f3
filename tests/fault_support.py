"""Forked children for the tests of faults: killed, limited, or left to run. Forking costs milliseconds,
starting
Python half a second."""

from __future__ import annotations

import mmap
import os
import resource
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ribbon_cli.config import load_config
from ribbon_cli.store import Run
from ribbon_cli.study import solve_config

QUICK = """\
name: quick
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 12, half_width: 0.1, steps: 4}
widths: [0.1]
spectrum: {modes: 2, full_up_to: 0}
"""
"""Six states, one of them a saddle met on the way, in some tenths of a second."""


_SECONDS = struct.Struct("d")


@dataclass(frozen=True)
class Ended:
    """How a child ended: its exit code, or minus the signal; what it wrote; seconds of processor; bytes of
    memory.
    """

    code: int
    output: str
    seconds: float
    memory: int


def child(action: Callable[[], object]) -> int:
    """Fork, do something in the child, and return its pid; the child leaves with 0, or with 70 and a
    traceback.
    """
    pid = os.fork()
    if pid:
        return pid
    code = 70
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        code = int(action() or 0)
    except BaseException:  # noqa: BLE001  (whatever it is, the child must not go on as the parent)
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def wait(pid: int) -> int:
    """Exit code of a child, or minus the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def limited(action: Callable[[], object], folder: Path, seconds: int = 2, memory: int = 2**30) -> Ended:
    """Run a child to its end with limits on processor time, and on memory beyond what it is born with."""
    log = folder / "child.log"

    def bounded() -> object:
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        born = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (born + memory, born + memory))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        return action()

    pid = child(bounded)
    _, status, usage = os.wait4(pid, 0)
    output = log.read_bytes().decode(errors="replace")
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, output, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def solve_in(folder: Path) -> int:
    """Solve the quick config to its end; the exit code."""
    return solve_config(load_config(folder / "quick.yaml"), folder / "runs").exit_code


class Marks:
    """Memory shared with children: whether a commit is under way, and how many seconds the last one took."""

    def __init__(self) -> None:
        self.memory = mmap.mmap(-1, 1 + _SECONDS.size)

    def watch(self, monkeypatch) -> None:
        """Mark each commit, here and in children to come."""
        write = Run.write_state

        def marked(run, *state):
            self.memory[0] = 1
            started = time.monotonic()
            try:
                write(run, *state)
            finally:
                _SECONDS.pack_into(self.memory, 1, time.monotonic() - started)
                self.memory[0] = 0

        monkeypatch.setattr(Run, "write_state", marked)

    @property
    def committing(self) -> bool:
        return self.memory[0] == 1

    @property
    def seconds(self) -> float:
        """What the last commit took that came to its end; none did at first."""
        return _SECONDS.unpack_from(self.memory, 1)[0]


def kill_after(pid: int, seconds: float, marks: Marks | None = None) -> bool:
    """Kill a child some time from now or, with marks, from the begin of its next commit; whether it still
    ran.
    """
    deadline = time.monotonic() + 60.0
    while marks is not None and not marks.committing and time.monotonic() < deadline:
        if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            break
        time.sleep(0.0002)  # the child needs the processor more
    time.sleep(seconds)
    os.kill(pid, signal.SIGKILL)
    return wait(pid) == -signal.SIGKILL


def contents(run: Run) -> dict[int, str]:
    """Content hash of every state by label, each read and checked."""
    found = {}
    for label, entry in run.entries().items():
        run.load(label)
        found[label] = entry.state.content_sha256
    return found
