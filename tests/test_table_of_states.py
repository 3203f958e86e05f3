"""`ribbon table`: one table over runs and sweeps, filtered, in every format; a sweep as an xarray dataset."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray
from cli_support import QUICK_RING, ribbon
from pyarrow import parquet, types
from table_runs import SWEEP, fill

import ribbon_cli
from ribbon_cli.api.gathering import gathered, sources
from ribbon_cli.config import load_sweep, parse_config
from ribbon_cli.errors import UsageError
from ribbon_cli.report.rows import Column, Rows, csv_bytes
from ribbon_cli.report.where import condition, hints
from ribbon_cli.store import Run, keep_sweep, list_runs
from ribbon_cli.study import solve_config

KINDS = {"half_width": "number", "linking_number": "number", "parameter_shear": "number"}
KINDS |= dict.fromkeys(("schedule.0.shear", "schedule.0.shear.to", "widths.10"), "number")
KINDS |= {"energy": "number", "certified": "truth", "run": "text", "initial_guess.half_width": "number"}
ROW = {"energy": 3.0, "certified": True, "run": "a-6170e105", "initial_guess.half_width": 0.1 + 0.2}
ROW |= {"schedule.0.shear": 0.2, "schedule.0.shear.to": 1.0, "widths.10": 2.0}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fill(tmp_path_factory.mktemp("runs"))


# --- conditions ---


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("energy < 5 and certified", True),
        ("energy < 5 and not certified", False),
        ("2 < energy <= 3", True),
        ("energy > 3 or run == 'a-6170e105'", True),
        ("initial_guess.half_width == 0.3", True),  # to rounding
        ("initial_guess.half_width != 0.3", False),
        ("certified == true", True),
        ("certified != False", True),
        ("energy > -1e3", True),
        ("schedule.0.shear == 0.2 and widths.10 > 1.5", True),
        ("schedule.0.shear.to < 2 and run != 'widths.0'", True),
        (" run != 'b' ", True),
    ],
)
def test_conditions(text: str, holds: bool) -> None:
    assert condition(text, KINDS)(ROW) is holds


def test_a_condition_on_twist_is_told_which_twist_it_is() -> None:
    columns = ("twist", "parameter_twist", "energy")
    assert "angle of a strip's end is parameter_twist" in hints("energy < 5 and twist > 0.3", columns)[0]
    for text, known in (("parameter_twist > 0.3", columns), ("twist > 0.3", columns[::2]), (None, columns)):
        assert hints(text, known) == []


@pytest.mark.parametrize("missing", [None, math.nan])
def test_a_comparison_with_a_missing_value_does_not_hold(missing: float | None) -> None:
    row = {**ROW, "energy": missing}
    assert not condition("energy < 5", KINDS)(row)
    assert not condition("energy != 5", KINDS)(row)
    assert condition("not energy < 5", KINDS)(row)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("enrgy < 5", "column 1: no column 'enrgy'; did you mean energy"),
        (
            "energy < 5 and schedule.0.shar > 1",
            "column 16: no column 'schedule.0.shar'; did you mean",
        ),
        ("b == 0.02", "no column 'b'; did you mean half_width"),
        ("twist_plus_writhe > 0", "did you mean linking_number"),
        ("shear > 0", "did you mean parameter_shear"),
        ("run == minimum", "column 8: no column 'minimum'; a text stands in quotes: 'minimum'"),
        ("minimum != run", "column 1: .* in quotes"),
        ("energy < 5 and initial_guess.halfwidth > 1", "column 16: .*did you mean initial_guess.half_width"),
        ("energy", "energy is a number: compare it"),
        ("energy < 'a'", "a number is compared with a text"),
        ("certified < true", "compared by == or !="),
        ("energy in 5", "compare by <"),
        ("energy < ", "not a condition"),
        ("", "not a condition"),
        ("energy < 5; run", "not a condition"),
        ("__import__('os').system('x') == 0", "expected a column"),
        ("energy + 1 < 5", "expected a column"),
        ("(lambda: 1)() < energy", "expected a column"),
        ("energy < 1e999", "expected a column"),
        ("energy < 5" + " and energy < 5" * 300, "at most 2000 characters"),
        ("not " * 400 + "certified", "not a condition|nested"),
        ("(" * 300 + "certified" + ")" * 300, "not a condition"),
        ("run == '\x00'", "not a condition"),
    ],
)
def test_what_is_no_condition_is_told_in_one_line(text: str, message: str) -> None:
    if text.startswith("not not"):  # deep, but not too deep for Python
        assert condition(text, KINDS)(ROW)
        return
    with pytest.raises(UsageError, match=message) as caught:
        condition(text, KINDS)
    assert "\n" not in str(caught.value)


# --- rows ---


def test_a_row_for_each_state_of_runs_and_sweeps(root: Path) -> None:
    found = gathered(sources(root, ["fam", "ring"]))
    assert len(found.rows) == 5 + 4
    names = [column.name for column in found.columns]
    assert names[:4] == ["state", "sweep", "initial_guess.half_width", "run"]
    assert {"energy", "certified", "self_contact", "run", "label", "content_sha256"} <= set(names)
    assert len(names) == len(set(names))
    widths = next(column for column in found.columns if column.name == "initial_guess.half_width")
    assert (widths.dtype, found.values(widths)) == ("float64", [0.1, 0.2, 1.0, 0.1, 0.2, *[None] * 4])
    assert [row["sweep"] for row in found.rows] == ["fam"] * 5 + [None] * 4


def test_each_run_comes_once(root: Path) -> None:
    found = sources(root, ["fam", "fam", "ring", "ring"])
    assert [source.begun for source in found] == [True] * 5 + [False, True]


def test_eigenvalues_are_those_stored(root: Path) -> None:
    run = next(run for run in list_runs(root) if run.short_name == "ring")
    found = gathered(sources(root, ["ring"]), modes=2)
    spectrum = next(s for s in run.load(1).spectra if s.metric == "physical")
    others = [v for v, label in zip(spectrum.values, spectrum.labels, strict=True) if label != "rotation"]
    assert [found.rows[0][f"eigenvalue_{k}"] for k in (1, 2)] == others[:2]


def test_a_table_reads_no_state_file_as_hdf5(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ribbon_cli.store.run.decode_bytes", lambda *_: pytest.fail("a state was read"))
    assert len(gathered(sources(root, ["fam"])).rows) == 5


def test_a_state_whose_file_is_lost_has_no_certificate(root: Path, tmp_path: Path) -> None:
    solve_config(parse_config(QUICK_RING, "ring.yaml"), tmp_path)
    run = list_runs(tmp_path)[0]
    run.state_path(1).write_bytes(b"")
    first = gathered(sources(tmp_path, ["ring"])).rows[0]
    assert (first["status"], first["certified"]) == ("damaged", False)


def test_whole_numbers_stay_whole_and_hashes_texts() -> None:
    columns = (Column("n", "int64"), Column("x", "float64"), Column("hash", "utf-8"), Column("ok", "bool"))
    row = {"n": 2, "x": 0.1 + 0.2, "hash": "6170e105", "ok": True}
    rows = Rows(columns, (row, {}))
    assert csv_bytes(rows).decode() == "n,x,hash,ok\n2,0.30000000000000004,6170e105,true\n,,,\n"


# --- formats ---


def table(root: Path, *words: str) -> str:
    done = ribbon("table", *words, "--runs", str(root), "-q")
    assert done.exit_code == 0, done.stderr
    return done.stdout


def test_text_shows_what_varies(root: Path) -> None:
    lines = table(root, "fam").splitlines()
    assert lines[0].split() == [
        *("state", "discretisation", "length", "initial_guess.half_width"),
        *("half_width", "segments", "energy", "status", "certified", "self_contact"),
    ]
    assert len(lines) == 6


def test_json_and_csv_and_files_hold_the_same(root: Path, tmp_path: Path) -> None:
    words = ["fam", "ring", "--where", "half_width >= 0.2 and certified", "--modes", "1"]
    document = json.loads(table(root, *words, "--json"))
    rows = document["rows"]
    assert len(rows) == 5
    paths = [tmp_path / f"t.{form}" for form in ("csv", "parquet", "nc")]
    for path in paths:
        assert table(root, *words, "-o", str(path)).strip() == str(path)
    text = list(csv.DictReader(io.StringIO(paths[0].read_text())))
    assert [float(row["energy"]) for row in text] == [row["energy"] for row in rows]
    assert [row["state"] for row in text] == [row["state"] for row in rows]
    read = parquet.read_table(paths[1])
    assert read.column_names == document["columns"]
    assert types.is_float64(read.schema.field("half_width").type)
    assert types.is_int64(read.schema.field("segments").type)
    assert types.is_boolean(read.schema.field("certified").type)
    assert types.is_string(read.schema.field("content_sha256").type)
    assert read.to_pylist() == rows
    frame = pandas.read_parquet(paths[1])
    assert list(frame["energy"]) == [row["energy"] for row in rows]
    with xarray.open_dataset(paths[2], engine="h5netcdf") as data:
        assert list(data["energy"].values) == [row["energy"] for row in rows]
        assert list(data["content_sha256"].values) == [row["content_sha256"] for row in rows]
        assert data["half_width"].dtype == np.float64
        assert data.sizes == {"state": 5}


def test_columns_are_chosen_by_name(root: Path) -> None:
    assert table(root, "ring", "--columns", "state,energy").splitlines()[0].split() == ["state", "energy"]
    done = ribbon("table", "ring", "--columns", "enrgy", "--runs", str(root))
    assert (done.exit_code, "did you mean energy" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rng"], "no run 'rng'"),
        (["famm"], "did you mean fam"),
        (["ring", "--where", "energy <"], "--where: column"),
        (["ring", "-o", "x.xls"], "written as .csv, .parquet or .nc"),
        (["ring", "-o", "x.parqet"], "did you mean parquet"),
    ],
)
def test_mistakes_are_told_in_one_line(root: Path, words: list[str], message: str) -> None:
    done = ribbon("table", *words, "--runs", str(root))
    assert done.exit_code == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


# --- programs ---


def test_the_doors_for_programs_hold_the_same(root: Path) -> None:
    frame = ribbon_cli.table("fam", where="initial_guess.half_width < 0.5", runs=root)
    assert len(frame) == 4
    assert frame["initial_guess.half_width"].dtype == np.float64
    sweep = ribbon_cli.open("fam", root)
    assert isinstance(sweep, ribbon_cli.OpenSweep)
    assert len(sweep.table(modes=1)) == 5
    with pytest.raises(UsageError, match="needs the name"):
        ribbon_cli.table(runs=root)


def test_a_sweep_is_a_dataset_over_its_keys(root: Path) -> None:
    data = ribbon_cli.open_sweep("fam", root).to_xarray(modes=2)
    assert data["energy"].dims == ("discretisation", "initial_guess.half_width")
    assert data["energy"].shape == (2, 3)
    assert data["initial_guess.half_width"].dtype == np.float64
    assert list(data["initial_guess.half_width"].values) == [0.1, 0.2, 1.0]
    assert list(data["length"].values) == [6.0, 7.5]  # which goes with the discretisation
    assert data["energy"].isnull().sum() == 1  # the point that was not run
    assert data["eigenvalue"].dims[-2:] == ("metric", "mode")
    ring = math.pi * data["initial_guess.half_width"] * 2 * math.pi / data["length"]
    assert float((data["energy"] / ring - 1).max()) < 0.03
    assert not [name for name, value in data.attrs.items() if name != "sweep"]


def test_levels_of_refinement_are_a_dimension(tmp_path: Path) -> None:
    path = tmp_path / "fine.yaml"
    text = SWEEP.replace("name: fam", "name: fine").replace(
        "  spectrum", "  refinement: [12, 24]\n  spectrum"
    )
    path.write_text(text.replace("[0.1, 0.2, 1]", "[0.1, 0.2]"))
    sweep = load_sweep(path)
    keep_sweep(tmp_path, sweep)
    for point in sweep.points[:2]:
        solve_config(point.config, tmp_path)
    data = ribbon_cli.open_sweep("fine", tmp_path).to_xarray()
    assert data["energy"].dims == ("discretisation", "initial_guess.half_width", "segments")
    assert list(data["segments"].values) == [12, 24]
    assert data["half_width"].dims == data["energy"].dims
    assert int(data["energy"].notnull().sum()) == 4


def test_a_run_keeps_its_columns_beside_others(root: Path) -> None:
    run = next(run for run in list_runs(root) if run.short_name == "ring")
    own = ribbon_cli.OpenRun.of(run).table()
    every = ribbon_cli.table("ring", runs=root)
    assert list(every.columns)[1:] == list(own.columns)
    assert list(every["energy"]) == list(own["energy"])
    assert isinstance(run, Run)
    assert replace(gathered([]), shown=()).rows == ()
