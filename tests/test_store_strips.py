"""States of open strips in files, logs, npz and references: all of the problem is kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import ribbon, ribbon_json
from picture_support import states_of
from store_support import make_record
from strip_runs import CANTILEVER, strips

import ribbon_cli
from ribbon_cli.analysis import run_table
from ribbon_cli.config import ConfigError, parse_config
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.parts import CLOSED, Ends, Loads, Material, Parts
from ribbon_cli.report.tables import RENDERERS
from ribbon_cli.store import Run, StateRecord, Summary, content_sha256, decode, encode
from ribbon_cli.store.fields import flatten
from ribbon_cli.store.npz import export_npz, load_npz
from ribbon_cli.store.refs import by_place, find_states, select
from ribbon_cli.store.summaries import varying
from ribbon_cli.study import solve_config
from ribbon_cli.study.records import state_of

__all__ = ["strips"]
PARTS = Parts(
    Ends("hinged", "clamped", 0.75, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    Material(1.5, 0.25),
    Loads(2.0, (0.0, 0.0, -1.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 0.375),
)
REACTIONS: dict[str, Any] = {
    "reaction_force": [1.0, 2.0, 3.0],
    "reaction_moment": [0.0, 0.5, 0.0],
    "start_force": [-1.0, -2.0, -3.0],
    "start_moment": [0.0, 0.25, float("nan")],
}


def strip(label: int = 1, parts: Parts = PARTS, **changes: Any) -> StateRecord:
    given = {"sigma": 0, "half_twists": 0, "length": 1.0, "bending_energy": 3.5, "lambda_end": 0.125}
    return make_record(label, parts=parts, **{**given, **REACTIONS, **changes})


def written(folder: Path, record: StateRecord) -> Path:
    path = folder / "state.h5"
    path.write_bytes(encode(record))
    return path


def test_a_file_alone_restores_the_problem(tmp_path: Path) -> None:
    record = strip()
    found = decode(written(tmp_path, record))
    assert found.parts == PARTS
    assert (found.sigma, found.bending_energy, found.lambda_end) == (0, 3.5, 0.125)
    for name, value in REACTIONS.items():
        np.testing.assert_array_equal(getattr(found, name), value)
    assert content_sha256(found) == content_sha256(record)
    assert found.parameters["twist"] == 0.3


def test_a_free_end_keeps_that_it_has_no_place(tmp_path: Path) -> None:
    record = strip(parts=Parts(Ends(end="free"), loads=Loads(1.0)), lambda_end=None)
    found = decode(written(tmp_path, record))
    assert found.parts.ends is not None
    assert np.isnan(found.parts.ends.span)
    assert list(found.parameters)[:2] == ["half_width", "gravity"]


def test_all_of_a_problem_is_in_the_content_hash() -> None:
    ends, material, loads = PARTS.ends, PARTS.material, PARTS.loads
    assert ends is not None
    others = [
        replace(PARTS, ends=replace(ends, end="hinged")),
        replace(PARTS, ends=replace(ends, start_eta=0.0)),
        replace(PARTS, material=replace(material, poisson=0.0)),
        replace(PARTS, loads=replace(loads, point_at=0.5)),
    ]
    assert len({content_sha256(strip(parts=parts)) for parts in (PARTS, *others)}) == 5


def test_files_of_closed_bands_hold_nothing_of_strips() -> None:
    paths = {field.item.path for field in flatten(make_record())}
    assert not any(path.startswith(("/ends", "/material", "/loads", "/reactions")) for path in paths)
    curved = make_record(sigma=1, half_twists=0, parts=Parts(material=Material(2.0)))
    assert {field.item.path for field in flatten(curved)} - paths == {
        *("/material/natural_curvature", "/material/poisson"),
    }


def test_a_strip_has_ends_and_no_sigma() -> None:
    with pytest.raises(ValueError, match="a strip has sigma 0 and ends"):
        make_record(sigma=0)
    with pytest.raises(ValueError, match="a strip has sigma 0 and ends"):
        make_record(parts=PARTS)


def test_unknown_ends_are_refused(tmp_path: Path) -> None:
    assert PARTS.ends is not None
    path = written(tmp_path, strip(parts=replace(PARTS, ends=replace(PARTS.ends, end="glued"))))
    with pytest.raises(StoreError, match="ends are 'hinged' and 'glued', which no strip has"):
        decode(path)


def test_a_row_tells_parameters_topology_and_reactions() -> None:
    row = json.loads(json.dumps(Summary.of(strip()).to_dict(), allow_nan=False))
    assert row["topology"] == {"open": True}
    assert list(row["parameters"])[:6] == ["half_width", "span", "lift", "shear", "twist", "tilt"]
    assert row["parameters"]["end_force_z"] == 3.0
    assert (row["bending_energy"], row["reaction_force"]) == (3.5, [1.0, 2.0, 3.0])
    assert row["start_moment"] == [0.0, 0.25, None]
    assert Summary.read(row) == Summary.of(strip())
    for key, wrong in (
        ("parameters", {"half_width": "0.5"}),
        ("parameters", {"width": 0.5}),
        ("parameters", [0.5]),
        ("bending_energy", "3"),
        ("reaction_force", [1.0, 2.0]),
        ("start_force", [1.0, 2.0, True]),
        ("topology", {"open": False}),
    ):
        with pytest.raises(ValueError, match="of state 1"):
            Summary.read(row | {key: wrong})


def test_a_row_of_a_closed_band_tells_its_parameters_too() -> None:
    state = Summary.of(make_record())
    row = state.to_dict()
    assert row["topology"] == {"half_twists": 1, "sigma": -1}
    assert (row["parameters"], row["bending_energy"]) == ({"half_width": 0.5}, state.energy)
    assert "reaction_force" not in row
    for sigma, parameters in ((-1, {"half_width": 0.5}), (1, {"half_width": 0.5, "natural_curvature": 0.0})):
        earlier = {k: v for k, v in row.items() if k not in ("parameters", "bending_energy")}
        earlier["topology"] = {"half_twists": 1, "sigma": sigma}
        assert Summary.read(earlier).parameters == parameters
    assert state.agrees({k: v for k, v in row.items() if k not in ("parameters", "bending_energy")})


def test_an_npz_of_a_strip_holds_its_problem(tmp_path: Path) -> None:
    path = tmp_path / "strip.npz"
    export_npz(strip(), path)
    found = load_npz(path)
    assert (found["sigma"], found["parts"]) == (0, PARTS)
    with np.load(path) as archive:
        arrays = dict(archive)
    assert arrays["g_end"].shape == (3,)
    assert arrays["reaction_moment"].tolist() == [0.0, 0.5, 0.0]
    for name, wrong, message in (
        ("ends_end", "glued", "which no strip has"),
        ("ends_lift", np.nan, "ends_lift is not finite"),
        ("loads_end_force", [1.0, 2.0], "loads_end_force is float64"),
        ("ends_start", 1.0, "ends_start is float64"),
    ):
        np.savez(path, **arrays | {name: np.asarray(wrong)})
        with pytest.raises(StoreError, match=message):
            load_npz(path)
    del arrays["ends_span"]
    np.savez(path, **arrays)
    with pytest.raises(StoreError, match="it has no ends_span"):
        load_npz(path)
    export_npz(make_record(), tmp_path / "closed.npz")
    with np.load(tmp_path / "closed.npz") as archive:
        assert not any(name.startswith(("ends", "loads")) for name in archive)


# ---- references

CONFIG = """\
name: strip
topology: open
length: 1
ends: {span: 0.75}
initial_guess: {recipe: strip, segments: 10, half_width: 0.05}
schedule: [{shear: 0.3}, {half_width: 0.1}]
"""
PLACES = [(0.05, 0.0, 10), (0.05, 0.15, 10), (0.05, 0.3, 10), (0.05, 0.3, 20), (0.1, 0.3, 10), (0.1, 0.3, 20)]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    made = Run.create_or_open(tmp_path, "strip", "0123abcd", CONFIG, CONFIG)
    with made.writing():
        for label, (b, shear, n) in enumerate(PLACES, start=1):
            parts = Parts(Ends(span=0.75, shear=shear))
            made.commit(strip(label, parts, n=n, half_width=b))
    return made


def test_a_state_is_named_by_any_parameter(run: Run, tmp_path: Path) -> None:
    assert select(run, {"half_width": 0.05, "shear": 0.15})[0].label == 2
    assert select(run, {"half_width": 0.05, "shear": 0.0}, 10)[0].label == 1
    found = find_states(tmp_path, "strip@shear=3*0.1,N=20")[1]
    assert [state.label for state in found] == [4, 6]
    for ref in ("strip@b=0.1,N=20", "strip@half_width=0.1,N=20"):
        assert [state.label for state in find_states(tmp_path, ref)[1]] == [6]


def test_what_is_left_out_takes_the_config_s_last_value(run: Run) -> None:
    state, told = select(run, {"half_width": 0.05}, 10)
    assert (state.label, told) == (
        3,
        "state 3 is taken (b = 0.05, shear = 0.3, N = 10), the only one that fits; "
        "shear = 0.3, the last value in the config",
    )
    state, told = select(run, {"shear": 0.15})  # at the one half-width that it has
    assert state.label == 2


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("shear=0.2", "has no equilibrium with shear = 0.2: it has shear = 0, 0.15, 0.3"),
        ("shaer=0.3", "no parameter 'shaer'; did you mean shear?"),
        ("b=0.1,half_width=0.1", "half_width is given twice"),
        ("b=x", "b must be a number, got 'x'"),
        ("gap=1", "expected RUN@b=...,N=..., got 'gap=1': no parameter 'gap'"),
        (
            "natural_curvature=1",
            "has no equilibrium with natural_curvature = 1: it has natural_curvature = 0",
        ),
        ("b=0.05,N=40", "with b = 0.05 and shear = 0.3 and N = 40: it has N = 10, 20"),
    ],
)
def test_what_is_not_there_is_told(run: Run, tmp_path: Path, query: str, message: str) -> None:
    from ribbon_cli.store import resolve_state

    with pytest.raises(UsageError) as caught:
        resolve_state(tmp_path, f"strip@{query}")
    assert message in str(caught.value)


def test_tables_never_mix_problems(run: Run) -> None:
    places = by_place(run.states())
    assert [[state.label for state in group] for group in places.values()] == [[1], [2], [3], [4], [5], [6]]
    assert [(place[0], place[1]) for place in places] == [(b, n) for b, _, n in PLACES]
    assert varying(run.states()) == ("shear",)
    assert varying(run.states()[2:4]) == ()


def test_energies_of_several_problems_are_not_compared(run: Run) -> None:
    table = run_table(run)
    assert [(row.half_width, row.segments, dict(row.others)) for row in table.rows] == [
        (b, n, {"shear": shear}) for b, shear, n in PLACES
    ]
    text = RENDERERS["text"](table)
    assert "0.05, shear = 0.15" in text
    document = json.loads(RENDERERS["json"](table))
    assert document["rows"][2]["parameters"] == {"shear": 0.3}
    assert "others" not in document["rows"][0]
    assert RENDERERS["csv"](table).splitlines()[0].count("shear") == 1


def test_ls_has_a_column_for_what_varies(run: Run, tmp_path: Path) -> None:
    listed = ribbon("ls", "strip", "--runs", tmp_path).stdout.splitlines()
    assert listed[0].split()[:4] == ["label", "b", "shear", "N"]
    assert listed[2].split()[:4] == ["2", "0.05", "0.15", "10"]
    shown = ribbon("show", "strip:2", "--runs", tmp_path).stdout
    assert "parameters:\n  half_width" in shown
    assert ribbon_json("show", "strip:2", "--runs", tmp_path)["parameters"]["shear"] == 0.15
    table = ribbon_cli.open("strip", runs=tmp_path).table()
    assert list(table["parameter_shear"]) == [shear for _, shear, _ in PLACES]
    assert list(table["reaction_force_z"]) == [3.0] * len(PLACES)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--in", "twits", "--to", "pi"], "--in: no parameter 'twits'; did you mean twist or tilt?"),
        (["--in", "shear", "--to", "0.8"], "--to 0.8: cannot be reached: at (span, lift, shear) the end is"),
        (["--in", "shear", "--to", "3*0.1"], "strip:3: has shear = 0.3 already"),
        (["--to", "-1"], "--to: must be > 0, the half-width, got -1"),
        (["--in", "b", "--to", "0"], "--to: must be > 0, the half-width, got 0"),
        (["--in", "twist", "--to", "x"], "must be a number such as 0.5 or pi/30, got 'x'"),
        (
            ["--in", "twist", "--to", "1", "--at", "2", "--arclength"],
            "--at: twist must be between 0 and 1, where the branch is followed, got 2",
        ),
        (
            ["--in", "twist", "--to", "1", "--arclength", "--both"],
            "--both needs --back-to B, the twist to go to",
        ),
    ],
)
def test_continue_speaks_of_the_parameter(run: Run, tmp_path: Path, words: list[str], message: str) -> None:
    result = ribbon("continue", "strip:3", *words, "--runs", tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr


def test_continue_refuses_what_a_problem_does_not_have(tmp_path: Path) -> None:
    made = Run.create_or_open(tmp_path, "ends", "0123abcd", CONFIG, CONFIG)
    with made.writing():
        made.commit(make_record(1))
        made.commit(strip(2, Parts(Ends(end="free"), loads=Loads(1.0)), kkt_residual=0.0))
    for state, name, has in (
        ("ends:1", "natural_curvature", "a one-sided band has no natural_curvature; it has half_width"),
        ("ends:1", "gravity", "a one-sided band has no gravity"),
        ("ends:2", "twist", "a strip with a free end has no twist; it has half_width, gravity, end_force_x"),
    ):
        result = ribbon("continue", state, "--in", name, "--to", "1", "--runs", tmp_path)
        assert result.exit_code == 2
        assert f"{state}: {has}" in result.stderr


def test_python_follows_and_finds_in_any_parameter(run: Run, tmp_path: Path) -> None:
    opened = ribbon_cli.open("strip", runs=tmp_path)
    assert opened.at(b=0.05, shear=0.15).label == 2
    with pytest.raises(UsageError, match="did you mean shear"):
        opened.at(shaer=0.15)
    with pytest.raises(UsageError, match=r"shear = 0\.15 already"):
        opened.at(b=0.05, shear=0.15).follow(0.15, in_="shear")
    with pytest.raises(UsageError, match="differ in shear as well"):
        opened.to_xarray(grid=True)
    assert list(opened.to_xarray()["parameter_shear"].values) == [shear for _, shear, _ in PLACES]


def test_closed_bands_are_at_one_place_by_width_and_mesh() -> None:
    states = [Summary.of(make_record(label, half_width=b)) for label, b in ((1, 0.5), (2, 0.5 * (1 + 1e-12)))]
    assert [len(group) for group in by_place(states).values()] == [2]
    assert CLOSED.names(-1) == ("half_width",)


def test_a_given_state_is_of_the_config_s_kind(run: Run, tmp_path: Path) -> None:
    export_npz(strip(), tmp_path / "strip.npz")
    for text, said in (
        (
            "topology: {half_twists: 0}\ninitial_guess: {state: strip.npz}\n",
            "is an open strip, where the config",
        ),
        (
            "topology: {half_twists: 0}\ninitial_guess: {state: 'strip:1'}\n",
            "is an open strip, where the config",
        ),
    ):
        with pytest.raises(ConfigError, match=said):
            solve_config(parse_config(text, tmp_path / "c.yaml"), tmp_path)
    assert state_of(strip()).band.parts == PARTS


@pytest.mark.parametrize("form", ["npz", "h5"])
def test_a_strip_goes_on_from_a_given_state_of_its_problem(strips: Path, tmp_path: Path, form: str) -> None:
    """The state is the start's minimum already, clamps, rule and loads with it, and the schedule leads on."""
    given = states_of(strips, "cantilever")[-1]
    export_npz(given, tmp_path / "given.npz")
    (tmp_path / "given.h5").write_bytes(encode(given))
    text = CANTILEVER.partition("initial_guess")[0].replace("0.1", "{force}")
    text += f"initial_guess: {{state: given.{form}}}\nschedule: [{{end_force_y: 0.25}}]\n"
    outcome = solve_config(parse_config(text.replace("{force}", "0.2"), tmp_path / "c.yaml"), tmp_path)
    first, last = outcome.run.states()
    assert (first.energy, first.certified) == (pytest.approx(given.energy, rel=1e-12), True)
    assert (last.parameters["end_force_y"], last.certified) == (0.25, True)
    with pytest.raises(
        ConfigError, match=r"loads.end_force = \[0, 0.2, 0\], where the config says \[0, 0.1, 0\]"
    ):
        solve_config(parse_config(text.replace("{force}", "0.1"), tmp_path / "c.yaml"), tmp_path)


def test_a_given_closed_band_takes_the_natural_curvature_of_the_config(tmp_path: Path) -> None:
    text = "topology: {half_twists: 0}\ninitial_guess: {recipe: cylinder, segments: 24, half_width: 0.1}\n"
    ring = solve_config(parse_config(f"name: ring\n{text}", tmp_path / "c.yaml"), tmp_path).run.load(1)
    export_npz(ring, tmp_path / "ring.npz")
    text = "name: curved\ntopology: {half_twists: 0}\nmaterial: {natural_curvature: 0.5}\n"
    text += "initial_guess: {state: ring.npz}\n"
    (found,) = solve_config(parse_config(text, tmp_path / "c.yaml"), tmp_path).run.states()
    assert found.parameters == {"half_width": 0.1, "natural_curvature": 0.5}
    d, h = 2 * np.pi / 24, 2 * np.pi / 24
    exact = 24 * 0.1 * ((1 - np.cos(d)) / h - 0.5 * np.sin(d) + h * 0.125)
    assert found.energy == pytest.approx(exact, rel=1e-12)
