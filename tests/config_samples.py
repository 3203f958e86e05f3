"""Configs that the tests of `ribbon_cli.config` start from, and how they are spoilt."""

from __future__ import annotations

import pytest

from ribbon_cli.config import ConfigError, parse_config

GOOD = """\
name: mobius-pi
topology: {half_twists: 1}
length: 2*pi
discretisation: thesis
initial_guess: {recipe: twist, segments: 50, half_width: 0.1, steps: 50}
widths: [0.1, 0.2, 0.5, 0.8, 1.0, 1.5]
refinement: [50, 100, 200, 400]
spectrum: {modes: 12, full_up_to: 200}
contact: record
"""
MINIMAL = "topology: {half_twists: 1}\ninitial_guess: {recipe: twist, segments: 50, half_width: 0.1}\n"
STRIP = """\
topology: open
length: 1
ends: {span: 0.75}
initial_guess: {recipe: strip, segments: 50, half_width: 0.05}
"""
KNOWN = (
    "name, topology, length, discretisation, ends, material, loads, initial_guess, widths, schedule, "
    "refinement, spectrum or contact"
)


def problems_of(text: str, path: str = "mobius.yaml") -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, path)
    assert caught.value.exit_code == 2
    return str(caught.value).splitlines()


def changed(old: str, new: str) -> str:
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)
