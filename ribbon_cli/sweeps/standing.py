"""Where each point of a sweep stands: by what was kept of it as long as that holds, else by its run's log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .. import study
from ..errors import StoreError
from ..store import Result, Run, SweepPoint, SweepRecord, kept_result
from ..store.root import named

POINT_STATUSES = ("done", "failed", "running", "unfinished", "missing")
"""Words for a point: all targets certified; some not, or it broke off; being written to; begun; not begun."""

_OF_RUNS = {"complete": "done", "failed": "failed", "running": "running", "damaged": "failed"}


@dataclass(frozen=True)
class PointStanding:
    """A point and where it stands; `failures` say why it failed, `words` what else is worth telling."""

    point: SweepPoint
    status: str
    failures: tuple[str, ...] = ()
    words: str = ""
    new_states: int = 0
    seconds: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The point for JSON."""
        return {
            "name": self.point.name,
            "run": self.point.run,
            "path": str(self.point.path),
            "values": dict(self.point.values),
            "status": self.status,
            "failures": list(self.failures),
            "seconds": self.seconds,
        }


def counts(points: Iterable[PointStanding]) -> dict[str, int]:
    """How many points have each status."""
    found = Counter(point.status for point in points)
    return {status: found[status] for status in POINT_STATUSES}


def of_result(point: SweepPoint, result: Result) -> PointStanding:
    """Where a point stands by what it came to; one that is written to by others is running."""
    status = "running" if result.status == "held" else result.status
    words = result.failures[0] if result.status == "held" else ""
    failures = () if words else result.failures
    return PointStanding(point, status, failures, words, result.new_states, result.seconds)


def standing(record: SweepRecord, point: SweepPoint) -> PointStanding:
    """Where a point stands. What its run tells is told, and raises nothing."""
    result = kept_result(record.folder, point)
    if result is not None:
        return of_result(point, result)
    if not point.exists:
        return PointStanding(point, "missing")
    run = Run(point.path)
    found = study.standing(run)
    status = _OF_RUNS.get(found.status, "unfinished")
    words = "" if found.holder is None else str(found.holder)
    failures = (found.damage,) if found.damage else _lost(run)
    if failures:
        status = "running" if words else "failed"
    elif status == "failed":
        failures = found.failures
    return PointStanding(point, status, failures, words)


def _lost(run: Run) -> tuple[str, ...]:
    """A line on each state whose file is not as it was committed: nothing else tells of these."""
    try:
        damaged = run.damage(run.entries())
    except StoreError as error:
        return (str(error),)
    advice = f"`ribbon repair {named(run.path)}` tells more"
    return tuple(f"state {label} is {word}: {advice}" for label, word in damaged.items())


def standings(record: SweepRecord) -> list[PointStanding]:
    """Where all points of a sweep stand, in their order."""
    return [standing(record, point) for point in record.points]
