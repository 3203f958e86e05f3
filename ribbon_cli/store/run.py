"""A run: one folder with the config, an append-only log and one immutable file a state.

A state is committed once its file is durable and its log line is. A kill between the two leaves a whole
file without a line; the next writer adopts it. The states are the truth: the log can be rebuilt from them.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.doors import Later
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import log
from ribbon_cli.store.atomic import TEMPORARY, is_passing, sync_folder, write_atomic, write_error
from ribbon_cli.store.events import REMOVED, Created, Entry, Event, Lost, Removed
from ribbon_cli.store.folder import (
    CONFIG,
    LOG,
    RESOLVED,
    RUN_FOLDER,
    STATES,
    check_run_version,
    create,
    is_run,
    label_of,
    remove,
    remove_abandoned,
    state_entry,
    state_name,
)
from ribbon_cli.store.hdf5 import decode_bytes, encoded, read_bytes
from ribbon_cli.store.lock import Holder, RunLock
from ribbon_cli.store.recovery import repair, sweep
from ribbon_cli.store.root import named
from ribbon_cli.store.summaries import LABELS, Summary

if TYPE_CHECKING:
    from ribbon_cli.store import beside
    from ribbon_cli.store.beside import Beside, Make
    from ribbon_cli.store.record import StateRecord
else:  # for writers alone
    beside = Later("ribbon_cli.store.beside")

_NAME = r"\w[\w.-]*"
_HASH = r"[0-9a-f]{8}"


class Run:
    """A run's folder. Reading needs no lock and never waits; writing happens inside `writing()`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = RunLock(path)
        self._log = log.LogReader(path / LOG)
        self._events: list[Event] = []
        self._entries: dict[int, Entry] = {}
        self._indexed = 0
        self._next = 0
        self._compared: dict[int, str] = {}
        self._beside: Beside | None = None
        self.second_process = True
        """Whether `commit_soon` may use a second process."""
        self.remarks: list[str] = []
        """What the last `writing()` found left by others, and did about it."""

    @classmethod
    def open(cls, path: str | Path) -> Run:
        """Open an existing run. Raises UsageError when the folder is not one."""
        path = Path(path)
        if path.name in ("", ".."):  # a run's name is its folder's
            path = path.resolve()
        if not is_run(path):
            raise UsageError(f"{path}: not a run folder (it has neither {RESOLVED} nor {LOG})")
        return cls(path)

    @classmethod
    def create_or_open(
        cls, root: str | Path, name: str, hash8: str, config_text: str, resolved_text: str
    ) -> Run:
        """Open the run `root/NAME-HASH8`, made first when there is none: nothing, or a complete run.

        `hash8` is of the resolved config's scientific part, so that the same config finds its run again.
        Raises UsageError for a name that cannot be a folder or a reference, StoreError when it cannot be
        written.
        """
        if not re.fullmatch(_NAME, name) or len(name.encode()) > 200:
            raise UsageError(
                f"name: must be letters, digits, '.', '_' and '-', at most 200 bytes, got {name!r}"
            )
        if not re.fullmatch(_HASH, hash8):
            raise ValueError(f"hash8 must be 8 hexadecimal digits, got {hash8!r}")
        root = Path(root)
        path = root / f"{name}-{hash8}"
        if is_run(path):
            return cls(path)
        try:
            root.mkdir(parents=True, exist_ok=True)
            remove_abandoned(root)
            create(path, {CONFIG: config_text.encode(), RESOLVED: resolved_text.encode()})
        except OSError as error:
            raise write_error(path, error) from error
        return cls.open(path)

    @property
    def name(self) -> str:
        """The folder's name, NAME-HASH8."""
        return self.path.name

    @property
    def short_name(self) -> str:
        """The name that the config gives."""
        match = RUN_FOLDER.fullmatch(self.name)
        return match["name"] if match else self.name

    @property
    def is_aside(self) -> bool:
        """Whether the run was set aside by a fresh start."""
        match = RUN_FOLDER.fullmatch(self.name)
        return bool(match and match["aside"])

    @property
    def log_path(self) -> Path:
        """The log's file."""
        return self.path / LOG

    def state_path(self, label: int) -> Path:
        """The file of a state."""
        return self.path / state_name(label)

    def label_of(self, path: str | Path) -> int | None:
        """Label of a state's file by its name, None when it is not one of this run's."""
        path = Path(path)
        return label_of(path.name) if path.resolve().parent == (self.path / STATES).resolve() else None

    def holder(self) -> Holder | None:
        """Who writes to the run now; None if nobody does. Takes no lock."""
        return self._lock.holder()

    # Reading

    def events(self) -> list[Event]:
        """Every line of the log in order, states included.

        Raises StoreError for a damaged log, or a run of a newer format.
        """
        self.settle()
        return self._events_now()

    def _events_now(self) -> list[Event]:
        """The same without what waits for its commit."""
        events = self._log.events()
        if events is not self._events:
            self._events, self._entries, self._indexed = events, {}, 0
        for event in events[self._indexed :]:
            self._take_in(event)
        self._indexed = len(events)
        return events

    def _take_in(self, event: Event) -> None:
        """Index an event of the log. Raises StoreError for a run of a newer format."""
        if isinstance(event, Entry):
            label = event.state.label
            later = bool(self._entries) and next(reversed(self._entries)) > label
            self._entries[label] = event
            if later:  # a state that was adopted after others
                self._entries = dict(sorted(self._entries.items()))
        elif isinstance(event, Removed):
            for label in event.labels:
                self._entries.pop(label, None)
        elif isinstance(event, Created):
            check_run_version(self.path, event)

    def entries(self) -> dict[int, Entry]:
        """The log's entry of every state by label, ascending; not to be changed.

        Raises StoreError as `events` does.
        """
        self.events()
        return self._entries

    def states(self, all: bool = False) -> list[Summary]:
        """Summaries of the equilibria, or of all states, in the order reached; opens no state file."""
        entries = self.entries().values()
        return [entry.state for entry in entries if all or entry.state.kind == "equilibrium"]

    def load(self, label: int) -> StateRecord:
        """Read a state.

        Raises UsageError for a label that the run does not have, StoreError when the file is not the one
        committed, or holds another state than the log says.
        """
        return self.load_entry(self._entry(label))

    def look_up(self, label: int) -> Summary:
        """The summary of a state whose file is there as it was committed: its hash is compared the first
        time.

        Raises UsageError, StoreError where the file is another.
        """
        entry = self._entries.get(label) or self._entry(label)  # what was committed stays as it is
        if self._compared.get(label) != entry.sha256:
            self.committed_bytes(entry)
            self._compared[label] = entry.sha256
        return entry.state

    def _entry(self, label: int) -> Entry:
        """The log's entry of a state.

        Raises UsageError for a label that the run does not have, StoreError.
        """
        entries = self.entries()
        if label not in entries:
            has = f"labels {min(entries)} to {max(entries)}" if entries else "no states yet"
            raise UsageError(f"{self.name}: no state {label}; the run has {has}")
        return entries[label]

    def damage(self, labels: Iterable[int]) -> dict[int, str]:
        """Which of these states' files are `missing`, `unreadable` as things are (permissions, a disk that is
        away) or, by their hash, `damaged`; HDF5 sees none of them.

        Raises StoreError as `events` does.
        """
        entries, found = self.entries(), {}
        for label in labels:
            path = self._state_file(label)
            try:
                data = read_bytes(path)
            except StoreError as error:
                if is_passing(error):
                    found[label] = "unreadable"
                else:
                    found[label] = "damaged" if os.path.lexists(path) else "missing"
                continue
            if hashlib.sha256(data).hexdigest() != entries[label].sha256:
                found[label] = "damaged"
        return found

    def load_entry(self, entry: Entry) -> StateRecord:
        """Read the state of an entry; its hash is checked before HDF5 sees a byte, and the entry's summary
        against what the file holds. Raises StoreError.
        """
        path = self.state_path(entry.state.label)
        record = decode_bytes(self.committed_bytes(entry), str(path))
        if record.label != entry.state.label:
            raise StoreError(f"{path}: damaged: it holds state {record.label}")
        if Summary.of(record) != entry.state:
            raise StoreError(
                f"{self.log_path}: its line on state {record.label} is not what {path.name} holds; "
                f"`ribbon repair {named(self.path)}` rebuilds it"
            )
        return record

    def committed_bytes(self, entry: Entry) -> bytes:
        """Bytes of a state's file. Raises StoreError where they are not those that were committed."""
        path = self._state_file(entry.state.label)
        data = read_bytes(path)
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            advice = f"`ribbon repair {named(self.path)}` puts it aside"
            raise StoreError(f"{path}: damaged: not the bytes that were committed; {advice}")
        return data

    def _state_file(self, label: int) -> str:
        """The same as `state_path`; a Path takes longer to make than the file to read."""
        return f"{self.path}/{state_name(label)}"

    # Writing

    @contextmanager
    def writing(self) -> Iterator[Run]:
        """Hold the run's lock, with leftovers of a killed writer cleared first; may be nested.

        At its end all states are committed. A signal ends it at once, and drops what `commit_soon` still had.
        Raises LockedError, naming pid and host, when another process writes; StoreError for a damaged log.
        """
        if self._lock.held:
            yield self
            return
        with self._locked():
            self.remarks += self._sweep()
            self._next = self._find_next_label()
            try:
                yield self
                self.settle()
            except Exception:
                with suppress(Exception):  # what was solved before it went wrong
                    self.settle()
                raise
            finally:
                second, self._beside = self._beside, None
                if second is not None:
                    second.end()

    @property
    def has_leftovers(self) -> bool:
        """Whether an interrupted writer left temporary files, a state without a line, or a part of a line.

        Lists the folder and opens no state. Raises StoreError as `events` does.
        """
        committed = {os.path.basename(state_name(label)) for label in self.entries()}
        try:
            here, states = os.listdir(self.path), os.listdir(self.path / STATES)
        except OSError:
            return False
        unknown = (name for name in states if name not in committed)
        return (
            self._log.torn
            or any(name.startswith(TEMPORARY) for name in here)
            or any(name.startswith(TEMPORARY) or label_of(name) is not None for name in unknown)
        )

    @property
    def is_writing(self) -> bool:
        """Whether this object is inside `writing()`."""
        return self._lock.held

    @property
    def next_label(self) -> int:
        """Label that the next commit must have."""
        return self._next if self._lock.held else self._find_next_label()

    def commit(self, record: StateRecord) -> Summary:
        """Store a state and return its summary; when this returns, the state survives a kill and a power cut.

        Raises ValueError unless `record.label` is `next_label`; StoreError when it cannot be written, and
        then the run is as before.
        """
        self.settle()
        self._claim(record.label)
        data, summary = encoded(record)
        self.write_state(record.label, data, summary)
        self._next += 1
        return summary

    def commit_soon(self, label: int, make: Make) -> None:
        """Store a state whose bytes are still to be made, by a second process where there is a core for it.

        States are committed in order. Reading the run, logging an event and the end of `writing()` wait for
        them. Raises ValueError unless `label` is `next_label`; StoreError when an earlier one, or this one,
        cannot be written.
        """
        self._claim(label)
        if self._beside is None and self.second_process and beside.possible():
            self._beside = beside.Beside(self.write_state)
        if self._beside is None:
            self.write_state(label, *make())
        else:
            with self._counted_again():
                self._beside.put(label, make)
        self._next += 1

    @property
    def behind(self) -> bool:
        """Whether `commit_soon` would have to wait: then there is time to do some of its work before."""
        return self._beside is not None and self._beside.behind

    def settle(self) -> None:
        """Wait until all states are committed. Raises what went wrong with one, and drops those behind it."""
        if self._beside is not None:
            with self._counted_again():
                self._beside.settle()

    @contextmanager
    def _counted_again(self) -> Iterator[None]:
        """Where a commit fails, labels go on from what is stored."""
        try:
            yield
        except Exception:
            with suppress(StoreError):
                self._next = self._find_next_label()
            raise

    def _claim(self, label: int) -> None:
        """Raises ValueError unless a label is the next."""
        self._require_lock()
        if label != self._next:
            raise ValueError(f"the next state of {self.name} is {self._next}, got label {label}")

    def write_state(self, label: int, data: bytes, summary: Summary) -> None:
        """Write a state's file and its line. Raises StoreError, and then the run is as before."""
        write_atomic(self.state_path(label), data)
        try:
            log.append_log(self.log_path, [state_entry(summary.to_dict(), data)])
        except StoreError:
            self._take_back(label)
            raise

    def _take_back(self, label: int) -> None:
        """Remove a state's file whose line could not be written, if the log can be seen to lack it."""
        with suppress(OSError, StoreError):
            self._events_now()
            if label not in self._entries:
                os.unlink(self.state_path(label))

    def remove_states(self, labels: Sequence[int], branches: Sequence[str] = ()) -> None:
        """Remove states from the run for good, with the log's entries on how these branches end.

        The log's line decides: a kill before it leaves the run as it was, one behind it leaves files that the
        next writer deletes. So does a file that cannot be deleted now, which `remarks` tells. Raises
        ValueError for a label that the run does not have, StoreError when the line cannot be written.
        """
        self._require_lock()
        entries = self.entries()
        if not set(labels) <= entries.keys():
            raise ValueError(f"{self.name} has no states {sorted(set(labels) - entries.keys())}")
        what = {"labels": sorted(labels), "branches": list(branches)}
        log.append_log(self.log_path, [{"event": REMOVED, "time": log.utc_now(), **what}])
        try:
            for label in labels:
                with suppress(FileNotFoundError):
                    os.unlink(self.state_path(label))
            sync_folder(self.path / STATES)
        except OSError as error:
            where = self.path / STATES
            self.remarks.append(f"{where}: {error.strerror}: the next writer deletes what is left")

    def log_event(self, kind: str, **data: Any) -> None:
        """Append an event with JSON-able data to the log, durably. Raises StoreError."""
        self._require_lock()
        self.settle()
        if kind == "state" or {"event", "time"} & data.keys():
            raise ValueError(f"event {kind!r} uses a name that the log reserves")
        log.append_log(self.log_path, [{"event": kind, "time": log.utc_now(), **data}])

    def sweep(self) -> list[str]:
        """Clear what a killed writer left, and say what was done; `writing()` does so on entry."""
        with self._locked():
            return self._sweep()

    def _sweep(self) -> list[str]:
        self.settle()
        self._log.look_again()
        return sweep(self.path, self.events())

    def set_aside(self) -> Path:
        """Rename the folder to NAME-HASH8.old-K, so that a fresh run can take its name; return the new path.

        Raises LockedError when another process writes to it, StoreError when it cannot be renamed.
        """
        with self._locked():
            self.settle()
            for k in itertools.count(1):
                target = self.path.with_name(f"{self.name}.old-{k}")
                if not os.path.lexists(target):
                    break
            try:
                os.rename(self.path, target)
                self.path = self._lock.folder = target
                self._log = log.LogReader(self.log_path)
                sync_folder(target.parent)
            except OSError as error:
                raise write_error(target, error) from error
        return target

    def remove(self) -> None:
        """Delete the run for good. Raises LockedError when another process writes to it, StoreError."""
        with self._locked():
            self.settle()
            try:
                remove(self.path)
            except OSError as error:
                raise write_error(self.path, error) from error

    def repair(self) -> list[str]:
        """Repair the run after damage, and return a line for each thing done; nothing is deleted.

        Damaged files are renamed, config files restored from the states, the log rebuilt from states and what
        can be read of it; see `recovery.repair`. Raises LockedError, StoreError.
        """
        with self._locked():
            self.settle()
            notes = repair(self.path)
            self._next = self._find_next_label()
            return notes

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Hold the lock, or go on holding it."""
        if self._lock.held:
            yield
            return
        self.remarks = self._lock.acquire()
        try:
            yield
        finally:
            self._lock.release()

    def _require_lock(self) -> None:
        """Guard against writing without the lock, which is a mistake of the program."""
        if not self._lock.held:
            raise RuntimeError(f"{self.name}: writing needs `with run.writing():`")

    def _find_next_label(self) -> int:
        """One more than any label that the log names; a lost state's is not used again.

        Labels that no run can reach are ignored, so that there is room for new ones.
        """
        events = self.events()
        labels = [0, *(event.state.label for event in events if isinstance(event, Entry))]
        labels += [event.label for event in events if isinstance(event, Lost)]
        return max(label for label in labels if label < LABELS // 10) + 1
