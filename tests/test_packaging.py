"""The lower bounds in pyproject.toml are those that `make test-minimum` installs."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
TEST_TOOLS = ("pytest", "hypothesis", "sympy")
"""What the tests import beside the dependencies; the other tools of [dev] run in one version only, those that
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
    tools = [line for line in project["optional-dependencies"]["dev"] if line.startswith(TEST_TOOLS)]
    bounds = pins(project["dependencies"], ">=")
    bounds |= {name: version for name, version in pins(tools, ">=").items() if name in TEST_TOOLS}
    lines = (ROOT / "constraints" / "minimum.txt").read_text().splitlines()
    pinned = pins([line for line in lines if line and not line.startswith("#")], "==")
    assert {name: version for name, version in pinned.items() if name not in COMPANIONS} == bounds


def test_the_lowest_python_is_the_one_that_is_tested():
    lowest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert f"MINIMUM_PYTHON ?= python{lowest.removeprefix('>=')}\n" in (ROOT / "Makefile").read_text()
