"""`ribbon repair`, `pack`, `unpack`, `compare`, `rm`, `path`, `rerun`, and what `ls` says of runs."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from cli_support import QUICK_BRANCH, QUICK_MOBIUS, QUICK_RING, QUICK_SCHOENKE, ribbon, ribbon_json, run
from store_support import make_record, make_run, relative_files

from ribbon_cli.config import dump_resolved, parse_config
from ribbon_cli.store import Run, encode, write_atomic
from ribbon_cli.study.failure import Failure
from ribbon_cli.study.plan import plan_of
from ribbon_cli.study.walk import Walk
from ribbon_cli.sweeps.standing import standing
from ribbon_cli.verify.reruns import by_command

FROZEN = Path(__file__).parent / "data" / "format-1.0"
NAME = "frozen-3b93991c"
TWO_WIDTHS = """\
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 10, half_width: 0.5}
widths: [0.5, 0.8, 0.9]
"""
EVERTED_BRANCH = """\
name: everted
topology: {half_twists: 0}
initial_guess: {recipe: eversion, segments: 40, half_width: 0.03, steps: 25}
widths: {arclength: {to: 0.2, at: [0.05, 0.2], max_step: 0.3}}
spectrum: {modes: 0, full_up_to: 0}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(FROZEN, tmp_path / "runs")
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in relative_files(folder) if "lock" not in name}


# --- pack and unpack ---


def test_pack_and_unpack_give_the_same_bytes(folder):
    document = ribbon_json("pack", "frozen", "-o", "shared.h5")
    assert document == {
        "run": NAME,
        "path": "shared.h5",
        "states": 6,
        "bytes": os.path.getsize("shared.h5"),
    }
    with h5py.File("shared.h5") as file:
        assert file.attrs["format"] == b"ribbon-pack"
    assert ribbon_json("unpack", "shared.h5", "--runs", "other")["states"] == 6
    assert files(folder / "other" / NAME) == files(folder / "runs" / NAME)
    assert ribbon("verify", "--runs", "other").exit_code == 0
    assert ribbon("pack", "frozen", "--runs", "other").stdout == f"{NAME}.pack.h5\n"
    assert Path(f"{NAME}.pack.h5").read_bytes() == Path("shared.h5").read_bytes()


def test_a_pack_is_read_by_h5py_alone(folder):
    assert ribbon("pack", "frozen", "-o", "shared.h5").exit_code == 0
    with h5py.File("shared.h5") as file:
        assert f"{file['states/0006/state/energy'][()]:.9f}" == "0.864281650"
        assert file["states/0006/state/u"].shape == (12, 3)
        assert bytes(file["files/config.yaml"][()]) == (folder / "runs" / NAME / "config.yaml").read_bytes()


def test_a_pack_is_not_written_over_nor_unpacked_over(folder):
    assert ribbon("pack", "frozen", "-o", "shared.h5").exit_code == 0
    assert "exists already" in ribbon("pack", "frozen", "-o", "shared.h5").stderr
    assert ribbon("pack", "frozen", "-o", "shared.h5", "--overwrite").exit_code == 0
    result = ribbon("unpack", "shared.h5")
    assert result.exit_code == 2
    assert "exists already" in result.stderr


def test_a_damaged_run_is_not_packed(folder):
    path = folder / "runs" / NAME / "states" / "0002.h5"
    path.write_bytes(path.read_bytes()[:-1])
    result = ribbon("pack", "frozen", "-o", "shared.h5")
    assert result.exit_code == 4
    assert "0002.h5: damaged" in result.stderr
    assert not list(folder.glob("*shared*"))


def _other_name(file):
    file.attrs["run"] = np.bytes_("../../escaped-01234567")


def _other_file(file):
    del file["files/states/0003.h5"]
    file["files/states/0003.h5"] = np.zeros(10, dtype="u1")


def _external(file):
    del file["files/states/0003.h5"]
    file["files/states/0003.h5"] = h5py.ExternalLink("/etc/hostname", "/")


def _outside(file):
    del file["files/log.jsonl"]
    file.create_dataset("files/log.jsonl", (64,), "u1", external=[("/etc/hostname", 0, 64)])


def _giant(file):
    del file["files/log.jsonl"]
    file.create_dataset("files/log.jsonl", (2**40,), "u1", chunks=(1024,))


