"""Repairs of a run's folder: after a kill, and after damage to its log.

Both need the run's lock. Nothing that might be a state is ever deleted.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.errors import StoreError
from ribbon_cli.store import configs, log
from ribbon_cli.store.atomic import TEMPORARY, is_passing, put_aside, unused_name, write_atomic, write_error
from ribbon_cli.store.events import Created, Entry, Event, removed
from ribbon_cli.store.folder import (
    LOG,
    STATES,
    check_run_version,
    created_entry,
    state_entry,
    state_files,
    state_name,
)
from ribbon_cli.store.hdf5 import decode_bytes, read_bytes
from ribbon_cli.store.preamble import check_seal, check_version
from ribbon_cli.store.root import named
from ribbon_cli.store.summaries import Summary

if TYPE_CHECKING:
    from ribbon_cli.store.record import StateRecord


def sweep(folder: Path, events: Sequence[Event]) -> list[str]:
    """Clear what a killed writer left in a run's folder, and return a line for each thing done.

    `events` are the log's, read under the lock. Temporary files go; a torn last line of the log is cut off; a
    whole state without a line is adopted; the file of a state that was removed is deleted; a file that has
    the name of a state, no line and no whole state in it is renamed to *.damaged-K. What was done is logged.
    Raises StoreError for a committed state or a config file that is not there as it was, or when the folder
    cannot be written.
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
    gone, files = removed(events), _files(folder)
    for label in sorted(gone.keys() & files.keys()):
        notes.append(_delete_removed(files.pop(label), gone[label]))
    known = {event.state.label for event in events if isinstance(event, Entry)} - gone.keys()
    adopted, more = _adopt(files, known)
    notes += more
    for label in sorted(known - files.keys())[:1]:
        raise StoreError(
            f"{folder / state_name(label)}: missing, though it was committed; "
            f"`ribbon repair {named(folder)}` marks it as lost, and it will be computed again"
        )
    configs.require(folder, events)
    if notes:
        # One by one: each is whole, or the last.
        done = {"event": "recovered", "time": log.utc_now(), "notes": notes}
        for document in [*(entry.document for entry in adopted), done]:
            log.append_log(folder / LOG, [document])
    return notes


def _delete_removed(path: Path, entry: Entry) -> str:
    """Delete the file of a state that was removed, if it is that, and say so. Raises StoreError."""
    try:
        if hashlib.sha256(_read(path)).hexdigest() != entry.sha256:
            raise ValueError("its state was removed, and it is another")
        os.unlink(path)
    except ValueError as error:
        return f"renamed {path.name} to {put_aside(path).name}: {error}"
    except OSError as error:
        raise write_error(path, error) from error
    return f"deleted {path.name}, whose state was removed"


def _adopt(files: Mapping[int, Path], known: Collection[int]) -> tuple[list[Event], list[str]]:
    """Entries for whole states without a line, and notes; other files are renamed."""
    entries, notes = [], []
    for label, path in files.items():
        if label in known:
            continue
        try:
            entries.append(_entry_from_file(label, path))
            notes.append(f"adopted state {label}")
        except ValueError as error:
            target = put_aside(path)
            notes.append(f"renamed {path.name} to {target.name}: {error}")
    return entries, notes


def _files(folder: Path) -> dict[int, Path]:
    """Files of the states. Raises StoreError."""
    try:
        return state_files(folder)
    except OSError as error:
        raise StoreError(f"{folder / STATES}: cannot be read: {error.strerror}") from error


def _entry_from_file(label: int, path: Path) -> Event:
    """Entry, marked as adopted, for a state that has none.

    The seal in its head vouches for the file; one of 1.0, without, is read. Raises ValueError unless it is
    whole, StoreError where it cannot be read now.
    """
    data = _read(path)
    state = _summary(data, path)
    if state.get("label") != label:
        raise ValueError(f"it holds state {state.get('label')}")
    return _readable(state_entry(state, data) | {"adopted": True})


def _summary(data: bytes, path: Path) -> dict[str, Any]:
    """Summary of a state by the bytes of its file.

    Raises ValueError for a damaged file, StoreError for one of a newer format, which is not damaged.
    """
    check_version(data, str(path))
    return check_seal(data) or Summary.of(_decoded(data, path)).to_dict()


def _readable(document: dict[str, Any]) -> Event:
    """Check that readers of the log will accept it. Raises ValueError: seals vouch only for bytes."""
    return log.parse_line(log.format_line(document)[:-1])


