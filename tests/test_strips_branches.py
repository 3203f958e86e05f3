"""Folds and branch points of strips: located, with their indices, and followed to both sides.

The strip spans 0.9 and its end is turned. On this coarse grid its branch in the twist has a branch point at
0.561 and a fold at 0.575; in the half-width, at twist 0.55, at 0.0511 and 0.0525.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import pytest
from strip_points import branch_point_in_span, vertex_in_span
from strip_support import band, planar, walked

from ribbon_cli.config import parse_config
from ribbon_cli.model.band import Discretisation
from ribbon_cli.parts import Ends
from ribbon_cli.solver.arclength import Point, Tangent, initial_tangent, point_of
from ribbon_cli.solver.branch import BranchOptions, advance
from ribbon_cli.solver.branch_events import Event
from ribbon_cli.solver.branch_switch import switch
from ribbon_cli.solver.status import Result, Status
from ribbon_cli.study import solve_config
from ribbon_cli.study.progress import Step


@lru_cache
def turned(twist: float) -> Result:
    """The minimum at half-width 0.05."""
    start = planar(band(24, Ends(span=0.9), rule=Discretisation.VALUE_AVERAGE))
    return walked(start, 5, twist=twist)


def followed(
    point: Point, tangent: Tangent, steps: int, options: BranchOptions
) -> tuple[list[Point], list[Event]]:
    """The points of a branch, and what happens on it."""
    points, events, length = [point], [], 0.03
    for _ in range(steps):
        made = advance(point, tangent, length, options)
        events += made.events
        if made.point is None:
            break
        point, tangent, length = made.point, made.tangent, made.following
        points.append(point)
    return points, events


@pytest.mark.parametrize(("parameter", "twist", "steps"), [("twist", 0.54, 9), ("half_width", 0.55, 7)])
def test_a_branch_point_and_a_fold_are_located_and_followed(parameter: str, twist: float, steps: int) -> None:
    start = turned(twist)
    point = point_of(start.state, start.multipliers, parameter)
    options = BranchOptions(0.5 * point.value, 1.5 * point.value)
    points, events = followed(point, initial_tangent(point, 1), steps, options)
    assert [(event.type, event.before, event.after) for event in events] == [
        ("branch-point", 0, 1),
        ("fold", 1, 2),
    ]
    crossing, fold = events
    # p is largest at the fold, and the branch goes on beyond it.
    assert fold.point.value > max(found.value for found in points)
    assert points[-1].value < fold.point.value
    assert points[-1].negative == 2
    for event in events:
        assert event.point.worst < 1e-9
    # dp/ds vanishes at the fold: the tangent there is the soft mode.
    assert abs(fold.tangent.value) < 1e-6 * abs(crossing.tangent.value)

    assert crossing.mode is not None
    sides = []
    for side in (1, -1):
        met = switch(crossing.point, crossing.tangent, crossing.mode.tangent, side)
        onward, _ = followed(met.point, met.tangent, 2, options)
        assert len(onward) == 3
        assert all(found.worst < 1e-9 and found.negative is not None for found in onward)
        sides.append(onward)
    # The crossing branch leaves to both sides of this one.
    apart = [side[-1].x - crossing.point.x for side in sides]
    assert apart[0] @ apart[1] < 0.0


def test_a_pitchforks_vertex_under_span_is_a_branch_point() -> None:
    """The lifted strip that is not symmetric under the half turn turns back where it meets those that are."""
    vertex, crossed = vertex_in_span(24), branch_point_in_span(24)
    assert abs(vertex.tangent.value) < 1e-4
    assert vertex.point.value == pytest.approx(crossed.point.value, abs=1e-9)
    assert vertex.point.energy == pytest.approx(crossed.point.energy, rel=1e-7)


SHEARED = """\
topology: open
length: 1
discretisation: value-average
ends: {span: 0.75}
initial_guess: {recipe: strip, segments: 24, half_width: 0.1}
schedule:
  - {shear: 0.125}
  - {arclength: {parameter: shear, to: 0.13, switch: 1}}
spectrum: {modes: 1, full_up_to: 0}
"""


@pytest.mark.slow
def test_a_schedule_ends_in_a_branch_that_is_left_to_both_sides(tmp_path: Path) -> None:
    told: list[object] = []
    outcome = solve_config(parse_config(SHEARED, "sheared.yaml"), tmp_path, progress=told.append)
    assert outcome.exit_code == 0
    assert any(isinstance(event, Step) and event.place.startswith("shear = 0.12") for event in told)
    main, *others = outcome.branches
    crossings = [point for point in main.points if point.type == "branch-point"]
    assert [(point.index_before, point.index_after) for point in crossings] == [(0, 1)]
    assert crossings[0].parameters["shear"] == pytest.approx(0.128898, abs=1e-6)
    assert len(others) == 2
    for course in others:
        assert [point.parameters["shear"] for point in course.points][-1] == 0.13
        assert course.points[-1].status == Status.MINIMUM.value
    # A half turn takes one side to the other.
    ends = [course.points[-1].energy for course in others]
    assert ends[0] == pytest.approx(ends[1], rel=1e-10)
    assert ends[0] < main.points[-1].energy
