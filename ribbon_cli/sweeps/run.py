"""Runs what is left of a sweep. The same call again goes on where the last one ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from .. import study
from ..config import ConfigError, Mistake, Point, Sweep
from ..errors import LockedError, TargetError
from ..store import Result, Run, SweepRecord, kept_result
from ..study.progress import Event
from .point import Task
from .pool import Executor
from .standing import PointStanding, of_result, standing

_PATIENCE = 0.5
"""Seconds between looks at a run that others write to."""


class Left(NamedTuple):
    """What a sweep has left to run, and what it passes over: done, or failed and not to be tried again."""

    tasks: tuple[Task, ...]
    passed: dict[str, Result]

    @property
    def cost(self) -> float:
        """Seconds on one core, as far as configs tell."""
        return sum(task.cost for task in self.tasks)


@dataclass(frozen=True)
class Began:
    """A sweep begins: its points, how many of them are left, and the seconds these take on one core."""

    total: int
    left: int
    cost: float
    workers: int


@dataclass(frozen=True)
class Within:
    """Something happened in the run of a point."""

    task: Task
    event: Event


@dataclass(frozen=True)
class Ended:
    """A point has come to something; `trace` is the traceback of an error of the program's own."""

    task: Task
    result: Result
    trace: str


@dataclass(frozen=True)
class Waiting:
    """All that is left is written to by others."""

    runs: tuple[str, ...]
    holder: str


SweepEvent = Began | Within | Ended | Waiting
Watcher = Callable[[SweepEvent], object]


@dataclass(frozen=True)
class SweepOutcome:
    """Where the points that were asked for stand at the end."""

    record: SweepRecord
    points: tuple[PointStanding, ...]

    @property
    def failures(self) -> tuple[tuple[str, str], ...]:
        """The points that failed, by their runs, and why."""
        return tuple((p.point.run, why) for p in self.points if p.status == "failed" for why in p.failures)

    @property
    def exit_code(self) -> int:
        """3 where a point failed, 5 where others still write to one, else 0."""
        statuses = {point.status for point in self.points}
        if "failed" in statuses:
            return TargetError.exit_code
        return LockedError.exit_code if "running" in statuses else 0


def what_is_left(
    sweep: Sweep,
    record: SweepRecord,
    root: Path,
    chosen: Sequence[int],
    retry: bool,
    argv: Sequence[str] = (),
    tell: Callable[[str], object] | None = None,
) -> Left:
    """The points among those chosen that are to be run, the dearest first, so that workers end together.

    Raises ConfigError with all that is wrong with the states that they start from.
    """
    tasks, passed, wrong = [], dict[str, Result](), dict[Mistake, None]()
    for index in chosen:
        point, known = sweep.points[index], kept_result(record.folder, record.points[index])
        if known is not None and (known.status == "done" or not (known.again or retry)):
            passed[point.run] = known
            continue
        task = Task(str(root.absolute()), str(record.folder.absolute()), point, tuple(argv))
        try:
            tasks.append(replace(task, cost=cost_of(point, root, tell)))
        except ConfigError as error:
            wrong |= {replace(mistake, file=mistake.file or error.path): None for mistake in error.mistakes}
    if wrong:
        raise ConfigError(sweep.path, wrong)
    return Left(tuple(sorted(tasks, key=lambda task: -task.cost)), passed)


def cost_of(point: Point, root: Path, tell: Callable[[str], object] | None = None) -> float:
    """Seconds that a run will take, as `ribbon check` has it. Raises ConfigError as that does."""
    band = study.given_band(point.config, root, tell) if point.config.guess.recipe == "state" else None
    return study.plan_of(point.config, None if band is None else (band.half_width, band.segments)).cost


def run_sweep(
    record: SweepRecord,
    left: Left,
    chosen: Sequence[int],
    executor: Executor,
    watcher: Watcher,
    wait_for_others: bool = True,
) -> SweepOutcome:
    """Run what is left of the chosen points, and tell where they stand.

    A point that others write to comes last: it is waited for, unless that is not wanted. Raises RibbonError
    where no more can be run.
    """
    watcher(Began(len(chosen), len(left.tasks), left.cost, executor.workers))
    results = {run: replace(result, new_states=0) for run, result in left.passed.items()}
    tasks: Iterable[Task] = left.tasks
    while tasks:
        held = []
        with closing(executor.run(tasks, lambda task, event: watcher(Within(task, event)))) as ended:  # type: ignore[type-var]
            by_run = {task.run: task for task in tasks}
            for result, trace in ended:
                if result.status == "held" and wait_for_others:
                    held.append(by_run[result.run])
                    continue
                results[result.run] = result
                watcher(Ended(by_run[result.run], result, trace))
        _wait(held, watcher)
        tasks = held
    points = (record.points[index] for index in chosen)
    return SweepOutcome(
        record,
        tuple(of_result(p, results[p.run]) if p.run in results else standing(record, p) for p in points),
    )


def _wait(held: Sequence[Task], watcher: Watcher) -> None:
    """Wait until others let go of one of these runs."""
    told = False
    while held:
        holders = [Run(Path(task.root) / task.run).holder() for task in held]
        if None in holders:
            return
        if not told:
            watcher(Waiting(tuple(task.run for task in held), str(holders[0])))
            told = True
        time.sleep(_PATIENCE)
