"""References: from what a user types to a state, or to a message that says what there is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from store_support import make_record, make_run

from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import (
    decode,
    encode,
    find_run,
    list_runs,
    resolve_state,
    runs_root,
    suggest,
    typed,
    write_atomic,
)
from ribbon_cli.store.root import named
from ribbon_cli.store.run import Run


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Runs mobius-pi (five states), mobius-pi-wide, and two named twin; one of mobius-pi was set aside."""
    root = tmp_path_factory.mktemp("runs")
    make_run(root, 1, "mobius-pi").set_aside()
    run = make_run(root, 0, "mobius-pi")
    states = [
        {"half_width": 0.5, "segments": 50},
        {"half_width": 0.5, "segments": 100},
        {"half_width": 0.5, "segments": 100, "certified": False},
        {"half_width": 0.5, "segments": 400, "kind": "intermediate"},
        {"half_width": 0.1 + 0.2, "segments": 200, "certified": False},
    ]
    with run.writing():
        for label, changes in enumerate(states, start=1):
            n = changes.pop("segments")
            run.commit(make_record(label, n, spectra=(), **changes))
    make_run(root, 0, "mobius-pi-wide")
    make_run(root, 1, "twin", "00000001")
    make_run(root, 1, "twin", "00000002")
    (root / "not-a-run").mkdir()
    return root


def test_root_comes_from_the_option_then_the_environment(monkeypatch):
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    assert runs_root() == Path("runs")
    monkeypatch.setenv("RIBBON_RUNS", "/data/runs")
    assert runs_root(None) == Path("/data/runs")
    assert runs_root("mine") == Path("mine")


def test_a_run_is_named_so_that_the_command_finds_it(root, monkeypatch):
    names = "mobius-pi-0123abcd", "twin-00000001", "mobius-pi-0123abcd.old-1"
    run, twin, aside = (root / name for name in names)
    monkeypatch.setenv("RIBBON_RUNS", str(root))
    assert [typed(Run(path)) for path in (run, twin, aside)] == ["mobius-pi", *names[1:]]
    monkeypatch.setenv("RIBBON_RUNS", "elsewhere")
    for path in (run, twin, aside):
        assert typed(Run(path)) == str(path)
        assert find_run("elsewhere", typed(Run(path))).path == path
    assert named(Path("two words") / run.name) == f"'two words/{run.name}'"


def test_runs_are_listed_without_those_set_aside(root, tmp_path):
    names = [run.name for run in list_runs(root)]
    assert names == ["mobius-pi-0123abcd", "mobius-pi-wide-0123abcd", "twin-00000001", "twin-00000002"]
    assert [run.name for run in list_runs(root, aside=True) if run.is_aside] == ["mobius-pi-0123abcd.old-1"]
    assert list_runs(tmp_path / "none") == []


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("mobius-pi", "mobius-pi-0123abcd"),
        ("mobius-pi-0123abcd", "mobius-pi-0123abcd"),
        ("mobius-pi-0", "mobius-pi-0123abcd"),
        ("mobius-pi-w", "mobius-pi-wide-0123abcd"),
        ("twin-00000002", "twin-00000002"),
        ("mobius-pi-0123abcd.old-1", "mobius-pi-0123abcd.old-1"),
    ],
)
def test_runs_are_found_by_name_or_unique_prefix(root, text, name):
    assert find_run(root, text).name == name


def test_runs_are_found_by_path(root):
    assert find_run("elsewhere", f"{root}/twin-00000001").name == "twin-00000001"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("twin", "more than one run: twin-00000001, twin-00000002; write more of its name; `ribbon check"),
        ("mob", "'mob' names more than one run: mobius-pi-0123abcd, mobius-pi-wide-0123abcd"),
        ("mobiuspi", "no run 'mobiuspi' in .*; did you mean mobius-pi"),
        ("zzz", "no run 'zzz' in .*: it has mobius-pi-0123abcd, "),
        ("", "no run '' in "),
        ("./none", "not a run folder"),
    ],
)
def test_what_names_no_run_is_explained(root, text, message):
    with pytest.raises(UsageError, match=message):
        find_run(root, text)


def test_no_runs_at_all(tmp_path):
    with pytest.raises(UsageError, match=r"no run 'x': there are no runs in .* \(see --runs\)"):
        find_run(tmp_path, "x")


@pytest.mark.parametrize(
    ("ref", "label"),
    [
        ("mobius-pi:4", 4),
        ("mobius-pi:0004", 4),
        ("mobius-pi@b=0.5,N=50", 1),
        ("mobius-pi@b=0.5,N=100", 2),
        ("mobius-pi@N=100,b=0.5", 2),
        ("mobius-pi@ b = 5e-1 , N = 100", 2),
        ("mobius-pi@b=0.5", 2),
        ("mobius-pi@N=50", 1),
        ("mobius-pi@b=0.3", 5),
        ("mobius-pi@b=0.5000000004,N=50", 1),
        ("mobius-pi@b=(pi-pi)+1/2,N=50", 1),
    ],
)
def test_states_are_found(root, ref, label):
    run, found, path = resolve_state(root, ref)
    assert (run.name, found) == ("mobius-pi-0123abcd", label)
    assert path == run.state_path(label)
    assert decode(path).label == label


