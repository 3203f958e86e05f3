"""The documentation's notebook runs from top to bottom, and shows what it says.

Cells are executed here as a notebook would: in order, in one namespace, with the last expression shown by the
methods that notebooks ask for. nbclient and ipykernel would bring thirty packages and a process behind
sockets for that.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot
import pytest
from matplotlib.axes import Axes

NOTEBOOK = Path(__file__).parent.parent / "docs" / "notebook.ipynb"
WAYS = ("_repr_png_", "_repr_html_")


def cells() -> list[str]:
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in document["cells"]}) == len(document["cells"])
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]


def shown(value: Any) -> str:
    """What a notebook shows of a value: an image, HTML or text."""
    if isinstance(value, Axes) or (isinstance(value, list) and value):  # pyplot's figures are shown by it
        return "picture" if matplotlib.pyplot.get_fignums() else ""
    for way in WAYS:
        method = getattr(value, way, None)
        if method is not None and (found := method()) is not None:
            return "picture" if way == "_repr_png_" else str(found)
    return repr(value)


def run_cell(text: str, names: dict[str, Any]) -> str:
    tree = ast.parse(text)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), names)
    if last is None:
        return ""
    assert isinstance(last, ast.Expr)
    return shown(eval(compile(ast.Expression(last.value), "<cell>", "eval"), names))


@pytest.fixture
def pictures():
    matplotlib.use("agg")
    matplotlib.pyplot.close("all")
    yield
    matplotlib.pyplot.close("all")


def test_the_notebook_imports_nothing_else():
    trees = [ast.parse(text) for text in cells()]
    imports = [
        node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert [ast.unparse(node) for node in imports] == ["import ribbon_cli as ribbon"]


def test_the_notebook_runs(tmp_path, monkeypatch, pictures):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    names: dict[str, Any] = {}
    outputs = {text: run_cell(text, names) for text in cells()}
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
