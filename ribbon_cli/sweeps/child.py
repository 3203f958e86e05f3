"""A worker process, seen from its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing import Pipe

from ..store import Result
from ..study.process import ONE_THREAD
from ..study.progress import Event
from .point import Task

_CODE = """\
import sys
sys.path[:] = sys.argv[2:]
from ribbon_cli.sweeps.worker import main
main(int(sys.argv[1]))
"""

Message = Event | tuple[Result, str]
"""What a worker sends: an event of the point that it runs, or what the point came to."""


class Child:
    """A fresh process with the package of this one and one thread of BLAS; `task` is what it was given.

    It is in a process group of its own, so that Ctrl-C in a terminal reaches its parent alone.
    """

    def __init__(self) -> None:
        self.connection, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-c", _CODE, str(theirs.fileno()), *sys.path],
                env=os.environ | ONE_THREAD,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                process_group=0,
            )
        self.task: Task | None = None
        self.ready = False

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self.process.poll() is not None

    def give(self, task: Task) -> None:
        """Hand over the next point; that nobody is there to take it, `receive` will tell."""
        self.task = task
        with suppress(OSError):
            self.connection.send(task)

    def receive(self) -> Message | None:
        """What the worker says next; None when it is ready. Raises EOFError where it has ended."""
        try:
            message: Message | None = self.connection.recv()
        except OSError as error:
            raise EOFError from error
        self.ready = True
        if isinstance(message, tuple):
            self.task = None
        return message

    def obituary(self) -> str:
        """How an ended process ended."""
        code = self.process.wait()
        if code >= 0:
            return f"its worker ended with exit code {code}"
        name = signal.Signals(-code).name
        return f"its worker was killed by {name}" + " (out of memory?)" * (name == "SIGKILL")

    def stop(self) -> None:
        """Tell the process to end: one that is at work by a signal, which leaves a run that resumes."""
        if self.task is not None:
            self.process.terminate()
        else:
            self.connection.close()

    def gone(self, seconds: float) -> None:
        """Wait for its end for so long, then kill it."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.connection.close()
