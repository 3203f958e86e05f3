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
from .pool import Told

_own = threading.local()
_in_hand: dict[str, Child] = {}
"""Worker processes at work, by the run of their point."""


def run_in_child(task: Task) -> Told:
    """Run a point in this thread's worker process, started where there is none."""
    child: Child | None = getattr(_own, "child", None)
    if child is None or child.ended:
        child = _own.child = Child()
    _in_hand[task.run] = child
    child.give(task)
    try:
        while True:
            message = child.receive()
            if isinstance(message, tuple):
                return message
    except EOFError:
        _own.child = None
        child.connection.close()
        return Result(task.run, "failed", (child.obituary(),), again=True), ""
    finally:
        _in_hand.pop(task.run, None)


def end_runs(runs: Iterable[str]) -> None:
    """End the processes at work on these runs, which leaves runs that resume."""
    for run in runs:
        child = _in_hand.get(run)
        if child is not None:
            child.process.terminate()
