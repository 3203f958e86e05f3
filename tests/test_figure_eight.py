"""The recipe figure-eight: Euler's elastica lifted at its crossing, and the band at rest next to it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from cli_support import ribbon
from scipy.integrate import quad

from ribbon_cli import solve
from ribbon_cli.config import parse_config
from ribbon_cli.errors import UsageError
from ribbon_cli.model.band import Band
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.topology import linking_number
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.recipes import RECIPES
from ribbon_cli.recipes.figure_eight import LIFT, figure_eight, height, lifted, modulus
from ribbon_cli.recipes.recipe import Making, NotMadeError

CONFIG = """\
name: eight
topology: {half_twists: 2}
initial_guess: {recipe: figure-eight, segments: 24, half_width: 0.05}
widths: [0.05]
spectrum: {modes: 0, full_up_to: 0}
contact: forces
"""


def elastica_energy() -> float:
    """The energy of the planar figure-eight, in that of the ring of the same length."""
    m = modulus()
    quarter = scipy.special.ellipk(m)

    def square(s: float) -> float:
        return float(
            (2.0 * math.sqrt(m) * 4.0 * quarter * scipy.special.ellipj(4.0 * quarter * s, m)[1]) ** 2
        )

    return quad(square, 0.0, 1.0)[0] / (2.0 * math.pi) ** 2


def test_the_modulus_is_that_of_the_closed_elastica():
    m = modulus()
    assert m == pytest.approx(0.826114766, abs=1e-9)
    assert elastica_energy() == pytest.approx(16.0 * scipy.special.ellipk(m) ** 2 * (m - 0.5) / math.pi**2)


@pytest.mark.parametrize("half_twists", [2, -2])
@pytest.mark.parametrize("segments", [40, 86])
def test_the_guess_is_a_closed_band_that_touches_nothing(segments, half_twists):
    band = Band(segments, 0.07, sigma=1)
    state = figure_eight(band, half_twists)
    problem = Problem(band)
    assert np.abs(problem.constraints(state.vector())).max() < 1e-12
    found = linking_number(state.u, state.g, 1, band.h)
    assert found.linking_number == pytest.approx(0.5 * half_twists, abs=1e-9)
    assert height(state) == pytest.approx(LIFT * 2.0 * band.half_width)
    seen = audit(Shape.of(state))
    assert seen.penetration == 0.0
    assert seen.clearance == pytest.approx((LIFT - 1.0) * 2.0 * band.half_width, rel=1e-5)


def test_unlifted_it_tends_to_the_elastica_at_second_order():
    errors = []
    for segments in (40, 80, 160):
        band = Band(segments, 0.1, sigma=1)
        energy = Problem(band).energy(lifted(band, 0.0).vector()) / (math.pi * band.half_width)
        errors.append(elastica_energy() - energy)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.02)
    assert errors[2] < 1e-3 * elastica_energy()


def test_both_hands_are_mirror_images():
    """Turned about the first facet's normal they have opposite eta and the same fold angles."""
    band = Band(30, 0.1, sigma=1)
    right, left = figure_eight(band, 2), figure_eight(band, -2)
    eta = [np.einsum("ij,ij->i", state.u, state.g) for state in (right, left)]
    np.testing.assert_allclose(eta[0], -eta[1], atol=1e-10)
    energies = [Problem(band).energy(state.vector()) for state in (right, left)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)


def test_what_cannot_be_lifted_is_not_made():
    (making,) = RECIPES["figure-eight"].way(Band(40, 0.3, sigma=1), 2, {}).parts
    assert isinstance(making, Making)
    with pytest.raises(NotMadeError, match="take a narrower band"):
        making.make(0, None)
    with pytest.raises(ValueError, match="two half-twists"):
        figure_eight(Band(40, 0.1, sigma=-1), 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("contact: forces", "contact: stop", "3:25: initial_guess.recipe: figure-eight rests on itself from"),
        ("contact: forces\n", "", "3:25: initial_guess.recipe: figure-eight rests on itself from"),
        (
            "half_twists: 2",
            "half_twists: 4",
            "figure-eight does not fit the topology: needs half_twists 2 or -2",
        ),
        ("segments: 24", "segments: 31", "must be even"),
        ("segments: 24", "segments: 18", "at least 20"),
    ],
)
def test_one_line_for_what_does_not_fit(old, new, message, tmp_path):
    with pytest.raises(UsageError) as raised:
        parse_config(CONFIG.replace(old, new), "eight.yaml")
    assert message in str(raised.value)
    path = tmp_path / "eight.yaml"
    path.write_text(CONFIG.replace(old, new), encoding="utf-8")
    done = ribbon("check", path)
    assert done.exit_code == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_it_rests_on_itself_at_its_crossing(tmp_path):
    run = solve(parse_config(CONFIG, "eight"), runs=tmp_path).run
    assert [state.kind for state in run.states(all=True)] == ["auxiliary", "equilibrium"]
    state = run.load(2)
    assert state.certified
    assert state.linking_number == pytest.approx(1.0, abs=1e-9)
    # The upper side of the lower sheet bears the lower side of the upper one.
    (pair,) = state.contacts.keys()
    assert (pair[0], pair[2]) == (1, 1)
    assert {pair[1] % 3, pair[3] % 3} == {1, 2}
    assert state.contacts.total_force == pytest.approx(0.0026524, rel=1e-3)
    assert state.energy / (math.pi * 0.05) == pytest.approx(elastica_energy(), rel=0.04)
