"""Families of configs that differ in a few keys: a base in `configs/`, and what each member changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from ribbon_cli.config import Config, parse_config

Changes = dict[str, Any]
"""Keys of a config with their values in place of the base's."""
FOLDER = "studies"
"""Where the bases' data are: members name them as if they lay there."""
OTHER_RULE = "value-average"


def _everted_cylinders() -> dict[str, Changes]:
    """The recipe at other numbers of segments."""
    return {f"everted-cylinder-{n}": {"initial_guess": _eversion(n, 0.03)} for n in (40, 80)}


def _everted_branches() -> dict[str, Changes]:
    """Branches of everted cylinders: from the recipe both ways, less symmetric families from stored states,
    and the recipe under the other rule up to where it loses its stability.

    At N = 320 and more the recipe's band is unstable at b = 0.03: it is made at a smaller width.
    """
    ways = {"to": 0.3, "back_to": 0.01, "both": True, "at": [0.03, 0.1, 0.2]}
    members: dict[str, Changes] = {str(n): {"initial_guess": _eversion(n, 0.03)} for n in (40, 80, 160)}
    members["320"] = {"initial_guess": _eversion(320, 0.015), "widths": {"arclength": ways}}
    members["640"] = {
        "initial_guess": _eversion(640, 0.008),
        "widths": {"arclength": ways | {"back_to": 0.005}},
    }
    for n, family in ((40, "A"), (80, "A"), (80, "B"), (80, "C"), (160, "A")):
        members[f"{n}{family.lower()}"] = {
            "initial_guess": {"state": f"data/everted-N{n}-{family}.npz"},
            "widths": {"arclength": {"to": 0.2, "back_to": 0.02}},
        }
    for n in (40, 80, 160, 320):
        members[f"{n}-{OTHER_RULE}"] = {
            "discretisation": OTHER_RULE,
            "initial_guess": _eversion(n, 0.015 if n == 320 else 0.03),
            "widths": {"arclength": {"to": 0.3, "stop_at": ["stability-lost"]}},
        }
    return {f"everted-branch-{name}": changes for name, changes in members.items()}


def _everted_moebius() -> dict[str, Changes]:
    """Branches of both families of everted Moebius bands from their stored saddles, under either rule."""
    one_way = {"widths": {"arclength": {"to": 0.2}}}
    members: dict[str, Changes] = {}
    for family in "ab":
        starts = {n: _saddle(f"data/everted-moebius-N{n}-{family.upper()}.npz") for n in (80, 160, 320, 640)}
        members |= {f"{family}-{n}": start | (one_way if n == 640 else {}) for n, start in starts.items()}
        members |= {
            f"{family}-{n}-{OTHER_RULE}": starts[n] | one_way | {"discretisation": OTHER_RULE}
            for n in (80, 160, 320)
        }
    return {f"everted-moebius-{name}": changes for name, changes in members.items()}


def _eversion(segments: int, half_width: float) -> Changes:
    return {"recipe": "eversion", "segments": segments, "half_width": half_width, "steps": 25}


def _saddle(state: str) -> Changes:
    """A start from the stored saddle itself, not from what it falls to."""
    return {"initial_guess": {"state": state, "saddle": "keep"}}


FAMILIES: dict[str, dict[str, Changes]] = {
    "everted-cylinder-160": _everted_cylinders(),
    "everted-branch-40": _everted_branches(),
    "studies/everted-moebius-a-80": _everted_moebius(),
}
"""Members by the path of their base in `configs/`, in the order in which they are solved."""
MEMBERS = {name: base for base, members in FAMILIES.items() for name in members}
"""The base of every member."""


def member(configs: Path, name: str) -> Config:
    """The config of a member. Raises ConfigError, OSError where the base is not there."""
    base = MEMBERS[name]
    text = (configs / f"{base}.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text) | FAMILIES[base][name] | {"name": name}
    head = f"# configs/{base}.yaml with the changes of paper/families.py.\n"
    written = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=110)
    return parse_config(head + written, configs / FOLDER / f"{name}.yaml")
