"""`ribbon ls`, `show` and `export` on runs made without solving."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from cli_support import ESCAPE, ribbon, ribbon_json, run
from store_support import make_record, make_run

from ribbon_cli import load_state
from ribbon_cli.config import dump_resolved, parse_config
from ribbon_cli.store import Run, Summary, content_sha256

CONFIG = """\
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 10, half_width: 0.5}
widths: [0.5, 0.8]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Run mobius with an intermediate state, a saddle and two equilibria; run twin set aside once."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    made = make_run(tmp_path / "runs")
    with made.writing():
        made.commit(make_record(1, kind="intermediate", stage="twist 1/2"))
        made.commit(make_record(2, kind="saddle", status="saddle", certified=False, negative_eigenvalues=2))
        made.commit(make_record(3))
        made.commit(make_record(4, 20, half_width=0.1 + 0.2, energy=math.nan, negative_eigenvalues=None))
    make_run(tmp_path / "runs", 1, "twin").set_aside()
    make_run(tmp_path / "runs", 0, "twin")
    return tmp_path


def test_ls_lists_runs(folder):
    lines = ribbon("ls").stdout.splitlines()
    heads = ["run", "status", "done", "running", "waiting", "failed", "states", "last", "change"]
    assert lines[0].split() == heads
    assert [line.split()[:7] for line in lines[1:]] == [
        ["mobius-0123abcd", "unknown", "-", "-", "-", "-", "4"],
        ["twin-0123abcd", "unknown", "-", "-", "-", "-", "0"],
    ]
    assert "twin-0123abcd.old-1" in ribbon("ls", "--all").stdout
    runs = ribbon_json("ls", "--all")
    assert [item["aside"] for item in runs] == [False, False, True]
    assert runs[0]["equilibria"] == 2
    assert runs[0]["last_change"].endswith("Z")
    # The stand-in for a config that these runs hold is not a whole one.
    assert runs[0]["complete"] is None


def test_ls_tells_whether_a_run_is_complete(folder):
    config = parse_config(CONFIG, "ring.yaml")
    made = Run.create_or_open("runs", config.name, config.hash8(), CONFIG, dump_resolved(config))
    complete = []
    stages = ((0.5, "cylinder"), (0.8, "b = 0.8"))
    for label, (half_width, stage) in enumerate(stages, start=1):
        with made.writing():
            made.commit(make_record(label, half_width=half_width, stage=stage))
        complete += [item["complete"] for item in ribbon_json("ls") if item["short_name"] == "ring"]
    assert complete == [False, True]


def test_ls_goes_on_past_a_damaged_run(folder):
    (folder / "runs/mobius-0123abcd/log.jsonl").write_text("garbage\n")
    result = ribbon("ls")
    assert result.exit_code == 4
    assert [line.split()[0] for line in result.stdout.splitlines()[1:]] == [
        "mobius-0123abcd",
        "twin-0123abcd",
    ]
    assert "damaged" in result.stdout
    assert result.stderr.startswith("ribbon: runs/mobius-0123abcd/log.jsonl:1: damaged line")
    assert ribbon("show", "mobius").exit_code == 4


def test_ls_lists_the_equilibria_of_a_run(folder):
    lines = ribbon("ls", "mob").stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["label", "3", "4"]
    assert lines[2].split()[:4] == ["4", "0.3", "20", "-"]
    everything = ribbon("ls", "mob", "--all").stdout
    assert "twist 1/2" in everything
    assert "saddle" in everything
    states = ribbon_json("ls", "mob")
    run = Run.open("runs/mobius-0123abcd")
    assert states == [state.listed(run.name) for state in run.states()]
    assert states[1]["energy"] is None
    assert [state["label"] for state in ribbon_json("ls", "mob", "--all")] == [1, 2, 3, 4]


