"""One writer for each run: an operating-system lock that ends with its process, and a note of who holds it.

Where the file system has no such locks, a file that only one process can create stands in for it. That one
outlives a killed process, so that a later writer must find out whether its holder is alive.
"""

from __future__ import annotations

import errno
import json
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ribbon_cli.errors import LockedError, StoreError
from ribbon_cli.store.atomic import write_atomic, write_durable, write_error
from ribbon_cli.store.hdf5 import read_bytes
from ribbon_cli.store.log import parse_json, utc_now

if TYPE_CHECKING:
    from filelock import BaseFileLock

LOCK = "lock"
HOLDER = "lock.holder"
CLAIM = "lock.claim"
_PATIENCE = 2.0
"""Seconds for which a new holder may still be about to write its note."""
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.EINVAL}


@dataclass(frozen=True)
class Holder:
    """The process that writes to a run."""

    pid: int
    host: str
    since: str

    def __str__(self) -> str:
        """The process in words, on one line whatever its note says."""
        words = f"process {self.pid} on {self.host} since {self.since}"
        return "".join(c if c.isprintable() else "?" for c in words)[:300]


@dataclass(frozen=True)
class _Note:
    """What a lock's file says: its holder, and what tells it from a later process with its number."""

    holder: Holder
    start: str | None


class RunLock:
    """The lock of a run's folder; `folder` follows the run when it is renamed under the lock.

    `lock` is locked by flock, and `lock.holder` is a note for people: left by a killed process it means
    nothing, since the lock ended with it. Without flock, `lock.claim` is lock and note in one. Whoever locks
    by flock respects a claim too, since another machine may see the same folder without flock.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock: BaseFileLock | None = None
        self._claimed = False

    @property
    def held(self) -> bool:
        """Whether this object holds the lock."""
        return self._lock is not None or self._claimed

    def acquire(self) -> list[str]:
        """Take the lock without waiting; return remarks on locks that were left behind or are of the weaker
        kind.

        Raises LockedError naming the holder; StoreError when the folder cannot be written.
        """
        try:
            before = os.stat(self.folder).st_ino
            remarks = self._by_flock() or self._by_claim()
        except OSError as error:
            raise write_error(self.folder / LOCK, error) from error
        try:
            # The folder may have been set aside, and another put in its place, before the lock was ours.
            if not self.folder.is_dir() or os.stat(self.folder).st_ino != before:
                raise LockedError(
                    f"{self.folder.name}: just set aside by another process: repeat the command"
                )
            if self._lock is not None:
                remarks = self._left_behind(remarks)
                write_atomic(self.folder / HOLDER, _note(), overwrite=True)
        except BaseException:
            self.release()
            raise
        return [remark for remark in remarks if remark]

    def _by_flock(self) -> list[str]:
        """Lock by flock; return an empty list where the file system has none. Raises LockedError, OSError."""
        from filelock import Timeout

        lock = _file_lock(self.folder / LOCK)
        try:
            lock.acquire()
        except Timeout:
            raise LockedError(self._describe_holder()) from None
        except NotImplementedError:
            return []
        except OSError as error:
            if error.errno in _NO_LOCKS:
                return []
            raise
        self._lock = lock
        return [""]

    def _by_claim(self) -> list[str]:
        """Lock by creating a file. Raises LockedError, OSError."""
        remarks = [f"{self.folder.name}: its file system has no flock: locked by the file {CLAIM} instead"]
        remarks += self._drop_stale_claim()
        try:
            write_durable(self.folder / CLAIM, _note())
        except FileExistsError:
            raise LockedError(self._describe_holder()) from None
        self._claimed = True
        return remarks

    def _left_behind(self, remarks: list[str]) -> list[str]:
        """Remarks on what the last holder left.

        Raises LockedError where a claim may be of a living process.
        """
        claim = self._drop_stale_claim()
        if os.path.lexists(self.folder / CLAIM):
            raise LockedError(self._describe_holder())
        note = self._read(HOLDER)
        left = f"{self.folder.name}: {note.holder} ended without releasing the run" if note else ""
        return [*remarks, *claim, left]

    def _drop_stale_claim(self) -> list[str]:
        """Remove a claim of a process of this machine that has ended. Raises OSError."""
        path = self.folder / CLAIM
        note = self._read(CLAIM)
        if note is None or _living(note):
            return []
        # Taken away under another name first: if it is a newer claim by now, it goes back.
        taken = path.with_name(f"{CLAIM}.stale-{os.getpid()}")
        try:
            os.rename(path, taken)
        except FileNotFoundError:
            return []
        if self._read(taken.name) != note:
            with suppress(OSError):
                os.link(taken, path)
            os.unlink(taken)
            return []
        os.unlink(taken)
        return [f"{self.folder.name}: removed the lock of {note.holder}, which has ended"]

    def release(self) -> None:
        """Release the lock; does nothing if it is not held."""
        if self._claimed:
            with suppress(OSError):
                os.unlink(self.folder / CLAIM)
            self._claimed = False
        if self._lock is None:
            return
        with suppress(OSError):
            os.unlink(self.folder / HOLDER)
        with suppress(OSError):  # a close that fails has released the lock nevertheless
            self._lock.release(force=True)
        self._lock = None

    def holder(self) -> Holder | None:
        """The process that holds the lock, as far as its note tells; None if none does."""
        notes = (self._read(name) for name in (CLAIM, HOLDER))
        return next((note.holder for note in notes if note is not None and _living(note)), None)

    def _describe_holder(self) -> str:
        """One line that names the process which holds the lock, and what to do."""
        deadline = time.monotonic() + _PATIENCE
        holder = self.holder()
        while holder is None and time.monotonic() < deadline:
            time.sleep(0.02)
            holder = self.holder()
        wait = "wait until it ends, or stop it"
        claim = self.folder / CLAIM
        if claim.exists():
            wait += f" (if it has ended already, remove {claim})"
        return f"{self.folder.name}: locked by {holder or 'another process'}: {wait}"

    def _read(self, name: str) -> _Note | None:
        """Return a note, None when there is none or it is no note."""
        try:
            note = parse_json(read_bytes(self.folder / name))
            return _Note(Holder(note["pid"], note["host"], note["since"]), note.get("start"))
        except (StoreError, ValueError, TypeError, KeyError, AttributeError):
            return None


def _file_lock(path: Path) -> BaseFileLock:
    """filelock's lock, told not to replace flock by a weaker lock without saying so."""
    from filelock import FileLock

    return FileLock(path, timeout=0, thread_local=False, fallback_to_soft=False)


def _note() -> bytes:
    """The note of this process."""
    note = {
        "pid": os.getpid(),
        "host": _host(),
        "since": utc_now(),
        "start": _start(os.getpid()),
    }
    return json.dumps(note).encode() + b"\n"


def _host() -> str:
    """The name of this machine; only a lock's note asks for it, and what tells it takes long to import."""
    import socket

    return socket.gethostname()


def _start(pid: int) -> str | None:
    """What tells a process from a later one with the same pid: the boot, and the moment of its start after
    it.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except (OSError, ValueError):
        return None
    return f"{boot} {fields[19]}"


def _living(note: _Note) -> bool:
    """Whether a note may belong to a living process; a process of another machine is unknown and counts as
    living.
    """
    if note.holder.host != _host():
        return True
    try:
        pid = int(note.holder.pid)
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, ValueError, OverflowError, TypeError):
        return True
    start = _start(pid)
    return start is None or note.start is None or note.start == start
