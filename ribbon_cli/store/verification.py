"""Whether a run's files are what was committed: log, config, hashes, schema.

Reading only, without the lock.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ribbon_cli.errors import StoreError
from ribbon_cli.store import configs
from ribbon_cli.store.atomic import TEMPORARY
from ribbon_cli.store.events import Created, Entry, Event, Lost, removed
from ribbon_cli.store.folder import STATES, state_files
from ribbon_cli.store.hdf5 import decode
from ribbon_cli.store.record import StateRecord
from ribbon_cli.store.run import Run


@dataclass(frozen=True)
class Finding:
    """Something that is wrong, or a `note`: something left over that harms nothing."""

    where: str
    what: str
    note: bool = False


@dataclass(frozen=True)
class Checked:
    """A state's file after its check: `record` is None where it cannot be read."""

    label: int | None
    path: Path
    record: StateRecord | None
    findings: tuple[Finding, ...]


def check_folder(run: Run) -> list[Finding]:
    """Check a run's log, config files and whatever else lies in its folder; states are left to
    `check_states`.

    A damaged log is a finding, not an error.
    """
    try:
        events = run.events()
    except StoreError as error:
        return [_from_error(error, run.log_path)]
    found = list(_check_config(run, events))
    labels = Counter(event.state.label for event in events if isinstance(event, Entry))
    for label in sorted(label for label, count in labels.items() if count > 1):
        found.append(Finding(str(run.log_path), f"it has {labels[label]} lines on state {label}"))
    for event in events:
        if isinstance(event, Lost):
            where = str(run.state_path(event.label))
            found.append(Finding(where, f"marked as lost: {event.reason}", note=True))
    return found + list(_leftovers(run, events))


def _check_config(run: Run, events: list[Event]) -> Iterator[Finding]:
    """Compare the config files with the hashes that the log's first line keeps."""
    created = [event for event in events if isinstance(event, Created)]
    if not created or events[:1] != created:
        yield Finding(str(run.log_path), "its first line, and no other, must be the event `created`")
        return
    for path, reason in configs.differing(run.path, configs.committed(created)):
        yield Finding(str(path), reason)


def _leftovers(run: Run, events: list[Event]) -> Iterator[Finding]:
    """What a killed writer left, and what was put aside; a running writer's own files are its business."""
    known = {event.state.label for event in events if isinstance(event, Entry)}
    gone = removed(events)
    if run.holder():
        return
    try:
        files = state_files(run.path)
        names = [path for place in (run.path, run.path / STATES) for path in sorted(place.iterdir())]
    except OSError as error:
        yield Finding(str(run.path / STATES), f"cannot be read: {error.strerror}")
        return
    for label in sorted(files.keys() & gone.keys()):
        yield Finding(str(files[label]), "its state was removed: the next writer deletes it", note=True)
    for label in sorted(files.keys() - known):
        yield Finding(str(files[label]), "was not committed: the next writer looks at it", note=True)
    for path in names:
        if path.name.startswith(TEMPORARY):
            yield Finding(str(path), "unfinished: the next writer removes it", note=True)
        elif ".damaged-" in path.name:
            yield Finding(str(path), "put aside as damaged", note=True)


def check_states(run: Run, labels: list[int] | None = None) -> Iterator[Checked]:
    """Check the files of a run's states, or of some, one by one; none where the log is damaged."""
    try:
        entries = run.entries()
    except StoreError:
        return
    for label in entries if labels is None else labels:
        yield _check_state(run, label, entries[label])


def _check_state(run: Run, label: int, entry: Entry) -> Checked:
    path = run.state_path(label)
    try:
        record = run.load_entry(entry)
    except StoreError as error:
        return Checked(label, path, None, (_from_error(error, path, run.log_path),))
    return Checked(label, path, record, ())


def check_file(path: Path) -> Checked:
    """Check a state file outside of a run by the hashes that it carries."""
    try:
        record = decode(path)
    except StoreError as error:
        return Checked(None, path, None, (_from_error(error, path),))
    return Checked(None, path, record, ())


def _from_error(error: StoreError, path: Path, *others: Path) -> Finding:
    """An error as a finding of the file that its message begins with, else of the first."""
    for where in (path, *others):
        if str(error).startswith(f"{where}: "):
            return Finding(str(where), str(error).removeprefix(f"{where}: "))
    return Finding(str(path), str(error))
