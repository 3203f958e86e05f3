"""Strips in equilibrium against closed forms and a boundary-value solver: `tests/references`, docs/strips.md.

References are continuous; energies and reactions tend to them at order 2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import curved, heavy
from references.helix import Helix, whole_turns
from references.planar import buckled, euler_load
from strip_support import HALF_WIDTH, Array, band, minimum, orders, planar, reactions_of

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.problem import Problem
from ribbon_cli.parts import FREE, Ends, Loads, Material, Parts
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.newton import Options, solve


def richardson(coarse: Array, middle: Array, fine: Array) -> Array:
    """The limit of three values, N doubling, whose errors are in h^2 and, from the ends, h^3."""
    once, twice = (4.0 * middle - coarse) / 3.0, (4.0 * fine - middle) / 3.0
    out: Array = (8.0 * twice - once) / 7.0
    return out


def buckled_errors(span: float, levels: list[int]) -> Array:
    """Relative errors (levels, 3) of energy, force and moment between clamps."""
    exact, out = buckled(span, HALF_WIDTH), []
    for n in levels:
        found = planar(band(n, Ends(span=span)))
        acting = reactions_of(found)
        out.append([found.energy, acting.force[0], acting.moment[2]])
    wanted = np.array([exact.energy, exact.force[0], exact.moment[2]])
    return np.array(out) / wanted - 1.0


@pytest.mark.parametrize("span", [0.95, 0.5, 0.2])
def test_the_buckled_strip_tends_to_the_elastica(span: float) -> None:
    errors = buckled_errors(span, [50, 100])
    assert orders(errors) == pytest.approx(2.0, abs=0.05)
    assert errors[-1] == pytest.approx(0.0, abs=3e-3)


@pytest.mark.large
@pytest.mark.parametrize("span", [0.95, 0.8, 0.65, 0.5, 0.35, 0.2])
def test_the_buckled_strip_tends_to_the_elastica_at_every_level(span: float) -> None:
    assert orders(buckled_errors(span, [50, 100, 200, 400])) == pytest.approx(2.0, abs=0.05)


def test_as_the_strip_becomes_straight_its_end_pushes_with_eulers_load() -> None:
    short = [0.01, 0.02, 0.04]
    forces = []
    for missing in short:
        levels = [reactions_of(planar(band(n, Ends(span=1.0 - missing)))).force for n in (24, 48, 96)]
        forces.append(richardson(*levels)[0])
    straight = np.polyfit(short, forces, 2)[-1]
    assert straight == pytest.approx(euler_load(HALF_WIDTH), rel=1e-5)


def on_helix(helix: Helix, n: int) -> State:
    """The helix's frames at the middles of N facets, between clamps that lie on it."""
    place = helix.point(1.0)
    ends = Ends(span=place[0], lift=place[1], shear=place[2], start_eta=helix.eta, end_eta=helix.eta)
    frames = np.array([helix.frame((i + 0.5) / n) for i in range(n)])
    g = np.tile(helix.ruling(0.0), (n, 1))
    return State(band(n, ends), frames[:, :, 0], g, np.zeros(n), g[0].copy())


@pytest.mark.parametrize(("eta", "turns"), [(0.3, 1), (-0.5, 1), (0.3, 2)])
def test_the_helix_between_clamps_on_it(eta: float, turns: int) -> None:
    helix = whole_turns(eta, HALF_WIDTH, turns)
    errors = []
    for n in (100, 200):
        found = minimum(on_helix(helix, n))
        acting = reactions_of(found)
        pairs = (
            (acting.force, helix.force),
            (acting.moment, helix.moment),
            (acting.start_force, -helix.force),
            (acting.start_moment, helix.start_moment),
        )
        errors.append([abs(found.energy - helix.energy), *(np.linalg.norm(a - b) for a, b in pairs)])
    assert orders(errors) == pytest.approx(2.0, abs=0.05)
    assert max(errors[-1]) < 2e-3 * helix.energy


def extrapolated(strip: Band) -> tuple[float, Array]:
    """Energy, and reactions at both ends (12,), as N tends to infinity."""
    rows = []
    for n in (strip.segments, 2 * strip.segments, 4 * strip.segments):
        found = planar(strip.with_segments(n))
        acting = reactions_of(found)
        rows.append(
            np.concatenate(
                ([found.energy], acting.force, acting.moment, acting.start_force, acting.start_moment)
            )
        )
    limit = richardson(*rows)
    return float(limit[0]), limit[1:]


def check(strip: Band, expected: heavy.Heavy) -> None:
    energy, acting = extrapolated(strip)
    assert energy == pytest.approx(expected.energy, rel=1e-6)
    force = np.zeros(3) if strip.parts.ends.end == FREE else expected.force  # a load there is no reaction
    wanted = np.concatenate((force, expected.moment, expected.start_force, expected.start_moment))
    assert np.abs(acting - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.parametrize("gravity", [5.0, 40.0])
def test_the_heavy_strip_between_clamps(gravity: float) -> None:
    strip = band(50, Ends(span=0.7, tilt=0.1, lift=0.05), loads=Loads(gravity))
    check(strip, heavy.clamped_clamped(0.7, HALF_WIDTH, gravity, lift=0.05, tilt=0.1))


@pytest.mark.parametrize(("gravity", "force"), [(20.0, (0.0, 0.0)), (4.0, (-0.1, 0.2))])
def test_the_heavy_cantilever_with_an_end_force(gravity: float, force: tuple[float, float]) -> None:
    strip = band(50, Ends(end=FREE), loads=Loads(gravity, end_force=(*force, 0.0)))
    check(strip, heavy.cantilever(HALF_WIDTH, gravity, end_force=force))


@pytest.mark.parametrize("rule", Discretisation)
def test_the_ring_with_natural_curvature(rule: Discretisation) -> None:
    errors = []
    for n in (50, 100):
        parts = Parts(material=Material(-2.5, 0.3))
        ring = cylinder(Band(n, 0.2, sigma=1, discretisation=rule))
        state = replace(ring, band=replace(ring.band, parts=parts))
        found = solve(Problem(state.band), state.vector(), None, Options(leave_saddles=0))
        assert found.energy == pytest.approx(curved.discrete_ring_energy(n, 0.2, -2.5), rel=1e-13)
        errors.append([found.energy - curved.ring_energy(0.2, -2.5)])
    assert orders(errors) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("natural", [0.0, 3.0, -4.0])
def test_the_arc_of_facets_is_an_equilibrium_to_rounding(natural: float) -> None:
    n, turn = 24, 0.06
    arc = curved.FoldedArc(n, turn, HALF_WIDTH, natural)
    ends = Ends(span=arc.span, lift=arc.lift, tilt=arc.tilt)
    u = np.column_stack((np.cos(arc.angles), np.sin(arc.angles), np.zeros(n)))
    g = np.tile(np.array([0.0, 0.0, 1.0]), (n, 1))
    found = minimum(State(band(n, ends, material=Material(natural, 0.3)), u, g, np.zeros(n), g[0].copy()))
    assert np.abs(found.state.u - u).max() < 1e-12
    assert found.energy == pytest.approx(arc.energy, rel=1e-12)
    acting = reactions_of(found)
    assert acting.moment == pytest.approx([0.0, 0.0, arc.moment], abs=1e-11)
    assert acting.start_moment == pytest.approx([0.0, 0.0, -arc.moment], abs=1e-11)
    assert acting.force == pytest.approx(np.zeros(3), abs=1e-11)
