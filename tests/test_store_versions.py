"""Files that earlier versions wrote, kept as they were: read, verified, listed, packed and exported."""

from __future__ import annotations

import shutil
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json
from store_support import relative_files

from ribbon_cli.facts import EVENTS, UNKNOWN, kind_of
from ribbon_cli.model.geometry import geometry
from ribbon_cli.parts import Ends, Loads, Material, Parts
from ribbon_cli.store import FORMAT_VERSION, Run, content_sha256, decode, encode
from ribbon_cli.store.folder import RUN_FORMAT_VERSION
from ribbon_cli.store.hdf5 import decode_bytes
from ribbon_cli.store.preamble import head_version
from ribbon_cli.study.records import state_of
from ribbon_cli.verify import judge
from ribbon_cli.verify.recompute import verify_record

DATA = Path(__file__).parent / "data"
VERSIONS = sorted(path.name.removeprefix("format-") for path in DATA.glob("format-*"))
IN_TWO = DATA / "format-1.1" / "in-two-pieces.h5"
AT_REST = DATA / "format-1.4" / "at-rest.h5"


RUNS = sorted(path for path in DATA.glob("format-*/*") if path.is_dir())


def frozen(version: str, name: str = "") -> Path:
    """The run that a version wrote, of that name where it wrote several."""
    (folder,) = (path for path in RUNS if path.parent.name == f"format-{version}" and name in path.name)
    return folder


