"""Sweeps as files: their points, names and mistakes, and the record beside the runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli_support import ribbon

import ribbon_cli
from ribbon_cli.config import ConfigError, load_cluster, load_config, load_sweep
from ribbon_cli.config.point_names import labels, point_name
from ribbon_cli.config.table import NAME
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import find_sweep, keep_sweep, list_sweeps
from ribbon_cli.study import Outcome, solve_config

BASE = """\
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 24, half_width: 0.1}
widths: [0.1]
"""
FAMILY = """\
config: base.yaml
vary:
  - topology.half_twists: [0, 1, -3]
    initial_guess.recipe: [cylinder, twist, schoenke]
  - widths: [[0.1], [2*pi/30, 0.25]]
"""
VALUES = "a list of values, or {from: ..., to: ..., steps: ...}"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    (tmp_path / "base.yaml").write_text(BASE)
    return tmp_path


def sweep_of(text: str, name: str = "fam.yaml") -> Any:
    Path(name).write_text(text)
    return load_sweep(name)


def mistakes(text: str, base: str = BASE) -> list[str]:
    Path("base.yaml").write_text(base)
    with pytest.raises(ConfigError) as caught:
        sweep_of(text)
    return str(caught.value).splitlines()


def test_keys_of_a_group_go_together_and_groups_multiply(folder):
    sweep = sweep_of(FAMILY)
    assert (sweep.name, sweep.keys) == ("fam", ("topology.half_twists", "initial_guess.recipe", "widths"))
    assert sweep.groups == (("topology.half_twists", "initial_guess.recipe"), ("widths",))
    found = [tuple(point.values.values()) for point in sweep.points]
    pairs = [(0, "cylinder"), (1, "twist"), (-3, "schoenke")]
    assert found == [(*pair, b) for pair in pairs for b in ((0.1,), (0.20943951023931953, 0.25))]
    assert [point.name for point in sweep.points[:2]] == [
        "fam-n0-cylinder-b0.1",
        "fam-n0-cylinder-b0.209439510239_0.25",
    ]
    assert sweep.points[5].config.half_twists == -3
    assert sweep.points[5].config.widths == (0.20943951023931953, 0.25)


def test_a_point_is_an_ordinary_config(folder):
    """Its text, as its run keeps it, is the same config with the same run."""
    for point in sweep_of(FAMILY).points:
        config = point.written("fam")
        Path("point.yaml").write_text(config.text)
        again = load_config("point.yaml")
        assert f"{again.name}-{again.hash8()}" == point.run
        assert again.scientific() == config.scientific()
        assert config.text.startswith("# A point of the sweep fam: topology.half_twists = ")


def test_an_inline_config_and_ranges(folder):
    sweep = sweep_of(
        "name: rings\nconfig: {topology: {half_twists: 0}, initial_guess: {recipe: cylinder, segments: 12}}\n"
        "vary:\n  - initial_guess.half_width: {from: 0.1, to: 0.3, steps: 4}\n"
        "    initial_guess.segments: {from: 10, to: 50, steps: 4}\n"
    )
    b, n = ([point.values[key] for point in sweep.points] for key in sweep.keys)
    assert b == [0.1, 0.15, 0.2, 0.25, 0.3]
    assert n == [10, 20, 30, 40, 50]
    assert all(type(value) is int for value in n)
    assert sweep.points[0].name == "rings-b0.1-N10"


def test_numbers_of_one_key_are_of_one_type(folder):
    """Whole half-widths and a default that no config spells out are floats beside others."""
    strip = (
        "config:\n  topology: open\n  ends: {span: 3}\n"
        "  initial_guess: {recipe: strip, segments: 24, half_width: 0.1}\n"
        "vary:\n  - ends.lift: [0, 1, 0.5]\n  - initial_guess.half_width: [1, 2]\n  - topology: [open]\n"
    )
    points = sweep_of(strip).points
    assert [type(point.values["ends.lift"]) for point in points] == [float] * 6
    assert [type(point.values["initial_guess.half_width"]) for point in points] == [float] * 6
    assert {point.values["topology"] for point in points} == {"open"}
    assert points[0].name == "fam-lift0-b1-open"


def test_sections_that_the_base_lacks_are_made(folder):
    points = sweep_of("config: base.yaml\nvary: [{spectrum.modes: [0, 3]}, {contact: [stop]}]\n").points
    assert [point.config.spectrum.modes for point in points] == [0, 3]
    assert points[1].name == "fam-modes3-stop"


def test_items_of_lists_are_reached_by_number(folder):
    points = sweep_of("config: base.yaml\nvary:\n  - widths.0: [0.1, 0.12]\n").points
    assert [point.config.widths for point in points] == [(0.1,), (0.12,)]
    assert points[0].name == "fam-b.00.1"


@pytest.mark.parametrize(
    ("vary", "lines"),
    [
        (
            "- topology.half_twists: [0, 1, 3.5]\n    initial_guess.recipe: [cylinder, twist]",
            [
                "fam.yaml:4:5: vary[0].initial_guess.recipe: must have as many values as "
                "topology.half_twists, 3, got 2"
            ],
        ),
        (
            "- widths: [[0.1], [-0.2]]\n  - contct: [stop]",
            [
                "fam.yaml:3:22: widths[0]: must be > 0, got -0.2",
                "fam.yaml:4:5: contct: unknown key: did you mean contact?",
            ],
        ),
        ("- widths: 0.1", [f"fam.yaml:3:13: vary[0].widths: must be {VALUES}, got 0.1"]),
        ("- widths: []", ["fam.yaml:3:13: vary[0].widths: must have at least one value, got an empty list"]),
        (
            "- widths: {from: 1, to: 1, steps: 2}",
            ["fam.yaml:3:27: vary[0].widths.to: must leave the values apart, got 1"],
        ),
        ("- name: [a, b]", ["fam.yaml:3:5: vary[0].name: cannot vary: points are named by what varies"]),
        (
            "- topology: [open]\n  - topology.half_twists: [1]",
            ["fam.yaml:4:5: vary[1].topology.half_twists: topology varies already, in vary[0]"],
        ),
        ("- widths.to: [1]", ["fam.yaml:3:5: widths.to: no key to in the config: it has a list"]),
        (
            "- initial_guess.half_width: [0.1, 0.2, 0.1]",
            [
                "fam.yaml:3:42: initial_guess.half_width: gives a point that there is already, fam-b0.1: "
                "values must differ, to 12 digits"
            ],
        ),
        ("- {}", [f"fam.yaml:3:5: vary[0]: must be a mapping {{key: {VALUES}}}, got {{}}"]),
        ("- widths", [f"fam.yaml:3:5: vary[0]: must be a mapping {{key: {VALUES}}}, got widths"]),
        (
            "- a.: [1]",
            [
                "fam.yaml:3:5: vary[0]: a key must be the path of one in a config, as topology.half_twists, "
                "got a."
            ],
        ),
        ("- widths: [[0.1], ~]", ["fam.yaml:3:21: vary[0].widths: has no value"]),
    ],
)
def test_mistakes_are_told_where_they_stand_all_at_once(folder, vary, lines):
    assert mistakes(f"config: base.yaml\nvary:\n  {vary}\n") == lines


def test_a_value_that_does_not_go_with_the_base_is_named_with_both_places(folder):
    base = BASE + "refinement: [24, 48]\n"
    told = mistakes(
        "config: base.yaml\nvary:\n  - initial_guess.segments: [24, 30]\n  - widths: [[0.1], [0.2]]\n", base
    )
    assert told == [
        "fam.yaml:3:34: refinement[0]: must be 30, the guess's segments, got 24 "
        "(base.yaml:4:14, with initial_guess.segments = 30)"
    ]


def test_a_mistake_of_the_base_alone_is_told_in_its_file(folder):
    told = mistakes("config: base.yaml\nvary:\n  - widths: [[0.1], [0.2]]\n", BASE + "contact: halt\n")
    assert told == ["base.yaml:4:10: contact: must be record, stop, forces or {gap: 0.02}, got halt"]


def test_a_base_that_is_not_there_and_missing_keys(folder):
    assert mistakes("config: bse.yaml\nvary:\n  - widths: [[0.1]]\n") == [
        "fam.yaml:1:9: config: bse.yaml: no such file: did you mean base.yaml?"
    ]
    assert mistakes("vary: []\n") == [
        "fam.yaml:1:1: config: is missing: give the path of a config, or its settings",
        "fam.yaml:1:7: vary: must have at least one item, got an empty list",
    ]
    Path("broken.yaml").write_text("a: [1\n")
    assert mistakes("config: broken.yaml\nvary:\n  - widths: [[0.1]]\n")[0].startswith("broken.yaml:1:")


def test_too_many_points_are_refused_before_any_is_made(folder):
    group = "{from: 1, to: 2, steps: 999}"
    text = f"config: base.yaml\nvary: [{{a: {group}}}, {{b: {group}}}]\n"
    assert mistakes(text) == ["fam.yaml:2:7: vary: must give at most 10000 points, got 1000000"]


def test_no_point_can_leave_the_folder_of_the_runs(folder):
    told = mistakes("name: ../x\nconfig: base.yaml\nvary:\n  - widths: [[0.1]]\n")
    assert told[0].startswith("fam.yaml:1:7: name: must be 1 to 40 of the characters")
    state = "initial_guess: [{state: ../../etc/x.npz}, {state: '../y.npz'}]"
    names = [
        point.name
        for point in sweep_of(f"config: base.yaml\nvary:\n  - {state}\n    widths: [[0.1], [0.2]]\n").points
    ]
    assert all(NAME.fits(name) for name in names)
    assert len(set(names)) == 2


def test_paths_of_states_are_seen_from_the_file_that_names_them(folder):
    Path("sub").mkdir()
    Path("sub/base.yaml").write_text("topology: {half_twists: 1}\ninitial_guess: {state: x.npz}\n")
    own = sweep_of("config: sub/base.yaml\nvary:\n  - contact: [stop]\n").points[0].config
    varied = sweep_of("config: sub/base.yaml\nvary:\n  - initial_guess.state: [x.npz]\n").points[0].config
    assert own.guess.state == str(folder / "sub" / "x.npz")
    assert varied.guess.state == str(folder / "x.npz")
    assert (own.path, varied.path) == ("sub/base.yaml", "fam.yaml")


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"material.poisson": 0.3, "loads.gravity": -1e-7}, "s-poisson0.3-gravity-1e-07"),
        ({"loads.gravity": 1e15}, "s-gravity1e15"),
        ({"topology.half_twists": -3}, "s-n-3"),
        ({"widths": (0.1, 0.2)}, "s-b0.1_0.2"),
        ({"initial_guess.state": "run@b=0.5,N=40"}, "s-run_b_0.5_N_40"),
        ({"a.both": True}, "s-both-true"),
        ({"a.to": 1.0, "b.to": 2.0}, "s-a.to1-b.to2"),
        ({"a.x": 1.0, "b.x": 2.0}, "s-a.x1-b.x2"),
    ],
)
def test_names_are_short_and_fit_for_folders(values, name):
    assert point_name("s", values, labels(list(values))) == name
    assert NAME.fits(name)


def test_long_names_are_cut_and_stay_apart():
    values = [
        {"widths": tuple(0.01 * k for k in range(20)), "a.b": "x" * 60, "c.d": float(j)} for j in range(3)
    ]
    names = [point_name("s", value, labels(list(value))) for value in values]
    assert len(set(names)) == 3
    assert all(NAME.fits(name) and len(name) == 64 for name in names)


def test_a_sweep_that_grows_keeps_its_runs(folder):
    small = sweep_of("config: base.yaml\nvary:\n  - widths: [[0.1], [0.2]]\n")
    large = sweep_of("config: base.yaml\nvary:\n  - widths: [[0.3], [0.1], [0.15], [0.2]]\n")
    assert {point.run for point in small.points} < {point.run for point in large.points}


def test_the_record_says_which_runs_are_a_sweeps(folder):
    sweep = sweep_of(FAMILY)
    kept = keep_sweep(Path("runs"), sweep)
    found = find_sweep(Path("runs"), "fam")
    assert found == kept
    assert [point.values for point in kept.points] == [point.values for point in sweep.points]
    assert [point.path for point in kept.points] == [Path("runs") / point.run for point in sweep.points]
    assert list_sweeps(Path("runs")) == ["fam"]
    assert find_sweep(Path("runs"), "other") is None
    assert find_sweep(Path("runs"), "../runs") is None
    before = Path("runs/sweeps/fam/sweep.json").stat()
    keep_sweep(Path("runs"), sweep)
    assert Path("runs/sweeps/fam/sweep.json").stat().st_ino == before.st_ino


@pytest.mark.parametrize("damage", ["", "{}", '{"format": "ribbon-sweep"', "[]", "\x00", '{"format": 1}'])
def test_a_damaged_record_is_told_and_written_anew(folder, damage):
    sweep = sweep_of(FAMILY)
    kept = keep_sweep(Path("runs"), sweep)
    Path("runs/sweeps/fam/sweep.json").write_text(damage)
    with pytest.raises(StoreError, match=r"sweep\.json: damaged: `ribbon sweep` .* writes it anew"):
        find_sweep(Path("runs"), "fam")
    assert ribbon("ls", "fam").exit_code == 4
    assert keep_sweep(Path("runs"), sweep) == find_sweep(Path("runs"), "fam") == kept


def test_a_forged_record_names_no_folder_elsewhere(folder):
    keep_sweep(Path("runs"), sweep_of(FAMILY))
    path = Path("runs/sweeps/fam/sweep.json")
    path.write_text(path.read_text().replace('"run": "fam', '"run": "../fam'))
    with pytest.raises(StoreError):
        find_sweep(Path("runs"), "fam")


def test_programs_open_a_sweep_with_the_runs_there_are(folder):
    sweep = sweep_of(FAMILY.replace("2*pi/30, 0.25", "0.2"))
    assert ribbon_cli.points("fam.yaml") == sweep.points
    with pytest.raises(UsageError, match="no sweep 'fam'"):
        ribbon_cli.open_sweep("fam")
    keep_sweep(Path("runs"), sweep)
    outcome = solve_config(sweep.points[0].written("fam"), Path("runs"))
    assert isinstance(outcome, Outcome)
    opened = ribbon_cli.open_sweep("fam")
    assert [point.run is None for point in opened.points] == [False] + [True] * 5
    assert opened.points[0].run.states()[0].half_width == 0.1
    with pytest.raises(UsageError, match="did you mean fam"):
        ribbon_cli.open_sweep("fan")


def test_a_sweep_is_no_config(folder):
    sweep_of(FAMILY)
    result = ribbon("check", "fam.yaml")
    assert result.exit_code == 2
    assert "fam.yaml:2:1: vary: makes this a sweep: `ribbon sweep` runs it" in result.stderr


def test_a_settings_file_of_a_cluster(folder):
    Path("slurm.yaml").write_text(
        'jobs: 2\nwalltime: "00:10:00"\npartition: debug\ndirectives: [--qos=long, "--mail-type END"]\n'
    )
    settings = load_cluster("slurm.yaml")
    assert (settings.jobs, settings.walltime, settings.partition) == (2, "00:10:00", "debug")
    assert settings.directives == ("--qos=long", "--mail-type END")
    assert settings.memory is None
    Path("slurm.yaml").write_text("jobs: 0\npartiton: debug\n")
    with pytest.raises(ConfigError) as caught:
        load_cluster("slurm.yaml")
    assert str(caught.value).splitlines() == [
        "slurm.yaml:1:1: walltime: is missing: give a time as Slurm reads it, 01:00:00",
        "slurm.yaml:1:7: jobs: must be an integer from 1 to 10000, got 0",
        "slurm.yaml:2:1: partiton: unknown key for a cluster: did you mean partition?",
    ]
