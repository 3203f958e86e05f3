"""Reactions of strips out of the plane: work at every parameter, and the balance of forces and moments."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from strip_support import Array, band, minimum, planar, reactions_of, walked

from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.ends import displacement, rotation
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.rates import rates
from ribbon_cli.parts import FINISHES, FREE, HALF_WIDTH, PARAMETERS, STARTS, Ends, Loads, Material
from ribbon_cli.solver.status import Result

LOADS = Loads(3.0, (0.0, -0.8, 0.6), (0.2, -0.1, 0.15), (0.3, -0.2, 0.1), 0.43)
CURVED = Material(1.5, 0.3)


@lru_cache
def loaded(
    start: str = "clamped", end: str = "clamped", rule: Discretisation = Discretisation.THESIS
) -> Result:
    """A strip with every load, with natural curvature, and with its end everywhere off the plane."""
    flat = Loads(3.0, end_force=(0.2, -0.1, 0.0))
    ends = Ends(start, end, 0.7) if end != FREE else Ends(start, end)
    found = planar(band(24, ends, loads=flat, material=CURVED, rule=rule))
    parts = replace(found.state.band.parts, loads=replace(LOADS, point_force=(0.0, 0.0, 0.0)))
    skew = replace(found.state, band=replace(found.state.band, parts=parts))
    found = minimum(skew)
    place = {} if end == FREE else {"span": 0.68, "lift": 0.06, "shear": 0.05, "twist": 0.2, "tilt": 0.15}
    force = {f"point_force_{axis}": value for axis, value in zip("xyz", LOADS.point_force, strict=True)}
    there = found.state.band
    for name, value in (place | force).items():
        there = there.with_parameter(name, value)
    return minimum(found.state.on(there))


def energy_at(found: Result, name: str, by: float) -> float:
    return walked(found, **{name: found.state.band.parameter(name) + by}).energy


@pytest.mark.parametrize("name", PARAMETERS)
def test_the_energys_slope_in_a_parameter_is_its_rate(name: str) -> None:
    """By differences of order 4 of neighbouring minima; places and turns do the work of the end's clamp."""
    found = loaded(rule=Discretisation.VALUE_AVERAGE)
    problem = Problem(found.state.band)
    rate = rates(problem, found.x, found.multipliers, problem.gradient(found.x), name).lagrangian
    step = 0.004 * (0.1 if name == HALF_WIDTH else 1.0)
    near, far = (
        (energy_at(found, name, k * step) - energy_at(found, name, -k * step)) / (2 * k * step)
        for k in (1, 2)
    )
    slope = (4.0 * near - far) / 3.0
    acting = reactions_of(found)
    ends = found.state.band.parts.ends
    assert ends is not None
    turned = rotation(replace(ends, tilt=0.0))
    work = {
        "span": acting.force[0],
        "lift": acting.force[1],
        "shear": acting.force[2],
        "twist": acting.moment[0],
        "tilt": acting.moment @ turned[:, 2],
    }
    if name in work:
        assert work[name] == pytest.approx(rate, rel=1e-9, abs=1e-11)
    size = max(np.linalg.norm(acting.force), np.linalg.norm(acting.moment), abs(rate))
    assert slope == pytest.approx(rate, abs=1e-6 * size)


def moments_of_area(state: State) -> tuple[float, Array]:
    """Area and first moment int r da (3,) of a strip, summed over triangles of its facets and its corner."""
    strip, b = state.band, state.band.half_width
    nodes = np.vstack((np.zeros(3), np.cumsum(strip.h * state.u, axis=0)))
    rulings = np.vstack((state.g, state.g_end))
    left, right = nodes + b * rulings, nodes - b * rulings
    triangles = [(left[i], right[i], right[i + 1]) for i in range(strip.segments)]
    triangles += [(left[i], right[i + 1], left[i + 1]) for i in range(strip.segments)]
    ends = strip.parts.ends
    assert ends is not None
    area, moment = 0.0, np.zeros(3)
    normals = [np.cross(b_ - a, c - a) for a, b_, c in triangles]
    for (a, b_, c), normal in zip(triangles, normals, strict=True):
        size = 0.5 * float(np.linalg.norm(normal))
        area, moment = area + size, moment + size * (a + b_ + c) / 3.0
    if ends.end == FREE:
        # From the last ruling to the edge at right angles: two triangles, one of them cut off.
        u, g = state.u[-1], rulings[-1]
        eta, tip = float(u @ g), nodes[-1]
        across = g - eta * u
        for side in (1.0, -1.0):
            corners = tip + side * b * g + tip + side * b * across + tip
            moment = moment - side * 0.5 * eta * b**2 * corners / 3.0
    return area, moment


@pytest.mark.parametrize("rule", Discretisation)
@pytest.mark.parametrize(("start", "end"), [(start, end) for start in STARTS for end in FINISHES])
def test_forces_and_moments_at_both_ends_balance_the_loads(
    start: str, end: str, rule: Discretisation
) -> None:
    found = loaded(start, end, rule)
    state, loads, acting = found.state, found.state.band.parts.loads, reactions_of(found)
    nodes = np.vstack((np.zeros(3), np.cumsum(state.band.h * state.u, axis=0)))
    tip = nodes[-1]
    ends = state.band.parts.ends
    assert ends is not None
    if end != FREE:
        assert tip == pytest.approx(displacement(ends), abs=1e-11)
    at = loads.point_at * state.band.segments
    point = nodes[int(at)] + (at - int(at)) * (nodes[int(at) + 1] - nodes[int(at)])
    area, moment = moments_of_area(state)
    assert area == pytest.approx(2.0 * state.band.half_width, rel=1e-12)
    down, pull, push = (np.array(v) for v in (loads.gravity_direction, loads.end_force, loads.point_force))
    weight = loads.gravity * down / np.linalg.norm(down)
    forces = acting.force + acting.start_force + area * weight + pull + push
    turning = acting.moment + acting.start_moment + np.cross(tip, acting.force + pull)
    turning += np.cross(moment, weight) + np.cross(point, push)
    assert np.abs(forces).max() < 1e-9
    assert np.abs(turning).max() < 1e-9
    for held, moment_there, ruling in (
        (start, acting.start_moment, state.g[0]),
        (end, acting.moment, state.g_end),
    ):
        if held == "hinged":
            assert moment_there @ ruling == pytest.approx(0.0, abs=1e-9)
    if end == FREE:
        assert not acting.force.any()
        assert not acting.moment.any()


def test_a_closed_band_has_no_reactions() -> None:
    from ribbon_cli.model.reactions import reactions

    problem = Problem(Band(9, 0.1))
    with pytest.raises(ValueError, match="no ends"):
        reactions(problem, np.zeros(problem.size), np.zeros(problem.rows))
