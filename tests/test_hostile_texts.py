"""Texts of others reach neither terminal nor page raw; files that cannot be read, or are no states."""

from __future__ import annotations

import copy
import errno
import json
import os
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from cli_support import COMMAND, environment, ribbon
from store_support import make_record, make_run, read_log

from ribbon_cli.errors import StoreError
from ribbon_cli.export.viewer import viewer_html
from ribbon_cli.pages.html import page, paragraph
from ribbon_cli.store import Run, decode
from ribbon_cli.store.log import format_line
from ribbon_cli.text import visible

FROZEN = Path(__file__).parent / "data" / "format-1.1" / "frozen-branch-e83cb1ed"
NAME = FROZEN.name
EVIL = "\x1b]0;owned\x07\x1b[2J\u202egnp.h5\x9b31m\r\n#\u2028\u200f<script>alert(1)</script><!--"
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(FROZEN, tmp_path / "runs" / NAME)
    return tmp_path


def test_what_is_seen_stays_and_what_is_obeyed_is_escaped():
    assert visible("κ = 0.5, N\u2009=\u200940\xa0mm, é, 帯") == "κ = 0.5, N\u2009=\u200940\xa0mm, é, 帯"
    assert visible("a\x1b[2J\u202eb\udcff\n") == "a\\x1b[2J\\u202eb\\udcff\\n"
    assert visible("a\n\tb\x07", "\n\t") == "a\n\tb\\x07"
    assert not OBEYED.search(visible(EVIL))


def test_nothing_in_a_log_reaches_a_terminal_raw(folder):
    run = Run.open(folder / "runs" / NAME)
    entries = copy.deepcopy(read_log(run.log_path))
    for entry in entries:
        entry["time"] = EVIL
    for field in ("stage", "status", "method", "message", "kind"):
        entries[2]["state"][field] = EVIL
    for field in ("branch", "reason", "message"):
        entries[3][field] = EVIL
    entries[2]["state"]["branch"]["name"] = entries[2]["state"]["branch"]["type"] = EVIL
    entries.append({"event": EVIL, "time": EVIL, "label": EVIL, "notes": [EVIL]})
    entries.append({"event": "state-lost", "time": EVIL, "label": 9, "reason": EVIL})
    run.log_path.write_bytes(b"".join(map(format_line, entries)))
    for words in (
        ("ls",),
        ("ls", NAME, "--all"),
        ("show", NAME),
        ("show", f"{NAME}:1"),
        ("verify", NAME),
        ("convergence-table", NAME),
        ("repair", NAME),
    ):
        for more in ((), ("--json",)):
            result = ribbon(*words, *more)
            assert result.exit_code in (0, 4), result.output
            assert not OBEYED.search(result.stdout + result.stderr), (words, result.output)
    lines = ribbon("ls").stdout.splitlines()
    assert len(lines) == 2  # a time with a line feed makes no row


def test_nothing_in_a_state_or_its_provenance_reaches_a_terminal_raw(folder):
    run = make_run(folder / "runs")
    with run.writing():
        run.commit(
            make_record(
                1,
                message=EVIL.replace("\x00", ""),
                stage=EVIL,
                method=EVIL,
                provenance={"argv": EVIL},
            )
        )
    for words in (("show", "mobius:1"), ("ls", "mobius", "--all"), ("compare", "mobius:1", f"{NAME}:1")):
        result = ribbon(*words)
        assert not OBEYED.search(result.stdout + result.stderr), (words, result.output)


@pytest.mark.parametrize("name", ["a\x1b[2J\nribbon: b.yaml", os.fsdecode(b"\xff\xfe.yaml"), "\u202elmay.h5"])
def test_odd_names_of_files_end_in_one_line(folder, name):
    (folder / name).write_bytes(b"names: x\n")
    os.mkdir(folder / "runs" / f"{name}-0123abcd")
    for words in (["check"], ["solve"], ["show"], ["verify"], ["ls"], ["unpack"], ["rm", "-y"], ["path"]):
        for argument in (name, f"{name}:1", f"./{name}", f"gone{name}"):
            result = ribbon(*words, argument)
            assert "internal error" not in result.stderr
            assert not OBEYED.search(result.stderr)
            assert result.exit_code in (0, 2, 4)
    done = subprocess.run([*COMMAND, "show", os.fsencode(name)], capture_output=True, env=environment())
    assert done.returncode in (2, 4)
    assert not OBEYED.search(done.stderr.decode())
    assert done.stderr.startswith(b"ribbon: ")
    assert done.stderr.count(b"\n") == 1
    assert NAME in ribbon("ls").stdout


def test_a_path_goes_to_a_program_byte_for_byte(folder):
    name = os.fsdecode(b"\xff-0123abcd")
    os.rename(folder / "runs" / NAME, folder / "runs" / name)
    done = subprocess.run([*COMMAND, "path", f"runs/{name}"], capture_output=True, env=environment())
    assert done.stdout == os.fsencode(folder / "runs" / name) + b"\n", done.stderr
    assert "\\udcff" in ribbon("ls").stdout


def test_pages_show_texts_and_obey_none():
    assert "<script" not in paragraph(EVIL)
    assert not OBEYED.search(page(EVIL, [paragraph(EVIL)]).decode())
    record = decode(FROZEN / "states" / "0001.h5")
    title = EVIL + "{{data}}</title><b>"
    html = viewer_html([record], title, title).decode()
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', html, re.DOTALL)
    assert "<" not in data[1]
    assert json.loads(data[1])["title"] == title
    head = html[: html.index("</title>")]
    assert "{{data}}" in head
    assert "<script" not in head
    assert not OBEYED.search(html)


