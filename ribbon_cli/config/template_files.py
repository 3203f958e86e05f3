"""Commented configs to start from, one file each in the folder `templates`."""

from __future__ import annotations

import re
from importlib.resources import files

from ribbon_cli.config.table import NAME


def templates() -> dict[str, str]:
    """The text of every template by name, in alphabetical order."""
    folder = files("ribbon_cli.config") / "templates"
    found = {
        file.name: file.read_text(encoding="utf-8")
        for file in folder.iterdir()
        if file.name.endswith(".yaml")
    }
    return {name.removesuffix(".yaml"): found[name] for name in sorted(found)}


def about_template(text: str) -> str:
    """The subject of a template: the beginning of its first comment."""
    words = " ".join(line.removeprefix("#").strip() for line in text.splitlines()[2:5])
    return re.split(r"[.:](?: |$)", words, maxsplit=1)[0]


def template(name: str, stem: str) -> str:
    """A template's text; the run is named after the stem of its file, if that can be a name."""
    fits = NAME.fits(stem) and stem.lower() != "null"  # to YAML, nothing
    return templates()[name].replace(f"\nname: {name}\n", f"\nname: {stem if fits else name}\n", 1)
