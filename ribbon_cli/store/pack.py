"""A run in one HDF5 file, to share: every file byte for byte, and beside them the states' datasets to look
at.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5ds, h5f, h5fd, h5g, h5o, h5p

from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import log
from ribbon_cli.store.atomic import publish, temporary_name, write_durable, write_error
from ribbon_cli.store.events import Created, Entry, removed
from ribbon_cli.store.folder import CONFIG, LOG, RESOLVED, STATES, place, state_name
from ribbon_cli.store.hdf5 import MAX_BYTES, PACK, UNREADABLE, check_dataset, read_bytes, text_attribute
from ribbon_cli.store.hdf5 import write_text_attribute as write_text
from ribbon_cli.store.preamble import refuse_newer
from ribbon_cli.store.run import Run
from ribbon_cli.text import in_a_line

FORMAT = PACK
FORMAT_VERSION = "1.1"
_RUN_NAME = re.compile(r"\w[\w.-]{0,200}-[0-9a-f]{8}(\.old-\d{1,6})?")
_LOOK = "states"
"""Group with a copy of each state's datasets; for people and viewers, never read back."""
_FILES = "files"
_SCALES_OF_AXES, _AXES_OF_SCALE = b"DIMENSION_LIST", b"REFERENCE_LIST"
"""Attributes in which HDF5 keeps what is attached to what."""


def pack(run: Run, path: Path, overwrite: bool = False) -> int:
    """Write a run to one file and return the number of its states; the same run gives the same bytes.

    Every state is compared with the log first. Raises StoreError for a damaged run, or when the file exists
    and is not to be overwritten, or cannot be written; UsageError where the folder has no run's name.
    """
    if not _RUN_NAME.fullmatch(run.name):
        raise UsageError(
            f"{run.path}: {run.name!r} is not as a run's folder is named, and could not be unpacked: "
            "call it NAME-HASH8 again"
        )
    temporary = temporary_name(path)
    try:
        try:
            count = _write(run, temporary)
            with open(temporary, "rb") as file:
                os.fsync(file.fileno())
            publish(temporary, path, overwrite)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise write_error(path, error) from error
    return count


def _write(run: Run, path: Path) -> int:
    """Write the whole file. Raises OSError, StoreError."""
    with _Sink(path) as sink:
        try:
            return _write_to(run, sink)
        finally:
            sink.check()


class _Sink(io.FileIO):
    """A new file that keeps its first failure, and what it could not write, until it is asked.

    HDF5 ends the process where a file that it has open cannot be written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "x+")
        self.failure: OSError | None = None
        self._kept: list[tuple[int, bytes]] = []

    def write(self, data: Any) -> int:
        """Write all; after a failure, keep it."""
        view = memoryview(data).cast("B")
        start, done = self.tell(), 0
        try:
            while done < len(view) and self.failure is None:
                done += super().write(view[done:]) or 0
        except OSError as error:
            self.failure = error
        if done < len(view):
            self._kept.append((start, bytes(view)))
            self.seek(start + len(view))
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Read what was written, be it kept."""
        view = memoryview(buffer).cast("B")
        start = self.tell()
        end = start + len(view)
        found = super().readinto(view) or 0
        view[found:] = bytes(len(view) - found)
        for at, data in self._kept:
            low, high = max(start, at), min(end, at + len(data))
            if low < high:
                view[low - start : high - start] = data[low - at : high - at]
        self.seek(end)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Cut or extend the file."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def check(self) -> None:
        """Raise the first failure, if any."""
        if self.failure is not None:
            raise self.failure


def _create(sink: _Sink) -> h5py.h5f.FileID:
    """A new HDF5 file in a sink. Its driver's settings end here: freed after Python, they crash."""
    creation = h5p.create(h5p.FILE_CREATE)
    creation.set_obj_track_times(False)
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5fd.fileobj_driver, sink)
    access.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    return h5f.create(b"pack", h5f.ACC_TRUNC, creation, access)


def _write_to(run: Run, sink: _Sink) -> int:
    """Write the whole file. Raises OSError, StoreError."""
    entries = run.entries()
    lines = read_bytes(run.log_path)
    with h5py.File(_create(sink)) as file:
        for name, text in (("format", FORMAT), ("format_version", FORMAT_VERSION), ("run", run.name)):
            write_text(file.id, name, text)
        plain = h5p.create(h5p.GROUP_CREATE)
        plain.set_obj_track_times(False)
        for group in (_LOOK, _FILES, f"{_FILES}/{STATES}"):
            h5g.create(file.id, group.encode(), gcpl=plain)
        for name in (CONFIG, RESOLVED):
            _write_file(file, name, read_bytes(run.path / name))
        _write_file(file, LOG, lines[: lines.rfind(b"\n") + 1])
        for label, entry in entries.items():
            sink.check()
            data = run.committed_bytes(entry)
            _write_file(file, state_name(label), data)
            with h5py.File(h5f.open_file_image(data)) as state:
                state.copy("/", file, f"{_LOOK}/{label:04d}")
                _attach_scales(state, file[f"{_LOOK}/{label:04d}"])
    return len(entries)


