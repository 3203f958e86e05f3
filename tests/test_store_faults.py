"""Every system call of the store fails once, or from then on: what was stored stays, errors are one line."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
from store_support import make_record, make_run

from ribbon_cli.errors import StoreError
from ribbon_cli.store import Run, content_sha256, write_atomic

CALLS = (
    "open",
    "write",
    "fsync",
    "link",
    "unlink",
    "rename",
    "close",
    "ftruncate",
    "mkdir",
    "fstat",
    "pread",
)


EACH_STEP = [pytest.param(3, id="every third"), pytest.param(1, marks=pytest.mark.faults, id="every")]
"""Of the calls that fail one after another, which are tried: every third, and in `make test-faults` each."""


class Faults:
    """Makes the n-th of the store's system calls fail, or all from the n-th on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monkeypatch = monkeypatch
        self.count = 0

    @contextmanager
    def at(self, n: int, forever: bool = False, calls: tuple[str, ...] = CALLS, code: int = errno.ENOSPC):
        self.count = 0
        with self.monkeypatch.context() as patch:
            for name in calls:
                patch.setattr(os, name, self._wrap(name, getattr(os, name), n, forever, code))
            yield

    def _wrap(self, name: str, call: Callable, n: int, forever: bool, code: int) -> Callable:
        def wrapped(*args, **kwargs):
            self.count += 1
            if self.count == n or (forever and self.count > n):
                if name == "close":
                    call(*args, **kwargs)  # a failing close closes all the same
                raise OSError(code, os.strerror(code))
            return call(*args, **kwargs)

        return wrapped


@pytest.fixture
def faults(monkeypatch):
    return Faults(monkeypatch)


@pytest.fixture
def copies(tmp_path):
    """Makes fresh copies of a run of two states."""
    made = make_run(tmp_path / "original", states=2)

    def copy(n: int) -> Run:
        return Run.open(shutil.copytree(made.path, tmp_path / str(n) / made.name))

    return copy


def failure(action: Callable[[], object]) -> str | None:
    """The message of the StoreError that an action raises, if it does."""
    try:
        action()
    except StoreError as error:
        return str(error)
    return None


@cache
def expected_content(label: int) -> str:
    return content_sha256(make_record(label))


def enter(run: Run) -> None:
    with run.writing():
        pass


def assert_intact(run: Run, stored: int) -> None:
    """The first states are there and right, what is listed can be read, the next writer clears the rest."""
    labels = [state.label for state in run.states()]
    assert labels[:stored] == list(range(1, stored + 1))
    enter(run)
    for label, entry in run.entries().items():
        run.load(label)
        assert entry.state.content_sha256 == expected_content(label)
    assert not list(run.path.rglob(".tmp-*"))
    assert not list(run.path.rglob("*.damaged*"))


@pytest.mark.parametrize("forever", [False, True])
@pytest.mark.parametrize("step", EACH_STEP)
def test_a_commit_in_which_any_call_fails_costs_no_other_state(copies, faults, forever, step):
    record = make_record(3)
    for n in range(1, 100, step):
        run = copies(n)
        with run.writing(), faults.at(n, forever):
            message = failure(lambda run=run: run.commit(record))
        if message:
            assert "\n" not in message
            assert "No space left on device; free some space" in message
        assert_intact(run, 2 if message else 3)
        if faults.count < n:
            break
    assert message is None
    assert n > 10


def test_a_failed_commit_can_be_repeated_at_once(copies, faults):
    record = make_record(3)
    for n in range(1, 100):
        run = copies(n)
        with run.writing():
            with faults.at(n, calls=("write", "fsync", "link")):
                message = failure(lambda run=run: run.commit(record))
            if message:
                run.commit(record)
        assert_intact(run, 3)
        if faults.count < n:
            break
    assert n == 7  # write, fsync, link, fsync of the folder; write and fsync of the log


