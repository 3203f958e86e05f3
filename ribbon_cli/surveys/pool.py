"""Tasks on several processes, their results in the order of the tasks.

Workers are spawned, each with one thread of BLAS, so that results have the bytes that one process gives them.
They end with the process that asked: its end of the pipe closes with it, however it is killed.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple, TypeVar

from ..errors import RibbonError
from ..solver import threads
from ..study.process import ONE_THREAD

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 8
"""Tasks a worker, beyond the first result that is missing: what is ahead of that is lost with a kill."""
_LEAVING = 2.0
"""Seconds that a worker has to end."""


class WorkerDiedError(RibbonError):
    """A worker was killed, as by a system that has no memory left; what was committed is kept."""


class _Worker(NamedTuple):
    process: BaseProcess
    connection: Connection


def in_order(work: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[R]:
    """Results of `work` on each task, in their order; with one worker they are computed here.

    `work` is a function of a module. Raises what it raises, and WorkerDiedError.
    """
    if workers < 2 or len(tasks) < 2:
        yield from map(work, tasks)
        return
    with _workers(work, min(workers, len(tasks))) as team:
        idle, busy = list(team), dict[Any, tuple[_Worker, int]]()
        ready: dict[int, R] = {}
        handed = done = 0
        while done < len(tasks):
            while idle and handed < min(len(tasks), done + AHEAD * len(team)):
                worker = idle.pop()
                worker.connection.send(tasks[handed])
                busy[worker.connection] = (worker, handed)
                handed += 1
            for connection in wait(list(busy)):
                worker, number = busy.pop(connection)
                ready[number] = _received(worker)
                idle.append(worker)
            while done in ready:
                yield ready.pop(done)
                done += 1


def _received(worker: _Worker) -> Any:
    try:
        failed, result = worker.connection.recv()
    except (EOFError, ConnectionError) as error:
        worker.process.join(_LEAVING)
        code = worker.process.exitcode
        raise WorkerDiedError(
            f"a worker ended with {code}: the same line goes on from what is committed; "
            "fewer workers need less memory"
        ) from error
    if failed:
        raise result
    return result


@contextmanager
def _workers(work: Callable[[T], R], count: int) -> Iterator[list[_Worker]]:
    """Processes that wait for tasks; at the end they are ended."""
    context = multiprocessing.get_context("spawn")
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    team: list[_Worker] = []
    with ExitStack() as stack:
        os.environ |= ONE_THREAD
        try:
            for _ in range(count):
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there, work), daemon=True)
                process.start()
                there.close()
                team.append(_Worker(process, here))
                stack.callback(_end, team[-1])
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
        yield team


def _end(worker: _Worker) -> None:
    worker.connection.close()
    worker.process.terminate()
    worker.process.join(_LEAVING)
    if worker.process.exitcode is None:
        worker.process.kill()
        worker.process.join()


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """The life of a worker; an interrupt from the terminal is for the process that asked."""
    threads.use(1)  # other workers have the other cores
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            task = connection.recv()
        except (EOFError, ConnectionError):
            return
        try:
            answer = (False, work(task))
        except Exception as error:  # noqa: BLE001  (raised where the result is asked for)
            answer = (True, error)
        try:
            connection.send(answer)
        except ConnectionError:
            return
