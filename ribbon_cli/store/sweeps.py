"""Records of sweeps: which points a sweep has, and which runs are theirs.

`sweeps/NAME/` in the folder of the runs holds `sweep.yaml`, as written, and `sweep.json`: the keys that
vary, and of each point its values and the name of its run's folder. The runs are ordinary runs. The record is
written anew whenever `ribbon sweep` finds it another; nothing but it knows the sweep.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from ribbon_cli import config as configs
from ribbon_cli.errors import StoreError
from ribbon_cli.store.atomic import write_atomic, write_error
from ribbon_cli.store.folder import RUN_FOLDER, STATES, is_run
from ribbon_cli.store.hdf5 import read_bytes
from ribbon_cli.store.lock import LOCK
from ribbon_cli.store.log import parse_json

SWEEPS = "sweeps"
SOURCE = "sweep.yaml"
RECORD = "sweep.json"
POINTS = "points"
SWEEP_FORMAT = "ribbon-sweep"
SWEEP_FORMAT_VERSION = "1.0"


@dataclass(frozen=True)
class SweepPoint:
    """A point of a sweep: its values by dotted key, in the order of the keys, and the path of its run.

    A value is a number, a text, a truth value, a tuple of these or a mapping. There may be no run yet.
    """

    name: str
    values: Mapping[str, Any]
    path: Path

    @property
    def run(self) -> str:
        """Name of its run's folder."""
        return self.path.name

    @property
    def exists(self) -> bool:
        """Whether its run has been begun."""
        return is_run(self.path)


@dataclass(frozen=True)
class SweepRecord:
    """A sweep by its record: `groups` are the keys that go together, `source` is the path of its file."""

    name: str
    groups: tuple[tuple[str, ...], ...]
    points: tuple[SweepPoint, ...]
    source: str
    folder: Path

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary."""
        return tuple(key for group in self.groups for key in group)


@dataclass(frozen=True)
class Result:
    """What running a point came to, with a sentence for each failure.

    `again` tells that what failed may go well the next time (no space on a disk): it is tried again without
    being asked for. `mark` is what `mark_of` gave when the run ended.
    """

    run: str
    status: Literal["done", "failed", "held"]
    failures: tuple[str, ...] = ()
    again: bool = False
    new_states: int = 0
    seconds: float = 0.0
    mark: str = ""


def mark_of(path: Path) -> str:
    """What changes whenever a run does: a hash of its files' names, sizes and times, and opens none of them.

    Empty where there is no run.
    """
    files = []
    for folder in (path, path / STATES):
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if not entry.name.startswith(LOCK) and entry.is_file():
                        facts = entry.stat()
                        files.append((entry.name, facts.st_size, facts.st_mtime_ns))
        except OSError:
            return ""
    return hashlib.sha256(repr(sorted(files)).encode()).hexdigest()[:32]


def keep_result(record: Path, result: Result) -> None:
    """Keep what a point came to in the folder of its sweep. Raises StoreError."""
    path = record / POINTS / f"{result.run}.json"
    write_atomic(path, json.dumps(asdict(result)).encode() + b"\n", overwrite=True)


def kept_result(record: Path, point: SweepPoint) -> Result | None:
    """What a point came to, where its run is as it was then; None where nothing is known."""
    try:
        with open(record / POINTS / f"{point.run}.json", "rb") as stream:
            document = parse_json(stream.read())
        result = Result(**document | {"failures": tuple(map(str, document["failures"]))})
    except (OSError, ValueError, TypeError, KeyError):
        return None
    known = result.status in ("done", "failed") and result.run == point.run
    return result if known and result.mark == mark_of(point.path) else None


def keep_sweep(root: Path, sweep: configs.Sweep) -> SweepRecord:
    """Write a sweep's record, where it is not as it is, and return it. Raises StoreError."""
    folder, document = root / SWEEPS / sweep.name, _document(sweep)
    try:
        (folder / POINTS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(folder, error) from error
    for name, data in ((SOURCE, sweep.text.encode()), (RECORD, _text(document))):
        path = folder / name
        if not path.is_file() or read_bytes(path) != data:
            write_atomic(path, data, overwrite=True)
    return _record(folder, document)


def record_of(root: Path, sweep: configs.Sweep) -> SweepRecord:
    """The record that a sweep has, or would have; nothing is written."""
    return _record(root / SWEEPS / sweep.name, _document(sweep))


def _document(sweep: configs.Sweep) -> dict[str, Any]:
    return {
        "format": SWEEP_FORMAT,
        "format_version": SWEEP_FORMAT_VERSION,
        "name": sweep.name,
        "source": str(Path(sweep.path).absolute()),
        "groups": [list(group) for group in sweep.groups],
        "points": [{"name": point.name, "run": point.run, "values": point.values} for point in sweep.points],
    }


def _text(document: Mapping[str, Any]) -> bytes:
    """JSON with a line for each point."""
    head = {key: value for key, value in document.items() if key != "points"}
    points = ",\n".join(json.dumps(point, allow_nan=False) for point in document["points"])
    return f'{json.dumps(head)[:-1]}, "points": [\n{points}\n]}}\n'.encode()


def find_sweep(root: Path, name: str) -> SweepRecord | None:
    """The sweep with a name, None where there is none. Raises StoreError for a damaged record."""
    folder = root / SWEEPS / name
    path = folder / RECORD
    if "/" in name or "\0" in name or name.startswith(".") or not os.path.isfile(path):
        return None
    try:
        return _record(folder, parse_json(read_bytes(path)))
    except (ValueError, TypeError, KeyError, AttributeError, UnicodeDecodeError) as error:
        raise StoreError(f"{path}: damaged: `ribbon sweep` with the sweep's file writes it anew") from error


def list_sweeps(root: Path) -> list[str]:
    """Names of the sweeps in a folder of runs."""
    try:
        return sorted(path.parent.name for path in (root / SWEEPS).glob(f"*/{RECORD}"))
    except OSError:
        return []


def _record(folder: Path, document: Mapping[str, Any]) -> SweepRecord:
    """A record from its document. Raises ValueError, TypeError, KeyError where it is none."""
    if document["format"] != SWEEP_FORMAT or not str(document["format_version"]).startswith("1."):
        raise ValueError(document["format"])
    groups = tuple(tuple(map(str, group)) for group in document["groups"])
    root = folder.parent.parent
    points = []
    for point in document["points"]:
        run = str(point["run"])
        if not RUN_FOLDER.fullmatch(run) or "/" in run or "\0" in run:
            raise ValueError(run)
        values = {key: _value(point["values"][key]) for group in groups for key in group}
        points.append(SweepPoint(str(point["name"]), values, root / run))
    return SweepRecord(folder.name, groups, tuple(points), str(document["source"]), folder)


def _value(value: Any) -> Any:
    return tuple(map(_value, value)) if isinstance(value, list | tuple) else value