@pytest.mark.parametrize("forever", [False, True])
@pytest.mark.parametrize("step", EACH_STEP)
def test_a_run_whose_creation_fails_is_absent_or_whole(tmp_path, faults, forever, step):
    for n in range(1, 100, step):
        root = tmp_path / f"{n}"
        with faults.at(n, forever):
            message = failure(lambda root=root: Run.create_or_open(root, "mobius", "0123abcd", "a", "b"))
        assert message is None or "No space left on device" in message
        if not forever and root.exists():
            assert [name for name in os.listdir(root) if name.startswith(".")] == []
        assert_intact(make_run(root, states=1), 1)
        if faults.count < n:
            break
    assert message is None
    assert n > 10


@pytest.mark.parametrize("step", EACH_STEP)
def test_recovery_in_which_any_call_fails_can_be_repeated(copies, faults, step):
    for n in range(1, 100, step):
        run = copies(n)
        run.log_path.write_bytes(run.log_path.read_bytes()[:-20])
        (run.path / ".tmp-x").write_bytes(b"x")
        with faults.at(n):
            failure(lambda run=run: enter(run))
        assert_intact(run, 1)
        assert len(run.states()) == 2
        if faults.count < n:
            break
    assert n > 10


@pytest.mark.parametrize("step", EACH_STEP)
def test_a_rebuild_in_which_any_call_fails_can_be_repeated(copies, faults, step):
    for n in range(1, 100, step):
        run = copies(n)
        data = bytearray(run.log_path.read_bytes())
        data[-40] ^= 1
        run.log_path.write_bytes(data)
        with faults.at(n):
            failure(run.repair)
        run.repair()
        assert_intact(run, 2)
        if faults.count < n:
            break
    assert n > 10


def test_full_disk_leaves_the_old_file_and_says_so(tmp_path, faults):
    path = tmp_path / "x.npz"
    path.write_bytes(b"old")
    for n in range(1, 20):
        with faults.at(n, forever=True, calls=("write", "fsync")):
            message = failure(lambda: write_atomic(path, b"new", overwrite=True))
        if message:
            assert message.startswith(f"{path}: cannot be written: No space left on device; free some")
        # Once renamed, an overwritten file cannot be taken back: only its folder's sync has failed then.
        assert path.read_bytes() == (b"old" if n < 3 else b"new")
        assert os.listdir(tmp_path) == ["x.npz"]
        if faults.count < n:
            break
    assert n == 4


def test_short_writes_are_continued(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, bytes(data[:7])))
    write_atomic(tmp_path / "x", b"0123456789" * 10)
    assert (tmp_path / "x").read_bytes() == b"0123456789" * 10


def test_file_systems_without_hard_links_or_folder_syncs_serve(tmp_path, monkeypatch):
    def no_link(*args):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    sync = os.fsync

    def no_folder_sync(descriptor):
        if Path(f"/proc/self/fd/{descriptor}").is_dir():
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        sync(descriptor)

    monkeypatch.setattr(os, "link", no_link)
    monkeypatch.setattr(os, "fsync", no_folder_sync)
    write_atomic(tmp_path / "x", b"1")
    with pytest.raises(StoreError, match="exists already"):
        write_atomic(tmp_path / "x", b"2")
    assert (tmp_path / "x").read_bytes() == b"1"
    assert os.listdir(tmp_path) == ["x"]


@pytest.mark.parametrize(
    ("code", "advice"),
    [(errno.EACCES, "permissions"), (errno.EROFS, "writable"), (errno.EIO, "check the file")],
)
def test_messages_say_what_to_do(tmp_path, faults, code, advice):
    with faults.at(1, code=code), pytest.raises(StoreError, match=advice):
        write_atomic(tmp_path / "x", b"1")


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(StoreError, match="its folder does not exist"):
        write_atomic(tmp_path / "none" / "x", b"1")


def test_an_interrupted_commit_is_kept_or_not_but_never_half(tmp_path, monkeypatch):
    for name in ("write", "fsync", "link", "unlink"):
        run = make_run(tmp_path / name, states=1)

        def interrupt(*args):
            raise KeyboardInterrupt

        with run.writing(), monkeypatch.context() as patch:
            patch.setattr(os, name, interrupt)
            with pytest.raises(KeyboardInterrupt):
                run.commit(make_record(2))
        assert_intact(run, 1)