@pytest.mark.parametrize("word", ["missing", "damaged"])
def test_states_whose_files_are_not_there_have_no_certificate(folder, word):
    path = folder / "runs/mobius-0123abcd/states/0003.h5"
    data = path.read_bytes()
    path.unlink()
    if word == "damaged":
        path.write_bytes(data[:5000] + bytes(4) + data[5004:-1] + b"!")
    result = ribbon("ls", "mob")
    assert result.exit_code == 4
    assert result.stderr.startswith(f"ribbon: runs/mobius-0123abcd/states/0003.h5: {word}: ")
    line = result.stdout.splitlines()[1].split()
    assert line[0] == "3"
    assert word in line
    assert line[-1] == "no"
    states = ribbon_json("ls", "mob", code=4)
    assert [(state["status"], state["certified"]) for state in states] == [(word, False), ("minimum", True)]
    table = ribbon("convergence-table", "mob")
    assert (table.exit_code, table.stdout) == (4, "")
    assert f"states/0003.h5: {word}" in table.stderr


def test_auxiliary_minima_are_told_from_equilibria(folder):
    other = make_run(folder / "runs", 0, "twisting")
    with other.writing():
        other.commit(make_record(1, kind="auxiliary"))
        other.commit(make_record(2))
    lines = ribbon("ls", "twisting", "--all").stdout.splitlines()
    assert ["minimum of the auxiliary problem" in line for line in lines[1:]] == [True, False]
    assert "minimum of the auxiliary problem" in ribbon("show", "twisting:1").stdout
    assert ribbon_json("show", "twisting:1")["status"] == "minimum"
    assert "auxiliary" not in ribbon("show", "twisting:2").stdout


def test_the_history_of_a_run_is_in_words(folder):
    other = make_run(folder / "runs", 1, "old")
    (folder / "runs/old-0123abcd/states/0002.h5").write_bytes(b"no state")
    other.sweep()
    page = ribbon("show", "old").stdout
    assert "{" not in page
    assert "created" in page
    assert "recovered: renamed 0002.h5 to 0002.h5.damaged-1" in page
    assert [event["event"] for event in ribbon_json("show", "old")["history"]] == ["created", "recovered"]


def test_empty_listings_say_so(folder, tmp_path):
    result = ribbon("ls", "twin")
    assert (result.exit_code, result.stdout) == (0, "")
    assert result.stderr == "twin-0123abcd has no states yet\n"
    assert ribbon("ls", "twin", "-q").stderr == ""
    assert ribbon_json("ls", "twin") == []
    assert "no runs in nowhere (see --runs)" in ribbon("ls", "--runs", "nowhere").stderr
    assert ribbon_json("ls", "--runs", "nowhere") == []


def test_a_run_without_equilibria_points_to_all(folder):
    other = make_run(folder / "runs", 0, "first-steps")
    with other.writing():
        other.commit(make_record(1, kind="auxiliary"))
    assert "has no equilibria yet; `ribbon ls first-steps --all`" in ribbon("ls", "first-steps").stderr


@pytest.mark.parametrize(
    ("ref", "message"),
    [
        ("mobios:1", "did you mean mobius?"),
        ("mobius:9", "mobius-0123abcd has no state 9: its labels are 1 to 4"),
        ("mobius@b=7", "has no equilibrium with b = 7: it has b = 0.3, 0.5"),
        ("none.h5", "none.h5: no such file"),
        ("nothing", "no run 'nothing' in runs"),
    ],
)
def test_unknown_references_are_explained(folder, ref, message):
    result = ribbon("show", ref)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "ref", ["mobius:3", "mobius-0123abcd:0003", "mob@b=0.5,N=10", "runs/mobius-0123abcd/states/0003.h5"]
)
def test_show_tells_all_of_a_state(folder, ref):
    document = ribbon_json("show", ref)
    record = make_record(3)
    assert document.items() >= Summary.of(record).listed("mobius-0123abcd").items()
    assert document["topology"] == {"half_twists": 1, "sigma": -1}
    assert document["provenance"] == dict(record.provenance)
    assert document["spectra"]["physical"]["modes"] == 6
    assert document["path"].endswith("runs/mobius-0123abcd/states/0003.h5")
    text = ribbon("show", ref).stdout
    for word in ("5.151432747", "minimum", "certified", "kkt_residual", "argv", "ribbon solve mobius.yaml"):
        assert word in text
    assert ESCAPE not in text


