"""Runs: what is committed stays, whatever happens to the writer, the log or the files."""

from __future__ import annotations

import json
import os
import time

import pytest
from store_support import CONFIG, RESOLVED, make_record, make_run, relative_files

from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import Run, Summary, content_sha256, encode, log
from ribbon_cli.store.atomic import temporary_name
from ribbon_cli.store.log import format_line


def last_event(run: Run) -> dict:
    return run.events()[-1]


def test_a_new_run_has_its_config_and_an_empty_log(tmp_path):
    run = Run.create_or_open(tmp_path / "runs", "mobius", "0123abcd", CONFIG, RESOLVED)
    assert run.path == tmp_path / "runs" / "mobius-0123abcd"
    assert (run.name, run.short_name, run.is_aside) == ("mobius-0123abcd", "mobius", False)
    assert relative_files(run.path) == {"config.yaml", "resolved.yaml", "log.jsonl"}
    assert (run.path / "config.yaml").read_text() == CONFIG
    assert (run.path / "resolved.yaml").read_text() == RESOLVED
    assert [event.kind for event in run.events()] == ["created"]
    assert run.states(all=True) == []
    assert run.next_label == 1
    assert os.listdir(tmp_path / "runs") == ["mobius-0123abcd"]


def test_commit_load_and_list(tmp_path):
    run = make_run(tmp_path)
    records = [
        make_record(1, kind="auxiliary"),
        make_record(2),
        make_record(3, kind="saddle"),
        make_record(4),
    ]
    with run.writing():
        for record in records:
            assert run.commit(record) == Summary.of(record)
    assert [state.label for state in run.states()] == [2, 4]
    assert run.states(all=True) == [Summary.of(record) for record in records]
    assert relative_files(run.path / "states") == {"0001.h5", "0002.h5", "0003.h5", "0004.h5"}
    for record in records:
        assert content_sha256(run.load(record.label)) == content_sha256(record)
        run.load(record.label)
    with pytest.raises(UsageError, match="no state 5; the run has labels 1 to 4"):
        run.load(5)


def test_the_same_config_finds_its_run_again(tmp_path):
    first = make_run(tmp_path, states=2)
    again = Run.create_or_open(tmp_path, "mobius", "0123abcd", "# rewritten\n" + CONFIG, RESOLVED)
    assert again.path == first.path
    assert (again.path / "config.yaml").read_text() == CONFIG
    with again.writing():
        assert again.next_label == 3
        again.commit(make_record(3))
    assert len(first.states()) == 3


@pytest.mark.parametrize("name", ["", "../up", "a/b", "a:b", "a@b", ".hidden", "a b", "x" * 201])
def test_names_that_cannot_be_folders_or_references_are_refused(tmp_path, name):
    with pytest.raises(UsageError, match="name: must be"):
        Run.create_or_open(tmp_path, name, "0123abcd", "", "")
    assert os.listdir(tmp_path) == []


def test_only_runs_open(tmp_path):
    with pytest.raises(UsageError, match="not a run folder"):
        Run.open(tmp_path)


def test_creation_that_fails_leaves_nothing(tmp_path, monkeypatch):
    def fail(path, data):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("ribbon_cli.store.folder.write_durable", fail)
    with pytest.raises(StoreError, match="No space left on device; free some space"):
        make_run(tmp_path)
    assert os.listdir(tmp_path) == []


def test_abandoned_creations_are_removed_and_fresh_ones_are_not(tmp_path):
    old, new = (temporary_name(tmp_path / "mobius-0123abcd") for _ in range(2))
    for path, age in ((old, 7200), (new, 0)):
        (path / "states").mkdir(parents=True)
        os.utime(path, (time.time() - age,) * 2)
    make_run(tmp_path)
    assert sorted(os.listdir(tmp_path)) == [new.name, "mobius-0123abcd"]


def test_writing_needs_the_lock_and_the_next_label(tmp_path):
    run = make_run(tmp_path)
    with pytest.raises(RuntimeError, match=r"with run\.writing"):
        run.commit(make_record(1))
    with pytest.raises(RuntimeError, match=r"with run\.writing"):
        run.log_event("note")
    with run.writing():
        with (
            run.writing(),
            pytest.raises(ValueError, match="next state of mobius-0123abcd is 1, got label 2"),
        ):
            run.commit(make_record(2))
        with pytest.raises(ValueError, match="reserves"):
            run.log_event("state", label=1)
        run.commit(make_record(1))


def test_a_state_is_never_replaced(tmp_path):
    run = make_run(tmp_path, states=1)
    with run.writing():
        other = run.state_path(2)
        other.write_bytes(b"someone's")
        with pytest.raises(StoreError, match="exists already and is not replaced"):
            run.commit(make_record(2))
        assert other.read_bytes() == b"someone's"


def test_events_keep_their_data(tmp_path):
    run = make_run(tmp_path, states=1)
    with run.writing():
        run.log_event("step-halved", stage="b = 0.5", width=float("nan"), reasons=("left topology",))
        run.log_event("status", status="finished")
    halved, status = (event.document for event in run.events()[-2:])
    assert halved["width"] is None
    assert halved["reasons"] == ["left topology"]
    assert status["status"] == "finished"
    assert status["time"].endswith("Z")


