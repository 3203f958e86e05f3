"""Spectra of 3 pi bands and of the everted cylinder: pairs, what the grid splits, checkerboards, groups."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from numeric_support import Array, load, with_rule
from spectral_support import Place, settled

from ribbon_cli.model.band import Discretisation
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.symmetry import SymmetryGroup, find_symmetries
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.newton import Options
from ribbon_cli.solver.spectra import Spectrum, lowest_spectrum

VALUE_AVERAGE, THESIS = Discretisation.VALUE_AVERAGE, Discretisation.THESIS
CHAIN = {120: 60, 240: 120, 480: 240, 100: 60, 200: 100, 400: 200}


@cache
def three_pi(segments: int, rule: Discretisation = VALUE_AVERAGE) -> Place:
    """The 3 pi band at b = 0.3."""
    if segments == 60:
        return settled(with_rule(load("3pi-b0.3-N60")[0], rule))
    coarse = three_pi(CHAIN[segments], rule).result.state
    result = to_segments(coarse, segments, Options()).result
    return Place(Problem(result.state.band), result)


@cache
def spectrum(segments: int, rule: Discretisation = VALUE_AVERAGE) -> Spectrum:
    place = three_pi(segments, rule)
    assert place.result.certified
    return lowest_spectrum(place.problem, place.x, place.local, "physical", 14)


def modes(found: Spectrum, label: str = "mode") -> Array:
    return found.values[[k for k, word in enumerate(found.labels) if word == label]]


def group(segments: int) -> SymmetryGroup:
    return find_symmetries(three_pi(segments).result.state)


def test_three_divides_n() -> None:
    """The lowest six: two pairs, one single mode, and sliding, which falls."""
    found = [spectrum(n) for n in (60, 120, 240, 480)]
    assert {group(n).name for n in (60, 120, 240)} == {"D3"}
    five = np.array([modes(s)[:5] for s in found])
    assert (np.abs(five[-1] - five[-2]) < 5e-3 * five[-1]).all()
    for first in (0, 2):
        assert five[:, first] == pytest.approx(five[:, first + 1], rel=1e-8)
    sliding = [float(modes(s, "sliding")[0]) for s in found]
    assert all(b < 0.5 * a for a, b in itertools.pairwise(sliding))
    assert all(s.sliding_overlap.max() > 0.99 for s in found)


def test_three_does_not_divide_n() -> None:
    """The grid keeps one half-turn of D3: pairs split, at second order; sliding is small and irregular."""
    found = {n: spectrum(n) for n in (100, 200, 400)}
    splits, residuals = [], []
    for n, each in found.items():
        symmetries = group(n)
        assert (symmetries.name, symmetries.near_name) == ("C2", "D3")
        residuals.append(symmetries.near_residual or 0.0)
        pair = modes(each)[:2]
        splits.append((pair[1] - pair[0]) / pair[0])
        assert each.sliding_overlap.max() > 0.99
        assert abs(float(modes(each, "sliding")[0])) < 1e-5
    assert all(0.2 < b / a < 0.35 for a, b in itertools.pairwise(splits))
    assert residuals == sorted(residuals, reverse=True)
    assert modes(found[400])[:5] == pytest.approx(modes(spectrum(480))[:5], rel=5e-3)


def test_checkerboards_of_the_3pi_band() -> None:
    """Found under `thesis` alone; without them the two rules agree."""
    found = spectrum(100, THESIS)
    checkerboards = [k for k, label in enumerate(found.labels) if label == "checkerboard"]
    assert checkerboards
    assert (found.hidden[checkerboards] > 0.9).all()
    left = np.delete(found.values, checkerboards)
    kept = left > 0.01  # sliding is tiny, and a matter of the grid
    assert left[kept] == pytest.approx(spectrum(100).values[: left.size][kept], rel=0.02)


def test_the_everted_cylinder_has_a_mirror() -> None:
    found = find_symmetries(load("everted-b0.04-N40")[0])
    assert (found.name, found.order) == ("C2h", 4)
    assert sorted(s.name for s in found.exact) == ["C2", "E", "i", "sigma"]
    assert found.residual < 1e-9
