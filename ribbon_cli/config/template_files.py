"""Commented configs to start from, one file each in the folder `templates`."""

from __future__ import annotations

from importlib.resources import files


def templates() -> dict[str, str]:
    """The text of every template by name, in alphabetical order."""
    folder = files("ribbon_cli.config") / "templates"
    found = {
        file.name: file.read_text(encoding="utf-8")
        for file in folder.iterdir()
        if file.name.endswith(".yaml")
    }
    return {name.removesuffix(".yaml"): found[name] for name in sorted(found)}
