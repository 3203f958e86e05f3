"""One writer a run: an operating-system lock that ends with its process, and a note of who holds it."""

from __future__ import annotations

import json
import os
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.errors import LockedError, StoreError
from ribbon_cli.store.atomic import write_atomic, write_error
from ribbon_cli.store.log import utc_now

if TYPE_CHECKING:
    from filelock import BaseFileLock

LOCK = "lock"
HOLDER = "lock.holder"
_PATIENCE = 0.5
"""Seconds for which a new holder may still be about to write its note."""


class RunLock:
    """The lock of a run's folder; `folder` follows the run when it is renamed under the lock.

    The note of pid and host is only ever read by those who fail to get the lock: a note left by a killed
    process means nothing, since its lock ended with it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock: BaseFileLock | None = None

    def acquire(self) -> None:
        """Take the lock without waiting. Raises LockedError naming the holder; StoreError."""
        from filelock import FileLock, Timeout

        lock = FileLock(self.folder / LOCK, timeout=0, thread_local=False)
        try:
            before = os.stat(self.folder).st_ino
            lock.acquire()
        except Timeout:
            raise LockedError(self._describe_holder()) from None
        except NotImplementedError as error:
            raise StoreError(
                f"{self.folder}: its file system has no locks: choose another with --runs"
            ) from error
        except OSError as error:
            raise write_error(self.folder / LOCK, error) from error
        self._lock = lock
        try:
            # The folder may have been set aside, and another put in its place, before the lock was ours.
            if not self.folder.is_dir() or os.stat(self.folder).st_ino != before:
                raise LockedError(
                    f"{self.folder.name}: just set aside by another process: repeat the command"
                )
            holder = {"pid": os.getpid(), "host": socket.gethostname(), "since": utc_now()}
            write_atomic(self.folder / HOLDER, json.dumps(holder).encode() + b"\n", overwrite=True)
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Give the lock back; does nothing when it is not held."""
        if self._lock is None:
            return
        with suppress(OSError):
            os.unlink(self.folder / HOLDER)
        with suppress(OSError):  # a close that fails has let go of the lock all the same
            self._lock.release(force=True)
        self._lock = None

    @property
    def held(self) -> bool:
        """Whether this object holds the lock."""
        return self._lock is not None

    def _describe_holder(self) -> str:
        """One line that names the process which holds the lock, and what to do."""
        deadline = time.monotonic() + _PATIENCE
        holder = self._read_holder()
        while not _plausible(holder) and time.monotonic() < deadline:
            time.sleep(0.02)
            holder = self._read_holder()
        if not _plausible(holder):
            return f"{self.folder.name}: locked by another process: wait until it ends, or stop it"
        return (
            f"{self.folder.name}: locked by process {holder['pid']} on {holder['host']}"
            f" since {holder['since']}: wait until it ends, or stop it"
        )

    def _read_holder(self) -> dict[str, Any]:
        """Return the note of the holder, empty when there is none or it is no note."""
        try:
            holder = json.loads((self.folder / HOLDER).read_bytes())
        except (OSError, ValueError):
            return {}
        return holder if isinstance(holder, dict) and {"pid", "host", "since"} <= holder.keys() else {}


def _plausible(holder: dict[str, Any]) -> bool:
    """Whether a note can be of a living process: one of this host with a dead pid was left by a kill."""
    if not holder:
        return False
    if holder["host"] != socket.gethostname():
        return True
    try:
        os.kill(int(holder["pid"]), 0)
    except ProcessLookupError:
        return False
    except (OSError, ValueError, OverflowError):
        return True
    return True
