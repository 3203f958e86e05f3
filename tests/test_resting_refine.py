"""Bands that rest on themselves, on finer grids."""

from __future__ import annotations

import numpy as np
import pytest
from resting_support import DATA, resting

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.topology import linking_number
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_gaps import arguments, gaps, vectors
from ribbon_cli.solver.newton import solve
from ribbon_cli.solver.prolongation import divided
from ribbon_cli.solver.resting_refine import _finer, resting_refined
from ribbon_cli.solver.resting_set import NoRestError, Rest, found, moved, rest_at, slopes, way_between


def test_facets_cut_into_parts_are_the_same_surface():
    """Constraints hold, what touches has the same gaps, and no way leads through itself."""
    for name in ("pi-b1.65-N100", "3pi-b0.9-N120"):
        state, pairs, *_ = resting(name)
        for parts in (2, 3):
            finer = divided(state, parts)
            assert np.abs(Problem(finer.band).constraints(finer.vector())).max() < 1e-9
            every = _finer(pairs, parts)
            what = arguments(every)
            value = gaps(vectors(Shape.of(finer), what), what, every.sign, finer.band.half_width).value
            assert np.abs(value).max() < 1e-10
            way = way_between(state, finer)
            assert way.after.segments == parts * state.band.segments
            assert way.depth(way.passages()) < 1e-12


def test_other_grids_are_refused():
    state, pairs, force, _ = resting("pi-b1.65-N100")
    rest = rest_at(state, np.zeros(503), pairs, force)
    with pytest.raises(NoRestError, match="N = 150 is no multiple of 100"):
        resting_refined(rest, 150)


def _wider(rest: Rest, half_width: float) -> Rest:
    while rest.band.half_width < half_width - 1e-12:
        by = min(0.01, half_width - rest.band.half_width)
        along, band = slopes(rest), rest.band.with_half_width(rest.band.half_width + by)
        try:
            rest = moved(rest, band, by, along)
        except NoRestError:
            rest = found(rest, band, by, along)
    return rest


@pytest.mark.long
def test_refined_bands_are_those_found_on_the_fine_grid():
    """From N = 50 to 100 at two widths; at b = 1.65 the energy is that known from another program."""
    with np.load(DATA / "pi-b1.5-N50-free.npz") as kept:
        band = Band(50, float(kept["half_width"]), sigma=-1)
        state = State(band, kept["u"], kept["g"], kept["xi"])
    rest = rest_at(state, solve(Problem(band), state.vector()).multipliers)
    for half_width, energy in ((1.55, 49.4011244160), (1.65, resting("pi-b1.65-N100")[3])):
        rest = _wider(rest, half_width)
        finer = resting_refined(rest, 100)
        assert finer.result.certified
        assert finer.result.energy == pytest.approx(energy, rel=1e-10)
        assert finer.audit.penetration <= 1e-9
        links = [linking_number(s.u, s.g, -1, s.band.h).linking_number for s in (rest.state, finer.state)]
        assert links[0] == pytest.approx(links[1], abs=1e-9)
        way = way_between(rest.state, finer.state)
        assert way.depth(way.passages()) <= 1e-4 * rest.band.length