def _attach_scales(state: h5py.File, copy: h5py.Group) -> None:
    """Attach the dimension scales of a state's copy as they are in the state.

    HDF5 copies an attachment as a reference to where the scale was in the other file, which leads nowhere.
    """
    paths: list[bytes] = []
    h5o.visit(state.id, paths.append)
    copies = {path: h5o.open(copy.id, path) for path in paths}
    for copied in copies.values():
        for name in (_SCALES_OF_AXES, _AXES_OF_SCALE):
            if h5a.exists(copied, name):
                h5a.delete(copied, name)
    for path, copied in copies.items():
        original = h5o.open(state.id, path)
        if h5a.exists(original, _SCALES_OF_AXES):
            group = path.rpartition(b"/")[0]
            for axis, dim in enumerate(h5py.Dataset(original).dims):
                for scale in dim:
                    h5ds.attach_scale(copied, copies[group + b"/" + scale.encode()], axis)


def _write_file(file: h5py.File, name: str, data: bytes) -> None:
    """Put a file's bytes into a dataset."""
    bytes_ = np.frombuffer(data, dtype=np.uint8)
    options: dict[str, Any] = {"chunks": (len(data),), "fletcher32": True} if data else {}
    file.create_dataset(f"{_FILES}/{name}", data=bytes_, track_times=False, **options)


def unpack(path: Path, root: Path) -> Run:
    """Restore the run of a packed file in `root`, byte for byte, and return it: nothing or a complete run is
    made.

    Raises UsageError where the run is there already, StoreError for a file that is damaged or holds no run,
    or when the run cannot be written.
    """
    name, files = read_pack(path)
    target = root / name
    if os.path.lexists(target):
        raise UsageError(f"{target}: exists already: choose another folder with --runs, or set it aside")
    temporary = temporary_name(target)
    try:
        try:
            root.mkdir(parents=True, exist_ok=True)
            os.mkdir(temporary)
            os.mkdir(temporary / STATES)
            for inside, data in files:
                write_durable(temporary / inside, data)
            place(temporary, target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise write_error(target, error) from error
    return Run.open(target)


def read_pack(path: Path) -> tuple[str, Iterator[tuple[str, bytes]]]:
    """Return the name of a packed run, and its files one after the other, each compared with the run's log.

    Raises StoreError, at once or while files are read, for whatever is not as `pack` writes it. Names of
    files are those that a run has, so that none can leave its folder.
    """
    if not os.path.isfile(path):
        raise StoreError(f"{path}: no such file")
    try:
        return _run_name(path), _files(path)
    except UNREADABLE as error:
        raise _not_a_pack(path, error) from error


def _run_name(path: Path) -> str:

    with h5py.File(path, "r") as file:
        if text_attribute(file, "format") != FORMAT:
            raise ValueError(f"its format is {text_attribute(file, 'format')!r}, not {FORMAT!r}")
        refuse_newer(text_attribute(file, "format_version"), path, FORMAT_VERSION)
        name = text_attribute(file, "run")
        if not _RUN_NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no run's name")
        return name


def _files(path: Path) -> Iterator[tuple[str, bytes]]:

    try:
        with h5py.File(path, "r") as file:
            lines = _read_file(file, LOG)
            events = [log.parse_line(line) for line in lines.split(b"\n")[:-1]]
            if not events or not isinstance(events[0], Created) or not lines.endswith(b"\n"):
                raise ValueError("its log does not begin as a run's")
            hashes = {name: events[0].files[name] for name in (CONFIG, RESOLVED)}
            gone = removed(events)
            for event in events:
                if isinstance(event, Entry) and event.state.label not in gone:
                    hashes[state_name(event.state.label)] = event.sha256
            yield LOG, lines
            for name, committed in hashes.items():
                data = _read_file(file, name)
                if hashlib.sha256(data).hexdigest() != committed:
                    raise ValueError(f"{name} is not what the log says")
                yield name, data
    except UNREADABLE as error:
        raise _not_a_pack(path, error) from error


def _read_file(file: h5py.File, name: str) -> bytes:
    """Bytes of a file in a pack. Raises ValueError for a dataset that is not plain bytes within the file."""
    node: Any = file
    where = f"{_FILES}/{name}"
    for part in where.split("/"):
        if not isinstance(node, h5py.Group) or not isinstance(node.get(part, getlink=True), h5py.HardLink):
            raise ValueError(f"{where} is missing, or not in the file itself")
        node = node[part]
    if not isinstance(node, h5py.Dataset) or node.dtype != "u1" or len(node.shape or ()) != 1:
        raise ValueError(f"{where} does not hold bytes")
    check_dataset(where, node.id, ("u1",))
    if node.size > MAX_BYTES:
        raise ValueError(f"{where} is larger than any file of a run")
    return bytes(node[()].tobytes())


def _not_a_pack(path: Path, error: Exception) -> StoreError:
    """One line for a file that cannot be unpacked."""
    return StoreError(f"{path}: damaged, or not a packed run: {in_a_line(error)}")
