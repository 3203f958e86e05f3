"""Many processes at one run: one writes, the others say who; readers see whole states alone."""

from __future__ import annotations

import os
import socket
from multiprocessing import Barrier, Value, get_context
from pathlib import Path

import pytest
from fault_support import child, wait
from store_support import make_record, make_run

from ribbon_cli.errors import LockedError
from ribbon_cli.store import Run

PROCESSES = 8


def contend(path: Path, barriers: list, writer) -> int:
    """Try to write at the same moment as the others: 0 for whoever wrote, 1 for whoever was told by whom."""
    run = Run.open(path)
    barriers[0].wait(30)
    try:
        with run.writing():
            writer.value = os.getpid()
            run.commit(make_record(run.next_label, spectra=()))
            barriers[1].wait(30)
            return 0
    except LockedError as error:
        message = str(error)
    barriers[1].wait(30)  # only then is it sure that the writer has said who it is
    return 1 if f"locked by process {writer.value} on {socket.gethostname()} since " in message else 2


def read_on(path: Path, stop) -> int:
    """Read whatever is listed, over and over; every state must be whole."""
    run = Run.open(path)
    rounds = seen = 0
    while not stop.value or not rounds:
        entries = run.entries()
        assert len(entries) >= seen
        for label in list(entries)[max(0, seen - 1) :]:
            run.load(label)
        seen, rounds = len(entries), rounds + 1
    return 0


def rounds(tmp_path: Path, count: int) -> None:
    context = get_context("fork")
    run = make_run(tmp_path)
    stop = Value("i", 0)
    reader = child(lambda: read_on(run.path, stop))
    for _ in range(count):
        barriers = [Barrier(PROCESSES, timeout=60), Barrier(PROCESSES, timeout=60)]
        writer = context.Value("i", 0)
        pids = [child(lambda b=barriers, w=writer: contend(run.path, b, w)) for _ in range(PROCESSES)]
        assert sorted(map(wait, pids)) == [0] + [1] * (PROCESSES - 1)
    stop.value = 1
    assert wait(reader) == 0
    assert list(run.entries()) == list(range(1, count + 1))
    for label in run.entries():
        run.load(label)
    assert not [path for path in run.path.rglob("*") if ".damaged-" in path.name or ".tmp-" in path.name]


def test_eight_processes_at_one_run(tmp_path):
    rounds(tmp_path, 2)


@pytest.mark.faults
def test_eight_processes_at_one_run_fifty_times(tmp_path):
    rounds(tmp_path, 50)
