"""One point of a sweep, solved as `ribbon solve` would, whatever comes of it."""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass
from pathlib import Path

from .. import study
from ..config import Point
from ..errors import LockedError, RibbonError
from ..store import Result, keep_result, mark_of


@dataclass(frozen=True)
class Task:
    """A point to run: the folders of the runs and of the sweep's record, and its cost in seconds."""

    root: str
    record: str
    point: Point
    argv: tuple[str, ...]
    cost: float = 0.0

    @property
    def run(self) -> str:
        """Name of its run's folder."""
        return self.point.run


def solve_point(task: Task, progress: study.Progress | None = None) -> tuple[Result, str]:
    """Run a point and keep what it came to with the sweep; the result, and the traceback of a bug.

    Raises nothing but what is no Exception: an interruption is no result.
    """
    began, run, trace = time.monotonic(), task.run, ""
    root, record, new = Path(task.root), Path(task.record), 0
    failures: tuple[str, ...] = ()
    again = True
    try:
        config = task.point.written(record.name)
        outcome = study.solve_config(config, root, progress=progress, argv=task.argv, second_process=False)
    except LockedError as error:
        return Result(run, "held", (str(error),), again), trace
    except (RibbonError, MemoryError, OSError) as error:
        failures = (str(error) or type(error).__name__,)
    except Exception as error:  # noqa: BLE001  (of one point alone, and told)
        failures, again = (f"internal error: {type(error).__name__}: {' '.join(str(error).split())}",), False
        trace = traceback.format_exc()
    else:
        failures, again, new = outcome.failures, False, outcome.new_states
    taken = time.monotonic() - began
    result = Result(
        run,
        "failed" if failures else "done",
        failures,
        again and bool(failures),
        new,
        taken,
        mark_of(root / run),
    )
    try:
        keep_result(record, result)
    except RibbonError as error:
        if not failures:
            return Result(run, "failed", (str(error),), True, new, taken), trace
    return result, trace
