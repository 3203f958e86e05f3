"""The claims of chapter 3: verdicts on states that are known, and the twist that untwists."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_support import solved, states_of  # noqa: F401
from store_support import make_summary

from paper import claims
from paper.__main__ import main
from paper.figures import ITEMS, TWIST_STEPS
from paper.library import Library
from paper.make import make
from paper.overturn import follow
from paper.studies import STUDIES
from ribbon_cli import solve
from ribbon_cli.config import load_config, parse_config
from ribbon_cli.store import Run

ROOT = Path(__file__).parent.parent


def test_every_item_has_its_configs_and_target():
    for item in ITEMS.values():
        for config in item.configs:
            assert (
                load_config(ROOT / f"configs/{config}.yaml").name.removeprefix("paper-") == Path(config).stem
            )
    assert f"steps: {TWIST_STEPS // 3}}}" in (ROOT / "configs/paper/three-pi-twisted.yaml").read_text()
    figures = {f"figure-3.{k}" for k in range(1, 15)}
    assert set(ITEMS) == figures | {"table-3.1"}
    named = {*figures, "table-3.1", *STUDIES}
    done = subprocess.run(
        ["make", "--dry-run", *named], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    assert {line.split()[-1] for line in done.stdout.splitlines() if "-m paper" in line} == named


@pytest.mark.large
def test_one_figure_alone(tmp_path):
    """Figure 3.1, twice: the second time nothing is solved, and every file is the same."""
    said: list[str] = []
    before: dict[str, bytes] = {}
    for _ in range(2):
        library = Library(ROOT / "configs", tmp_path / "runs")
        made = make(["figure-3.1"], library, tmp_path / "paper", said.append)
        files = {path.name: path.read_bytes() for path in (tmp_path / "paper").iterdir()}
        panels = ("", "-a", "-b", "-c")
        assert set(files) == {f"figure-3.1{panel}.{form}" for panel in panels for form in ("pdf", "png")}
        assert len(made["figure-3.1"].sources) == 3
        before = before or files
        assert files == before


def test_an_unknown_name_is_told_before_anything_is_made(tmp_path, capsys):
    assert main(["figure-3.1", "everted-cylindre", "--runs", str(tmp_path / "runs")]) == 2
    assert "did you mean everted-cylinder" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


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


def test_claims_about_the_pi_band(solved):  # noqa: F811
    state = states_of(solved, "mobius")[-1]
    assert claims.inflection_count(state, 1).agrees
    assert not claims.inflection_count(state, 3).agrees
    assert claims.half_turn_symmetry(state).agrees
    assert not claims.period(state, "tau", 2, 1, "periodic", "it is not").agrees
    assert claims.period(state, "tau", 1, 1, "after the whole length").agrees
    # Across the seam kappa_s comes back with the opposite sign.
    assert claims.period(state, "kappa_s", 1, -1, "antiperiodic").agrees
    assert all(check.agrees for check in claims.largest_at_inflections(state, ("lambda_5",)))
    assert claims.certified_minima(states_of(solved, "mobius")).agrees


def test_claims_about_a_ring(solved):  # noqa: F811
    state = states_of(solved, "ring")[-1]
    assert not claims.inflection_count(state, 2).agrees
    assert not claims.half_a_band_apart(state).agrees
    assert not claims.contact_width([], "1.5").agrees


def test_claims_about_contact():
    touching = make_summary(self_contact=True, segments=100, half_width=1.51)
    apart = replace(touching, self_contact=False, half_width=1.4)
    finer = replace(touching, segments=200, half_width=1.512)
    assert claims.contact_width([apart, touching, finer], "1.5").agrees
    assert not claims.contact_width([apart, touching, finer], "1.50").agrees
    assert not claims.contact_width([apart], "1.4").agrees


def test_half_of_a_spectrum():
    low, high = np.linspace(0.01, 0.02, 50), np.linspace(1.0, 2.0, 50)
    falling = [(n, np.concatenate((low / n, high))) for n in (1, 2, 4)]
    assert [check.agrees for check in claims.half_vanish(falling, "made up")] == [True, True]
    steady = [(n, np.concatenate((low, high))) for n in (1, 2, 4)]
    assert [check.agrees for check in claims.half_vanish(steady, "made up")] == [True, False]
