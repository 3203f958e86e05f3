"""The documentation's notebook runs from top to bottom, and shows what it says, as on the site."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot
import pytest

DOCS = Path(__file__).parent.parent / "docs"
sys.path.insert(0, str(DOCS / "site"))

from notebook_page import run_cell  # noqa: E402

NOTEBOOKS = ("notebook.ipynb", "sweep-notebook.ipynb")


def cells(name: str) -> list[str]:
    document = json.loads((DOCS / name).read_text(encoding="utf-8"))
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in document["cells"]}) == len(document["cells"])
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]


@pytest.fixture
def pictures():
    matplotlib.use("agg")
    matplotlib.pyplot.close("all")
    yield
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_the_notebook_imports_nothing_else(name):
    trees = [ast.parse(text) for text in cells(name)]
    imports = [
        node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert [ast.unparse(node) for node in imports] == ["import ribbon_cli as ribbon"]


@pytest.mark.docs
def test_the_notebook_runs(tmp_path, monkeypatch, pictures):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    names: dict[str, Any] = {}
    shown = {text: run_cell(text, names) for text in cells("notebook.ipynb")}
    outputs = {text: one.kind if one.kind == "picture" else one.text for text, one in shown.items()}
    last = {text.splitlines()[-1]: output for text, output in outputs.items()}
    assert last["outcome.exit_code"] == "0"
    assert "6 of 6 equilibria certified" in last["run"]
    assert "certified minimum" in last["state"]
    assert "the finest certified one of 2 that fit" in last["state"]
    assert "<table" in last["finer"]
    assert names["finer"].certified
    assert names["finer"].segments == 96
    assert "ends at b = 0.5 (range)" in last["followed"]
    drawing = [output for text, output in outputs.items() if ".plot" in text]
    assert drawing == ["picture"] * 5
    assert (tmp_path / "band.stl").stat().st_size > 1000
    assert names["grid"].energy.shape == (3, 2)
    assert not names["grid"].energy.isnull().any()


@pytest.mark.docs
def test_the_notebook_of_a_sweep_runs(tmp_path, monkeypatch, pictures):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    names: dict[str, Any] = {}
    shown = [run_cell(text, names) for text in cells("sweep-notebook.ipynb")]
    assert [one.kind for one in shown] == ["text", "html", "picture", "html", "picture", "picture"]
    assert shown[0].text == "12"
    assert names["energy"].dims == ("n", "b")
    assert names["energy"].shape == (3, 4)
    assert not names["energy"].isnull().any()
    assert (names["energy"].diff("n") > 0).all()
