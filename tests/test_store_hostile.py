"""Runs folders that others have put things into: links, pipes, forged lines, names, and what is not ours."""

from __future__ import annotations

import itertools
import json
import os
import resource
import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest
from cli_support import COMMAND, environment, ribbon, ribbon_json
from store_support import make_record, make_run, read_log

from ribbon_cli.errors import StoreError
from ribbon_cli.store import Run, Summary, export_npz, list_runs, write_atomic
from ribbon_cli.store.atomic import temporary_name
from ribbon_cli.store.events import GivenUp
from ribbon_cli.store.lock import RunLock, _file_lock
from ribbon_cli.store.log import format_line, parse_line

FROZEN = Path(__file__).parent / "data" / "format-1.1"
NAME = "frozen-branch-e83cb1ed"
READERS = (
    ("ls",),
    ("ls", NAME, "--all"),
    ("show", NAME),
    ("show", f"{NAME}:2"),
    ("verify", NAME),
    ("convergence-table", NAME),
    ("pack", NAME, "-o", "a.h5"),
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(FROZEN / NAME, tmp_path / "runs" / NAME)
    return tmp_path


# --- the log ---


def state(**changes):
    return lambda entry: {**entry, "state": {**entry["state"], **changes}}


def without(key):
    return lambda entry: {name: value for name, value in entry.items() if name != key}


FORGED = {
    "no state": ("state", without("state")),
    "no summary": ("state", lambda entry: {**entry, "state": {"label": 1}}),
    "no hash": ("state", without("sha256")),
    "no time": ("state", without("time")),
    "another file": ("state", lambda entry: {**entry, "file": "states/../../other/states/0001.h5"}),
    "a label in words": ("state", state(label="one")),
    "a label that is none": ("state", state(label=0)),
    "half a label": ("state", state(label=1.5)),
    "a truth for a label": ("state", state(label=True)),
    "energy in words": ("state", state(energy="low")),
    "widths": ("state", state(half_width=[0.1])),
    "a list of stages": ("state", state(stage=["b"])),
    "topology": ("state", state(topology=[1])),
    "events": ("state", state(events=5)),
    "a part of a branch": ("state", state(branch={"name": "up"})),
    "a list of hashes": ("created", lambda entry: {**entry, "files": ["config.yaml"]}),
    "nothing missed": ("ended", without("missed")),
    "missed in threes": ("ended", lambda entry: {**entry, "missed": [[1, 2, 3]]}),
    "an end of no branch": ("branch-end", without("branch")),
    "a lost state without a label": ("ended", lambda entry: {"event": "state-lost", "time": entry["time"]}),
}


@pytest.mark.parametrize("what", FORGED)
def test_a_line_that_says_nonsense_is_damage_whatever_its_checksum(folder, what):
    run = Run.open(folder / "runs" / NAME)
    make_run(folder / "runs", 1, "other")
    kind, forge = FORGED[what]
    entries = read_log(run.log_path)
    place = next(k for k, entry in enumerate(entries) if entry["event"] == kind)
    entries[place] = forge(entries[place])
    run.log_path.write_bytes(b"".join(map(format_line, entries)))
    for words in READERS:
        result = ribbon(*words)
        assert result.exit_code == 4, (words, result.output)
        assert f"log.jsonl:{place + 1}: damaged line: " in result.stdout + result.stderr
    assert {item["short_name"]: item["status"] for item in json.loads(ribbon("ls", "--json").stdout)} == {
        "frozen-branch": "damaged",
        "other": "unknown",
    }
    assert ribbon("repair", NAME).exit_code == 0
    result = ribbon("verify", NAME)
    assert result.exit_code == 0, result.output
    assert len(Run.open(run.path).entries()) == 2


@pytest.mark.parametrize("order", [[0, 0, 1, 2, 3, 4], [1, 0, 2, 3, 4], [0, 2, 0, 1, 3, 4]])
def test_repair_makes_one_first_line(folder, order):
    run = Run.open(folder / "runs" / NAME)
    entries = read_log(run.log_path)
    run.log_path.write_bytes(b"".join(format_line(entries[k]) for k in order))
    assert "first line, and no other" in ribbon("verify", NAME).stdout
    assert ribbon("repair", NAME).exit_code == 0
    assert ribbon("verify", NAME).exit_code == 0
    assert read_log(run.log_path)[0] == entries[0]
    states = [entry["state"] for entry in entries if "state" in entry]
    assert Run.open(run.path).states(all=True) == [Summary.read(state) for state in states]


def test_a_second_line_on_a_state_is_noticed_and_dropped(folder):
    run = Run.open(folder / "runs" / NAME)
    entries = read_log(run.log_path)
    run.log_path.write_bytes(b"".join(map(format_line, [*entries, state(energy=1.0)(entries[1])])))
    assert "it has 2 lines on state 1" in ribbon("verify", NAME).stdout
    assert ribbon("repair", NAME).exit_code == 0
    assert ribbon("verify", NAME).exit_code == 0
    assert Run.open(run.path).entries()[1].document == entries[1]


GIVEN = {
    "event": "stage-given-up",
    "time": "2026-11-22T09:27:34.654Z",
    "stage": "from 2: b = 0.2",
    "parent": 2,
    "status": "stalled",
    "detail": "(At 1e-3.)",
}


def test_a_step_that_was_given_up_is_read_as_it_was_written():
    event = parse_line(format_line(GIVEN)[:-1])
    assert isinstance(event, GivenUp)
    assert (event.stage, event.parent, event.status, event.detail) == tuple(GIVEN.values())[2:]


@pytest.mark.parametrize(
    ("key", "value"),
    [("stage", 2), ("parent", "2"), ("parent", True), ("status", None), ("detail", ["(At.)"])],
)
@pytest.mark.parametrize("missing", [False, True])
def test_a_step_that_was_given_up_has_fields_of_known_types(key, value, missing):
    forged = without(key)(GIVEN) if missing else GIVEN | {key: value}
    with pytest.raises(ValueError, match=key):
        parse_line(format_line(forged)[:-1])


# --- what is no file ---


REST = ("resolved.yaml", "config.yaml", "lock.holder")
PIPES = [
    "log.jsonl",
    pytest.param("lock.claim", marks=pytest.mark.long),
    *(pytest.param(name, marks=pytest.mark.faults) for name in REST),
]


@pytest.mark.parametrize("name", PIPES)
def test_a_pipe_in_a_run_keeps_nobody_waiting(folder, name):
    run = folder / "runs" / NAME
    (run / name).unlink(missing_ok=True)
    os.mkfifo(run / name)
    for words in (("ls",), ("show", NAME), ("verify", NAME), ("repair", NAME), ("verify", NAME)):
        done = subprocess.run(
            [*COMMAND, *words], capture_output=True, text=True, timeout=30, env=environment()
        )
        assert "internal error" not in done.stderr
    assert done.returncode == 0, done.stderr
    assert all((run / name).is_file() for name in ("log.jsonl", "resolved.yaml", "config.yaml"))


def test_a_run_that_cannot_be_looked_into_hides_no_other(folder, monkeypatch):
    make_run(folder / "runs", 1, "shut")
    look = os.stat

    def refused(path, *args, **keys):
        if isinstance(path, str | os.PathLike) and "shut-0123abcd/" in os.fspath(path):
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return look(path, *args, **keys)

    monkeypatch.setattr(os, "stat", refused)
    found = {item["short_name"]: item for item in ribbon_json("ls", code=4)}
    assert found["frozen-branch"]["status"] == "complete"
    assert found["shut"]["status"] == "damaged"
    assert "Permission denied" in found["shut"]["damage"]
    assert ribbon("show", "frozen-branch").exit_code == 0


# --- names and links ---


def test_a_link_to_a_run_is_not_deleted_for_it(folder):
    shutil.move(folder / "runs" / NAME, folder / "elsewhere")
    os.symlink("../elsewhere", folder / "runs" / NAME)
    result = ribbon("rm", NAME, "--yes")
    assert result.exit_code == 2
    assert f"a link to {folder / 'elsewhere'}" in result.stderr
    assert [run.name for run in list_runs("runs")] == [NAME]
    assert ribbon("verify", NAME).exit_code == 0


def test_a_run_may_be_named_from_within(folder, monkeypatch):
    monkeypatch.chdir(folder / "runs" / NAME)
    assert ribbon_json("show", "./")["name"] == NAME
    assert ribbon("pack", "./", "-o", folder / "a.h5").exit_code == 0
    assert ribbon("unpack", folder / "a.h5", "--runs", folder / "other").exit_code == 0


def test_what_could_not_be_unpacked_is_not_packed(folder):
    os.rename(folder / "runs" / NAME, folder / "runs" / "mine")
    result = ribbon("pack", "mine")
    assert result.exit_code == 2
    assert "could not be unpacked" in result.stderr
    assert os.listdir(folder) == ["runs"]


@pytest.mark.parametrize("words", [["show"], ["ls"], ["verify"], ["path"], ["rm", "--yes"]])
@pytest.mark.parametrize("tail", ["", ":3", ".h5", "@b=1"])
def test_a_reference_longer_than_any_file_s_name_is_a_usage_error(folder, words, tail):
    assert ribbon(*words, "a" * 5000 + tail).exit_code == 2


def test_a_file_may_have_the_longest_name(tmp_path):
    path = tmp_path / ("a" * 251 + ".npz")
    export_npz(make_record(), path)
    assert path.is_file()
    write_atomic(tmp_path / ("ä" * 127), b"")


def test_nobody_to_ask_is_no(folder):
    done = subprocess.run(
        ["/bin/sh", "-c", 'exec "$@" <&-', "sh", *COMMAND, "rm", NAME],
        capture_output=True,
        text=True,
        env=environment(),
    )
    assert done.returncode == 2
    assert "is kept" in done.stderr
    assert (folder / "runs" / NAME).is_dir()


def test_a_lock_in_an_empty_folder_is_no_run_and_in_nobody_s_way(tmp_path):
    """As a process leaves it that was about to lock a run which another deleted."""
    run = make_run(tmp_path, 1)
    path, lock = run.path, RunLock(run.path)
    run.remove()
    with _file_lock(path / "lock"):
        assert os.listdir(path) == ["lock"]
    assert not lock.held
    assert len(make_run(tmp_path, 1).entries()) == 1
    assert sorted(os.listdir(tmp_path)) == [path.name]
    run.remove()
    path.mkdir()
    (path / "precious").touch()
    with pytest.raises(StoreError, match="not empty"):
        make_run(tmp_path)
    assert os.listdir(path) == ["precious"]


@pytest.mark.parametrize("blocks", [1, 20, 60])
def test_a_pack_that_finds_no_room_says_so_and_leaves_nothing(folder, blocks):
    """In a process of its own: HDF5 may end a process whose writes fail."""
    limits = (blocks * 1024, resource.RLIM_INFINITY)
    done = subprocess.run(
        [*COMMAND, "pack", NAME, "-o", "a.h5"],
        capture_output=True,
        text=True,
        env=environment(),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits),
    )
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr == "ribbon: a.h5: cannot be written: File too large; check the file system\n"
    assert os.listdir(folder) == ["runs"]


