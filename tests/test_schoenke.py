"""The n-inflection construction: closed forms, closure, linking numbers, and the bands that come of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ribbon_cli.config import RECIPES, parse_config
from ribbon_cli.model.band import Band
from ribbon_cli.model.folding import ClosureError
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.topology import linking_number
from ribbon_cli.recipes.schoenke import best_unit, schoenke, unit, widest
from ribbon_cli.study import plan_of, solve_config

LENGTH = 2.0 * math.pi
CONFIG = """
name: construction
topology: {{half_twists: {half_twists}}}
initial_guess: {{recipe: schoenke, segments: {segments}, half_width: {half_width}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""


def band(half_twists: int, segments: int, share: float) -> Band:
    """A band of a share of the widest."""
    n = abs(half_twists)
    return Band(segments, share * widest(n, LENGTH), LENGTH, (-1) ** n)


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation about a unit axis."""
    k = np.cross(np.eye(3), axis)
    result: np.ndarray = np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k
    return result


@pytest.mark.parametrize("n", range(3, 10))
def test_a_unit_and_a_half_turn_rotate_by_a_full_turn_over_n(n: int) -> None:
    """The frame condition, and the midline's: a unit moves along no axis but turns about one."""
    for share in (0.1, 0.5, 0.9):
        piece = best_unit(n, share * widest(n, LENGTH), LENGTH)
        axis = np.array([piece.eta, 0.0, 1.0]) / math.hypot(1.0, piece.eta)
        turn = rotation(axis, piece.turn)
        tangent = np.array([1.0, 0.0, 0.0])
        whole = turn @ np.diag([1.0, -1.0, -1.0])
        assert np.trace(whole) == pytest.approx(1 + 2 * math.cos(2 * math.pi / n), abs=1e-12)
        # End of the unit's midline: flat, arc (integral of the turned tangent), flat.
        along = (tangent @ axis) * axis
        across = tangent - along
        radius = piece.arc / piece.turn
        swept = along * piece.arc + radius * (
            math.sin(piece.turn) * across + (1 - math.cos(piece.turn)) * np.cross(axis, across)
        )
        end = piece.flat * (tangent + turn @ tangent) + swept
        values, vectors = np.linalg.eig(whole)
        fixed = vectors[:, np.argmin(np.abs(values - 1))].real
        assert end @ fixed == pytest.approx(0.0, abs=1e-12)
        assert n * (2 * piece.flat + piece.arc) == pytest.approx(LENGTH, rel=1e-13)


@pytest.mark.parametrize("n", range(3, 10))
def test_the_best_unit_is_the_one_of_least_energy_that_keeps_rulings_apart(n: int) -> None:
    for share in (0.05, 0.4, 0.8):
        b = share * widest(n, LENGTH)
        best = best_unit(n, b, LENGTH)
        allowed = (0.9 + 0.1 * share) * best.width
        assert b == pytest.approx(allowed, rel=1e-9)
        for turn in np.linspace(math.pi + 1e-3, best.turn + 0.3, 200):
            try:
                other = unit(n, float(turn), LENGTH)
            except ValueError:
                continue
            if other.flat > 0 and b <= (0.9 + 0.1 * share) * other.width:
                assert other.energy(b) >= best.energy(b) * (1 - 1e-12)


def test_the_widest_triangle_is_folded_from_a_strip_of_aspect_root_three() -> None:
    assert LENGTH / (2 * widest(3, LENGTH)) == pytest.approx(math.sqrt(3), rel=1e-14)
    for n in range(3, 12):
        assert unit(n, math.pi + 1e-6, LENGTH).width == pytest.approx(widest(n, LENGTH), rel=1e-4)
        assert RECIPES["schoenke"].widest(n) * LENGTH == pytest.approx(widest(n, LENGTH), rel=1e-14)


@pytest.mark.parametrize("n", range(3, 10))
@pytest.mark.parametrize("hand", [1, -1])
def test_it_closes_with_the_linking_number_asked_for(n: int, hand: int) -> None:
    """Lk = n/2 for both hands, also on grids that n does not divide."""
    for segments in (8 * n, 8 * n + 1, 40 * n + 7):
        for share in (0.05, 0.5):
            strip = band(n, segments, share)
            state = schoenke(strip, hand * n)
            assert np.abs(Problem(strip).constraints(state.vector())).max() < 1e-12
            found = linking_number(state.u, state.g, strip.sigma, strip.h)
            assert found.linking_number == pytest.approx(hand * n / 2, abs=1e-9)


def test_the_left_handed_band_is_the_mirror_image() -> None:
    right, left = (schoenke(band(5, 60, 0.3), n) for n in (5, -5))
    mirror = np.diag([1.0, -1.0, 1.0])  # facet 1's frame is the standard one
    assert np.allclose(right.u @ mirror, left.u, atol=1e-10)
    assert np.allclose(right.g @ mirror, left.g, atol=1e-10)
    assert np.allclose(right.xi, left.xi, atol=1e-10)


def test_its_energy_is_that_of_the_pieces() -> None:
    strip = band(3, 2400, 0.1)
    made = Problem(strip).energy(schoenke(strip, 3).vector())
    piece = best_unit(3, strip.half_width, LENGTH)
    assert made == pytest.approx(3 * piece.energy(strip.half_width), rel=5e-3)


def test_what_cannot_be_constructed() -> None:
    with pytest.raises(ValueError, match="at least 3 half-twists"):
        schoenke(Band(60, 0.1), 2)
    with pytest.raises(ValueError, match="sigma -1"):
        schoenke(Band(60, 0.1), 3)
    with pytest.raises(ValueError, match=r"half-width below 1\.8138, got 1\.9"):
        schoenke(Band(60, 1.9, sigma=-1), 3)
    with pytest.raises(ClosureError):
        schoenke(band(3, 24, 0.95), 3)


def solved(root: Path, half_twists: int, segments: int, half_width: float, more: str = ""):
    text = CONFIG.format(half_twists=half_twists, segments=segments, half_width=half_width) + more
    return solve_config(parse_config(text, "construction.yaml"), root)


@pytest.mark.parametrize("hand", [1, -1])
def test_the_three_pi_band(tmp_path: Path, hand: int) -> None:
    """Certified, Lk = 3/2, three inflections, and the symmetry of a third, which nothing imposes."""
    outcome = solved(tmp_path, 3 * hand, 60, 0.2, "widths: [0.2, 0.4, 0.65]\nrefinement: [60, 120]\n")
    assert outcome.exit_code == 0
    for target in outcome.targets:
        record = outcome.run.load(target.label or 0)
        assert record.certified
        assert record.linking_number == pytest.approx(1.5 * hand, abs=1e-6)
        third = record.segments // 3
        for values, sign in ((record.kappa_s, -1.0), (record.tau, 1.0)):
            # kappa changes sign across the seam as well, tau does not.
            again = np.concatenate((values, (sign**3) * values))[third : third + record.segments]
            assert np.abs(again - sign * values).max() < 1e-6 * np.abs(values).max()
        closed = np.append(record.kappa_s, -record.kappa_s[0])
        assert int((np.sign(closed[1:]) != np.sign(closed[:-1])).sum()) == 3
    states = outcome.run.states(all=True)
    assert (states[0].stage, states[0].status, states[0].kind) == (
        "construction",
        "constructed",
        "auxiliary",
    )


@pytest.mark.long
def test_the_five_pi_band_is_a_saddle_and_kept_as_one(tmp_path: Path) -> None:
    """Index n - 3 = 2: the ways down lead through the band itself, which is no success."""
    outcome = solved(tmp_path, 5, 80, 0.1)
    assert outcome.exit_code == 3
    (state,) = outcome.run.states()
    assert (state.status, state.certified, state.negative_eigenvalues) == ("saddle", False, 2)
    assert state.linking_number == pytest.approx(2.5, abs=1e-6)
    assert "passed through itself" in outcome.failures[0]
    again = solved(tmp_path, 5, 80, 0.1)
    assert (again.new_states, again.exit_code) == (0, 3)


def test_a_mesh_that_does_not_divide_is_told_and_one_too_coarse_is_refused(tmp_path: Path) -> None:
    text = CONFIG.format(half_twists=3, segments=50, half_width=0.1)
    config = parse_config(text, "construction.yaml")
    assert "50 segments do not divide into 3 equal units" in plan_of(config).notes[0]
    outcome = solve_config(config, tmp_path)
    assert outcome.exit_code == 0
    assert "do not divide" in outcome.notes[0]
    coarse = solved(tmp_path, 3, 24, 1.75)
    assert coarse.exit_code == 3
    assert "take more segments, or a narrower band" in coarse.failures[0]
    assert coarse.run.states(all=True) == []