@pytest.fixture(params=RUNS, ids=lambda path: f"{path.parent.name}-{path.name}")
def folder(request, tmp_path, monkeypatch) -> Path:
    """A copy of such a run in ./runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    run = request.param
    shutil.copytree(run, tmp_path / "runs" / run.name)
    return tmp_path / "runs" / run.name


def test_there_is_a_frozen_run_of_every_version_up_to_this_one():
    assert VERSIONS == ["1.0", "1.1", "1.2", "1.3", "1.4"]
    assert VERSIONS[-1] == FORMAT_VERSION == RUN_FORMAT_VERSION
    for run in RUNS:
        heads = {head_version(path.read_bytes()) for path in run.glob("states/*.h5")}
        version = run.parent.name.removeprefix("format-")
        assert heads == {None if version == "1.0" else version}


def test_every_state_is_read_and_verified(folder):
    run = Run.open(folder)
    for label in run.entries():
        run.load(label)
    result = ribbon("verify", "all")
    assert (result.exit_code, result.stdout) == (0, ""), result.output
    assert len(ribbon_json("ls", run.short_name, "--all")) == len(run.entries())


def test_it_is_packed_and_unpacked_to_the_same_bytes(folder):
    ribbon_json("pack", folder.name, "-o", "shared.h5")
    ribbon_json("unpack", "shared.h5", "--runs", "other")
    other = folder.parents[1] / "other" / folder.name
    names = {name for name in relative_files(folder) if "lock" not in name}
    assert names == {name for name in relative_files(other) if "lock" not in name}
    for name in names:
        assert (folder / name).read_bytes() == (other / name).read_bytes()


def test_its_states_are_exported_and_repaired_without_a_log(folder):
    run = Run.open(folder)
    last = list(run.entries())[-1]
    assert ribbon("export", f"{run.short_name}:{last}", "--to", "npz", "-o", "x.npz").exit_code == 0
    with np.load("x.npz") as archive:
        np.testing.assert_array_equal(archive["u"], run.load(last).u)
    before = run.states(all=True)
    run.log_path.unlink()
    assert ribbon("repair", run.short_name).exit_code == 0
    assert Run.open(folder).states(all=True) == before
    assert ribbon("verify", "all").exit_code == 0


def test_it_is_resumed_refined_repaired_and_packed_by_this_version(folder):
    """What an earlier version computed is kept; what is lost is computed again, into the same run."""
    run, config = Run.open(folder), f"{Run.open(folder).short_name}.yaml"
    before, last = run.entries(), max(run.entries())
    shutil.copy(folder / "config.yaml", config)
    assert ribbon("solve", config).exit_code == 0
    assert len(Run.open(folder).entries()) == last
    run.state_path(last).unlink()
    assert ribbon("verify", run.name).exit_code == 4
    assert ribbon("repair", run.name).exit_code == 0
    assert ribbon_json("solve", config, "-q")["new_states"] == 1
    assert [path.name for path in folder.parent.iterdir()] == [run.name]
    again = Run.open(folder).entries()[last + 1].state
    assert again.stage == before[last].state.stage
    assert again.energy == pytest.approx(before[last].state.energy, rel=1e-12)
    finer = 2 * again.segments
    assert ribbon("refine", f"{run.name}:{last + 1}", "--to", str(finer)).exit_code == 0
    lines = run.log_path.read_bytes().splitlines(keepends=True)
    run.log_path.write_bytes(b"".join([lines[0], b"nonsense\n", *lines[2:]]) + b"torn")
    assert ribbon("repair", run.name).exit_code == 0
    ribbon_json("pack", run.name, "-o", "shared.h5")
    ribbon_json("unpack", "shared.h5", "--runs", "other")
    for root in ("runs", "other"):
        result = ribbon("verify", "all", "--runs", root)
        assert (result.exit_code, result.stdout) == (0, ""), result.output
        states = ribbon_json("ls", run.name, "--all", "--runs", root)
        assert finer in {state["segments"] for state in states}


def test_repair_takes_states_without_kinds_as_they_are(folder):
    """Earlier formats have sentences alone: no line of the log is written anew for that."""
    log = folder / "log.jsonl"
    before = log.read_bytes()
    assert Run.open(folder).repair() == []
    assert log.read_bytes() == before
    lines = before.splitlines(keepends=True)
    log.write_bytes(b"".join([*lines[:-1], b"nonsense\n", lines[-1]]))
    assert Run.open(folder).repair() == ["dropped 1 damaged line of the log"]
    assert log.read_bytes().splitlines(keepends=True)[: len(lines)] == lines


def test_what_the_branch_of_1_1_says():
    record = Run.open(frozen("1.1")).load(2)
    branch = record.branch
    assert (branch.name, branch.type, branch.arclength) == ("branch up", "width", 0.01)
    assert branch.tangent.shape == (8, 7)
    assert record.energy == 0.3281724411486899
    assert record.events == ("reached b = 0.11",)


def test_what_the_strip_and_the_curved_ring_of_1_3_say():
    """All of a strip's problem, its reactions, and the closed form of a ring with natural curvature."""
    strip = Run.open(frozen("1.3", "strip")).load(2)
    assert strip.parts == Parts(
        Ends(end="hinged", span=0.75, shear=0.02),
        Material(0.5, 0.3),
        Loads(gravity=2.0, point_force=(0.0, 0.01, 0.0)),
    )
    assert (strip.energy, strip.bending_energy) == (0.3301333539445556, 0.3020616759011883)
    np.testing.assert_allclose(strip.reaction_moment[2], 0.0, atol=1e-12)
    ring = Run.open(frozen("1.3", "curved")).load(1)
    assert (ring.parts, ring.parameters["natural_curvature"]) == (Parts(material=Material(0.5)), 0.5)
    d = 2 * np.pi / 10
    assert ring.energy == pytest.approx((1 - np.cos(d)) / d - 0.5 * np.sin(d) + d * 0.125, rel=1e-12)


