"""Files that appear whole or not at all, even if the process is killed or the disk is full.

Every system call goes through the `os` module by name, so that tests can make any one of them fail.
"""

from __future__ import annotations

import errno
import itertools
import os
import re
from contextlib import suppress
from pathlib import Path

from ribbon_cli.errors import StoreError

TEMPORARY = ".tmp-"
"""Prefix of files and folders that are not finished; whoever holds the run's lock may remove them."""

_NO_LINKS = {errno.EPERM, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EMLINK}
_NO_FOLDER_SYNC = {errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP}
_NO_FILE = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ELOOP, errno.ENXIO}
_counter = itertools.count()
_STEM = 40
_NAMED = re.escape(TEMPORARY) + r".{0,40}-\d+-\d+-[0-9a-f]{8}"


def write_atomic(path: str | Path, data: bytes, *, overwrite: bool = False) -> None:
    """Write a file so that it is durable and whole when this returns, and absent or as before when it raises.

    The bytes go to a temporary file in the same folder, are synced, and get their name in one step; then the
    folder is synced. Without `overwrite` an existing file is never replaced. Raises StoreError, one
    line, for any failure of the file system, after removing the temporary file.
    """
    path = Path(path)
    temporary = temporary_name(path)
    try:
        try:
            write_durable(temporary, data)
            publish(temporary, path, overwrite)
        finally:
            with suppress(OSError):
                os.unlink(temporary)
    except OSError as error:
        raise write_error(path, error) from error


def write_error(path: str | Path, error: OSError) -> StoreError:
    """One line for a failed write, with what to do about it."""
    advice = {
        errno.ENOSPC: "free some space, then repeat the command",
        errno.EDQUOT: "free some of your quota, then repeat the command",
        errno.EEXIST: "it exists already and is not replaced",
        errno.EACCES: "check the folder's permissions",
        errno.EROFS: "choose a folder on a writable file system",
        errno.ENOENT: "its folder does not exist",
    }
    reason = error.strerror or str(error) or type(error).__name__
    hint = advice.get(error.errno or 0, "check the file system")
    return StoreError(f"{path}: cannot be written: {reason}; {hint}")


def is_passing(error: StoreError) -> bool:
    """Whether what could not be read may well be whole: no permission, too many open files, a disk away.

    Not so where nothing of that name is there, or no file.
    """
    cause = error.__cause__
    return isinstance(cause, OSError) and cause.errno not in _NO_FILE


def unused_name(path: Path, word: str) -> Path:
    """First of PATH.WORD-1, PATH.WORD-2, ... that does not exist."""
    names = (path.with_name(f"{path.name}.{word}-{k}") for k in itertools.count(1))
    return next(name for name in names if not os.path.lexists(name))


def put_aside(path: Path) -> Path:
    """Rename a damaged file to *.damaged-K. Raises StoreError."""
    target = unused_name(path, "damaged")
    try:
        os.rename(path, target)
    except OSError as error:
        raise write_error(target, error) from error
    return target


def temporary_name(path: Path) -> Path:
    """Return an unused name for an unfinished file or folder beside `path`."""
    # Cut short: a name may be as long as the file system lets it, and no longer.
    stem = path.stem[:_STEM]
    return path.parent / f"{TEMPORARY}{stem}-{os.getpid()}-{next(_counter)}-{os.urandom(4).hex()}"


def is_temporary(name: str) -> bool:
    """Whether a name was given by `temporary_name` and not by another program."""
    return re.fullmatch(_NAMED, name, re.DOTALL) is not None


def without_waiting(path: str | Path, flags: int) -> int:
    """Open a file, as `opener` of `open`; of a pipe, do not wait for its writer."""
    return os.open(path, flags | os.O_NONBLOCK)


def write_durable(path: str | Path, data: bytes) -> None:
    """Create a new file, write all of it and sync it. Raises OSError."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        write_all(descriptor, data)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_all(descriptor: int, data: bytes) -> None:
    """Write every byte; a single call may write fewer. Raises OSError."""
    view = memoryview(data)
    while view:
        written = os.write(descriptor, view)
        if written == 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        view = view[written:]


def sync_folder(path: str | Path) -> None:
    """Make the names in a folder durable, where the file system can. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_FOLDER_SYNC:
            raise
    finally:
        os.close(descriptor)


def publish(temporary: Path, path: Path, overwrite: bool) -> None:
    """Give a finished, synced file its name, durably.

    Raises OSError, FileExistsError for an existing file.
    """
    _rename(temporary, path, overwrite)
    try:
        sync_folder(path.parent)
    except BaseException:
        # Its name may not survive a power cut, so neither success nor failure would be true: take it back.
        if not overwrite:
            with suppress(OSError):
                os.unlink(path)
        raise


def _rename(temporary: Path, path: Path, overwrite: bool) -> None:
    if overwrite:
        os.rename(temporary, path)
        return
    try:
        # A link, unlike a rename, fails when the name is taken, however many processes try.
        os.link(temporary, path)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        # No hard links here (some network and removable file systems): the run's lock keeps others out.
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from error
        os.rename(temporary, path)
