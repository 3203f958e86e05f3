"""The main job: Table 3.1 from configs/, entry by entry, every state with its certificate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from paper.table import compare_with_thesis, thesis_table
from ribbon_cli.analysis import table_entries
from ribbon_cli.config import SpectrumRequest, load_config
from ribbon_cli.report.convergence import convergence_rows
from ribbon_cli.study import Outcome, refine_state, solve_config

CONFIGS = Path(__file__).parent.parent / "configs"
WITHOUT_SPECTRA = SpectrumRequest(modes=0, full_up_to=0)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def table(root: Path) -> Outcome:
    config = load_config(CONFIGS / "mobius-pi.yaml")
    return solve_config(replace(config, spectrum=WITHOUT_SPECTRA), root)


def test_every_state_is_certified(table: Outcome) -> None:
    assert table.exit_code == 0
    assert len(table.targets) == 24
    for state in table.run.states(all=True):
        assert state.kkt_residual <= 1e-9
        assert state.constraint_residual <= 1e-9
        assert state.inverted_facets == 0
        if state.kind in ("equilibrium", "intermediate"):
            assert state.certified
            assert (state.status, state.negative_eigenvalues) == ("minimum", 0)
            assert state.linking_number == pytest.approx(0.5, abs=1e-9)


def test_the_thesis_is_reproduced(table: Outcome) -> None:
    rows = compare_with_thesis(convergence_rows(table_entries(table.run)), thesis_table())
    compared = [row for row in rows if row.relative_difference is not None]
    assert len(compared) == 18
    off = [row for row in compared if abs(row.relative_difference) > 5e-4]
    assert [(row.half_width, row.segments) for row in off] == [(0.1, 50)]
    # Another minimum at N = 50, and the saddle beside the minimum at N = 400: docs/errata.md.
    unlike = [(row.half_width, row.segments) for row in compared if not row.agrees]
    assert unlike == [(0.1, 50), (0.8, 200)]
    assert off[0].delta == pytest.approx(0.00460148, abs=5e-9)


def test_the_other_minimum_explains_the_first_entry(table: Outcome, root: Path) -> None:
    other = solve_config(load_config(CONFIGS / "paper" / "mobius-pi-second-minimum.yaml"), root)
    assert other.exit_code == 0
    (state,) = other.run.states()
    assert state.energy == pytest.approx(0.972161015, abs=5e-9)
    assert state.negative_eigenvalues == 0
    (finer,) = [s for s in table.run.states() if s.segments == 100 and s.half_width == pytest.approx(0.1)]
    assert abs(state.energy - finer.energy) == pytest.approx(0.0419388, abs=5e-8)


def test_the_saddle_at_half_width_one_half_is_not_taken(table: Outcome) -> None:
    (state,) = [s for s in table.run.states() if s.segments == 400 and s.half_width == 0.5]
    assert state.energy == pytest.approx(5.15143268, abs=5e-9)
    assert state.energy < 5.15143272


def test_refinement_by_hand_gives_the_same(table: Outcome, root: Path) -> None:
    energies = {(s.half_width, s.segments): s.energy for s in table.run.states()}
    outcome = refine_state(root, f"{table.run.name}@b=0.5,N=50", to=400)
    assert outcome.exit_code == 0
    state = next(s for s in outcome.run.states() if s.label == outcome.targets[0].label)
    assert state.energy == pytest.approx(energies[0.5, 400], rel=1e-9)


@pytest.mark.large
def test_the_left_handed_band_has_the_same_energies(table: Outcome, root: Path) -> None:
    config = load_config(CONFIGS / "mobius-pi-left.yaml")
    left = solve_config(replace(config, spectrum=WITHOUT_SPECTRA), root)
    right = {(s.half_width, s.segments): s.energy for s in table.run.states()}
    assert len(left.targets) == 24
    for state in left.run.states():
        assert state.energy == pytest.approx(right[state.half_width, state.segments], rel=1e-10)
        assert state.linking_number == pytest.approx(-0.5, abs=1e-9)


def test_the_other_rule_has_the_same_limit_and_a_smaller_error(table: Outcome, root: Path) -> None:
    config = load_config(CONFIGS / "mobius-pi-value-average.yaml")
    config = replace(config, widths=(0.1, 0.2, 0.5), spectrum=WITHOUT_SPECTRA)
    config = replace(config, refinement=replace(config.refinement, at=(0.5,)))
    other = convergence_rows(table_entries(solve_config(config, root).run))
    ours = convergence_rows(table_entries(table.run))
    (limit,) = [e for e in ours.extrapolations if e.half_width == 0.5]
    (same,) = [e for e in other.extrapolations if e.half_width == 0.5]
    assert limit.energy is not None
    assert same.energy == pytest.approx(limit.energy, rel=2e-6)
    orders = [row.order for row in other.rows if row.half_width == 0.5 and row.order is not None]
    assert orders == sorted(orders, reverse=True)
    assert 2.0 < orders[-1] < orders[0] < 2.5
    errors = [
        abs(row.energy - limit.energy)
        for table_ in (other, ours)
        for row in table_.rows
        if (row.half_width, row.segments) == (0.5, 200) and row.energy is not None
    ]
    assert errors[0] < errors[1]
