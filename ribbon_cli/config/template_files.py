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
    """What a template is of: the beginning of its first comment."""
    words = " ".join(line.removeprefix("#").strip() for line in text.splitlines()[2:5])
    return re.split(r"[.:](?: |$)", words, maxsplit=1)[0]


def template(name: str, stem: str) -> str:
    """A template's text; it calls the run by the stem of the file that it is for, if that can be a name."""
    fits = NAME.fits(stem) and stem.lower() != "null"  # to YAML, nothing
    return templates()[name].replace(f"\nname: {name}\n", f"\nname: {stem if fits else name}\n", 1)
