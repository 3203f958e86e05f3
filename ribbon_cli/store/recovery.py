"""Putting a run's folder in order: after a kill, and after damage to its log.

Both need the run's lock. Nothing that might be a state is ever deleted.
"""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import Any

from ribbon_cli.errors import StoreError
from ribbon_cli.store import log
from ribbon_cli.store.atomic import TEMPORARY, write_atomic, write_error
from ribbon_cli.store.folder import (
    CONFIG,
    LOG,
    RESOLVED,
    STATES,
    created_entry,
    state_entry,
    state_files,
    state_name,
)
from ribbon_cli.store.hdf5 import decode_bytes, read_bytes


def sweep(folder: Path) -> list[str]:
    """Clear what a killed writer left in a run's folder, and return a line for each thing done.

    Temporary files go; a torn last line of the log is cut off; a whole state without a line is adopted; a
    file that has the name of a state, no line and no whole state in it is renamed to *.damaged-K. What was
    done is logged. Raises StoreError for a damaged log, or when the folder cannot be written.
    """
    notes: list[str] = []
    try:
        os.makedirs(folder / STATES, exist_ok=True)
        for place in (folder, folder / STATES):
            for path in sorted(place.glob(f"{TEMPORARY}*")):
                os.unlink(path)
                notes.append(f"removed the unfinished file {path.name}")
    except OSError as error:
        raise write_error(folder, error) from error
    if log.cut_torn_line(folder / LOG):
        notes.append("cut off an unfinished line of the log")
    known = {entry["state"]["label"] for entry in log.read_log(folder / LOG) if entry["event"] == "state"}
    adopted, more = _adopt(folder, known)
    notes += more
    if notes:
        log.append_log(
            folder / LOG, [*adopted, {"event": "recovered", "time": log.utc_now(), "notes": notes}]
        )
    return notes


def _adopt(folder: Path, known: set[int]) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries for whole states that are not known, and notes; what is no whole state is renamed."""
    entries, notes = [], []
    for label, path in _files(folder).items():
        if label in known:
            continue
        try:
            entries.append(_entry_from_file(label, path))
            notes.append(f"adopted state {label}")
        except StoreError as error:
            target = _unused(path, "damaged")
            try:
                os.rename(path, target)
            except OSError as failure:
                raise write_error(target, failure) from failure
            notes.append(f"renamed {path.name} to {target.name}: {error}")
    return entries, notes


def _files(folder: Path) -> dict[int, Path]:
    """Files of the states. Raises StoreError."""
    try:
        return state_files(folder)
    except OSError as error:
        raise StoreError(f"{folder / STATES}: cannot be read: {error.strerror}") from error


def _entry_from_file(label: int, path: Path) -> dict[str, Any]:
    """Entry, marked as adopted, for a state that has none. Raises StoreError unless its file is whole."""
    data = read_bytes(path)
    record = decode_bytes(data, str(path))
    if record.label != label:
        raise StoreError(f"{path}: holds state {record.label}")
    return state_entry(record, data) | {"adopted": True}


def _unused(path: Path, word: str) -> Path:
    """First of PATH.WORD-1, PATH.WORD-2, ... that does not exist."""
    names = (path.with_name(f"{path.name}.{word}-{k}") for k in itertools.count(1))
    return next(name for name in names if not os.path.lexists(name))


def rebuild(folder: Path) -> list[str]:
    """Rebuild a run's log from its states, and return a line for each thing done.

    Lines that can be read are kept; a state without one is adopted as in `sweep`; a state without a file
    becomes an event `state-lost`. A line whose state's file differs from it stays: what was committed is
    known, and reading the state goes on saying that it is damaged. The old log is kept as log.jsonl.old-K;
    a log that is in order is left alone. Raises StoreError.
    """
    path = folder / LOG
    entries, unreadable = log.salvage_log(path)
    notes = [f"dropped {unreadable} damaged lines of the log"] if unreadable else []
    if not any(entry["event"] == "created" for entry in entries):
        entries.insert(0, created_entry(_config_files(folder)) | {"rebuilt": True})
        notes.append("made a new first line of the log")
    known = {entry["state"]["label"] for entry in entries if entry["event"] == "state"}
    adopted, more = _adopt(folder, known)
    lost = known - _files(folder).keys()
    notes += more + [f"{state_name(label)} is missing: marked as lost" for label in sorted(lost)]
    if notes:
        entries = [_lost(entry) if _names(entry, lost) else entry for entry in entries]
        done = {"event": "rebuilt", "time": log.utc_now(), "notes": notes}
        _replace(path, [*entries, *adopted, done])
    return notes


def _names(entry: dict[str, Any], labels: set[int]) -> bool:
    """Whether an entry is on one of the states."""
    return entry["event"] == "state" and entry["state"]["label"] in labels


def _lost(entry: dict[str, Any]) -> dict[str, Any]:
    """Entry in place of that of a state whose file is gone."""
    return {**entry, "event": "state-lost", "label": entry["state"]["label"]}


def _config_files(folder: Path) -> dict[str, bytes]:
    """The config files that a run still has. Raises StoreError."""
    return {name: read_bytes(folder / name) for name in (CONFIG, RESOLVED) if (folder / name).is_file()}


def _replace(path: Path, entries: list[dict[str, Any]]) -> None:
    """Replace a log in one step, keeping the old one under another name. Raises StoreError."""
    if path.exists():
        write_atomic(_unused(path, "old"), read_bytes(path))
    write_atomic(path, b"".join(map(log.format_line, entries)), overwrite=True)
