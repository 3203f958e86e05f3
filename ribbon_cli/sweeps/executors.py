"""Which executor runs a sweep, by what was asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import UsageError
from .cluster import dask_executor
from .pool import Executor, Here, Processes
from .resources import memory_of, workers_for
from .run import Left


@contextmanager
def executor_for(
    left: Left,
    workers: int | None = None,
    dask: str | None = None,
    here: bool = False,
    tell: Callable[[str], object] | None = None,
) -> Iterator[Executor]:
    """The executor: this process alone (`here`), Dask, or worker processes; `tell` hears why they are fewer
    than asked for.

    Where nothing is left to run, none is started. Raises UsageError for options that do not go together.
    """
    if dask is not None and workers is not None and dask != "local":
        raise UsageError("--workers goes with worker processes of this machine: the cluster has its own")
    if here and (dask is not None or workers is not None):
        raise UsageError("--array-index runs in this process: leave out --workers and --dask")
    if here or not left.tasks:
        yield Here()
        return
    configs = [task.point.config for task in left.tasks]
    count, why = workers_for(workers, configs)
    if why and tell is not None:
        tell(why)
    if dask is None:
        yield Processes(count)
        return
    with dask_executor(dask, count, memory_of(configs)) as executor:
        yield executor
