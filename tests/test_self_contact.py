"""A band that meets itself is said to, wherever it is listed, drawn or written, beside its certificate."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from cli_support import QUICK_RING, ribbon, ribbon_json

from ribbon_cli import solve
from ribbon_cli.cli.export_command import EXPORT_FORMATS
from ribbon_cli.cli.render import states_table, targets_table
from ribbon_cli.export.words import MEETS_ITSELF, contact_warning, standing
from ribbon_cli.pages.run import run_page
from ribbon_cli.store import Run
from ribbon_cli.study import Target

WARNING = f"warning: state 5 {MEETS_ITSELF}\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Run:
    """A solved ring with one more state, of which it is said that its facets meet: state 5."""
    run = solve(yaml.safe_load(QUICK_RING) | {"name": "ring"}, tmp_path_factory.mktemp("ring") / "runs").run
    record = run.load(4)
    with run.writing():
        run.commit(replace(record, label=5, parent=4, self_contact=True, clearance=0.0, half_width=0.6))
    return run


@pytest.fixture
def folder(made, monkeypatch) -> Path:
    monkeypatch.chdir(made.path.parents[1])
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    return made.path.parents[1]


def test_listings_have_a_column(made):
    """What `ls` and `solve` print; a target that was not reached has dashes in all of them."""
    states = {state.label: state for state in made.states()}
    targets = [Target(0.6, 24, 5, True, True, ""), Target(0.7, 24, None, False, False, "not reached")]
    for text in (states_table(list(states.values()), kinds=False), targets_table(targets, states)):
        heads, *rows = text.splitlines()
        place = heads.index("contact")
        words = [row[place : place + len("contact")].strip() for row in rows]
        assert words == (["no"] * 4 + ["yes"] if len(rows) == 5 else ["yes", "-"])
        assert {len(row.split()) for row in rows if "reached" not in row} == {len(heads.split())}


@pytest.mark.parametrize("ref", ["ring:5", "ring:4"])
def test_show_says_so_beside_the_certificate(folder, ref):
    lines = {line.split()[0]: line for line in ribbon("show", ref).stdout.splitlines() if line.strip()}
    assert (MEETS_ITSELF in lines["certified"]) == (ref == "ring:5")
    assert ribbon_json("show", ref)["certified"] is True


@pytest.mark.parametrize("form", EXPORT_FORMATS)
def test_every_export_warns_once(folder, form):
    words = ("export", "ring:5", "--to", form, "-o", f"five.{form}", "--overwrite")
    result = ribbon(*words)
    assert result.exit_code == 0
    assert result.stderr.count("warning: ") == result.stderr.count(WARNING) == 1
    assert ribbon(*words, "-q").stderr == ""
    other = ribbon("export", "ring:4", "--to", form, "-o", f"four.{form}", "--overwrite")
    assert "warning" not in other.stderr


@pytest.mark.parametrize("form", ["obj", "ply", "stl", "csv", "json", "svg", "html", "vtkhdf", "npz"])
def test_the_file_says_so_where_it_carries_notes(folder, form):
    path = Path(f"noted.{form}")
    assert ribbon("export", "ring:5", "--to", form, "-o", path, "--overwrite").exit_code == 0
    if form == "npz":
        assert np.load(path)["self_contact"]
    elif form == "vtkhdf":
        with h5py.File(path) as file:
            assert MEETS_ITSELF in file["VTKHDF"].attrs["Description"].decode()
    elif form == "json":
        assert b'"self_contact": true' in path.read_bytes()
    elif form == "csv":
        with path.open() as file:
            assert {row["self_contact"] for row in csv.DictReader(file)} == {"True"}
    else:
        data = path.read_bytes()
        assert (b"self-contact" in data[:80]) if form == "stl" else (MEETS_ITSELF.encode() in data)


@pytest.mark.parametrize(
    "kind", ["pattern", *(pytest.param(k, marks=pytest.mark.long) for k in ("shape", "spectrum"))]
)
def test_captions_say_so_and_plot_warns_once(folder, kind):
    words = ("plot", "ring:5", kind, "-o", "x.svg", "--overwrite")
    result = ribbon(*words)
    assert result.exit_code == 0
    assert result.stderr.count(WARNING) == 1
    assert f"certified minimum, {MEETS_ITSELF}, sha256" in ribbon_json(*words)["caption"]
    assert "warning" not in ribbon(*words, "-q").stderr
    assert "warning" not in ribbon("plot", "ring:4", kind, "-o", "x.svg", "--overwrite").stderr


def test_of_several_states_it_is_said_which(folder, made):
    result = ribbon("plot", "ring:5", "shape", "--with", "ring:4", "-o", "x.svg", "--overwrite")
    assert "(2 of 2 certified, 1 in self-contact without forces)" in result.stderr
    said = "of 2 states 1 touch or pass through themselves (no contact forces): 5"
    assert result.stderr.count(f"warning: {said}\n") == 1
    one, five = made.load(4), made.load(5)
    assert [standing(record) for record in (one, five)] == ["", "self-contact"]
    assert standing(replace(five, certified=False)) == "no certificate, self-contact"
    assert contact_warning([one]) == ""
    assert contact_warning([five] * 11).endswith("5, 5, 5, 5, 5, 5, 5, 5 and 3 more")


def test_a_run_in_one_file_warns_too(folder):
    result = ribbon("export", "ring", "--to", "html", "--segments", "24", "-o", "run.html", "--overwrite")
    assert result.stderr.count("warning: of 3 states 1 touch or pass through themselves") == 1
    assert MEETS_ITSELF.encode() in Path("run.html").read_bytes()


@pytest.mark.long
def test_the_page_of_a_run_says_so(made):
    page = run_page(made).decode()
    assert f"the narrowest b = 0.6: there the band {MEETS_ITSELF}, whatever its certificate." in page
    assert page.count('<td class="no">yes</td>') == 1
