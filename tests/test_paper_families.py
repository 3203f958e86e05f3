"""Configs of the studies that are made from one base each: names and hashes by which runs are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from paper import families
from paper.families import MEMBERS, member
from paper.studies import Place, solve
from ribbon_cli.config import load_config
from ribbon_cli.errors import TargetError

CONFIGS = Path(__file__).parents[1] / "configs"
HASHES = {
    "everted-cylinder-40": "b17e190f",
    "everted-cylinder-80": "7154c0a3",
    "everted-branch-40": "67e59bcb",
    "everted-branch-80": "40a66602",
    "everted-branch-160": "bbc8f864",
    "everted-branch-320": "8a3bb5b5",
    "everted-branch-640": "fe20b161",
    "everted-branch-40a": "c83aef73",
    "everted-branch-80a": "c71e860c",
    "everted-branch-80b": "42d93758",
    "everted-branch-80c": "450b27d3",
    "everted-branch-160a": "4447c7ae",
    "everted-branch-40-value-average": "3fafe5fa",
    "everted-branch-80-value-average": "64587dc8",
    "everted-branch-160-value-average": "9582131f",
    "everted-branch-320-value-average": "d877b1f7",
    "everted-moebius-a-80": "828baf86",
    "everted-moebius-a-160": "21185168",
    "everted-moebius-a-320": "7c53ba7a",
    "everted-moebius-a-640": "53b73654",
    "everted-moebius-a-80-value-average": "8658cd34",
    "everted-moebius-a-160-value-average": "ce55aaa7",
    "everted-moebius-a-320-value-average": "af7814e1",
    "everted-moebius-b-80": "0b593769",
    "everted-moebius-b-160": "33d5271b",
    "everted-moebius-b-320": "8e4a589c",
    "everted-moebius-b-640": "ac1f6f78",
    "everted-moebius-b-80-value-average": "f7778f47",
    "everted-moebius-b-160-value-average": "e69755e1",
    "everted-moebius-b-320-value-average": "b30887c8",
}
"""Runs are called NAME-HASH8: those that were made from files of their own are found again."""


def test_members_have_the_hashes_that_their_runs_are_called_by():
    assert {name: member(CONFIGS, name).hash8() for name in MEMBERS} == HASHES


@pytest.mark.parametrize("name", MEMBERS)
def test_every_member_can_be_solved(name):
    config = member(CONFIGS, name)
    assert config.name == name
    assert config.guess.state is None or Path(config.guess.state).is_file()
    assert config.guess.keep_saddle == name.startswith("everted-moebius-")
    assert (config.arclength is None) == name.startswith("everted-cylinder-")


@pytest.mark.parametrize("base", sorted(set(MEMBERS.values())))
def test_a_base_among_its_members_is_what_its_file_says(base):
    name = Path(base).name
    if name in MEMBERS:
        assert member(CONFIGS, name).resolved() == load_config(CONFIGS / f"{base}.yaml").resolved()


@pytest.mark.long
def test_solving_a_member_prints_what_came_of_it(tmp_path, monkeypatch, capsys):
    """A ring with other levels; then one that ends on a saddle, as on few facets an everted cylinder does."""
    changes = {
        "small": {
            "initial_guess": {"recipe": "cylinder", "segments": 12, "half_width": 0.3},
            "refinement": [12, 24],
        },
        "coarse": {
            "initial_guess": {"recipe": "eversion", "segments": 12, "half_width": 0.15, "steps": 25},
            "refinement": [12],
        },
    }
    monkeypatch.setitem(families.FAMILIES, "ring", changes)
    for name in changes:
        monkeypatch.setitem(MEMBERS, name, "ring")
    place = Place(CONFIGS, tmp_path, quiet=True)
    solve("small", place)
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[:4] == ["b", "N", "label", "E"]
    assert [row.split()[1] for row in rows] == ["12", "24"]
    with pytest.raises(TargetError, match="coarse"):
        solve("coarse", place)
    assert "coarse" not in capsys.readouterr().out
