"""The eversion: from the cylinder to the everted one, and what tells it from others with Lk = 0."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ribbon_cli.config import parse_config
from ribbon_cli.model.band import Band
from ribbon_cli.model.problem import Problem
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.recipes.eversion import eversion_stage, half_turn, not_everted
from ribbon_cli.store import Run
from ribbon_cli.study import refine_state, solve_config
from ribbon_cli.study.records import state_of

CONFIG = """
name: everted
topology: {{half_twists: 0}}
length: {length}
initial_guess: {{recipe: eversion, segments: {segments}, half_width: {half_width}, steps: {steps}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""


def everted(
    root: Path, segments: int, half_width: float = 0.03, length: float = 2 * math.pi, steps: int = 25
) -> tuple[Run, int]:
    text = CONFIG.format(segments=segments, half_width=half_width, length=length, steps=steps)
    outcome = solve_config(parse_config(text, "everted.yaml"), root)
    return outcome.run, outcome.exit_code


def test_prescribed_rulings_turn_by_a_quarter() -> None:
    """(3.6)-(3.8): k = 0 is the cylinder, at k = K the rulings are antiparallel."""
    stages = [eversion_stage(12, 4, k) for k in range(5)]
    assert [stage.index for stage in stages] == [0, 1, 2, 3, 4]
    first, last = stages[0].prescription.rulings, stages[-1].prescription.rulings
    assert set(first) == {0, 6}
    assert all((first[node] == [0, 0, 1]).all() for node in first)
    assert (last[0] == [0, 1, 0]).all()
    assert (last[6] == [0, -1, 0]).all()
    middle = stages[2].prescription.rulings
    assert np.allclose(middle[0], [0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-15)
    assert np.allclose(middle[6], [0, -math.sqrt(0.5), math.sqrt(0.5)], atol=1e-15)


@pytest.mark.parametrize(("segments", "steps"), [(41, 25), (40, 0)])
def test_what_no_eversion_can_be_made_of(segments: int, steps: int) -> None:
    with pytest.raises(ValueError, match="even number of segments"):
        eversion_stage(segments, steps, 0)


@pytest.mark.parametrize("segments", [40, *(pytest.param(n, marks=pytest.mark.long) for n in (80, 160))])
def test_everted_cylinders_are_certified_minima(tmp_path: Path, segments: int) -> None:
    """b = 0.03, K = 25: minima with Lk = 0 and two inflections, neither the ring nor the figure-eight."""
    run, code = everted(tmp_path, segments)
    assert code == 0
    (summary,) = run.states()
    record = run.load(summary.label)
    assert record.certified
    assert record.linking_number == pytest.approx(0.0, abs=1e-6)
    assert int((np.sign(record.kappa_s) != np.sign(np.roll(record.kappa_s, 1))).sum()) == 2
    assert 6.5 < record.energy / (math.pi * 0.03) < 6.9  # the ring has 1
    assert not record.self_contact
    assert np.abs(record.midline[:, 2]).max() > 0.1  # the figure-eight is planar
    assert np.abs(record.tau).max() > 0.1


def test_the_stages_are_stored_with_the_rejoined_band(tmp_path: Path) -> None:
    run, _ = everted(tmp_path, 40, steps=10)
    auxiliary = [s for s in run.states(all=True) if s.kind == "auxiliary"]
    names = [s.stage for s in auxiliary]
    assert names[:11] == [f"eversion {k}/10" for k in range(11)]
    solved = [s for s in auxiliary if s.stage.startswith("eversion")]
    assert all(s.certified and abs(s.linking_number) < 1e-9 for s in solved)
    last, joined = run.load(solved[-1].label), run.load(auxiliary[-1].label)
    assert joined.stage == "halves rejoined"
    assert joined.cut_node is None
    assert (joined.status, joined.certified) == ("constructed", False)
    assert np.isnan(joined.lambda_1).all()
    # The join is an isometry that keeps the halves as they were: closed, isometric, of the same energy.
    assert joined.constraint_residual < 1e-9
    assert joined.energy == pytest.approx(last.energy, rel=1e-9)
    assert joined.linking_number == pytest.approx(0.0, abs=1e-9)
    assert not_everted(state_of(joined)) is None
    assert everted(tmp_path, 40, steps=10)[0].states(all=True) == run.states(all=True)


def test_steps_that_fail_are_halved_and_reported(tmp_path: Path) -> None:
    """All in one step turns facets inside out; in two halves it goes, and the band is the same."""
    run, code = everted(tmp_path, 40, steps=1)
    assert code == 0
    states = run.states(all=True)
    solved = [s for s in states if s.stage.startswith("eversion")]
    assert [s.stage for s in solved] == ["eversion 0/1", "eversion 0.5/1", "eversion 1/1"]
    assert [len(s.events) for s in solved] == [0, 1, 0]
    assert "a step from eversion 0/1 to 1 failed, halved" in solved[1].events[0]
    assert solved[1].parent == solved[0].label
    assert states[-1].energy == pytest.approx(0.640012967, abs=5e-10)
    assert len(everted(tmp_path, 40, steps=1)[0].states(all=True)) == len(states)


def test_the_half_turn_is_stored_as_pieces(tmp_path: Path) -> None:
    """From the last auxiliary band, cut, to the joined one: each piece moves rigidly, as Figure 3.2 shows."""
    run, _ = everted(tmp_path, 40, steps=5)
    records = [run.load(s.label) for s in run.states(all=True) if s.status == "constructed"]
    whole = next(run.load(s.label) for s in run.states(all=True) if s.stage == "eversion 5/5")
    *pieces, joined = records
    names = ["cut along both rulings", "half turned 1/4", "half turned 2/4", "half turned 3/4"]
    assert [r.stage for r in pieces] == names
    half, h = 20, joined.length / 40
    for record in pieces:
        assert record.cut_node == half + 1
        assert np.allclose(record.u[:half], whole.u[:half], atol=1e-12)
        assert np.allclose(record.g_cut, whole.g[half], atol=1e-12)
        for first, last in ((0, half - 1), (half, 40)):
            steps = np.diff(record.midline[first : last + 1], axis=0)
            assert np.allclose(steps, h * record.u[first:last], atol=1e-12)
        # The second piece turns about an axis that both cuts' middles keep their distance from.
        end = record.midline[half - 1] + h * record.u[half - 1]
        middle = 0.5 * (record.midline[half] + record.midline[40])
        assert np.allclose(middle, 0.5 * end, atol=1e-9)
        assert record.energy == pytest.approx(pieces[0].energy, rel=1e-12)
        assert np.isnan([record.linking_number, record.clearance, record.kappa_s[0], record.tau[half]]).all()
    cut, quarter = pieces[0], pieces[2]
    # Before it is turned, the second piece is the whole band's, run through the other way.
    assert np.allclose(cut.midline[half:], whole.midline[half:][::-1], atol=1e-9)
    assert np.allclose(cut.g[half + 1 :], whole.g[half + 1 :][::-1], atol=1e-12)
    chord = quarter.midline[40] - quarter.midline[half]
    assert np.abs(chord @ (whole.midline[half] - whole.midline[0])) < 1e-9
    assert np.allclose(joined.g[half], whole.g[half], atol=1e-12)


@pytest.mark.long
def test_other_lengths_give_the_same_shape(tmp_path: Path) -> None:
    """Only 2b/l matters: at length 1 the energy is that of 2 pi."""
    energies = []
    for k, length in enumerate((2 * math.pi, 1.0)):
        run, code = everted(tmp_path / str(k), 40, 0.03 * length / (2 * math.pi), length)
        assert code == 0
        energies.append(run.states()[0].energy)
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)


@pytest.mark.long
def test_a_ring_in_the_place_of_an_everted_cylinder_is_no_success(tmp_path: Path) -> None:
    """On 20 facets the freed band runs off; the saddle it starts on is all that is kept, uncertified."""
    run, code = everted(tmp_path, 20)
    assert code == 3
    (state,) = run.states()
    assert (state.status, state.certified) == ("saddle", False)
    assert not_everted(state_of(run.load(state.label))) is None


def test_the_ring_is_not_everted() -> None:
    assert "0 times" in (not_everted(cylinder(Band(40, 0.03))) or "")


@pytest.mark.long
def test_an_everted_state_stays_one_when_refined(tmp_path: Path) -> None:
    run, _ = everted(tmp_path, 40)
    outcome = refine_state(tmp_path, f"{run.path.name}:{run.states()[0].label}", to=80)
    assert outcome.exit_code == 0
    record = run.load(outcome.targets[0].label or 0)
    assert not_everted(state_of(record)) is None


def test_the_half_turn_is_exact() -> None:
    assert (half_turn(math.pi) == np.diag([1.0, -1.0, -1.0])).all()
    assert np.allclose(half_turn(0.3) @ half_turn(math.pi - 0.3), half_turn(math.pi), atol=1e-15)


def test_stages_have_the_rotations_that_keep_both_rulings() -> None:
    """Between the first and the last stage the rulings are not parallel: no rotation is left."""
    ring = cylinder(Band(12, 0.1))
    counts = []
    for stage in (eversion_stage(12, 2, k) for k in range(3)):
        problem = Problem(ring.band, stage.prescription)
        counts.append(problem.rotations(problem.impose(ring.vector())).shape[1])
    assert counts == [1, 0, 1]
