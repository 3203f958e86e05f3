"""House rules that a machine can hold: who imports whom, sizes, docstrings, no print."""

from __future__ import annotations

import ast
import importlib
import statistics
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import ribbon_cli

PACKAGE = Path(ribbon_cli.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
PAPER = sorted((PACKAGE.parent / "paper").rglob("*.py"))
"""Modules outside the package that keep the rules of its style."""

RANKS = {
    "errors": 0,
    "digits": 0,
    "facts": 0,
    "parts": -1,  # what facts are about
    "doors": 0,
    "keys": 0,
    "expression": 0,
    "text": 0,
    "model": 1,
    "solver": 2,
    "recipes": 3,
    "config": 4,
    "store": 5,
    "report": 6,
    "export": 6,
    "plot": 7,
    "study": 7,
    "analysis": 8,
    "sweeps": 8,
    "verify": 8,
    "surveys": 8,
    "pages": 9,
    "api": 10,
    "cli": 11,
}
"""A room imports from itself and from rooms of lower rank; see docs/architecture.md."""
FRONT_DOORS = {"__init__", "__main__"}
"""The package's own modules, which open every room."""
CLOSED = {
    "config": {"model", "solver", "recipes"},
    "store": {"model", "solver", "recipes"},  # files outlive the mathematics that filled them
    "report": {"model", "solver", "recipes"},  # reads states, never solves
    "export": {"model", "solver", "recipes"},
    "plot": {"model", "solver", "recipes"},
    "pages": {"model", "solver", "recipes"},
    "api": {"model", "solver", "recipes"},
    "cli": {"model", "solver", "recipes"},  # holds no numerics
}
"""Rooms of lower rank that a room keeps out of all the same."""
OPENED = {
    ("export", "ribbon_cli.model.staggered"),  # pure formulas on stored arrays
    ("config", "ribbon_cli.recipes.RECIPES"),  # cards: their mathematics waits until it is used
}
"""What a room may import of rooms that are closed to it."""
LONGEST, LONGEST_MEDIAN = 600, 220
MOST_IMPORTS_INSIDE = 60
LONGEST_BLOCK = 9
"""Most equal lines in two places."""


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def room(module: str) -> str:
    """`ribbon_cli.model.band` is in `model`; what the package offers by itself is in `api`."""
    name = module.split(".")[1]
    return "api" if name in {*ribbon_cli.__all__, "__version__"} else name


def imported(path: Path) -> set[str]:
    """What a module imports of this package by dotted name, inside functions as well."""
    package = name_of(path).split(".")[:-1]
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{source}.{alias.name}" for alias in node.names}
    return {name for name in found if name.startswith("ribbon_cli.")}


def test_every_room_has_a_rank() -> None:
    assert {room(name_of(path)) for path in MODULES} - FRONT_DOORS == set(RANKS)


def test_imports_go_down() -> None:
    for path in MODULES:
        here = room(name_of(path))
        if here in FRONT_DOORS:
            continue
        for name in imported(path):
            there = room(name)
            assert there == here or RANKS[there] < RANKS[here], f"{path}: {here} must not import {name}"
            closed = there in CLOSED.get(here, ()) and (here, name) not in OPENED
            assert not closed, f"{path}: {here} must not import {name}"


def test_the_package_knows_nothing_of_what_stands_outside() -> None:
    for path in MODULES:
        roots = set()
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Import):
                roots |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                roots.add((node.module or "").split(".")[0])
        assert not roots & {"paper", "bench", "tests"}, path


@pytest.mark.parametrize("stub", sorted(PACKAGE.rglob("__init__.pyi")), ids=lambda path: path.parent.name)
def test_doors_offer_what_they_list(stub: Path) -> None:
    """A name that is a module's as well would mean the module once that is imported."""
    package = importlib.import_module(name_of(stub).removesuffix(".__init__"))
    for node in tree_of(stub).body:
        assert isinstance(node, ast.ImportFrom)
        for alias in node.names:
            assert alias.asname == alias.name
            found = getattr(package, alias.name)
            assert isinstance(found, ModuleType) == (node.module is None), alias.name
            assert node.module is None or not stub.with_name(f"{alias.name}.py").exists(), alias.name


def test_imports_stand_at_the_top() -> None:
    """What is slow to import waits behind the door of its room, not within functions."""
    inside = [
        (name_of(path), node.lineno)
        for path in MODULES
        for function in ast.walk(tree_of(path))
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert len(set(inside)) < MOST_IMPORTS_INSIDE


def test_modules_are_short() -> None:
    paths = [*MODULES, *PAPER]
    lengths = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in paths}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}
    assert statistics.median(lengths.values()) < LONGEST_MEDIAN


def test_no_block_of_lines_stands_twice() -> None:
    """Ten equal lines, without blank ones and comments; data tables have none."""
    first: dict[tuple[str, ...], str] = {}
    twice = []
    for path in MODULES:
        numbered = enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        lines = [(k, line.strip()) for k, line in numbered if line.strip() and line.strip()[0] != "#"]
        for at in range(len(lines) - LONGEST_BLOCK):
            block = lines[at : at + LONGEST_BLOCK + 1]
            here = f"{name_of(path)}:{block[0][0]}"
            there = first.setdefault(tuple(line for _, line in block), here)
            twice += [(there, here)] if there != here else []
    assert twice == []


def test_nothing_is_printed() -> None:
    """Data goes out through `cli.output`; libraries return values."""
    for path in (*MODULES, *PAPER):
        calls = [node.func for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
        assert not any(isinstance(call, ast.Name) and call.id == "print" for call in calls), path
        if path in PAPER or room(name_of(path)) != "cli":
            assert not any(isinstance(call, ast.Attribute) and call.attr == "echo" for call in calls), path


def test_public_things_have_docstrings() -> None:
    for path in (*MODULES, *PAPER):
        tree = tree_of(path)
        assert ast.get_docstring(tree), f"{path}: no docstring"
        for name, node in public_things(tree):
            assert ast.get_docstring(node), f"{path}: {name} has no docstring"


def public_things(
    node: ast.Module | ast.ClassDef, prefix: str = ""
) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Public classes, functions and methods of a module with their names."""
    for child in node.body:
        if not isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if child.name.startswith("_"):
            continue
        yield prefix + child.name, child
        if isinstance(child, ast.ClassDef):
            yield from public_things(child, f"{prefix}{child.name}.")
