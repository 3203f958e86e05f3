"""Executors: what runs the points of a sweep. Here are this process, and processes on this machine."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import wait
from typing import Protocol

from ..errors import RibbonError
from ..store import Result
from ..study.progress import Event
from .child import Child
from .point import Task, solve_point

MOST_DEATHS = 2
"""A point whose worker has died so many times is given up until the next time."""
_GRACE = 10.0
"""Seconds that workers have to end before they are killed."""

Told = tuple[Result, str]
"""What a point came to, and the traceback of an error of the program's own."""
Tell = Callable[[Task, Event], object]
"""Who hears of the events of a point."""


class Executor(Protocol):
    """Runs points, and gives what each came to as it comes; closed early, it leaves runs that resume.

    A worker that dies harms the point alone that it was at.
    """

    workers: int

    def run(self, tasks: Iterable[Task], tell: Tell) -> Iterator[Told]:
        """What each of the tasks came to, in any order. Raises RibbonError where no more can be run."""


class Here:
    """Runs points one after the other in this process: the element of a job array."""

    workers = 1

    def run(self, tasks: Iterable[Task], tell: Tell) -> Iterator[Told]:
        """See `Executor`."""
        for task in tasks:
            yield solve_point(task, lambda event, task=task: tell(task, event))  # type: ignore[misc]


class Processes:
    """Runs points in worker processes of this machine, each of which takes one at a time."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def run(self, tasks: Iterable[Task], tell: Tell) -> Iterator[Told]:
        """See `Executor`."""
        left, deaths = deque(tasks), Counter[str]()
        children: list[Child] = []
        try:
            while left or any(child.task for child in children):
                self._hand_out(left, children)
                busy = {child.connection: child for child in children if child.task is not None}
                for connection in wait(list(busy)):
                    child = busy[connection]  # type: ignore[index]
                    task = child.task
                    assert task is not None
                    try:
                        message = child.receive()
                    except EOFError:
                        children.remove(child)
                        yield from _died(child, task, deaths, left)
                        continue
                    if isinstance(message, tuple):
                        yield message
                    elif message is not None:
                        tell(task, message)
        finally:
            _end(children)

    def _hand_out(self, left: deque[Task], children: list[Child]) -> None:
        """Give every idle worker a point, and start workers as long as there are points for them."""
        for child in [child for child in children if child.task is None and child.ended]:
            child.connection.close()
            children.remove(child)
        for child in children:
            if child.task is None and left:
                child.give(left.popleft())
        while left and len(children) < self.workers:
            children.append(Child())
            children[-1].give(left.popleft())


def _died(child: Child, task: Task, deaths: Counter[str], left: deque[Task]) -> Iterator[Told]:
    """A worker has died: its point is tried once more, then given up until the next time.

    Raises RibbonError for a worker that did not even start.
    """
    how = child.obituary()
    child.connection.close()
    if not child.ready:
        raise RibbonError(f"worker processes do not start: {how}")
    deaths[task.run] += 1
    if deaths[task.run] < MOST_DEATHS:
        left.append(task)
    else:
        yield Result(task.run, "failed", (f"{how}, and so was the one before",), again=True), ""


def _end(children: list[Child]) -> None:
    """End all workers, those at work as well."""
    for child in children:
        child.stop()
    until = time.monotonic() + _GRACE
    for child in children:
        child.gone(max(0.1, until - time.monotonic()))
