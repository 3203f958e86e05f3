"""The layout of a run's folder, and how such a folder is made."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import log
from ribbon_cli.store.atomic import is_temporary, sync_folder, temporary_name, write_durable
from ribbon_cli.store.events import Created
from ribbon_cli.store.lock import HOLDER, LOCK, RunLock

CONFIG = "config.yaml"
RESOLVED = "resolved.yaml"
LOG = "log.jsonl"
STATES = "states"
RUN_FORMAT = "ribbon-run"
RUN_FORMAT_VERSION = "1.4"

RUN_FOLDER = re.compile(r"(?P<name>.+)-[0-9a-f]{8}(?P<aside>\.old-\d+)?")
"""Name of a run's folder."""
_STATE_FILE = re.compile(r"(\d{4,})\.h5")
_ABANDONED = 3600.0
"""Seconds after which an unfinished run folder cannot belong to a process that is still creating it."""


def is_run(path: Path) -> bool:
    """Whether a folder is a run's, even one that has lost a file; an unreadable folder is judged by its
    name.
    """
    if path.name.startswith("."):
        return False
    for name in (RESOLVED, LOG):
        try:
            if stat.S_ISREG(os.stat(path / name).st_mode):
                return True
        except PermissionError:
            return RUN_FOLDER.fullmatch(path.name) is not None
        except (OSError, ValueError):
            continue
    return False


def state_name(label: int) -> str:
    """Path of a state's file inside its run."""
    return f"{STATES}/{label:04d}.h5"


def label_of(name: str) -> int | None:
    """Label in the name of a state's file, None for any other name."""
    match = _STATE_FILE.fullmatch(name)
    return int(match[1]) if match and int(match[1]) > 0 and name == f"{int(match[1]):04d}.h5" else None


def state_files(folder: Path) -> dict[int, Path]:
    """Files of a run's states by label, ascending. Raises OSError."""
    labels = filter(None, map(label_of, os.listdir(folder / STATES)))
    return {label: folder / state_name(label) for label in sorted(labels)}


def state_entry(state: dict[str, Any], data: bytes) -> dict[str, Any]:
    """What the log says of a state with the summary `state`, whose file holds `data`."""
    return {
        "event": "state",
        "time": log.utc_now(),
        "file": state_name(state["label"]),
        "sha256": hashlib.sha256(data).hexdigest(),
        "state": state,
    }


def created_entry(files: Mapping[str, bytes]) -> dict[str, Any]:
    """What the log's first line says, with the hashes of its config files."""
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    return {
        "event": "created",
        "time": log.utc_now(),
        "format": RUN_FORMAT,
        "format_version": RUN_FORMAT_VERSION,
        "files": hashes,
    }


def check_run_version(path: Path, created: Created) -> None:
    """Refuse a run of a newer format by the first event of its log. Raises StoreError."""
    version = created.format_version
    if int(version.partition(".")[0]) > int(RUN_FORMAT_VERSION.partition(".")[0]):
        raise StoreError(f"{path}: run of format {version}, this is {RUN_FORMAT_VERSION}: update ribbon")


def create(path: Path, files: Mapping[str, bytes]) -> None:
    """Make a run's folder: built under a temporary name beside it, then renamed.

    Another process may have made the same folder meanwhile, which serves as well. Raises OSError, and leaves
    nothing unless it is complete.
    """
    temporary = temporary_name(path)
    try:
        os.mkdir(temporary)
        os.mkdir(temporary / STATES)
        for name, data in files.items():
            write_durable(temporary / name, data)
        write_durable(temporary / LOG, log.format_line(created_entry(files)))
        try:
            place(temporary, path)
        except OSError:
            if not is_run(path):
                if not _has_lock_alone(path):
                    raise
                _clear(path)
                place(temporary, path)
            sync_folder(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _has_lock_alone(path: Path) -> bool:
    """Whether a folder is what a process leaves that locks a run while another deletes it."""
    try:
        return set(os.listdir(path)) <= {LOCK, HOLDER}
    except OSError:
        return False


def _clear(path: Path) -> None:
    """Remove a folder that is not a run. Raises OSError."""
    other = temporary_name(path)
    os.rename(path, other)
    if is_run(other):  # another process has put a run there meanwhile
        os.rename(other, path)
    else:
        shutil.rmtree(other, ignore_errors=True)


def place(temporary: Path, path: Path) -> None:
    """Give a finished folder its name, durably; its files are synced already. Raises OSError."""
    sync_folder(temporary / STATES)
    sync_folder(temporary)
    os.rename(temporary, path)
    sync_folder(path.parent)


def remove(path: Path) -> None:
    """Delete a run's folder: renamed first, so that a kill leaves no half run under its name.

    Raises UsageError for a link to a run, which is not all of it; OSError.
    """
    if os.path.islink(path):
        raise UsageError(f"{path}: a link to {os.path.realpath(path)}: name that folder, or remove the link")
    temporary = temporary_name(path)
    os.rename(path, temporary)
    sync_folder(path.parent)
    shutil.rmtree(temporary)


def remove_abandoned(root: Path) -> None:
    """Remove folders that a killed process was creating, removing or repeating a run in long ago.

    Folders with other names, or in which a run is being written, are kept. Failures are harmless and ignored.
    """
    with suppress(OSError):
        for path in [path for path in root.iterdir() if is_temporary(path.name)]:
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > _ABANDONED and not _written_in(path):
                    shutil.rmtree(path, ignore_errors=True)


def _written_in(folder: Path) -> bool:
    """Whether a process writes to a run in a folder, as a repeated run for hours. Raises OSError."""
    return any(RunLock(path).holder() for path in folder.iterdir() if path.is_dir())
