"""The process that points are run in: it takes them one by one from its parent, and ends with it."""

from __future__ import annotations

import os
import signal
import sys
import time
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from types import FrameType
from typing import Any, NoReturn

from ..solver import threads
from ..study.process import Stopped, heed, stop
from ..study.progress import Event, Step
from .point import Task, solve_point

_GRACE = 5.0
"""Seconds for a solve to notice that it is to stop; a kill does no harm either."""


def main(descriptor: int) -> None:
    """Run tasks from a connection until it ends; SIGTERM leaves a run that resumes."""
    threads.use(1)  # other workers have the other cores
    # Ctrl-C in a terminal is the parent's to hear.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    heed(signal.SIGTERM)
    if signal.getsignal(signal.SIGTERM) is not signal.SIG_IGN:
        signal.signal(signal.SIGTERM, _stop_once)
    connection: Connection[Any, Any] = Connection(descriptor)
    tasks: SimpleQueue[Task] = SimpleQueue()
    Thread(target=_listen, args=(connection, tasks), daemon=True).start()

    def tell(event: Event) -> None:
        if not isinstance(event, Step):
            connection.send(event)

    try:
        connection.send(None)
        while True:
            connection.send(solve_point(tasks.get(), tell))
    except Stopped as stopped:
        sys.exit(128 + stopped.number)
    except OSError:  # nobody listens
        sys.exit(128 + signal.SIGTERM)


def _stop_once(number: int, frame: FrameType | None) -> NoReturn:
    """Stop at the first signal, and let locks go undisturbed by a second."""
    signal.signal(number, signal.SIG_IGN)
    stop(number, frame)


def _listen(connection: Connection[Any, Any], tasks: SimpleQueue[Task]) -> None:
    """Take in tasks; where the parent has gone, whatever became of it, end."""
    try:
        while True:
            tasks.put(connection.recv())
    except (EOFError, OSError):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE)
        os._exit(128 + signal.SIGTERM)
