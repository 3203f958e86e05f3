"""Every system call of a commit fails once in a real `ribbon solve`: documented exit code, one line, nothing
lost.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from cli_support import ribbon
from fault_support import contents

from ribbon_cli.store import Run, list_runs

CALLS = ("open", "write", "fsync", "link", "unlink", "rename", "close", "ftruncate", "fstat", "pread")
CODES = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EMFILE, errno.EDQUOT)
RING = """\
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 8, half_width: 0.1}
widths: [0.1, 0.2]
spectrum: {modes: 0, full_up_to: 0}
"""
SHORT = -1
"""Stands for a write that writes less than it was asked to."""


class Calls:
    """Counts the system calls of the run's second commit, and makes the n-th fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monkeypatch = monkeypatch
        self.names: list[str] = []

    @contextmanager
    def failing(self, n: int, code: int) -> Iterator[None]:
        write, commits = Run.write_state, 0
        self.names = []

        def second(run: Run, *state: object) -> None:
            nonlocal commits
            commits += 1
            if commits != 2:
                write(run, *state)
                return
            with self.monkeypatch.context() as patch:
                for name in CALLS:
                    patch.setattr(os, name, self._wrapped(name, getattr(os, name), n, code))
                write(run, *state)

        with self.monkeypatch.context() as patch:
            patch.setattr(Run, "write_state", second)
            yield

    def _wrapped(self, name: str, call: Callable, n: int, code: int) -> Callable:
        def wrapped(*args, **kwargs):
            self.names.append(name)
            if len(self.names) != n:
                return call(*args, **kwargs)
            if code == SHORT:
                return call(args[0], args[1][: max(1, len(args[1]) // 3)]) if name == "write" else call(*args)
            if name == "close":
                call(*args)  # a failing close closes all the same
            raise OSError(code, os.strerror(code))

        return wrapped


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    (tmp_path / "ring.yaml").write_text(RING)
    return tmp_path


def fail_each(folder, monkeypatch, codes: Callable[[int], tuple[int, ...]]) -> list[str]:
    """Solve with the n-th call of the second commit failing, for every n; the names of the calls."""
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    expected = contents(list_runs("runs")[0])
    calls = Calls(monkeypatch)
    n = 0
    while True:
        n += 1
        for code in codes(n):
            shutil.rmtree("runs")
            with calls.failing(n, code):
                result = ribbon("solve", "ring.yaml", "-q")
            if len(calls.names) < n:
                return calls.names
            where = f"{calls.names[n - 1]} ({n}) with {errno.errorcode.get(code, 'a short write')}"
            assert result.exit_code in (0, 4), where
            assert "Traceback" not in result.stderr, where
            if result.exit_code == 4:
                assert code != SHORT, where
                lines = [line for line in result.stderr.splitlines() if line.startswith("ribbon: ")]
                assert len(lines) == 1, where
                assert f"cannot be written: {os.strerror(code)}; " in lines[0], where
            (run,) = list_runs("runs")
            kept = contents(run)
            assert kept.items() <= expected.items(), where
            assert 1 in kept, where
            assert ribbon("solve", "ring.yaml", "-q").exit_code == 0, where
            assert contents(run) == expected, where
            assert not [path for path in run.path.rglob("*") if ".tmp-" in path.name], where


def test_every_call_fails_once(folder, monkeypatch):
    """Every second call with one of the codes in turn, writes also short; the next test takes all."""
    names = fail_each(
        folder, monkeypatch, lambda n: (CODES[n // 2 % len(CODES)], SHORT)[: n % 2 + (n % 10 == 1)]
    )
    assert {"open", "write", "fsync", "link", "unlink", "close"} <= set(names)
    assert len(names) > 12


@pytest.mark.faults
def test_every_call_fails_once_in_every_way(folder, monkeypatch):
    assert len(fail_each(folder, monkeypatch, lambda n: (*CODES, SHORT))) > 12
