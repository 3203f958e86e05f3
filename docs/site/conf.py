"""Settings of the documentation's site: `make docs` builds it from the pages as they are, into build/site.

The source folder is the project's, so that links between pages work here as they do in the repository. The
front page is README.md; the navigation follows the headings and links of docs/README.md.
"""

from __future__ import annotations

import re
import shutil
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
sys.path[:0] = [str(HERE), str(ROOT)]

project = "ribbon"
author = "The ribbon developers"
copyright = author
version = release = version_of("ribbon")

root_doc = "README"
extensions = ["myst_parser", "sphinx.ext.autodoc", "notebook_page"]
include_patterns = ["*.md", "docs/**", "findings/*.md"]
exclude_patterns = [
    ".*",
    "bench",
    "build",
    "configs",
    "constraints",
    "docs/site",
    "paper",
    "ribbon_cli",
    "runs",
    "tests",
]
highlight_language = "none"
# In docstrings `this` is code, and -- an option.
default_role = "code"
smartquotes = False

myst_heading_anchors = 4
myst_url_schemes = ["https", "http"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"ribbon {version}"
# Summaries of search results are fetched, which browsers refuse to pages opened from a disk.
html_show_search_summary = False
html_copy_source = False
html_show_sourcelink = False


def navigation(text: str) -> str:
    """A table of contents for each section of docs/README.md, with the pages that it links."""
    parts = []
    for section in text.split("\n## ")[1:]:
        caption, _, body = section.partition("\n")
        links = re.findall(r"^- \[([^]]+)\]\(([^)#]+)\)", body, re.MULTILINE)
        entries = [f"{title} <{(ROOT / 'docs' / file).resolve().relative_to(ROOT)}>" for title, file in links]
        lines = ["```{toctree}", ":hidden:", f":caption: {caption}", "", *entries, "```"]
        parts.append("\n".join(re.sub(r"\.(md|rst|ipynb)>$", ">", line) for line in lines))
    return "\n\n".join(parts)


def add_navigation(app: Any, name: str, source: list[str]) -> None:
    """Put the tables of contents below the front page; docs/README.md, which they are from, is in none."""
    if name == root_doc:
        pages = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
        source[0] += "\n\n" + navigation(pages)
    elif name == "docs/README":
        source[0] = "---\norphan: true\n---\n" + source[0]


def copy_front_page(app: Any, exception: Exception | None) -> None:
    """Browsers open index.html."""
    if exception is None and app.builder.name == "html":
        shutil.copy(app.outdir / "README.html", app.outdir / "index.html")


def setup(app: Any) -> None:
    """Connect the two steps."""
    app.connect("source-read", add_navigation)
    app.connect("build-finished", copy_front_page)
