"""Writers of a run: one at a time, each told who writes, and killed ones cost nothing."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from store_support import make_record, make_run, relative_files

from ribbon_cli.errors import LockedError
from ribbon_cli.store import Run

HERE = Path(__file__).parent


def start(code: str, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=HERE, stdout=subprocess.PIPE, text=True, bufsize=1
    )


HOLD = """
import sys, time
from ribbon_cli.store import Run
with Run.open(sys.argv[1]).writing():
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_writer_is_told_who_writes_and_a_killed_one_leaves_no_lock(tmp_path):
    run = make_run(tmp_path, states=1)
    child = start(HOLD, str(run.path))
    try:
        assert child.stdout.readline() == "held\n"
        holder = f"locked by process {child.pid} on {socket.gethostname()} since"
        with pytest.raises(LockedError, match=holder), run.writing():
            pass
        with pytest.raises(LockedError):
            run.set_aside()
        with pytest.raises(LockedError):
            run.repair()
        assert len(run.states()) == 1  # readers do not wait
    finally:
        child.kill()
        child.wait()
        child.stdout.close()
    assert (run.path / "lock.holder").exists()
    with run.writing():
        run.commit(make_record(2))
    assert not (run.path / "lock.holder").exists()


def test_a_second_writer_in_the_same_process_is_refused_and_a_stale_note_not_believed(tmp_path, monkeypatch):
    monkeypatch.setattr("ribbon_cli.store.lock._PATIENCE", 0.1)
    run = make_run(tmp_path)
    other = Run.open(run.path)
    with run.writing():
        with pytest.raises(LockedError, match=f"process {os.getpid()}"), other.writing():
            pass
        ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True)
        note = {"pid": int(ended.stdout), "host": socket.gethostname(), "since": "long ago"}
        for text in (json.dumps(note), "torn", "[]", json.dumps(note | {"pid": "x"})):
            (run.path / "lock.holder").write_text(text)
            with pytest.raises(LockedError, match="locked by"), other.writing():
                pass
        (run.path / "lock.holder").write_text(json.dumps(note))
        with pytest.raises(LockedError, match="locked by another process"), other.writing():
            pass
    with other.writing():
        pass


def test_nothing_is_written_before_the_lock_is_held(tmp_path):
    run = make_run(tmp_path, states=1)
    other = Run.open(run.path)
    (run.path / ".tmp-x").write_bytes(b"x")
    with run.writing():
        (run.path / ".tmp-y").write_bytes(b"y")
        before = relative_files(run.path)
        with pytest.raises(LockedError), other.writing():
            pass
        assert relative_files(run.path) == before


def test_a_lock_on_a_folder_that_was_set_aside_meanwhile_is_refused(tmp_path, monkeypatch):
    from filelock import FileLock

    run = make_run(tmp_path, states=1)
    late = Run.open(run.path)
    acquire = FileLock.acquire

    def overtaken(lock, *args, **kwargs):
        monkeypatch.setattr(FileLock, "acquire", acquire)
        lock_file = acquire(lock, *args, **kwargs)
        os.rename(run.path, tmp_path / "elsewhere")
        make_run(tmp_path)
        return lock_file

    monkeypatch.setattr(FileLock, "acquire", overtaken)
    with pytest.raises(LockedError, match="just set aside by another process"), late.writing():
        pass
    with Run.open(run.path).writing():
        pass


COMMIT = """
import sys
from store_support import make_record
from ribbon_cli.store import Run
run = Run.create_or_open(sys.argv[1], "mobius", "0123abcd", "a", "b")
with run.writing():
    for label in range(run.next_label, 10**6):
        run.commit(make_record(label, spectra=()))
        print(label, flush=True)
"""


@pytest.mark.parametrize("kills", [5, pytest.param(15, marks=pytest.mark.faults)])
def test_nothing_committed_is_lost_in_kills_at_random_moments(tmp_path, kills):
    """Each writer is killed some moment after a number of its commits, however fast the machine is."""
    chance = random.Random(5)
    acknowledged = awaited = 0
    for _ in range(kills):
        child = start(COMMIT, str(tmp_path))
        commits = chance.randint(2, 6)
        awaited += commits
        acknowledged = [int(child.stdout.readline()) for _ in range(commits)][-1]
        time.sleep(chance.uniform(0.0, 0.03))
        child.send_signal(signal.SIGKILL)
        said = child.stdout.read().split()
        child.wait()
        child.stdout.close()
        acknowledged = max([acknowledged, *map(int, said)])
        run = Run.open(tmp_path / "mobius-0123abcd")
        labels = [state.label for state in run.states()]
        assert labels == list(range(1, len(labels) + 1))
        assert len(labels) >= acknowledged
    assert acknowledged >= awaited > 2 * kills
    run.sweep()
    for label in run.entries():
        run.load(label)
    assert run.load(acknowledged).label == acknowledged
    assert {Path(name).suffix for name in relative_files(run.path / "states")} == {".h5"}


@pytest.fixture
def no_flock(monkeypatch):
    """A file system without flock."""

    def refuse(*arguments):
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))

    monkeypatch.setattr("fcntl.flock", refuse)
    monkeypatch.setattr("ribbon_cli.store.lock._PATIENCE", 0.1)


def test_without_flock_a_file_stands_in_and_it_is_said(tmp_path, no_flock):
    run = make_run(tmp_path, states=1)
    other = Run.open(run.path)
    with run.writing():
        assert run.remarks == [
            "mobius-0123abcd: its file system has no flock: locked by the file lock.claim instead"
        ]
        assert other.holder().pid == os.getpid()
        with (
            pytest.raises(LockedError, match=f"process {os.getpid()} .*remove .*lock.claim"),
            other.writing(),
        ):
            pass
    with other.writing():
        other.commit(make_record(2))
    assert not (run.path / "lock.claim").exists()


def test_a_claim_of_a_dead_process_is_removed_and_one_of_another_machine_kept(tmp_path, no_flock):
    run = make_run(tmp_path)
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True)
    note = {"pid": int(ended.stdout), "host": socket.gethostname(), "since": "then"}
    (run.path / "lock.claim").write_text(json.dumps(note))
    with run.writing():
        assert f"removed the lock of process {note['pid']} on" in run.remarks[1]
    (run.path / "lock.claim").write_text(json.dumps(note | {"host": "elsewhere"}))
    with pytest.raises(LockedError, match="on elsewhere since then"), run.writing():
        pass


def test_a_claim_is_respected_with_flock_as_well(tmp_path):
    run = make_run(tmp_path)
    (run.path / "lock.claim").write_text(json.dumps({"pid": 1, "host": "elsewhere", "since": "then"}))
    with pytest.raises(LockedError, match="on elsewhere since then"), run.writing():
        pass


def test_a_pid_used_again_is_not_taken_for_the_holder(tmp_path):
    run = make_run(tmp_path)
    note = {"pid": os.getpid(), "host": socket.gethostname(), "since": "then", "start": "another boot 1"}
    (run.path / "lock.holder").write_text(json.dumps(note))
    assert run.holder() is None
    with run.writing():
        assert "ended without releasing the run" in run.remarks[0]
