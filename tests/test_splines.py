"""The closed splines are scipy's, to the last bit, and are had without its `interpolate`."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from ribbon_cli.model.splines import PeriodicSpline


def _pair(seed: int, shape: tuple[int, ...]) -> tuple[PeriodicSpline, CubicSpline]:
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 60))
    steps = np.full(count, 0.1) if seed % 2 else random.uniform(0.1, 1.0, count)
    knots = np.concatenate(([0.3], 0.3 + np.cumsum(steps)))
    values = random.standard_normal((count, *shape))
    values = np.concatenate((values, values[:1]))
    return PeriodicSpline(knots, values), CubicSpline(knots, values, bc_type="periodic")


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
def test_values_and_derivatives_are_scipys(shape: tuple[int, ...]) -> None:
    for seed in range(20):
        ours, theirs = _pair(seed, shape)
        np.testing.assert_array_equal(ours.coefficients, theirs.c)
        places = np.concatenate((np.linspace(-9.0, 30.0, 101), ours.knots))
        for derivative in range(3):
            np.testing.assert_array_equal(ours(places, derivative), theirs(places, derivative))


def test_roots_are_scipys() -> None:
    found = 0
    for seed in range(60):
        ours, theirs = _pair(seed, ())
        roots = ours.roots()
        np.testing.assert_array_equal(roots, np.unique(theirs.roots(extrapolate=False)))
        found += roots.size
    assert found > 500


@pytest.mark.parametrize("values", [np.zeros(6), np.ones(6)])
def test_a_constant_has_no_root(values: np.ndarray) -> None:
    assert PeriodicSpline(np.arange(6.0), values).roots().size == 0


def test_a_root_at_a_knot_is_found_once() -> None:
    s = np.arange(13.0)
    roots = PeriodicSpline(s, np.sin(np.pi * s / 6.0)).roots()
    np.testing.assert_allclose(np.unique(roots.round(12)), [0.0, 6.0, 12.0], atol=1e-12)


def test_a_closed_band_is_refined_without_scipys_interpolation_and_trees() -> None:
    code = """
import sys
import numpy as np
from ribbon_cli.model.band import Band
from ribbon_cli.model.topology import linking_number
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.prolongation import inflections, smooth

state = smooth(cylinder(Band(12, 0.1)), 24).state
linking_number(state.u, state.g, 1, state.band.h)
inflections(np.cos(np.arange(12.0)), state.band)
print(sorted(m for m in sys.modules if m in ("scipy.interpolate", "scipy.spatial")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