@pytest.mark.long
def test_the_report_of_a_forged_run_obeys_nothing(folder):
    run = Run.open(folder / "runs" / NAME)
    entries = copy.deepcopy(read_log(run.log_path))
    for field in ("stage", "status", "method", "message"):
        entries[2]["state"][field] = EVIL
    for field in ("reason", "message"):
        entries[3][field] = EVIL
    run.log_path.write_bytes(b"".join(map(format_line, entries)))
    (run.path / "config.yaml").write_text((run.path / "config.yaml").read_text() + f"# {EVIL}\n")
    result = ribbon("report", NAME, "-o", "a.html")
    assert result.exit_code == 0, result.output
    assert not OBEYED.search(result.stdout + result.stderr)
    html = (folder / "a.html").read_text()
    assert "alert(1)" in html
    assert "<script>alert(1)" not in html
    assert not OBEYED.search(html)


def test_a_text_in_an_npz_file_reaches_no_terminal_raw(folder):
    assert ribbon("export", f"{NAME}:1", "--to", "npz", "-o", "a.npz").exit_code == 0
    with np.load("a.npz") as archive:
        arrays = dict(archive)
    np.savez("b.npz", **arrays | {"discretisation": np.array(EVIL)})
    np.savez("c.npz", **arrays | {"u": np.zeros((3, 3)), "kind": np.array(EVIL)})
    np.savez(f"d{OBEYED.sub('', EVIL).replace('/', '')}\x1b.npz", **arrays | {"sigma": np.array(7)})
    for name in os.listdir(folder):
        for words in (("export", name, "--to", "csv", "-o", "x.csv"), ("spectrum", name), ("show", name)):
            if name.endswith(".npz") and name != "a.npz":
                result = ribbon(*words)
                assert result.exit_code in (2, 4), result.output
                assert "internal error" not in result.stderr
                assert not OBEYED.search(result.stdout + result.stderr)


# --- what cannot be read, and what is no state ---


def test_a_file_that_may_not_be_read_is_neither_missing_nor_damaged(folder, monkeypatch):
    opened = os.open

    def refused(path, *args, **keys):
        if os.fspath(path).endswith("0002.h5"):
            raise PermissionError(errno.EACCES, "Permission denied", os.fspath(path))
        return opened(path, *args, **keys)

    monkeypatch.setattr(os, "open", refused)
    result = ribbon("ls", NAME)
    assert result.exit_code == 4
    assert "0002.h5: unreadable: " in result.stderr
    assert "1 " in ribbon("ls", NAME, "--status", "unreadable").stdout
    assert ribbon("show", f"{NAME}:2").exit_code == 4
    result = ribbon("repair", NAME)
    assert (result.exit_code, "cannot be read: Permission denied" in result.stderr) == (4, True)
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    assert ribbon("verify", NAME).exit_code == 0


@pytest.mark.parametrize("missing", [os.path.lexists, os.path.exists])
def test_a_file_that_may_not_be_looked_at_is_not_lost(folder, monkeypatch, missing):
    """A folder that may be listed, and not entered."""
    monkeypatch.setattr(
        os.path, missing.__name__, lambda path: "states" not in os.fspath(path) and missing(path)
    )
    before = (folder / "runs" / NAME / "log.jsonl").read_bytes()
    assert ribbon("repair", NAME).exit_code == 0
    assert (folder / "runs" / NAME / "log.jsonl").read_bytes() == before


def test_a_log_that_may_not_be_read_is_not_rebuilt(folder, monkeypatch):
    run = Run.open(folder / "runs" / NAME)
    (run.path / "states" / "0002.h5").write_bytes(b"nothing")
    opened = open

    def refused(path, *args, **keys):
        if os.fspath(path).endswith("log.jsonl"):
            raise PermissionError(errno.EACCES, "Permission denied", os.fspath(path))
        return opened(path, *args, **keys)

    with monkeypatch.context() as here:
        here.setattr("builtins.open", refused)
        with pytest.raises(StoreError, match="cannot be read: Permission denied"):
            run.repair()
    assert sorted(os.listdir(run.path / "states")) == ["0001.h5", "0002.h5"]


@pytest.mark.parametrize("command", ["show", "verify"])
def test_what_is_no_state_is_called_what_it_is(folder, command):
    assert ribbon("pack", NAME, "-o", "a.h5").exit_code == 0
    shutil.copy(folder / "runs" / NAME / "log.jsonl", "log.jsonl")
    (folder / "b.h5").write_bytes(b"PK\x03\x04")
    with h5py.File("c.h5", "w") as file:
        file["x"] = 1.0
    for path, words in (
        ("a.h5", "a packed run, not a state: `ribbon unpack`"),
        ("log.jsonl", "as the log of a run: name the run"),
        ("b.h5", "an npz file is read when its name ends in .npz"),
        ("c.h5", "damaged, or not a state file: the root attribute 'format' is missing"),
    ):
        result = ribbon(command, path)
        assert result.exit_code == 4
        assert words in result.stdout + result.stderr, result.output


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["solve", "-h"],
        pytest.param([], marks=pytest.mark.long),
        pytest.param(["--version"], marks=pytest.mark.long),
    ],
)
def test_help_that_cannot_be_written_ends_in_one_line(words):
    start = partial(subprocess.run, [*COMMAND, *words], stderr=subprocess.PIPE, text=True, env=environment())
    with open("/dev/full", "w") as full:
        done = start(stdout=full)
    assert done.returncode == 1
    assert done.stderr == "ribbon: standard output cannot be written: No space left on device\n"
    read, write = os.pipe()
    os.close(read)
    done = start(stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")
