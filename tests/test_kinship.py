"""Refined minima that are, or are not, those they came from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from numeric_support import load

from ribbon_cli.analysis import table_entries
from ribbon_cli.config import parse_config
from ribbon_cli.model.problem import Problem
from ribbon_cli.report.convergence import convergence_rows
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.kinship import another_minimum
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.study import refine_state, solve_config

SECOND = Path(__file__).parent.parent / "configs" / "paper" / "data" / "pi-b0.1-N50-second-minimum.npz"
BOTH = f"""
name: both
topology: {{half_twists: 1}}
initial_guess: {{state: {SECOND}}}
refinement: [50, 100, 200]
spectrum: {{modes: 0, full_up_to: 0}}
"""


@pytest.mark.parametrize("name", ["pi-b0.1-N50", "pi-b0.5-N50"])
def test_a_refined_band_is_its_own_kin(name: str) -> None:
    state, multipliers = load(name)
    coarse = solve(Problem(state.band), state.vector(), multipliers.vector()).state
    for n in (60, 100, 40):
        fine = to_segments(coarse, n, Options()).result
        assert fine.certified
        assert another_minimum(coarse, fine.state, Options()) is None, n


def test_a_chain_that_changes_its_minimum_says_so(tmp_path: Path) -> None:
    """E_50 = 0.972161 is of a minimum that N = 100 does not have; E_100 and E_200 are of one band."""
    outcome = solve_config(parse_config(BOTH, "both.yaml"), tmp_path)
    assert all(target.certified for target in outcome.targets)
    first, second, third = (outcome.run.load(target.label) for target in outcome.targets)
    assert first.energy == pytest.approx(0.972161, abs=1e-6)
    assert second.events == ("another minimum: taken back to N = 50 it has E = 0.925620733, not 0.972161015",)
    assert third.events == ()
    assert any("another minimum" in note for note in outcome.notes)
    rows = convergence_rows(table_entries(outcome.run)).rows
    assert "E_100 is not on the branch of E_50" in rows[0].note
    assert [row.note for row in rows[1:]] == ["", ""]
    assert rows[0].delta == pytest.approx(0.0419388, abs=1e-7)
    assert rows[0].order is None


@pytest.mark.long
def test_entries_that_are_not_related_are_compared(tmp_path: Path) -> None:
    """A state whose parents do not lead to the coarser entry is prolonged or taken back to tell."""
    second = solve_config(parse_config(BOTH.replace("[50, 100, 200]", "[50]"), "both.yaml"), tmp_path).run
    text = """
name: main
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 50, half_width: 0.1, steps: 50}
spectrum: {modes: 0, full_up_to: 0}
"""
    run = solve_config(parse_config(text, "main.yaml"), tmp_path).run
    saddle = next(s.label for s in run.states(all=True) if s.kind == "saddle")
    made = refine_state(tmp_path, f"{run.name}:{saddle}", levels=1)
    assert made.targets[0].certified
    assert [entry.breaks for entry in table_entries(run)] == ["", ""]

    fine = run.load(made.targets[0].label or 0)
    with second.writing():
        second.commit(replace(fine, label=second.next_label, parent=None))
    coarse_entry, fine_entry = table_entries(second)
    assert coarse_entry.breaks == ""
    assert fine_entry.breaks.startswith("another minimum: taken back to N = 50 it has E = 0.9256")