def test_log_is_plain_json_and_every_line_is_checksummed(tmp_path):
    run = make_run(tmp_path, states=2)
    lines = run.log_path.read_bytes().splitlines(keepends=True)
    assert [json.loads(line)["event"] for line in lines] == ["created", "state", "state"]
    changed = lines[1].replace(b'"energy":5.151432747', b'"energy":5.151432740')
    assert changed != lines[1]
    run.log_path.write_bytes(lines[0] + changed + lines[2])
    with pytest.raises(
        StoreError,
        match=r"log\.jsonl:2: damaged line: its checksum does not match; `ribbon repair \S+/mob",
    ):
        run.states()
    with pytest.raises(StoreError, match="damaged line"), run.writing():
        pass


def test_newer_run_format_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("ribbon_cli.store.folder.RUN_FORMAT_VERSION", "2.0")
    run = Run.create_or_open(tmp_path, "mobius", "0123abcd", CONFIG, RESOLVED)
    monkeypatch.undo()
    with pytest.raises(StoreError, match=r"run of format 2\.0, this is 1\.4: update ribbon"):
        run.states()


def test_every_torn_last_line_is_ignored_then_cut_and_its_state_adopted(tmp_path):
    run = make_run(tmp_path, states=2)
    whole = run.log_path.read_bytes()
    start = whole.rstrip(b"\n").rfind(b"\n") + 1
    for end in [start + 1, start + 50, (start + len(whole)) // 2, len(whole) - 1]:
        run.log_path.write_bytes(whole[:end])
        assert [state.label for state in run.states()] == [1]
        with run.writing():
            assert run.next_label == 3
        assert [state.label for state in run.states()] == [1, 2]
        assert run.entries()[2].document["adopted"] is True
        assert last_event(run).kind == "recovered"
        run.load(2)


def test_a_crash_between_file_and_log_line_is_adopted(tmp_path):
    run = make_run(tmp_path, states=1)
    for label in (2, 3):
        run.state_path(label).write_bytes(encode(make_record(label)))
    assert len(run.states()) == 1
    assert run.sweep() == ["adopted state 2", "adopted state 3"]
    assert run.states() == [Summary.of(make_record(label)) for label in (1, 2, 3)]
    assert run.sweep() == []


def test_leftovers_are_swept_and_no_possible_state_is_deleted(tmp_path):
    run = make_run(tmp_path, states=1)
    (run.path / ".tmp-config-1").write_bytes(b"x")
    (run.path / "states" / ".tmp-0002-1").write_bytes(b"x" * 100)
    run.state_path(2).write_bytes(b"torn")
    run.state_path(3).write_bytes(encode(make_record(4)))
    with run.writing():
        assert run.next_label == 2
    assert relative_files(run.path / "states") == {"0001.h5", "0002.h5.damaged-1", "0003.h5.damaged-1"}
    notes = " / ".join(last_event(run).document["notes"])
    assert "removed the unfinished file .tmp-0002-1" in notes
    assert "holds state 4" in notes


def test_damage_is_told_from_health(tmp_path):
    run = make_run(tmp_path, states=3)
    path = run.state_path(2)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    run.state_path(3).unlink()
    run.load(1)
    with pytest.raises(StoreError, match=r"0002\.h5: damaged: not the bytes that were committed"):
        run.load(2)
    with pytest.raises(StoreError, match=r"0003\.h5: cannot be read: No such file"):
        run.load(3)


def test_a_log_that_misquotes_a_state_is_found(tmp_path):
    from ribbon_cli.store.log import format_line

    run = make_run(tmp_path, states=1)
    documents = [event.document for event in run.events()]
    documents[1]["state"]["energy"] = 1.0
    run.log_path.write_bytes(b"".join(map(format_line, documents)))
    with pytest.raises(StoreError, match="its line on state 1 is not what"):
        run.load(1)


def test_a_lost_log_is_rebuilt_from_the_states(tmp_path):
    run = make_run(tmp_path, states=3)
    before = run.states()
    run.log_path.unlink()
    for lacking in (run.states, run.sweep):
        with pytest.raises(StoreError, match=r"log\.jsonl: cannot be read.*`ribbon repair \S*/mobius"):
            lacking()
    notes = run.repair()
    assert notes == ["made a new first line of the log", *(f"adopted state {label}" for label in (1, 2, 3))]
    assert run.states() == before
    assert run.repair() == []
    assert run.next_label == 4


def test_a_damaged_log_is_rebuilt_keeping_what_can_be_read(tmp_path):
    run = make_run(tmp_path, states=2)
    with run.writing():
        run.log_event("note", text="kept")
        run.commit(make_record(3))
    before = run.states()
    data = bytearray(run.log_path.read_bytes())
    data[data.find(b'"label":2')] ^= 1
    run.log_path.write_bytes(data)
    assert run.repair() == ["dropped 1 damaged line of the log", "adopted state 2"]
    assert run.states() == before
    assert "kept" in [event.document.get("text") for event in run.events()]
    assert (run.path / "log.jsonl.old-1").read_bytes() == data


def test_a_lost_state_is_marked_and_its_label_not_used_again(tmp_path):
    run = make_run(tmp_path, states=3)
    run.state_path(3).unlink()
    assert run.repair() == ["states/0003.h5 is missing: marked as lost"]
    assert [state.label for state in run.states()] == [1, 2]
    lost = next(event.document for event in run.events() if event.kind == "state-lost")
    assert lost["label"] == 3
    assert lost["state"]["content_sha256"] == content_sha256(make_record(3))
    assert run.next_label == 4


def test_repair_puts_damaged_states_aside_and_deletes_nothing(tmp_path):
    run = make_run(tmp_path, states=3)
    other = encode(make_record(1, energy=1.0))
    run.state_path(1).write_bytes(other)
    assert run.repair() == ["renamed 0001.h5 to 0001.h5.damaged-1: not the bytes that were committed"]
    assert list(run.entries()) == [2, 3]
    assert (run.path / "states/0001.h5.damaged-1").read_bytes() == other
    assert run.repair() == []
    with run.writing():
        assert run.next_label == 4
    (lost,) = [event.document for event in run.events() if event.kind == "state-lost"]
    assert (lost["label"], lost["reason"]) == (1, "damaged, now 0001.h5.damaged-1")


def test_repair_corrects_a_line_that_is_not_what_its_state_holds(tmp_path):
    run = make_run(tmp_path, states=2)
    entries = [dict(event.document) for event in run.events()]
    entries[1]["state"] = entries[1]["state"] | {"energy": 1.0}
    run.log_path.write_bytes(b"".join(map(format_line, entries)))
    with pytest.raises(StoreError, match="its line on state 1 is not what"):
        run.load(1)
    assert run.repair() == ["wrote the line on state 1 anew"]
    run.load(1)


def test_repair_restores_config_files_from_the_states(tmp_path):
    run = make_run(tmp_path)
    provenance = {"config_text": CONFIG, "config_resolved": RESOLVED}
    with run.writing():
        run.commit(make_record(1))
        run.commit(make_record(2, provenance=provenance))
    (run.path / "resolved.yaml").unlink()
    (run.path / "config.yaml").write_text("name: other\n")
    assert Run.open(run.path).repair() == [
        "restored config.yaml from a state's provenance",
        "restored resolved.yaml from a state's provenance",
    ]
    assert (run.path / "config.yaml").read_text() == CONFIG
    assert (run.path / "config.yaml.damaged-1").read_text() == "name: other\n"
    assert (run.path / "resolved.yaml").read_text() == RESOLVED


@pytest.mark.parametrize("kind", ["equilibrium", "saddle"])
def test_a_writer_goes_not_on_where_a_state_is_missing(kind, tmp_path):
    run = make_run(tmp_path, states=1)
    with run.writing():
        run.commit(make_record(2, kind=kind))
        run.commit(make_record(3))
    run.state_path(2).unlink()
    message = r"0002\.h5: missing, .*; `ribbon repair .*` marks it as lost, and it will be computed again$"
    with pytest.raises(StoreError, match=message), run.writing():
        pass
    run.repair()
    with run.writing():
        pass


def test_the_log_is_read_on_from_where_it_was_read_to(tmp_path, monkeypatch):
    run = make_run(tmp_path, states=3)
    reader = Run.open(run.path)
    assert len(reader.entries()) == 3
    parsed = []
    monkeypatch.setattr(
        log, "parse_line", lambda line, parse=log.parse_line: parsed.append(line) or parse(line)
    )
    assert len(reader.entries()) == 3
    assert parsed == []
    with run.writing():
        run.commit(make_record(4))
    parsed.clear()
    assert len(reader.entries()) == 4
    assert len(parsed) == 1
    run.log_path.write_bytes(run.log_path.read_bytes())
    assert len(Run.open(run.path).entries()) == 4


def test_a_log_put_in_the_place_of_another_is_read_anew(tmp_path):
    """Even if it got the other's inode number, as file systems use them again."""
    first, other = make_run(tmp_path / "a", states=1), make_run(tmp_path / "b", states=3)
    reader = Run.open(first.path)
    assert list(reader.entries()) == [1]
    before = os.stat(first.log_path).st_ino
    with open(first.log_path, "r+b") as file:
        events = [*reversed(other.events()), *other.events()]
        file.write(b"".join(format_line(event.document) for event in events))
    assert os.stat(first.log_path).st_ino == before
    assert reader.events() == events


def test_set_aside_keeps_the_old_run(tmp_path):
    run = make_run(tmp_path, states=2)
    assert run.set_aside() == tmp_path / "mobius-0123abcd.old-1"
    assert run.is_aside
    assert run.short_name == "mobius"
    assert len(run.states()) == 2
    fresh = make_run(tmp_path, states=1)
    assert fresh.path == tmp_path / "mobius-0123abcd"
    assert fresh.set_aside().name == "mobius-0123abcd.old-2"
    assert sorted(os.listdir(tmp_path)) == ["mobius-0123abcd.old-1", "mobius-0123abcd.old-2"]