def repair(folder: Path) -> list[str]:
    """Repair a run's folder after damage, and return a line for each thing done; nothing is deleted.

    Config files that are missing or changed are restored from what the states keep of them. State files that
    are not the committed ones are renamed to *.damaged-K, and marked as lost in the log, as are missing ones;
    whole ones that the log does not name are adopted as in `sweep`. Lines of the log that can be read are
    kept, but for those that do not agree with their state's file. The old log is kept as log.jsonl.old-K;
    what is in order is left alone. Raises StoreError.
    """
    path = folder / LOG
    events, unreadable = log.salvage_log(path)
    lines = f"{unreadable} damaged line{'s' * (unreadable != 1)}"
    notes = [f"dropped {lines} of the log"] if unreadable else []
    created = [event for event in events if isinstance(event, Created)][:1]
    for first in created:
        check_run_version(folder, first)
    rest = [event for event in events if not isinstance(event, Created)]
    if created and [*created, *rest] != events:
        notes.append("made the event `created` the first line of the log, and the only one of its kind")
    hashes, states = configs.committed(created), _files(folder).values()
    if other := configs.contradiction(folder, hashes, states):
        created, hashes = [], other
        notes.append("dropped the first line of the log: it names a config that none of the states came of")
    notes += configs.restore(folder, hashes, states)
    if created:
        first_line = created[0].document
    else:
        first_line = created_entry(configs.present(folder)) | {"rebuilt": True}
        notes.append("made a new first line of the log")
    kept, more = _checked_lines(folder, rest)
    known = {event.state.label for event in kept if isinstance(event, Entry)}
    adopted, others = _adopt(_files(folder), known)
    notes += [*more, *others]
    if notes:
        done = {"event": "rebuilt", "time": log.utc_now(), "notes": notes}
        _replace(path, [first_line, *(event.document for event in (*kept, *adopted)), done])
    return notes


def _checked_lines(folder: Path, events: Sequence[Event]) -> tuple[list[Event], list[str]]:
    """The lines of a log as they should be, and a note on each that was another."""
    kept, notes, seen = list[Event](), list[str](), set[int]()
    there, gone = _files(folder).keys(), removed(events)
    for event in events:
        if isinstance(event, Entry):
            label = event.state.label
            if label in seen:
                notes.append(f"dropped a second line on state {label}")
                continue
            seen.add(label)
            if label not in gone:  # else a file that is left is the next writer's to delete
                event, note = _checked_entry(folder, event, there)
                notes += [note] if note else []
        kept.append(event)
    return kept, notes


def _checked_entry(folder: Path, entry: Entry, there: Collection[int]) -> tuple[Event, str]:
    """An entry as it should be, and a note where that is another; a state's file is put aside if damaged.

    A file is missing where the folder does not list it: one that may not be looked at is `there`.
    """
    label = entry.state.label
    path = folder / state_name(label)
    document = entry.document
    lost = document | {"event": "state-lost", "label": label}
    if label not in there:
        event = _readable(lost | {"reason": "its file is missing"})
        return event, f"{state_name(label)} is missing: marked as lost"
    try:
        data = _read(path)
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            raise ValueError("not the bytes that were committed")
        state = _summary(data, path)
        added = entry.state.added()
        if added | state == added | document["state"]:
            return entry, ""
        anew = _readable(state_entry(state, data) | {"time": entry.time})
        return anew, f"wrote the line on state {label} anew"
    except ValueError as error:
        target = put_aside(path)
        event = _readable(lost | {"reason": f"damaged, now {target.name}"})
        return event, f"renamed {path.name} to {target.name}: {error}"


def _read(path: Path) -> bytes:
    """Bytes of a state's file.

    A file must never be taken for damaged because of a passing failure: too many open files, a disk that is
    away. Raises ValueError for what is no file of that size, StoreError where reading fails.
    """
    try:
        return read_bytes(path)
    except StoreError as error:
        if is_passing(error):
            raise
        raise ValueError(str(error)) from error


def _decoded(data: bytes, path: Path) -> StateRecord:
    """The record of a file of format 1.0. Raises ValueError."""
    try:
        return decode_bytes(data, str(path))
    except StoreError as error:
        raise ValueError(str(error)) from error


def _replace(path: Path, documents: list[dict[str, Any]]) -> None:
    """Replace a log in one step, keeping the old one under another name. Raises StoreError."""
    if path.is_file():
        write_atomic(unused_name(path, "old"), read_bytes(path))
    elif os.path.lexists(path):
        put_aside(path)
    write_atomic(path, b"".join(map(log.format_line, documents)), overwrite=True)
