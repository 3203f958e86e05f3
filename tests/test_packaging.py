"""The lower bounds in pyproject.toml are those that `make test-minimum` installs."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parent.parent
TEST_TOOLS = ("pytest", "hypothesis", "jsonschema")
"""What the tests import beside the dependencies; others of [test] come in one version, those that
read exports among them."""


COMPANIONS = {"pyparsing"}
"""What a lower bound requires without a bound from above, in a version of its time."""


def pins(lines: list[str], operator: str) -> dict[str, str]:
    """Names and versions of requirements that are all of the form name-operator-version."""
    found = [re.fullmatch(rf"([\w-]+){operator}([\w.]+)", line) for line in lines]
    assert None not in found, lines
    return {match[1]: match[2] for match in found if match}


def test_minimum_versions_are_the_lower_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    tools = [line for line in project["optional-dependencies"]["test"] if line.startswith(TEST_TOOLS)]
    bounds = pins(project["dependencies"], ">=")
    bounds |= {name: version for name, version in pins(tools, ">=").items() if name in TEST_TOOLS}
    lines = (ROOT / "constraints" / "minimum.txt").read_text().splitlines()
    pinned = pins([line for line in lines if line and not line.startswith("#")], "==")
    assert {name: version for name, version in pinned.items() if name not in COMPANIONS} == bounds


def test_what_the_lowest_versions_do_without_is_left_out():
    """Readers of exports and tables are not installed there: what imports them could not be collected."""
    tools = project()["project"]["optional-dependencies"]["test"]
    lacking = {line.partition(">=")[0] for line in tools if not line.startswith(TEST_TOOLS)}
    importing = set()
    for path in (ROOT / "tests").glob("test_*.py"):
        imported = re.findall(r"^(?:import|from) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        if lacking & set(imported):
            importing.add(f"tests/{path.name}")
    left_out = set(re.findall(r"--ignore=(\S+)", (ROOT / "Makefile").read_text(encoding="utf-8")))
    assert importing
    assert importing <= left_out


def test_the_lowest_python_is_the_one_that_is_tested():
    lowest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert f"MINIMUM_PYTHON ?= python{lowest.removeprefix('>=')}\n" in (ROOT / "Makefile").read_text()


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    told = project()["project"]
    # Unquoted, a version of two numbers would be read as one number.
    assert cited["version"] == told["version"]
    assert re.search(r'^version: "', (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited["license"] == told["license"] == "MIT"
    assert cited["authors"] == told["authors"] == [{"name": "The ribbon developers"}]
    (thesis,) = cited["references"]
    assert thesis["title"] in (ROOT / "README.md").read_text(encoding="utf-8").replace("\n", " ")


def test_the_licence_is_here():
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert text.startswith("MIT License\n\nCopyright (c) 2026 the ribbon developers\n")


def test_files_of_data_are_installed():
    """Whatever lies in the package beside modules, `py.typed` among it, is named as its data."""
    data = project()["tool"]["setuptools"]["package-data"]
    named = {
        path
        for package, patterns in data.items()
        for p in patterns
        for path in ROOT.glob("ribbon_cli/**/" + p if package == "*" else f"{package.replace('.', '/')}/{p}")
    }
    there = {path for path in (ROOT / "ribbon_cli").rglob("*") if path.is_file()}
    assert {path for path in there - named if path.suffix not in (".py", ".pyc")} == set()
    assert ROOT / "ribbon_cli" / "py.typed" in named


def test_pythons_are_those_that_the_package_is_tried_on():
    told = project()["project"]["classifiers"]
    versions = [line.rpartition(" ")[2] for line in told if re.search(r":: 3\.\d+$", line)]
    assert (
        f"PACKAGE_PYTHONS ?= {' '.join(f'python{v}' for v in versions)}\n" in (ROOT / "Makefile").read_text()
    )
