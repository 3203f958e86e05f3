"""The claims of chapter 3: verdicts on states that are known, and the twist that untwists."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from picture_support import solved, states_of  # noqa: F401
from store_support import make_summary

from ribbon_cli import solve
from ribbon_cli.config import parse_config
from ribbon_cli.paper import claims
from ribbon_cli.paper.figures import ITEMS, TWIST_STEPS
from ribbon_cli.paper.overturn import follow
from ribbon_cli.store import Run

ROOT = Path(__file__).parent.parent


def test_every_item_has_its_configs():
    for item in ITEMS.values():
        for config in item.configs:
            assert (ROOT / f"configs/paper/{config}.yaml").is_file()
    assert f"steps: {TWIST_STEPS // 3}}}" in (ROOT / "configs/paper/three-pi-twisted.yaml").read_text()


def test_each_check_says_what_it_asks(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    checks = [
        claims.inflection_count(state, 1),
        claims.torsion_vanishes(state),
        claims.injectivity_nearly_active(state),
        claims.half_turn_symmetry(state),
        claims.certified_minima([state]),
        claims.period(state, "kappa_s", 2, -1, "kappa_s is pi-antiperiodic", "why"),
        *claims.extremum_at_inflections(state),
        *claims.largest_at_inflections(state, ("lambda_5",)),
    ]
    assert all(check.claim and check.expected and check.found for check in checks)
    assert claims.inflection_count(state, 1).agrees
    assert not claims.inflection_count(state, 3).agrees
    # Once round kappa_s changes its sign, which twice half round would undo.
    assert [(c.agrees, c.note) for c in checks if "antiperiodic" in c.claim] == [(False, "why")]


@pytest.mark.parametrize(("widths", "agrees"), [([1.52, 1.49], True), ([1.56, 1.58], False), ([], False)])
def test_the_contact_is_held_to_the_printed_digits(widths, agrees):
    states = [
        make_summary(self_contact=True, segments=n, half_width=b)
        for n, b in zip((50, 100), widths, strict=False)
    ]
    assert claims.contact_width(states, "1.5").agrees is agrees


def test_a_twist_by_three_half_turns_ends_as_minus_one(tmp_path):
    text = (
        "name: t\ntopology: {half_twists: 1}\nspectrum: {modes: 0, full_up_to: 0}\n"
        "initial_guess: {recipe: twist, segments: 30, half_width: 0.1, steps: 15}\n"
    )
    with np.errstate(all="raise", under="ignore"):
        outcome = solve(parse_config(text, "test"), runs=tmp_path)
        run = Run.open(outcome.run.path)
        (label,) = [s.label for s in run.states(all=True) if s.stage == "twist 15/15"]
        end = follow(run.load(label), 16, 3, 45)
    assert end.last == 45
    assert end.turned_over == 16
    assert end.stopped.startswith("twist 16/45: (Beyond half a turn it turns over at the seam")
    assert end.linking_number == pytest.approx(-0.5, abs=1e-9)
