"""Dask: an executor on a scheduler that runs elsewhere, on one made here, or on jobs of Slurm.

Its dependencies are the extra `cluster`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any
from uuid import uuid4

from ..config import load_cluster
from ..errors import RibbonError, TargetError, UsageError
from ..store import Result
from .dask_worker import end_runs, run_in_child
from .point import Task
from .pool import Tell, Told

_SECONDS = "10s"
"""For a scheduler to answer."""
_QUIET = 40
"""Level of messages from which a cluster made here is heard: errors."""


class Dask:
    """Runs points on the workers of a Dask scheduler; see `Executor`."""

    def __init__(self, client: Any, workers: int) -> None:
        self.workers = workers
        self._client = client

    def run(self, tasks: Iterable[Task], tell: Tell) -> Iterator[Told]:
        """See `Executor`. Raises TargetError where the scheduler has gone."""
        distributed = _package("distributed")
        # Keys of their own: equal ones would share a result, also with what another client asked for before.
        asked = {self._submit(task): task for task in tasks}
        left = dict(asked)
        try:
            for future in distributed.as_completed(list(asked)):
                yield self._told(future, left.pop(future))
        finally:
            self._end(left)

    def _submit(self, task: Task) -> Any:
        return self._client.submit(run_in_child, task, key=f"{task.run}-{uuid4().hex}", pure=False, retries=0)

    def _told(self, future: Any, task: Task) -> Told:
        if future.status == "finished":
            told: Told = future.result()
            return told
        if future.status == "error":
            error = future.exception()
            words = " ".join(f"{type(error).__name__}: {error}".split())
            return Result(task.run, "failed", (f"its Dask worker: {words}",), again=True), ""
        raise TargetError("the Dask scheduler has gone: what is committed is kept, and the same line resumes")

    def _end(self, left: dict[Any, Task]) -> None:
        """Take back what has not begun, and end what is in hand, which cancelling alone would not."""
        if left:
            with suppress(Exception):
                self._client.cancel(list(left))
                self._client.run(end_runs, [task.run for task in left.values()])


@contextmanager
def dask_executor(where: str, workers: int, memory: int) -> Iterator[Dask]:
    """An executor on `local`, on the scheduler at an address, or on jobs that a settings file describes.

    Where it is `local`, `workers` are threads of this process: each hands its points to a worker process of
    its own. They hold one point at a time, so that none waits while a worker is idle. `memory` is what a run
    needs, in bytes. Raises UsageError for no scheduler, RibbonError without Dask, ConfigError for the file.
    """
    distributed = _package("distributed")
    if where == "local":
        with (
            _package("dask").config.set({"distributed.scheduler.worker-saturation": 1.0}),
            distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=False,
                dashboard_address=None,
                memory_limit=0,
                silence_logs=_QUIET,
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield Dask(client, workers)
    elif where.lower().endswith((".yaml", ".yml")):
        settings = load_cluster(where)
        with _slurm(settings, memory) as cluster, distributed.Client(cluster) as client:
            cluster.scale(jobs=settings.jobs)
            yield Dask(client, settings.jobs)
    else:
        try:
            client = distributed.Client(where, timeout=_SECONDS)
        except (OSError, ValueError) as error:
            why = " ".join(str(error).split())
            raise UsageError(f"--dask: no scheduler answers at {where}: {why}") from error
        with client:
            yield Dask(client, max(1, sum(client.nthreads().values())))


def _slurm(settings: Any, memory: int) -> Any:
    """A cluster of Slurm's jobs, each with one worker on one processor."""
    jobqueue = _package("dask_jobqueue")
    given = {
        "queue": settings.partition,
        "account": settings.account,
        "walltime": settings.walltime,
        "log_directory": settings.logs,
    }
    return jobqueue.SLURMCluster(
        cores=1,
        processes=1,
        memory=f"{settings.memory or memory >> 20} MiB",
        python=sys.executable,
        job_extra_directives=list(settings.directives),
        scheduler_options={"dashboard_address": None},
        silence_logs=_QUIET,
        **{key: value for key, value in given.items() if value is not None},
    )


def _package(name: str) -> ModuleType:
    """A package of the extra. Raises RibbonError, saying how to get it, where it is missing."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        advice = "`pip install -e '.[cluster]'` in ribbon's folder brings it"
        raise RibbonError(
            f"--dask needs {name.replace('_', '-')}, which is not installed: {advice}"
        ) from error