def test_what_is_unknown_is_null(folder):
    document = ribbon_json("show", "mobius:4")
    assert document["energy"] is None
    assert document["negative_eigenvalues"] is None


def test_show_tells_of_a_run(folder):
    document = ribbon_json("show", "mob")
    assert document["name"] == "mobius-0123abcd"
    assert document["states"] == 4
    assert [event["event"] for event in document["history"]] == ["created"]
    assert ribbon_json("show", "runs/mobius-0123abcd")["name"] == "mobius-0123abcd"
    assert "equilibria" in ribbon("show", "mob").stdout


def test_a_file_outside_a_run_is_shown_and_exported(folder):
    os.rename("runs/mobius-0123abcd/states/0003.h5", "found.h5")
    assert ribbon_json("show", "found.h5")["run"] is None
    assert ribbon_json("export", "found.h5", "--to", "npz")["path"] == "found.npz"
    result = ribbon("show", "found.npz")
    assert result.exit_code == 2
    assert "holds no certificate" in result.stderr


def test_a_damaged_state_is_exit_code_4(folder):
    path = folder / "runs/mobius-0123abcd/states/0003.h5"
    path.write_bytes(path.read_bytes()[:-100])
    for words in (["show", "mobius:3"], ["export", "mobius:3", "--to", "npz"], ["show", path]):
        result = ribbon(*words)
        assert (result.exit_code, result.stdout) == (4, "")
        assert "damaged" in result.stderr
    assert not (folder / "mobius-3.npz").exists()


def test_export_writes_npz(folder):
    result = ribbon("export", "mobius:3", "--to", "npz")
    assert (result.exit_code, result.stdout) == (0, "mobius-3.npz\n")
    record = make_record(3)
    with np.load("mobius-3.npz") as data:
        np.testing.assert_array_equal(data["u"], record.u)
        assert data["half_width"] == 0.5
    again = ribbon("export", "mobius:3", "--to", "npz")
    assert again.exit_code == 2
    assert "exists already and is not replaced: add --overwrite" in again.stderr
    assert ribbon("export", "mobius:3", "--to", "npz", "--overwrite").exit_code == 0
    document = ribbon_json("export", "mobius:3", "--to", "npz", "-o", "other.npz")
    assert document == {
        "path": "other.npz",
        "format": "npz",
        "content_sha256": content_sha256(record),
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "npy"], "did you mean ply or npz?"),
        (["--to", "npz", "-o", "runs"], "runs: is a folder: name a file with -o"),
        (["--to", "npz", "-o", "none/x.npz"], "none/x.npz: its folder does not exist"),
    ],
)
def test_exports_that_cannot_be(folder, words, message):
    result = ribbon("export", "mobius:3", *words)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr


def test_load_state_takes_references_and_paths(folder):
    assert load_state("mobius:3").label == 3
    assert load_state("mob@b=0.3", runs=folder / "runs").label == 4
    assert load_state(folder / "runs/mobius-0123abcd/states/0001.h5").kind == "intermediate"


@pytest.mark.parametrize(
    "words",
    [
        ["ls"],
        ["show", "mobius:3"],
        pytest.param(["ls", "mobius"], marks=pytest.mark.long),
        pytest.param(["show", "mobius"], marks=pytest.mark.long),
    ],
)
def test_a_process_prints_json_alone_and_no_escape_codes(folder, words):
    done = run(*words, "--json", "-q", cwd=folder, TERM="xterm-256color", FORCE_COLOR="1")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout[0] in "[{"
    assert ESCAPE not in run(*words, cwd=folder, FORCE_COLOR="1").stdout


def test_a_run_below_a_folder_with_marks_in_its_name_is_no_state(tmp_path):
    """As for every other command, what is a folder is a run."""
    made = make_run(tmp_path / "a@b")
    result = ribbon("export", made.path, "--to", "npz")
    assert result.exit_code == 2
    assert f"npz takes one state: name one of {made.name}" in result.stderr
