"""A run of five thousand states: what listings, references and resuming open and read does not grow with the
files.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli_support import ribbon, ribbon_json
from store_support import CONFIG, RESOLVED, make_record

from bench.store import make_run
from ribbon_cli.config import load_config
from ribbon_cli.errors import StoreError
from ribbon_cli.store import Run, encode, log, resolve_state
from ribbon_cli.store.folder import state_entry, state_name
from ribbon_cli.store.preamble import check_seal, seal
from ribbon_cli.study import solve_config
from ribbon_cli.study.journal import Journal
from ribbon_cli.study.progress import silence

STATES = 5000
OPENED: list[str] = []
OPENING: list[str] = []
WATCH: list[Path] = []


def _note(event: str, arguments: tuple) -> None:
    """Note a file that is opened by `open`, or by `os.open` for reading alone."""
    if event != "open" or not WATCH or isinstance(arguments[0], int):
        return
    path, mode, flags = os.fsdecode(arguments[0]), arguments[1], arguments[2]
    if not path.startswith(str(WATCH[0])) or os.path.isdir(path):
        return
    if isinstance(mode, str):
        OPENED.append(path)
        OPENING.append(path)  # whose opener may be `os.open`
    elif path not in OPENING and flags & os.O_ACCMODE == os.O_RDONLY:
        OPENED.append(path)
    else:
        OPENING.clear()


sys.addaudithook(_note)


@contextmanager
def opened(folder: Path) -> Iterator[list[str]]:
    """Files in a folder that are opened meanwhile."""
    OPENED.clear()
    WATCH[:] = [folder]
    try:
        yield OPENED
    finally:
        WATCH.clear()


def read(files: list[str]) -> int:
    """Bytes that were read at most: each file whole, as often as it was opened."""
    return sum(os.path.getsize(name) for name in files if os.path.exists(name))


def make_big_run(root: Path, states: int = STATES) -> Run:
    """A run of that many states at as many widths; each file is that of the first under another label."""
    run = Run.create_or_open(root, "big", "0123abcd", CONFIG, RESOLVED)
    data = encode(make_record(1, n=8, spectra=()))
    summary, image = check_seal(data), bytearray(data)
    image[:2048] = bytes(2048)
    lines = []
    for label in range(1, states + 1):
        state = summary | {"label": label, "half_width": 0.1 + label / states, "stage": f"b = {label}"}
        file = seal(bytes(image), state)
        (run.path / state_name(label)).write_bytes(file)
        lines.append(log.format_line(state_entry(state, file)))
    with open(run.log_path, "ab") as stream:
        stream.write(b"".join(lines))
    return run


def no_hdf5(*arguments: object) -> None:
    raise AssertionError("HDF5 was asked")


@pytest.fixture(scope="module")
def big(tmp_path_factory) -> Run:
    return make_big_run(tmp_path_factory.mktemp("big"))


def test_a_listing_reads_each_state_once(big):
    with opened(big.path.parent) as files:
        listed = ribbon("ls", "big", "--runs", big.path.parent, "--json")
    assert len(json.loads(listed.stdout)) == STATES
    assert len([name for name in files if name.endswith(".h5")]) == STATES
    assert len(files) < STATES + 20
    states = sum(os.path.getsize(big.state_path(label)) for label in big.entries())
    assert read(files) < states + 2 * os.path.getsize(big.log_path)


def test_references_and_the_list_of_runs_open_no_state(big):
    root = big.path.parent
    with opened(root) as files:
        assert ribbon_json("ls", "--runs", root)[0]["states"] == STATES
        assert resolve_state(root, f"big@b={0.1 + 77 / STATES!r}")[1] == 77
    assert not [name for name in files if name.endswith(".h5")]
    assert len(files) < 20
    assert read(files) < 3 * os.path.getsize(big.log_path)


def test_the_log_is_read_once_however_often_a_run_is_asked(big):
    run = Run.open(big.path)
    with opened(big.path) as files:
        for label in range(1, 200):
            run.look_up(label)
            run.entries()
    assert files.count(str(run.log_path)) == 1
    assert len(files) == 200


def test_resuming_starts_with_the_stages_that_are_asked_for(big, monkeypatch):
    """Each finished stage's file is hashed, and none is taken apart."""
    monkeypatch.setattr("ribbon_cli.store.run.decode_bytes", no_hdf5)
    with opened(big.path) as files, Run.open(big.path).writing() as run:
        journal = Journal(run, silence, (), None)
        assert journal.finished("b = 4999").certified
        assert journal.finished("b = 4998").half_width == 0.1 + 4998 / STATES
        assert len([name for name in files if name.endswith(".h5")]) == 2
        assert run.next_label == STATES + 1
    assert len(files) < 20
    assert read(files) < 3 * os.path.getsize(big.log_path)


def test_a_finished_run_is_passed_over_by_reading_each_file_once_and_without_hdf5(tmp_path, monkeypatch):
    run = make_run(tmp_path, 200)
    monkeypatch.setattr("ribbon_cli.store.run.decode_bytes", no_hdf5)
    with opened(run.path) as files:
        outcome = solve_config(load_config(tmp_path / "big.yaml"), tmp_path / "runs")
    assert (len(outcome.targets), outcome.new_states, outcome.exit_code) == (200, 0, 0)
    assert all(files.count(str(run.state_path(label))) == 1 for label in range(1, 201))
    assert files.count(str(run.log_path)) == 1
    assert len(files) < 200 + 20


def test_a_damaged_state_of_a_finished_run_is_not_passed_over(tmp_path):
    """Its hash is compared, though nothing of it is needed but what the log says."""
    run = make_run(tmp_path, 20)
    data = bytearray(run.state_path(7).read_bytes())
    data[-1] ^= 1
    run.state_path(7).write_bytes(data)
    with pytest.raises(StoreError, match=r"0007\.h5: damaged: not the bytes that were committed"):
        solve_config(load_config(tmp_path / "big.yaml"), tmp_path / "runs")


def test_the_index_is_rebuilt_by_reading_each_state_once_and_without_hdf5(big, tmp_path, monkeypatch):
    run = make_big_run(tmp_path, 50)
    before = list(run.states())
    run.log_path.unlink()
    monkeypatch.setattr("ribbon_cli.store.recovery.decode_bytes", no_hdf5)
    with opened(run.path) as files:
        run.repair()
    assert sorted(name for name in files if name.endswith(".h5")) == sorted(
        str(run.state_path(label)) for label in range(1, 51)
    )
    assert run.states() == before


def test_arrays_of_a_finished_stage_are_read_when_they_are_needed(tmp_path):
    run = Run.create_or_open(tmp_path, "few", "0123abcd", CONFIG, RESOLVED)
    record = make_record(1)
    with run.writing():
        run.commit(record)
    with opened(run.path) as files:
        journal = Journal(run, silence, (), None)
        state = journal.finished("b = 0.5")
        assert (state.label, state.stage, state.sigma, state.events) == (1, "b = 0.5", -1, record.events)
        assert len([name for name in files if name.endswith(".h5")]) == 1
        found = journal.load(state)
        assert (found.u == record.u).all()
        assert found.spectra[0].metric == "euclidean"
        assert found.provenance == record.provenance
    assert [name for name in files if name.endswith(".h5")] == [str(run.state_path(1))] * 2
