"""Steps in width against the slopes of their branch: derivatives in b, folds, long steps, grid phase."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numeric_support import E3, Array, load, unit, with_rule

from ribbon_cli.config import parse_config
from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.problem import FREE, Prescription, Problem
from ribbon_cli.model.rates import rates
from ribbon_cli.solver.continuation import to_width
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.status import Status
from ribbon_cli.solver.tracking import BranchPoint, agree
from ribbon_cli.study import solve_config

SECOND = Path(__file__).parent.parent / "configs" / "paper" / "data" / "pi-b0.1-N50-second-minimum.npz"
CASES = {
    "free": FREE,
    "held": Prescription({0: unit(1), 3: unit(2)}),
    "open seam": Prescription({0: E3}, seam=unit(3)),
}


def lagrangian(problem: Problem, x: Array, multipliers: Array) -> float:
    return problem.energy(x) - float(multipliers @ problem.weighted_constraints(x))


def lagrangian_gradient(problem: Problem, x: Array, multipliers: Array) -> Array:
    local = problem.local_derivatives(x, multipliers)
    return local.gradient - problem.jacobian_matrix(local).T @ multipliers


@pytest.mark.parametrize("rule", list(Discretisation))
@pytest.mark.parametrize("sigma", [1, -1])
@pytest.mark.parametrize("case", CASES)
def test_derivatives_in_the_width(rule: Discretisation, sigma: int, case: str) -> None:
    """L is linear in b, so that central differences are right to roundoff."""
    bands = [Band(11, b, sigma=sigma, discretisation=rule) for b in (0.6, 0.7, 0.8)]
    low, middle, high = (Problem(band, CASES[case]) for band in bands)
    rng = np.random.default_rng(4)
    x, y = middle.impose(rng.standard_normal(middle.size)), rng.standard_normal(middle.rows)
    slope = (lagrangian(high, x, y) - lagrangian(low, x, y)) / 0.2
    by_width = rates(middle, x, y, middle.gradient(x), "half_width")
    assert by_width.lagrangian == pytest.approx(slope, rel=1e-11)
    rows = (high.weighted_constraints(x) - low.weighted_constraints(x)) / 0.2
    assert by_width.constraints == pytest.approx(rows, abs=1e-12)
    bend = (lagrangian_gradient(high, x, y) - lagrangian_gradient(low, x, y)) / 0.2
    found = by_width.gradient
    assert found == pytest.approx(bend, abs=1e-12 * np.abs(bend).max())
    assert not found[middle.fixed].any()


@pytest.mark.parametrize("rule", list(Discretisation))
def test_slopes_of_a_branch_are_those_of_its_points(rule: Discretisation) -> None:
    state, multipliers = load("pi-b0.5-N50")
    middle = solve(Problem(with_rule(state, rule).band), state.vector(), multipliers.vector())
    point = BranchPoint.at(middle.state, middle.multipliers)
    ends = []
    for step in (-1e-3, 1e-3):
        band = middle.state.band.with_half_width(0.5 + step)
        ends.append(solve(Problem(band), middle.x, middle.multipliers))
    low, high = ends
    assert point.rise == pytest.approx((high.energy - low.energy) / 2e-3, rel=1e-6)
    bend = (high.energy - 2.0 * middle.energy + low.energy) / 1e-6
    assert point.bend == pytest.approx(bend, rel=1e-4)
    assert point.slope == pytest.approx((high.x - low.x) / 2e-3, abs=1e-5)
    change = (high.multipliers - low.multipliers) / 2e-3
    assert point.multiplier_slope == pytest.approx(change, abs=1e-4 * np.abs(change).max())
    assert agree(point, BranchPoint.at(high.state, high.multipliers))


def second_minimum(half_width: float) -> tuple[State, Array]:
    """The branch of the second minimum at b = 0.1, N = 50, followed in short steps."""
    with np.load(SECOND) as data:
        state = State(Band(50, 0.1, sigma=-1), data["u"], data["g"], data["xi"])
    result = solve(Problem(state.band), state.vector())
    for b in np.linspace(0.1, half_width, 6)[1:]:
        move = to_width(result.state, result.multipliers, float(b), Options())
        assert move.result.status is Status.MINIMUM
        result = move.result
    return result.state, result.multipliers


@pytest.mark.long
def test_a_fall_off_a_fold_is_seen() -> None:
    """Past b = 0.11257 there is no such branch; Newton converges to a certified minimum of another one."""
    state, multipliers = second_minimum(0.1125)
    band = state.band.with_half_width(0.113)
    other = solve(Problem(band), state.vector(), multipliers)
    assert other.certified
    assert other.energy == pytest.approx(1.04964, abs=1e-5)
    for b in (0.113, 0.2, 0.5):
        move = to_width(state, multipliers, b, Options())
        assert move.result.status is Status.LEFT_BRANCH, b
        assert not move.result.certified


@pytest.mark.long
def test_a_schedule_ends_at_a_fold_and_keeps_what_it_has(tmp_path: Path) -> None:
    text = (
        "name: fold\ntopology: {half_twists: 1}\nspectrum: {modes: 0, full_up_to: 0}\n"
        f"initial_guess: {{state: {SECOND}}}\nwidths: [0.1, 0.1125, 0.113, 0.2]\n"
    )
    outcome = solve_config(parse_config(text, "fold.yaml"), tmp_path)
    assert outcome.exit_code == 3
    assert [target.reached for target in outcome.targets] == [True, True, False, False]
    assert "the branch seems to turn back (fold) near b = 0.11256" in outcome.failures[0]
    states = outcome.run.states(all=True)
    assert states[-1].kind == "intermediate"
    assert 0.1125 < states[-1].half_width < 0.11257
    energies = [state.energy for state in states]
    assert energies == sorted(energies)
    assert any("not on the branch" in note for note in outcome.notes)
    assert solve_config(parse_config(text, "fold.yaml"), tmp_path).new_states == 0


@pytest.mark.parametrize("widths", [(0.2, 0.5, 1.5), (0.5,)])
@pytest.mark.parametrize("rule", list(Discretisation))
def test_long_steps_on_a_branch_are_not_cut(rule: Discretisation, widths: tuple[float, ...]) -> None:
    state, multipliers = load("pi-b0.1-N50")
    result = solve(Problem(with_rule(state, rule).band), state.vector(), multipliers.vector())
    for b in widths:
        before = result
        move = to_width(before.state, before.multipliers, b, Options())
        result = move.result
        assert result.certified, (b, result.message)
        plain = solve(Problem(before.state.band.with_half_width(b)), before.x, before.multipliers, Options())
        assert result.energy == plain.energy
        assert bool(move.events) == (b == 1.5)
    if widths[-1] == 1.5:
        assert [str(event) for event in move.events] == [
            "grid phase: slid until the inflection sat on a node"
        ]