# --- clocks and hosts ---


def test_a_clock_that_goes_back_changes_nothing(folder, monkeypatch):
    times = itertools.count()
    monkeypatch.setattr(
        "ribbon_cli.store.log.utc_now", lambda: f"20{99 - next(times):02}-01-01T00:00:00.000Z"
    )
    (folder / "a.yaml").write_text(
        (folder / "runs" / NAME / "config.yaml").read_text().replace(NAME[:-9], "a")
    )
    assert ribbon("solve", "a.yaml").exit_code == 0
    run = next(run for run in list_runs("runs") if run.short_name == "a")
    told = [event.time for event in run.events()]
    assert told == sorted(told, reverse=True)
    run.state_path(2).unlink()
    for words in (
        ("repair", "a"),
        ("solve", "a.yaml"),
        ("verify", "a"),
        ("ls",),
        ("show", "a"),
        ("repair", "a"),
    ):
        result = ribbon(*words)
        assert result.exit_code == 0, result.output
    assert "nothing to repair" in result.stderr
    assert list(run.entries()) == [1, 3]


def test_a_note_that_another_host_left_locks_nobody_out(folder, monkeypatch):
    """Of a process there nothing is known: the run counts as in hand until somebody writes."""
    run = Run.open(folder / "runs" / NAME)
    with run.writing():
        note = (run.path / "lock.holder").read_text()
    (run.path / "lock.holder").write_text(note)
    monkeypatch.setattr("socket.gethostname", lambda: "renamed")
    assert ribbon_json("ls")[0]["status"] == "running"
    with run.writing():
        assert f"process {os.getpid()} on " in run.remarks[0]
        assert "ended without releasing" in run.remarks[0]
    assert ribbon_json("ls")[0]["status"] == "complete"


