"""Strips out of the plane: limits N -> infinity under both rules, which agree within their error bars."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import pytest
import yaml
from strip_support import band, minimum, planar, refined

from ribbon_cli.config import load_config, parse_config
from ribbon_cli.model.band import Discretisation
from ribbon_cli.model.problem import Problem
from ribbon_cli.parts import Ends
from ribbon_cli.report.convergence import Entry, Extrapolation, convergence_rows
from ribbon_cli.solver.status import Result
from ribbon_cli.solver.steps import inverted_facets
from ribbon_cli.study import solve_config

CONFIGS = Path(__file__).parents[1] / "configs" / "strips"
LIMITS = {
    ("twist", math.pi / 2, 0.05): 2.451464,
    ("twist", math.pi / 2, 0.1): 5.127349,
    ("twist", math.pi, 0.05): 3.1976407,
    ("twist", math.pi, 0.1): 8.3726438,
    ("shear", 0.3, 0.05): 1.1304459,
    ("shear", 0.3, 0.1): 2.7124566,
}
"""By parameter, its value and the half-width; the span is 0.5 with a twist and 0.75 with a shear."""
THROUGH = """
schedule:
  - {span: 0.75}
  - {shear: {to: 0.3, steps: 6}}
  - {half_width: 0.1}
refinement: {levels: [100, 200, 400, 800], at: [0.05, 0.1]}
spectrum: {modes: 0, full_up_to: 0}
"""
"""The way to the limits in shear; the config of that name goes farther, on coarser meshes."""
SHEARED = {
    (0.05, 100): 1.130650388,
    (0.05, 200): 1.130552431,
    (0.1, 100): 2.709928432,
    (0.1, 200): 2.711924365,
}
"""Energies under the thesis' rule by CasADi and IPOPT, at shear 0.3."""


@lru_cache
def sheared(half_width: float, rule: Discretisation) -> tuple[Result, ...]:
    """The strip at span 0.75, buckled, sheared by 0.3 at once, and refined: N = 50, 100, 200."""
    flat = planar(band(50, Ends(span=0.75), half_width=half_width, rule=rule))
    found = [minimum(flat.state.on(flat.state.band.with_parameter("shear", 0.3)))]
    for n in (100, 200):
        found.append(refined(found[-1], n))
    for each in found:
        assert (inverted_facets(Problem(each.state.band), each.x) > 0.0).all()
    return tuple(found)


@pytest.mark.parametrize("half_width", [0.05, 0.1])
def test_sheared_strips_have_the_energies_that_ipopt_finds(half_width: float) -> None:
    for found in sheared(half_width, Discretisation.THESIS)[1:]:
        assert found.energy == pytest.approx(SHEARED[half_width, found.state.band.segments], abs=1e-9)


@pytest.mark.parametrize("rule", Discretisation)
@pytest.mark.parametrize("half_width", [0.05, 0.1])
def test_coarse_strips_are_near_their_limit(half_width: float, rule: Discretisation) -> None:
    coarse, fine = sheared(half_width, rule)[1:]
    limit = (4.0 * fine.energy - coarse.energy) / 3.0
    assert limit == pytest.approx(LIMITS["shear", 0.3, half_width], rel=1e-4)


def limits(name: str, rule: str, folder: Path) -> dict[tuple[str, float, float], Extrapolation]:
    """The limits at the ends of a config's legs, under a rule."""
    data = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"))
    data |= {"name": f"{name}-{rule}", "discretisation": rule}
    data |= yaml.safe_load(THROUGH) if name == "sheared" else {}
    outcome = solve_config(parse_config(yaml.safe_dump(data), f"{name}.yaml"), folder)
    assert outcome.exit_code == 0
    parameter = "twist" if name == "twisted" else "shear"
    states = [state for state in outcome.run.states() if state.kind == "equilibrium"]
    assert all(state.certified and not state.inverted_facets for state in states)
    found = {}
    for known, value, half_width in LIMITS:
        if known != parameter:
            continue
        entries = [
            Entry(half_width, state.segments, state.energy, state.certified)
            for state in states
            if state.half_width == half_width and abs((state.parameters[parameter] or 0.0) - value) < 1e-12
        ]
        found[known, value, half_width] = convergence_rows(entries, 1.0).extrapolations[0]
    return found


@pytest.mark.large
@pytest.mark.parametrize("name", ["twisted", "sheared"])
def test_the_limits_under_both_rules_agree(name: str, tmp_path: Path, figure: Callable[[str], None]) -> None:
    by_rule = [limits(name, rule.value, tmp_path) for rule in Discretisation]
    for place in by_rule[0]:
        one, other = (found[place] for found in by_rule)
        assert one.energy is not None
        assert one.error is not None
        assert other.energy is not None
        assert other.error is not None
        figure(f"{place}: {one.energy:.9g} +- {one.error:.1e}, {other.energy:.9g} +- {other.error:.1e}")
        assert max(one.error, other.error) < 1e-4 * one.energy
        assert abs(one.energy - other.energy) <= one.error + other.error
        assert one.energy == pytest.approx(LIMITS[place], abs=one.error + 1e-6)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_configs_of_strips_are_valid(path: Path) -> None:
    assert load_config(path).open


@pytest.mark.large
@pytest.mark.parametrize("name", ["buckled", "hanging", "straightened", "cantilever"])
def test_the_configs_of_strips_come_to_their_end(name: str, tmp_path: Path) -> None:
    outcome = solve_config(load_config(CONFIGS / f"{name}.yaml"), tmp_path)
    assert outcome.exit_code == 0
    assert all(target.certified for target in outcome.targets)


def test_the_config_with_a_point_load_comes_to_its_end(tmp_path: Path) -> None:
    outcome = solve_config(load_config(CONFIGS / "point-load.yaml"), tmp_path)
    assert outcome.exit_code == 0
    last = list(outcome.run.states())[-1]
    assert (last.segments, last.parameters["point_force_y"]) == (48, -0.8)
    # The clamps carry the load, each the half of it.
    record = outcome.run.load(last.label)
    assert record.reaction_force[1] == pytest.approx(0.4, abs=1e-9)
    assert record.start_force[1] == pytest.approx(0.4, abs=1e-9)
