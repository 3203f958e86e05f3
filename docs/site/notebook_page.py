"""Notebooks as pages of the site: each is run while the site is built, and shown with what its cells show.

Cells are executed here as a notebook would: in order, in one namespace, with the last expression shown by the
methods that notebooks ask for. nbclient and ipykernel would bring thirty packages and a process behind
sockets for that.
"""

from __future__ import annotations

import ast
import base64
import html
import io
import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Shown:
    """What a cell shows: `kind` is "picture" (PNG as base64), "html", "text" or "nothing"."""

    kind: str
    text: str = ""


def run_cell(text: str, names: dict[str, Any]) -> Shown:
    """Execute a cell in a namespace, and show its last expression."""
    tree = ast.parse(text)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), names)
    if last is None:
        return Shown("nothing")
    assert isinstance(last, ast.Expr)
    return shown(eval(compile(ast.Expression(last.value), "<cell>", "eval"), names))


def shown(value: Any) -> Shown:
    """What a notebook shows of a value: a picture, HTML or text."""
    import matplotlib.pyplot as pyplot

    if pyplot.get_fignums():  # pandas and xarray draw by pyplot, which shows what they drew
        image = io.BytesIO()
        pyplot.gcf().savefig(image, format="png", bbox_inches="tight")
        pyplot.close("all")
        return Shown("picture", base64.b64encode(image.getvalue()).decode())
    for method, kind in (("_repr_png_", "picture"), ("_repr_html_", "html")):
        found = getattr(value, method, lambda: None)()
        if isinstance(found, tuple):  # with its size
            found = found[0]
        if found is not None:
            return Shown(kind, base64.b64encode(found).decode() if kind == "picture" else str(found))
    return Shown("text", repr(value))


def page(document: dict[str, Any]) -> str:
    """A notebook as a page in Markdown, its cells run in a folder of its own."""
    import matplotlib

    matplotlib.use("agg")
    before = Path.cwd()
    names: dict[str, Any] = {}
    parts: list[str] = []
    os.environ.pop("RIBBON_RUNS", None)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in document["cells"]:
                text = "".join(cell["source"])
                if cell["cell_type"] == "markdown":
                    parts.append(text)
                else:
                    parts += [f"```python\n{text}\n```", rendered(run_cell(text, names))]
        finally:
            os.chdir(before)
    return "\n\n".join(part for part in parts if part)


def rendered(output: Shown) -> str:
    """What a cell shows, in HTML: one block without empty lines, which would end it."""
    if output.kind == "nothing":
        return ""
    if output.kind == "picture":
        inner = f'<img alt="picture" src="data:image/png;base64,{output.text}">'
    elif output.kind == "html":
        inner = "\n".join(line for line in output.text.splitlines() if line.strip())
    else:
        inner = f"<pre>{html.escape(output.text)}</pre>"
    return f'<div class="shown">\n{inner}\n</div>'


def setup(app: Any) -> None:
    """Let Sphinx read notebooks."""
    from myst_parser.parsers.sphinx_ import MystParser

    class NotebookParser(MystParser):
        """Reads a notebook as the page it makes."""

        supported = ("notebook",)

        def parse(self, inputstring: str, document: Any) -> None:
            super().parse(page(json.loads(inputstring)), document)

    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