@pytest.mark.parametrize("pid", [0, -1, 2**70, "1", None, [1], True, 1e300])
def test_a_claim_with_an_odd_pid_is_respected(folder, pid):
    run = Run.open(folder / "runs" / NAME)
    note = {"pid": pid, "host": socket.gethostname(), "since": "then\x1b[2J"}
    (run.path / "lock.claim").write_text(json.dumps(note))
    result = ribbon("repair", NAME)
    assert result.exit_code == 5
    assert "\x1b" not in result.stderr
    assert "remove" in result.stderr
    assert ribbon("ls").exit_code == ribbon("show", NAME).exit_code == 0


# --- what is removed as abandoned ---


def old(path: Path) -> Path:
    os.utime(path, (time.time() - 7200,) * 2)
    return path


def test_only_our_own_abandoned_folders_are_removed(tmp_path):
    foreign = tmp_path / ".tmp-of-another-program"
    ours = temporary_name(tmp_path / "ring-01234567")
    again = temporary_name(tmp_path / "rerun-ring-01234567")
    for path in (foreign, ours):
        (path / "states").mkdir(parents=True)
        old(path)
    inside = make_run(again, 1)
    with inside.writing():
        old(again)
        make_run(tmp_path, 1, "first")
        assert not ours.exists()
        assert foreign.is_dir()
        assert len(list_runs(again)) == 1  # repeated for hours, and not done yet
    old(again)
    make_run(tmp_path, 1, "second")
    assert not again.exists()