@pytest.fixture(scope="module")
def refined(tmp_path_factory):
    """A run whose finer states are not its latest; places with two states, and without a certificate."""
    root = tmp_path_factory.mktemp("refined")
    places = [(0.5, 160, 1), (0.5, 80, 1), (0.5, 320, 0), (0.5, 80, 1), (0.8, 40, 0), (0.8, 80, 0)]
    places += [(0.8, 80, 0), (0.9, 40, 1), (0.2, 40, 0)]
    run = make_run(root, 0, "band")
    with run.writing():
        for label, (b, n, certified) in enumerate(places, start=1):
            changes = {"half_width": b, "certified": bool(certified), "spectra": ()}
            run.commit(make_record(label, n, **changes))
    return root


@pytest.mark.parametrize(
    ("ref", "label", "said"),
    [
        ("@b=0.5", 1, "state 1 is taken (b = 0.5, N = 160), the finest certified one of 4 that fit"),
        ("@b=0.5,N=80", 4, "state 4 is taken (b = 0.5, N = 80), the latest certified one of 2 that fit"),
        ("@b=0.5,N=160", 1, None),
        (
            "@b=0.8",
            7,
            "state 7 is taken (b = 0.8, N = 80), the finest and latest one of 3 that fit, without "
            "certificate like the others",
        ),
        ("@b=0.9", 8, "state 8 is taken (b = 0.9, N = 40), the only one that fits"),
        ("@b=0.2,N=40", 9, "state 9 is taken (b = 0.2, N = 40), the only one that fits, without certificate"),
        ("@N=40", 8, "state 8 is taken (b = 0.9, N = 40), the only certified one of 3 that fit"),
        (":2", 2, None),
    ],
)
def test_the_finest_certified_state_is_meant_and_said(refined, ref, label, said):
    told = []
    assert resolve_state(refined, f"band{ref}", told.append)[1] == label
    assert told == ([] if said is None else [f"band{ref}: {said}"])
    assert resolve_state(refined, f"band{ref}")[1] == label


@pytest.mark.parametrize(
    ("ref", "message"),
    [
        ("mobius-pi:6", "mobius-pi-0123abcd has no state 6: its labels are 1 to 5"),
        ("mobius-pi-wide:1", "has no state 1: its labels are none yet"),
        ("mobius-pi:two", "a label is a whole number"),
        ("mobius-pi:-1", "a label is a whole number"),
        ("mobius-pi", "is a run: name one of its states, for instance mobius-pi:5"),
        ("mobius-pi-0", "is a run: name one of its states, for instance mobius-pi-0:5"),
        ("mobius-pi@b=0.4", r"has no equilibrium with b = 0\.4: it has b = 0\.3, 0\.5"),
        ("mobius-pi@b=0.500000001,N=50", r"has no equilibrium with b = 0\.500000001"),
        ("mobius-pi@b=0.5,N=400", r"has no equilibrium with b = 0\.5 and N = 400: it has N = 50, 100"),
        ("mobius-pi@N=7", "has no equilibrium with N = 7: it has N = 50, 100, 200"),
        ("mobius-pi@M=7", r"expected RUN@b=\.\.\.,N=\.\.\., got 'M=7'"),
        ("mobius-pi@b=1,b=1", "got 'b=1'"),
        ("mobius-pi@", r"expected RUN@b"),
        ("mobius-pi@b=wide", "b must be a number, got 'wide'"),
        ("mobius-pi@N=1.5", "N must be a number"),
        ("mobius-pi@b=nan", "b must be a number, got .nan. \\(not made of numbers"),
        ("mobius-pi@b=1/0", "b must be a number, got .1/0. \\(division by zero\\)"),
        ("mobius-pi-wide@b=1", r"has no equilibria yet; `ribbon ls \S*/mobius-pi-wide-0123abcd --all`"),
        ("mobiuspi@b=0.5", "did you mean mobius-pi"),
        ("none/0001.h5", "no such file"),
    ],
)
def test_what_names_no_state_is_explained(root, ref, message):
    with pytest.raises(UsageError, match=message) as caught:
        resolve_state(root, ref)
    assert "\n" not in str(caught.value)


def test_paths_find_their_run_if_they_have_one(root, tmp_path, monkeypatch):
    inside = find_run(root, "twin-00000001").state_path(1)
    run, label, path = resolve_state("elsewhere", str(inside))
    assert (run.name, label, path) == ("twin-00000001", 1, inside)
    monkeypatch.chdir(inside.parent)
    run, label, path = resolve_state("elsewhere", "0001.h5")
    assert (run.name, label, path) == ("twin-00000001", 1, Path("0001.h5"))
    for name in ("copy.h5", "copy.npz", "copy"):
        write_atomic(tmp_path / name, encode(make_record()))
        assert resolve_state(root, str(tmp_path / name)) == (None, None, tmp_path / name)


def test_suggestions():
    assert suggest("covergence", ["convergence", "spectrum"]) == "; did you mean convergence?"
    assert suggest("x", ["convergence"]) == ""


def test_listing_opens_no_state_file(root):
    code = (
        "import sys; from ribbon_cli.store import find_run, resolve_state\n"
        "find_run(sys.argv[1], 'mobius-pi').states(all=True); resolve_state(sys.argv[1], 'mobius-pi@b=0.5')\n"
        "sys.exit(bool({'numpy', 'h5py'} & sys.modules.keys()))"
    )
    subprocess.run([sys.executable, "-c", code, str(root)], check=True)


def test_unreadable_folder_of_runs_is_a_usage_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be read: Not a directory"):
        list_runs(tmp_path / "file")
    with pytest.raises(StoreError, match="cannot be written"):
        make_run(tmp_path / "file")
    assert os.listdir(tmp_path) == ["file"]
