"""Work on several cores within one process, with the bits that one core gives.

numpy lets go of Python's lock while it computes, so that threads are of use where each call takes far longer
than what is between calls.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

T = TypeVar("T")
R = TypeVar("R")

_most = 4
"""Threads at most: what is between numpy's calls is done by one at a time."""


def use(most: int) -> None:
    """Let at most so many threads work from now on: one, where processes share the cores."""
    global _most
    _most = most


_helped = threading.local()


def cpu_seconds() -> float:
    """Processor time of this thread so far, with that of the threads that worked for it."""
    return time.thread_time() + float(getattr(_helped, "seconds", 0.0))


def cores() -> int:
    """How many cores this process may use."""
    known = getattr(os, "sched_getaffinity", None)
    return len(known(0)) if known is not None else os.cpu_count() or 1


def mapped(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """What a function gives for each item, in their order; calls must not depend on one another.

    Threads end with the call, since a process is copied while it has one alone. What the first call to fail
    raises is raised, and so is what interrupts the wait; calls not begun by then are left out.
    """

    handling = np.geterr()  # of floating-point errors: threads begin without what holds here

    def call(item: T) -> tuple[R, float]:
        began = time.thread_time()
        with np.errstate(**handling):
            return function(item), time.thread_time() - began

    todo = list(items)
    count = min(cores(), len(todo), _most)
    if count < 2:
        return [function(item) for item in todo]
    pool = ThreadPoolExecutor(count)
    try:
        calls = [pool.submit(call, item) for item in todo]
        found = [each.result() for each in calls]
        _helped.seconds = getattr(_helped, "seconds", 0.0) + sum(seconds for _, seconds in found)
        return [result for result, _ in found]
    finally:
        pool.shutdown(cancel_futures=True)