def test_what_the_figure_eight_at_rest_and_the_ring_of_1_4_say():
    """One ruling rests on another; and a ring whose contact forces keep a gap has nothing to push."""
    record = decode(AT_REST)
    contacts = record.contacts
    assert (record.certified, record.self_contact, contacts.names()) == (True, True, ["edge 34 with edge 71"])
    assert (contacts.force.tolist(), contacts.sign.tolist()) == ([0.024492076970005293], [1])
    assert (contacts.gap, contacts.excluded) == (0.0, 0.005 * record.length)
    assert record.clearance == contacts.clearance == 0.0 < contacts.penetration < 1e-16
    assert record.message.endswith("(At rest on 1 contact, with forces of 0.0244921 in all.)")
    assert ribbon("verify", AT_REST).exit_code == 0
    run = Run.open(frozen("1.4"))
    ring = run.load(2).contacts
    assert (len(ring), ring.gap, ring.clearance) == (0, 0.02, run.load(2).clearance)
    assert [state.contacts for state in run.states()] == [0, 0]


def test_what_the_band_in_two_pieces_of_1_1_says():
    record = decode(IN_TWO)
    assert (record.cut_node, record.status, record.kind) == (9, "constructed", "auxiliary")
    np.testing.assert_array_equal(record.g_cut, [0.0, -1.0, 0.0])
    assert np.flatnonzero(np.isnan(record.kappa_s)).tolist() == [0, 8]
    assert ribbon("verify", IN_TWO).exit_code == 0


def test_events_of_every_version_have_kinds():
    """Files of 1.0 and 1.1 have sentences alone, of which the words are known."""
    known = {}
    for path in RUNS:
        run, version = Run.open(path), path.parent.name.removeprefix("format-")
        for state in run.states(all=True):
            assert run.load(state.label).event_kinds == state.event_kinds
            known.setdefault(version, []).extend(state.event_kinds)
    assert known == {
        "1.0": ["saddle-left"],
        "1.1": ["width-reached"],
        "1.2": ["turn-halved", "turn-halved", "saddle-left"],
        "1.3": [],
        "1.4": [],
    }


def test_the_kinds_of_events_are_read_from_the_file_and_not_from_its_sentences():
    record = replace(decode(IN_TWO), events=("as I said", "a fold"), event_kinds=("fold", "later-word"))
    again = decode_bytes(encode(record), "x.h5")
    assert (again.events, again.event_kinds) == (record.events, ("fold", "later-word"))
    assert content_sha256(again) == content_sha256(replace(record, event_kinds=("fold", "fold")))
    for wrong in (("fold",), ("fold", "two words"), ("fold", "")):
        with pytest.raises(ValueError, match=r"2 events have \d kinds, of one word each"):
            encode(replace(record, event_kinds=wrong))


def test_every_sentence_is_known_by_its_words():
    numbers = defaultdict(lambda: 1.5)
    for kind, sentence in EVENTS.items():
        assert kind_of(sentence.format_map(numbers)) == kind
    assert kind_of("something else: 1.5") == UNKNOWN


def test_open_seams_have_no_fold_and_older_numbers_there_are_no_error():
    """1.0 and 1.1 have the strip closed up at the first node, and verify takes both."""
    record = Run.open(frozen("1.2")).load(1)
    assert record.seam_open
    for name in ("kappa_s", "tau", "eta"):
        assert np.flatnonzero(np.isnan(getattr(record, name))).tolist() == [0]
    shape = geometry(state_of(record))
    older = replace(record, kappa_s=shape.kappa_s, tau=shape.tau, eta=shape.eta)
    assert verify_record(older) == []
    assert verify_record(replace(older, eta=shape.eta + 1e-5 * (np.arange(record.segments) == 0)))
    assert judge(record, older).answer == "same to rounding"


@pytest.mark.parametrize(
    "name",
    ["u", "g", "xi", "g_cut", "g_end", "midline", "kappa_s", "tau", "eta", "eta_prime", "energy", "cut_node"],
)
def test_a_wrong_number_of_a_band_in_two_pieces_is_noticed(name):
    record = decode(IN_TWO)
    value = np.array(getattr(record, name))
    value.flat[value.size // 2 + (name in ("kappa_s", "tau"))] += 1 if name == "cut_node" else 1e-5
    wrong = replace(record, **{name: value if value.ndim else value.item()})
    assert verify_record(record) == []
    assert verify_record(wrong)