def _newer(file):
    file.attrs["format_version"] = np.bytes_("2.0")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_other_name, "is no run's name"),
        (_other_file, "states/0003.h5 is not what the log says"),
        (_external, "files/states/0003.h5 is missing, or not in the file itself"),
        (_outside, "keeps its data outside the file"),
        (_giant, "larger than any file of a run"),
        (_newer, "newer than 1.1: update ribbon"),
    ],
)
def test_hostile_packs_are_refused_whole(folder, change, message):
    assert ribbon("pack", "frozen", "-o", "shared.h5").exit_code == 0
    with h5py.File("shared.h5", "r+") as file:
        change(file)
    result = ribbon("unpack", "shared.h5", "--runs", "other")
    assert result.exit_code == 4
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (folder / "other").exists() or os.listdir(folder / "other") == []
    write_atomic("none.h5", b"no HDF5 at all")
    assert ribbon("unpack", "none.h5").exit_code == 4
    missing = ribbon("unpack", "missing.h5")
    assert (missing.exit_code, missing.stderr) == (4, "ribbon: missing.h5: no such file\n")


# --- repair, rm, path ---


def test_repair_makes_verify_pass_and_a_solve_compute_again_what_was_lost(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    (path,) = (tmp_path / "runs").iterdir()
    before = {s.stage: s.energy for s in Run.open(path).states()}
    damaged = Run.open(path).state_path(3)
    damaged.write_bytes(damaged.read_bytes()[:-9])
    for words in (("solve", "ring.yaml", "-q"), ("show", "ring:3"), ("verify", "ring")):
        assert ribbon(*words).exit_code in (0, 4)
    assert ribbon("verify", "ring").exit_code == 4
    document = ribbon_json("repair", "ring")
    assert len(document["done"]) == 1
    assert ribbon("verify", "ring").exit_code == 0
    assert "nothing to repair" in ribbon("repair", "ring").stderr
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    assert {s.stage: s.energy for s in Run.open(path).states()} == before
    assert ribbon("verify", "ring").exit_code == 0


def test_rm_asks(folder):
    result = ribbon("rm", "frozen", input="n\n")
    assert result.exit_code == 2
    assert f"delete runs/{NAME} with 6 states?" in result.stderr
    assert ribbon("rm", "frozen", input="").exit_code == 2
    assert (folder / "runs" / NAME).is_dir()
    assert ribbon("rm", "frozen:3", "--yes").exit_code == 2
    assert ribbon("rm", "frozen", input="y\n").exit_code == 0
    assert os.listdir(folder / "runs") == []


def test_rm_with_yes_and_a_run_in_use(folder):
    with Run.open(folder / "runs" / NAME).writing():
        assert ribbon("rm", "frozen", "--yes").exit_code == 5
    assert ribbon_json("rm", "frozen", "--yes")["run"] == NAME
    assert os.listdir(folder / "runs") == []


def test_path_says_where(folder):
    assert ribbon("path", "frozen").stdout == f"{folder}/runs/{NAME}\n"
    assert ribbon("path", "frozen:3").stdout == f"{folder}/runs/{NAME}/states/0003.h5\n"
    assert ribbon_json("path", "frozen@b=0.1")["path"].endswith("0006.h5")
    assert ribbon("path", "nothing").exit_code == 2


# --- compare and rerun ---


def test_compare_states_field_by_field(folder):
    document = ribbon_json("compare", "frozen:5", "frozen:6", code=3)
    fields = {field["path"]: field for field in document["fields"]}
    assert not document["equal"]
    assert fields["/state/energy"]["difference"] == pytest.approx(0.0584863726)
    assert fields["/state/u"]["first"] == [12, 3]
    assert fields["/state/half_width"]["equal"]
    assert fields["/certificate/negative_eigenvalues"]["second"] == 0
    assert fields["/spectra/physical/values"]["first"] is None
    assert document["answer"] == "different"
    text = ribbon("compare", "frozen:5", "frozen:6").stdout
    assert "/state/energy" in text
    assert "/state/half_width" not in text


def test_provenance_does_not_make_states_different(folder):
    record = Run.open(folder / "runs" / NAME).load(6)
    write_atomic("a.h5", encode(record))
    write_atomic("b.h5", encode(replace(record, provenance={"argv": "another"})))
    result = ribbon("compare", "a.h5", "b.h5")
    assert result.stdout.splitlines()[-1] == "identical"
    assert ribbon_json("compare", "a.h5", "b.h5")["equal"]


def test_compare_runs_by_stage(folder):
    shutil.copytree(folder / "runs" / NAME, folder / "runs" / "twin-3b93991c")
    document = ribbon_json("compare", "frozen", "twin")
    assert document["equal"]
    assert len(document["states"]) == 6
    assert "6 of 6 states are equal" in ribbon("compare", "frozen", "twin").stderr
    assert ribbon("compare", "frozen", "twin:3").exit_code == 2


@pytest.mark.parametrize("name", ["config.yaml", "resolved.yaml"])
def test_a_changed_config_in_a_run_stops_whatever_would_go_by_it(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    (path,) = Path("runs").iterdir()
    before = (path / name).read_text()
    (path / name).write_text(before.replace("0.5", "0.6"))
    for words in (("rerun", "ring", "-q"), ("refine", "ring:1", "--to", "20", "-q")):
        result = ribbon(*words)
        assert result.exit_code == 4
        assert f"{name}: not the bytes that the run was made with; `ribbon repair" in result.stderr
    assert ribbon("repair", "ring").exit_code == 0
    assert (path / name).read_text() == before
    assert ribbon("rerun", "ring", "-q").exit_code == 0


def test_a_changed_config_that_no_state_keeps_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = parse_config(TWO_WIDTHS, "ring.yaml")
    made = Run.create_or_open("runs", config.name, config.hash8(), TWO_WIDTHS, dump_resolved(config))
    (made.path / "config.yaml").write_text("name: other\n")
    Path("ring.yaml").write_text(TWO_WIDTHS)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 4
    assert "config.yaml is not the bytes" in ribbon("repair", "ring").stdout
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 4
    assert ribbon("solve", "ring.yaml", "-q", "--fresh").exit_code == 0


def test_rerun_repeats_a_run_from_its_stored_config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    assert ribbon("refine", "ring:1", "--to", "20", "-q").exit_code == 0
    Path("ring.yaml").unlink()
    document = ribbon_json("rerun", "ring")
    assert document["equal"]
    assert [state["equal"] for state in document["states"]] == [True] * 4
    assert [state["stage"] for state in document["not_from_config"]] == ["state 1 refined to N = 20"]
    assert len(os.listdir("runs")) == 1
    assert ribbon("rerun", "ring", "--into", "again").exit_code == 0
    assert len(os.listdir("again")) == 1
    (path,) = Path("runs").iterdir()
    other = Run.open(path)
    record = other.load(2)
    other.state_path(2).unlink()
    write_atomic(other.state_path(2), encode(replace(record, energy=record.energy + 1e-9)))
    assert ribbon("rerun", "ring", "-q").exit_code == 4
    assert ribbon("repair", "ring").exit_code == 0
    assert ribbon("rerun", "ring", "-q").exit_code == 3


def test_a_rerun_that_does_not_come_to_a_level_is_not_the_same(tmp_path, monkeypatch):
    """The level is the config's own, and not one that `ribbon refine` has added."""
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    assert ribbon("refine", "ring:1", "--to", "20", "-q").exit_code == 0
    monkeypatch.setattr(Walk, "refine", lambda *words: Failure("solve", None, "made to fail", {"stage": "N"}))
    document = ribbon_json("rerun", "ring", code=3)
    assert not document["equal"]
    assert [state["equal"] for state in document["states"]] == [True, False, True, False]
    assert [state["stage"] for state in document["not_from_config"]] == ["state 1 refined to N = 20"]


STAGES = {3: "given state", 7: "branch up, step 4, branch-point", 9: "branch from 3 up, step 2, branch-point"}
STAGES |= {12: "branch from 7 side +, step 2, branch-point", 15: "branch from 9 side -, step 3, branch-point"}
STAGES |= {20: "branch from 20 side +, step 2, branch-point"}  # as no honest log has it


@pytest.mark.parametrize(
    ("stage", "made"),
    [
        ("b = 0.5, refined to N = 100", False),
        ("state 3 refined to N = 100, on the way", True),
        ("from 3, b = 0.6", True),
        ("branch down, step 2, fold", False),
        ("branch from 3 (steps up to 0.2) down, step 2", True),
        ("branch from 7 side +, step 1", False),
        ("branch from 12 side -, step 5", False),
        ("branch from 9 side +, step 1", True),
        ("branch from 15 side +, step 1", True),
        ("branch from 20 side +, step 1", False),
    ],
)
def test_what_commands_made_is_told_from_what_a_config_leads_to(stage, made):
    assert by_command(stage, STAGES) is made


# --- what ls says of runs ---


def standing_of(name: str) -> dict:
    (found,) = [item for item in ribbon_json("ls") if item["short_name"] == name]
    return found


def counts(item: dict) -> tuple:
    return (item["status"], item["done"], item["running"], item["waiting"], item["failed"])


def test_ls_tells_how_far_a_run_has_come(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = parse_config(TWO_WIDTHS, "ring.yaml")
    made = Run.create_or_open("runs", config.name, config.hash8(), TWO_WIDTHS, dump_resolved(config))
    assert counts(standing_of("ring")) == ("waiting", 0, 0, 3, 0)
    with made.writing():
        made.commit(make_record(1, half_width=0.5, stage="cylinder"))
        item = standing_of("ring")
        assert counts(item) == ("running", 1, 1, 1, 0)
        assert item["holder"]["pid"] == os.getpid()
        made.commit(make_record(2, half_width=0.8, certified=False, stage="b = 0.8"))
    assert counts(standing_of("ring")) == ("waiting", 1, 0, 1, 1)
    with made.writing():
        made.log_event("ended", exit_code=3, missed=[[0.9, 10]])
    assert counts(standing_of("ring")) == ("failed", 1, 0, 0, 2)
    assert ribbon("show", "ring").stdout.splitlines()[:3:2] == [
        "1 of 3 targets not reached: b = 0.9",
        "1 of 3 targets without certificate: b = 0.8",
    ]
    assert ribbon("ls", "--status", "complete", "-q").stdout == ""
    assert len(ribbon_json("ls", "--status", "failed")) == 1
    assert "did you mean failed?" in ribbon("ls", "--status", "fialed").stderr


SHEARED = """\
name: moved
topology: open
length: 1
ends: {span: 0.7}
initial_guess: {recipe: strip, segments: 10, half_width: 0.05}
schedule: [{shear: 0.1}, {shear: 0.2}]
"""
CURVED = """\
name: moved
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 10, half_width: 0.05}
schedule: [{natural_curvature: 0.1}, {natural_curvature: 0.2}]
"""


@pytest.mark.parametrize(
    ("text", "first", "symbol"),
    [(SHEARED, "strip", "shear"), (CURVED, "cylinder", "natural_curvature")],
)
def test_what_a_command_adds_at_a_width_reaches_no_target_there(tmp_path, monkeypatch, text, first, symbol):
    monkeypatch.chdir(tmp_path)
    config = parse_config(text, "moved.yaml")
    made = Run.create_or_open("runs", config.name, config.hash8(), text, dump_resolved(config))
    names = [stage.name for stage in plan_of(config).stages]
    assert names[0] == first
    with made.writing():
        for label, stage in enumerate(names[:2], start=1):
            made.commit(make_record(label, half_width=0.05, stage=stage))
    assert counts(standing_of("moved")) == ("waiting", 2, 0, 1, 0)
    with made.writing():
        made.log_event("ended", exit_code=3, missed=[[0.05, 10]])
    assert counts(standing_of("moved")) == ("failed", 2, 0, 0, 1)
    with made.writing():
        made.commit(make_record(3, half_width=0.05, stage=f"from 2, {symbol} = 0.15"))
        made.commit(make_record(4, half_width=0.05, segments=10, stage="state 1 refined to N = 10"))
    assert counts(standing_of("moved")) == ("failed", 2, 0, 0, 1)
    assert len(ribbon_json("ls", "--status", "failed")) == 1
    said = ribbon("show", "moved").stdout.splitlines()[0]
    assert said == f"1 of 3 targets not reached: {symbol} = 0.2"
    assert ribbon_json("show", "moved")["not_reached"] == [f"{symbol} = 0.2"]
    point = SimpleNamespace(run=made.path.name, exists=True, path=made.path)
    assert standing(SimpleNamespace(folder=tmp_path), point).failures == (said,)


def test_ls_counts_each_visit_of_a_schedule(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(TWO_WIDTHS.replace("[0.5, 0.8, 0.9]", "[0.5, 0.6, 0.5, 0.6]"))
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    assert counts(standing_of("ring")) == ("complete", 4, 0, 0, 0)
    (path,) = Path("runs").iterdir()
    with Run.open(path).writing() as made:
        made.log_event("ended", exit_code=3, missed=[[0.6, 10]])
    Run.open(path).state_path(4).unlink()
    assert ribbon("repair", "ring").exit_code == 0
    assert counts(standing_of("ring")) == ("failed", 3, 0, 0, 1)


def test_an_unstable_point_of_a_branch_is_no_failure(tmp_path, monkeypatch):
    """The everted band, unstable at the width asked for, is what was asked for."""
    monkeypatch.chdir(tmp_path)
    Path("everted.yaml").write_text(EVERTED_BRANCH)
    assert ribbon("solve", "everted.yaml", "-q").exit_code == 0
    states = ribbon_json("ls", "everted")
    assert [state["certified"] for state in states] == [True, True, False]
    assert counts(standing_of("everted")) == ("complete", 3, 0, 0, 0)


def test_ls_knows_how_far_a_run_from_a_given_state_has_come(tmp_path, monkeypatch):
    """Its width and N are the state's own, which the config does not name."""
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    Path("on.yaml").write_text("topology: {half_twists: 0}\ninitial_guess: {state: ring:1}\n")
    assert ribbon("solve", "on.yaml", "-q").exit_code == 0
    assert counts(standing_of("on")) == ("complete", 1, 0, 0, 0)


def test_ls_filters_states(folder):
    assert [state["label"] for state in ribbon_json("ls", "frozen@b=0.1,N=12")] == [6]
    assert [state["label"] for state in ribbon_json("ls", "frozen", "--kind", "auxiliary")] == [1, 2, 3, 4]
    assert [state["label"] for state in ribbon_json("ls", "frozen", "--all", "--status", "saddle")] == [5]
    assert ribbon_json("ls", "frozen@b=0.2") == []
    assert "no such states" in ribbon("ls", "frozen@b=0.2").stderr
    assert ribbon("ls", "frozen", "--kind", "none").exit_code == 2
    assert "did you mean saddle" in ribbon("ls", "frozen", "--status", "sadle").stderr
    assert ribbon("ls", "--kind", "saddle").exit_code == 2


def test_a_solve_keeps_which_targets_were_missed_and_a_changed_config_says_what_changed(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    (first,) = os.listdir("runs")
    assert counts(standing_of("ring")) == ("complete", 4, 0, 0, 0)
    Path("ring.yaml").write_text(QUICK_RING.replace("[0.1, 0.5]", "[0.1, 0.4]"))
    result = ribbon("solve", "ring.yaml")
    assert f"its config differs from that of {first} in widths ([0.1, 0.5] -> [0.1, 0.4])" in result.stderr
    assert ribbon("solve", "ring.yaml").stderr.count("differs") == 0


def test_provenance_keeps_the_config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(QUICK_RING)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    facts = ribbon_json("show", "ring:1")["provenance"]
    assert facts["config_text"] == QUICK_RING
    assert "length: 6.28" in facts["config_resolved"]
    assert len(facts["config_sha256"]) == 64
    assert {
        "version_numpy",
        "version_scipy",
        "version_pyyaml",
        "version_rich",
        "version_hdf5",
    } <= facts.keys()
    assert "config_text" not in ribbon("show", "ring:1").stdout
    assert "  ended" in ribbon("show", "ring").stdout


# --- the same bytes ---


@pytest.mark.parametrize(
    "config",
    [
        pytest.param(QUICK_MOBIUS, id="twist", marks=pytest.mark.faults),
        pytest.param(QUICK_SCHOENKE, id="schoenke", marks=pytest.mark.long),
        pytest.param(QUICK_BRANCH, id="branch", marks=pytest.mark.faults),
    ],
)
def test_the_environment_changes_no_bytes(tmp_path, config):
    found = []
    for k, changes in enumerate(
        (
            {"PYTHONHASHSEED": "0"},
            {"PYTHONHASHSEED": "1", "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
            {"PYTHONHASHSEED": "random", "LC_ALL": "C"},
        )
    ):
        folder = tmp_path / str(k)
        folder.mkdir()
        (folder / "band.yaml").write_text(config)
        done = run("solve", "band.yaml", "-q", cwd=folder, **changes)
        assert done.returncode == 0, done.stderr
        (made,) = [Run.open(path) for path in (folder / "runs").iterdir()]
        found.append([entry.state.content_sha256 for entry in made.entries().values()])
    assert found[0] == found[1] == found[2]


def test_a_run_is_found_by_its_log_alone(tmp_path):
    made = make_run(tmp_path, states=1)
    (made.path / "resolved.yaml").unlink()
    assert ribbon_json("ls", "--runs", tmp_path)[0]["states"] == 1
    assert ribbon("verify", "--runs", tmp_path).exit_code == 4
