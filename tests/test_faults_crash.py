"""What a power cut may leave of a commit: any prefix of its writes, and any part of what was not synced yet.

The operations of a real commit are recorded, and disks are made on which some of them never arrived. What was
synced before the cut is there; of the rest, names and blocks of 512 bytes may each be there or not.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from store_support import make_record, make_run

from ribbon_cli.store import Run

BLOCK = 512


@dataclass
class Operation:
    """One change of the disk: of a file's content (`inode` and bytes), or of a name in a folder."""

    kind: str
    inode: int = 0
    path: str = ""
    other: str = ""
    offset: int = 0
    data: bytes = b""


@dataclass
class Recorder:
    """Records what the store does to a folder, through the calls of `os`."""

    folder: Path
    operations: list[Operation] = field(default_factory=list)
    _open: dict[int, tuple[int, str, bool]] = field(default_factory=dict)

    @contextmanager
    def recording(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        with monkeypatch.context() as patch:
            for name in ("open", "write", "fsync", "link", "unlink", "rename", "ftruncate"):
                patch.setattr(os, name, getattr(self, name)(getattr(os, name)))
            yield

    def _note(self, kind: str, **facts: object) -> None:
        self.operations.append(Operation(kind, **facts))

    def _inside(self, path: object) -> str:
        return os.path.relpath(os.fspath(path), self.folder)

    def open(self, call: Callable) -> Callable:
        def wrapped(path, flags, *mode):
            new = bool(flags & os.O_CREAT) and not os.path.lexists(path)
            descriptor = call(path, flags, *mode)
            found = os.fstat(descriptor)
            self._open[descriptor] = (found.st_ino, self._inside(path), bool(flags & os.O_APPEND))
            if new:
                self._note("name", inode=found.st_ino, path=self._inside(path))
            return descriptor

        return wrapped

    def write(self, call: Callable) -> Callable:
        def wrapped(descriptor, data):
            inode, _, append = self._open[descriptor]
            end = os.fstat(descriptor).st_size
            offset = end if append else os.lseek(descriptor, 0, os.SEEK_CUR)
            written = call(descriptor, data)
            self._note("write", inode=inode, offset=offset, data=bytes(data[:written]))
            return written

        return wrapped

    def fsync(self, call: Callable) -> Callable:
        def wrapped(descriptor):
            inode, path, _ = self._open[descriptor]
            call(descriptor)
            folder = os.path.isdir(f"/proc/self/fd/{descriptor}")
            self._note("sync-folder" if folder else "sync", inode=inode, path=path)

        return wrapped

    def link(self, call: Callable) -> Callable:
        def wrapped(source, target):
            call(source, target)
            self._note("name", inode=os.stat(target).st_ino, path=self._inside(target))

        return wrapped

    def unlink(self, call: Callable) -> Callable:
        def wrapped(path):
            call(path)
            self._note("unname", path=self._inside(path))

        return wrapped

    def rename(self, call: Callable) -> Callable:
        def wrapped(source, target):
            call(source, target)
            inode = os.stat(target).st_ino
            self._note("rename", inode=inode, path=self._inside(target), other=self._inside(source))

        return wrapped

    def ftruncate(self, call: Callable) -> Callable:
        def wrapped(descriptor, size):
            call(descriptor, size)
            self._note("truncate", inode=self._open[descriptor][0], offset=size)

        return wrapped


class Disk:
    """Files by inode and names of inodes, from a folder; operations are applied to it, whole or in part."""

    def __init__(self, folder: Path) -> None:
        self.files: dict[int, bytearray] = {}
        self.names: dict[str, int] = {}
        for path in folder.rglob("*"):
            if path.is_file():
                self.names[os.path.relpath(path, folder)] = path.stat().st_ino
                self.files[path.stat().st_ino] = bytearray(path.read_bytes())

    def copy(self) -> Disk:
        twin = object.__new__(Disk)
        twin.files = {inode: bytearray(data) for inode, data in self.files.items()}
        twin.names = dict(self.names)
        return twin

    def apply(self, operation: Operation, arrives: Callable[[], bool]) -> None:
        """Apply an operation, each part of it if `arrives` says so."""
        if operation.kind == "write":
            self._write(operation, arrives)
        elif not arrives():
            return
        elif operation.kind in ("name", "rename"):
            self.files.setdefault(operation.inode, bytearray())
            self.names[operation.path] = operation.inode
            self.names.pop(operation.other, None)
        elif operation.kind == "unname":
            self.names.pop(operation.path, None)
        elif operation.kind == "truncate":
            del self.files.setdefault(operation.inode, bytearray())[operation.offset :]

    def _write(self, operation: Operation, arrives: Callable[[], bool]) -> None:
        content = self.files.setdefault(operation.inode, bytearray())
        for start in range(0, len(operation.data), BLOCK):
            if arrives():
                block = operation.data[start : start + BLOCK]
                place = operation.offset + start
                content.extend(bytes(max(0, place + len(block) - len(content))))
                content[place : place + len(block)] = block

    def write_to(self, folder: Path) -> None:
        """Make the folder that this disk holds."""
        for name in ("", "states"):
            (folder / name).mkdir(exist_ok=True, parents=True)
        for name, inode in self.names.items():
            (folder / name).write_bytes(self.files[inode])


def synced(operations: list[Operation], index: int) -> bool:
    """Whether a later operation of the list makes one durable."""
    this = operations[index]
    for later in operations[index + 1 :]:
        if this.kind in ("write", "truncate"):
            if later.kind == "sync" and later.inode == this.inode:
                return True
        elif later.kind == "sync-folder" and later.path == (os.path.dirname(this.path) or "."):
            return True
    return False


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """A disk with two states, and the operations of the commit of a third."""
    run = make_run(tmp_path / "base", states=2)
    with run.writing():
        before = Disk(run.path)
        recorder = Recorder(run.path)
        with recorder.recording(monkeypatch):
            run.commit(make_record(3))
    return before, recorder.operations, run.state_path(3).read_bytes()


def reopen(disk: Disk, folder: Path, new: bytes, *, acknowledged: bool) -> int:
    """Reopen a disk after the cut: the old states or these and the new one; how many there are."""
    disk.write_to(folder)
    run = Run.open(folder)
    for label in run.entries():  # readers never see a part, before any writer has cleared up
        run.load(label)
    with run.writing():
        labels = list(run.entries())
    assert labels in ([1, 2], [1, 2, 3])
    if 3 in labels:
        assert run.state_path(3).read_bytes() == new
    for label in labels:
        run.load(label)
    names = {path.name for path in folder.rglob("*")}
    assert not [name for name in names if name.startswith(".tmp-")]
    assert labels == [1, 2, 3] or not acknowledged
    assert run.next_label == labels[-1] + 1
    return len(labels)


@pytest.mark.parametrize(
    "sizes", [(1, 88, 2047), pytest.param((1, 88, 89, 90, 2047, 2048), marks=pytest.mark.faults)]
)
def test_every_prefix_of_a_commit_gives_the_old_or_the_new(recorded, tmp_path, sizes):
    """A write may also be torn, after so many bytes, in its middle, or before its last byte."""
    before, operations, new = recorded
    found = []
    for cut in range(len(operations) + 1):
        disk = before.copy()
        for operation in operations[:cut]:
            disk.apply(operation, lambda: True)
        found.append(reopen(disk, tmp_path / f"whole-{cut}" / "mobius-0123abcd", new, acknowledged=False))
        if cut < len(operations) and operations[cut].kind == "write":
            size = len(operations[cut].data)
            for part in sorted({*sizes, size // 2, size - 1} & set(range(1, size))):
                torn = disk.copy()
                shorter = Operation(**{**vars(operations[cut]), "data": operations[cut].data[:part]})
                torn.apply(shorter, lambda: True)
                reopen(torn, tmp_path / f"part-{cut}-{part}" / "mobius-0123abcd", new, acknowledged=False)
    assert found == sorted(found)
    assert found[-1] == 3


def subsets(recorded, tmp_path, count: int, seed: int) -> tuple[int, int]:
    """Cut at random places with random parts of what was not synced; how often old and new came out."""
    before, operations, new = recorded
    chance = random.Random(seed)
    counts = {2: 0, 3: 0}
    for k in range(count):
        cut = chance.randint(1, len(operations))
        share = chance.choice((0.1, 0.5, 0.9))
        disk = before.copy()
        for index, operation in enumerate(operations[:cut]):
            durable = synced(operations[:cut], index)
            disk.apply(operation, lambda durable=durable, share=share: durable or chance.random() < share)
        last = max(i for i, operation in enumerate(operations) if operation.kind == "sync")
        folder = tmp_path / f"cut-{k}" / "mobius-0123abcd"
        counts[reopen(disk, folder, new, acknowledged=cut > last)] += 1
    return counts[2], counts[3]


@pytest.mark.long
def test_random_parts_of_what_was_not_synced(recorded, tmp_path):
    old, new = subsets(recorded, tmp_path, 25, seed=1)
    assert old
    assert new


@pytest.mark.faults
def test_a_thousand_random_parts_of_what_was_not_synced(recorded, tmp_path, figure):
    old, new = subsets(recorded, tmp_path, 1000, seed=2)
    figure(f"{old} times the old state, {new} times the new one")
    assert min(old, new) > 100
