"""A recipe is one file: its card is all that config and study need to know of it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ribbon_cli.config import Guess, parse_config
from ribbon_cli.model.band import Band, State
from ribbon_cli.recipes import RECIPES
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.recipes.recipe import Made, Making, NotMadeError, Recipe, Way
from ribbon_cli.study import plan_of, solve_config

CONFIG = """
name: own
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 12, half_width: 0.3}
spectrum: {modes: 0, full_up_to: 0}
"""


def own(band: Band, _half_twists: int, settings: Mapping[str, Any]) -> Way:
    """Two rings, one after the other, or why there is none."""

    def make(k: int, before: State | None) -> Made:
        assert before is None
        if settings["refuse"]:
            raise NotMadeError("no ring today; take another recipe")
        return Made(cylinder(band), f"ring {k}")

    return Way("own freed", (Making(("first ring", "second ring"), make),))


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Recipe:
    made = Recipe(
        "own", "", "0", lambda n: n == 0, "", "own guess freed", own, lambda _: ("first ring", "second ring")
    )
    monkeypatch.setitem(RECIPES, "own", made)
    return made


def test_study_runs_what_a_card_says(card: Recipe, tmp_path: Path) -> None:
    config = replace(parse_config(CONFIG, "own.yaml"), guess=Guess(card.name, 12, 0.3, {"refuse": False}))
    outcome = solve_config(config, tmp_path)
    assert outcome.exit_code == 0
    states = outcome.run.states(all=True)
    assert [(s.stage, s.kind) for s in states] == [
        ("first ring", "auxiliary"),
        ("second ring", "auxiliary"),
        ("own guess freed", "equilibrium"),
    ]
    assert [stage.name for stage in plan_of(config).stages] == [s.stage for s in states]
    assert solve_config(config, tmp_path).new_states == 0


def test_what_cannot_be_made_is_told(card: Recipe, tmp_path: Path) -> None:
    config = replace(parse_config(CONFIG, "own.yaml"), guess=Guess(card.name, 12, 0.3, {"refuse": True}))
    outcome = solve_config(config, tmp_path)
    assert outcome.exit_code == 3
    assert outcome.failures == (
        "b = 0.3, N = 12: not reached: first ring: no ring today; take another recipe",
    )


def test_settings_are_told_apart_by_the_hash(card: Recipe) -> None:
    config = parse_config(CONFIG, "own.yaml")
    guesses = [Guess(card.name, 12, 0.3, {"refuse": refuse}) for refuse in (False, True)]
    first, second = (replace(config, guess=guess) for guess in guesses)
    assert first.hash8() != second.hash8()
    assert first.resolved()["initial_guess"]["refuse"] is False


def test_cards_are_read_without_the_mathematics() -> None:
    code = (
        "import sys, ribbon_cli.recipes as r; [c.stages({'steps': 3}) for c in r.RECIPES.values()]; "
        "sys.exit(str({'numpy', 'scipy', 'ribbon_cli.model.band'} & set(sys.modules) or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""
