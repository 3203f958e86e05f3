"""What runs on a Dask worker: it hands points to worker processes of ours, and waits.

So a run that dies harms neither the Dask worker nor what runs beside it, BLAS has one thread whatever the
cluster says, and runs end with the Dask worker, however that ends.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable

from ..store import Result
from .child import Child
from .point import Task
from .pool import MOST_DEATHS, Told

_own = threading.local()
_in_hand: dict[str, Child] = {}
"""Worker processes at work, by the run of their point."""
_ended: set[str] = set()
"""Runs that were told to end, and are not to be tried again here."""


def run_in_child(task: Task) -> Told:
    """Run a point in this thread's worker process; one that dies is followed by another, once."""
    how = ""
    for _ in range(MOST_DEATHS):
        child: Child | None = getattr(_own, "child", None)
        if child is None or child.ended:
            child = _own.child = Child()
        told = _given_to(child, task)
        if told is not None:
            return told
        _own.child, how = None, child.obituary()
        if task.run in _ended:
            break
    _ended.discard(task.run)
    return Result(task.run, "failed", (how,), again=True), ""


def _given_to(child: Child, task: Task) -> Told | None:
    """What a point came to in a worker process; None where that has died."""
    _in_hand[task.run] = child
    child.give(task)
    try:
        while True:
            message = child.receive()
            if isinstance(message, tuple):
                return message
    except EOFError:
        child.connection.close()
        return None
    finally:
        _in_hand.pop(task.run, None)


def end_runs(runs: Iterable[str]) -> None:
    """End the processes at work on these runs, which leaves runs that resume."""
    for run in runs:
        child = _in_hand.get(run)
        if child is not None:
            _ended.add(run)
            child.process.terminate()
