"""Configs of open strips, loads and schedules: what they resolve to, and what is wrong with them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from config_samples import GOOD, MINIMAL, STRIP, problems_of

from ribbon_cli.config import Leg, dump_resolved, parse_config, templates
from ribbon_cli.parts import CLOSED, Ends, Loads, Material, Parts
from ribbon_cli.study import plan_of, solve_config
from ribbon_cli.study.plan import Goal, goals

RING = "topology: {half_twists: 0}\ninitial_guess: {recipe: cylinder, segments: 50, half_width: 0.1}\n"
FREE = STRIP.replace("{span: 0.75}", "{end: free}")


def config(text: str):
    return parse_config(text, "strip.yaml")


def test_a_strip_says_what_its_problem_is_made_of() -> None:
    found = config(
        STRIP.replace("span: 0.75", "span: 3/4, lift: 0.1, tilt: pi/6, end: hinged, end_eta: 0.2")
        + "material: {natural_curvature: 2, poisson: 0.3}\n"
        "loads: {gravity: -1, gravity_direction: [3, 4, 0], end_force: [1, 2, 0]}\n"
    )
    ends = Ends(end="hinged", span=0.75, lift=0.1, tilt=math.pi / 6, end_eta=0.2)
    loads = Loads(gravity=-1.0, gravity_direction=(0.6, 0.8, 0.0), end_force=(1.0, 2.0, 0.0))
    assert found.parts == Parts(ends, Material(2.0, 0.3), loads)
    assert (found.open, found.sigma, found.half_twists) == (True, 0, 0)


@pytest.mark.parametrize(
    "text",
    [
        STRIP,
        templates()["strip"],
        FREE + "loads: {gravity: 1, gravity_direction: [1, 2, 0]}\n",
        STRIP + "loads: {gravity: 1, gravity_direction: [0.3, -0.4, 0]}\nmaterial: {poisson: 0.5}\n",
        STRIP
        + "schedule: [{shear: {to: 0.1, steps: 3}, lift: 0.1}, {arclength: {parameter: twist, to: -1}}]\n",
        STRIP + "schedule: [{arclength: {to: 0.2}}]\n",
        RING + "material: {natural_curvature: -1}\nschedule: [{natural_curvature: 0}, {half_width: 0.2}]\n",
    ],
)
def test_a_resolved_config_is_the_config(text: str) -> None:
    found = config(text)
    again = parse_config(dump_resolved(found), found.path)
    assert again.hash8() == found.hash8()
    assert replace(again, text=found.text, name=found.name, guess=found.guess) == found


def test_closed_bands_are_resolved_as_they_were() -> None:
    assert list(config(GOOD).resolved()) == [
        *(
            "name",
            "topology",
            "length",
            "discretisation",
            "initial_guess",
            "widths",
            "refinement",
            "spectrum",
        ),
        "contact",
    ]
    assert config(GOOD).parts == CLOSED
    branch = config(MINIMAL + "widths: {arclength: {to: 0.2}}\n").resolved()
    assert branch["widths"] == {"arclength": {"to": 0.2, "max_step": 0.1, "steps": 500}}
    assert branch == config(MINIMAL + "schedule: [{arclength: {to: 0.2}}]\n").resolved()


def test_what_differs_has_another_hash() -> None:
    texts = [
        STRIP,
        STRIP.replace("0.75", "0.7"),
        STRIP.replace("0.75", "0.75, end: hinged"),
        STRIP.replace("0.75", "0.75, tilt: 0.1"),
        STRIP + "loads: {gravity: 1}\n",
        STRIP + "material: {poisson: 0.1}\n",
        STRIP + "schedule: [{shear: 0.1}]\n",
        STRIP + "schedule: [{shear: {to: 0.1, steps: 2}}]\n",
        STRIP + "schedule: [{arclength: {parameter: shear, to: 0.1}}]\n",
    ]
    assert len({config(text).hash8() for text in texts}) == len(texts)


MISTAKES = [
    (
        STRIP.replace("0.75", "1.2, lift: 0.5"),
        "3:7: ends: cannot be reached: at (span, lift, shear) the end is 1.3 away from the start, "
        "which must be less than the length 1",
    ),
    (
        STRIP.replace("0.75", "1"),
        "3:7: ends: at (span, lift, shear) the end is 1 away from the start, the length 1, so that "
        "the strip is flat, and its rulings are undetermined: bring it nearer",
    ),
    (
        FREE,
        "3:7: ends: a strip with a free end is flat without loads or natural curvature, and its "
        "rulings are undetermined",
    ),
    (
        FREE + "loads: {end_force: [2, 0, 0]}\n",
        "3:7: ends: a strip with a free end is flat where it is pulled along its tangent, and its "
        "rulings are undetermined",
    ),
    (
        FREE.replace("{end", "{start: hinged, end") + "loads: {gravity: 1}\n",
        "3:7: ends: a strip with a hinged start and a free end hangs flat along its loads, and its "
        "rulings are undetermined",
    ),
    (
        STRIP.replace("0.75", "0.7, shear: 0.1"),
        "3:26: ends.shear: must be 0 at the start, where the recipe strip makes a planar shape, got"
        " 0.1: move shear in `schedule`",
    ),
    (
        STRIP.replace("0.75", "0.7, twist: pi/2"),
        "3:26: ends.twist: must be 0 at the start, where the recipe strip makes a planar shape, got"
        " 1.5708: move twist in `schedule`",
    ),
    (
        STRIP + "loads: {end_force: [0, 0, 1]}\n",
        "5:20: loads.end_force[2]: must be 0 at the start, where the recipe strip makes a planar "
        "shape, got 1: move end_force_z in `schedule`",
    ),
    (
        STRIP + "loads: {gravity: 1, gravity_direction: [0, 0, 1]}\n",
        "5:18: loads.gravity: must be 0 at the start, where the recipe strip makes a planar shape, "
        "got 1 along [0.0, 0.0, 1.0]: move gravity in `schedule`",
    ),
    (
        STRIP + "loads: {gravity_direction: [0, 0, 0]}\n",
        "5:28: loads.gravity_direction: must not be zero",
    ),
    (
        STRIP + "loads: {gravity_direction: [0, 1]}\n",
        "5:28: loads.gravity_direction: must be a list of three numbers, as [0, -1, 0], got a list of 2",
    ),
    (
        STRIP.replace("span: 0.75", "lift: 0"),
        "3:7: ends.span: is missing: give the end's place along the start's tangent",
    ),
    (
        STRIP.replace("ends: {span: 0.75}\n", ""),
        "1:1: ends: is missing: give where the strip's end is, as {span: 0.75}, or {end: free}",
    ),
    (
        FREE.replace("free", "free, twist: 1") + "loads: {gravity: 1}\n",
        "3:19: ends.twist: a free end has no twist: remove it",
    ),
    (
        STRIP.replace("span: 0.75", "span: 0.75, start: free"),
        "3:27: ends.start: must be clamped or hinged, got free",
    ),
    (
        STRIP + "material: {poisson: 0.6}\n",
        "5:21: material.poisson: must be at most 0.5, got 0.6",
    ),
    (
        STRIP + "material: {poisson: -1}\n",
        "5:21: material.poisson: must be > -1, got -1",
    ),
    (
        RING + "ends: {span: 1}\n",
        "3:7: ends: a closed band has no ends: remove it, or give topology: open",
    ),
    (
        RING + "loads: {gravity: 1}\n",
        "3:8: loads: a closed band has no frame that loads could have a direction in: remove it, or"
        " give topology: open",
    ),
    (
        MINIMAL + "material: {natural_curvature: 1}\n",
        "3:11: material.natural_curvature: a natural curvature turns over at the seam of a "
        "one-sided band: remove it",
    ),
    (
        STRIP.replace("open", "{half_twists: 1, open: true}"),
        "1:28: topology.open: does not go with half_twists: a strip is topology: open",
    ),
    (
        STRIP.replace("recipe: strip", "recipe: twist"),
        "4:25: initial_guess.recipe: twist does not fit the topology: needs half_twists 1 or -1, "
        "got open; take strip",
    ),
    (
        RING.replace("cylinder", "strip"),
        "2:25: initial_guess.recipe: strip does not fit the topology: needs topology open, got "
        "half_twists 0; take cylinder or eversion",
    ),
    (
        STRIP + "widths: [0.1]\nschedule: [{half_width: 0.1}]\n",
        "6:11: schedule: cannot be combined with widths, its short form: keep one of the two",
    ),
    (
        STRIP + "schedule: [{shaer: 0.1}]\n",
        "5:13: schedule[0].shaer: unknown key: did you mean shear?",
    ),
    (
        STRIP + "schedule: [{shear: {to: 0.1, step: 2}}]\n",
        "5:30: schedule[0].shear.step: unknown key: did you mean steps?",
    ),
    (
        RING + "schedule: [{twist: 1}]\n",
        "3:20: schedule[0].twist: a closed band has no twist; it has half_width, natural_curvature",
    ),
    (
        MINIMAL + "schedule: [{natural_curvature: 1}]\n",
        "3:32: schedule[0].natural_curvature: a one-sided band has no natural_curvature; it has half_width",
    ),
    (
        STRIP + "schedule: [{shear: 0.1}, {shear: 0.1}]\n",
        "5:26: schedule[1]: moves nothing: the leg begins at shear = 0.1",
    ),
    (
        STRIP + "schedule: [{shear: {to: 0.1, steps: 2}, lift: {to: 0.1, steps: 3}}]\n",
        "5:47: schedule[0].lift: takes 3 steps and shear 2: the parameters of one leg move together",
    ),
    (
        STRIP + "schedule: [{shear: 0.3}, {shear: 0.8}]\n",
        "5:26: schedule[1]: cannot be reached: at (span, lift, shear) the end is 1.09659 away from "
        "the start, which must be less than the length 1",
    ),
    (
        STRIP + "schedule: [{}, {shear: 0.05}]\n",
        "5:12: schedule[0]: moves nothing: it names no parameter",
    ),
    (
        STRIP + "schedule: [{half_width: 1}]\n",
        "5:25: schedule[0].half_width: must be < 1, the band's length, got 1",
    ),
    (
        STRIP + "schedule: [{arclength: {parameter: shear, to: 0.1, at: [0.1, 0.2]}}]\n",
        "5:62: schedule[0].arclength.at[1]: must be between 0 and 0.1, where the branch is followed, got 0.2",
    ),
    (
        STRIP + "schedule: [{arclength: {to: 0.1}}, {shear: 0.1}]\n",
        "5:24: schedule[0].arclength: must be the last leg",
    ),
    (
        STRIP + "schedule: [{shear: 0.1}, {arclength: {parameter: shear, to: 0.1}}]\n",
        "5:61: schedule[1].arclength.to: must differ from where it begins, got 0.1",
    ),
    (
        STRIP + "schedule: [{arclength: {to: 0}}]\n",
        "5:29: schedule[0].arclength.to: must be > 0, got 0",
    ),
    (
        STRIP + "schedule: [{arclength: {parameter: twits, to: 1}}]\n",
        "5:36: schedule[0].arclength.parameter: must be half_width, span, lift, shear, twist, tilt,"
        " gravity, end_force_x, end_force_y, end_force_z, point_force_x, point_force_y, "
        "point_force_z or natural_curvature, got twits, did you mean twist?",
    ),
    (
        RING + "schedule: [{arclength: {parameter: twist, to: 1}}]\n",
        "3:36: schedule[0].arclength.parameter: a closed band has no twist; it has half_width, "
        "natural_curvature",
    ),
]


@pytest.mark.parametrize(
    ("legs", "told"),
    [
        ("{twist: 90}", ["twist = 90 is 14.3 turns, as angles are in radians; 90 degrees are 1.5708"]),
        ("{arclength: {parameter: tilt, to: -30}}", ["tilt = -30 is 4.77 turns, as angles are in radians; "]),
        ("{twist: 2*pi, tilt: 0.5}", []),
    ],
)
def test_an_angle_that_may_be_in_degrees_is_noted(legs: str, told: list[str]) -> None:
    notes = [note for note in plan_of(config(f"{STRIP}schedule: [{legs}]\n")).notes if "radians" in note]
    assert len(notes) == len(told)
    assert all(map(str.startswith, notes, told))


@pytest.mark.parametrize(("text", "line"), MISTAKES)
def test_one_mistake_gives_one_message(text: str, line: str) -> None:
    assert problems_of(text, "s.yaml") == [f"s.yaml:{line}"]


def test_all_mistakes_are_told_at_once() -> None:
    lines = problems_of(
        "topology: open\nlength: 1\nends: {span: 0.75, start: free}\n"
        "material: {poisson: 1}\nloads: {point_at: 2}\nschedule: [{half_width: 0.1}]\nwidths: [0.1]\n",
        "s.yaml",
    )
    assert [line.split(": ")[1] for line in lines] == [
        *("initial_guess", "ends.start", "material.poisson", "loads.point_at", "schedule"),
    ]


# ---- legs and goals


def test_a_leg_moves_together_in_equal_steps() -> None:
    leg = Leg({"shear": 0.3, "lift": 0.0}, 3)
    steps = leg.targets({"shear": 0.0, "lift": -0.3, "span": 0.7})
    assert steps[-1] == {"shear": 0.3, "lift": 0.0}
    assert [step["shear"] for step in steps] == pytest.approx([0.1, 0.2, 0.3], rel=1e-15)
    assert [step["lift"] for step in steps] == pytest.approx([-0.2, -0.1, 0.0], rel=1e-15)
    assert Leg({"shear": -0.3}, 6).targets({"shear": 0.3})[2] == {"shear": 0.0}
    assert Leg({"shear": 0.3}).targets({"shear": 0.0}) == [{"shear": 0.3}]


def test_legs_are_named_and_numbered_by_what_they_move() -> None:
    found = config(
        STRIP
        + "schedule: [{shear: {to: 0.02, steps: 2}}, {half_width: 0.1, shear: 0}, {shear: 0.02}]\n"
        + "refinement: [50, 100]\n"
    )
    names = [stage.name for stage in plan_of(found).stages]
    assert names == [
        "strip",
        "shear = 0.01",
        "shear = 0.02",
        "shear = 0.02, refined to N = 100",
        "b = 0.1, shear = 0",
        "b = 0.1, shear = 0, refined to N = 100",
        "shear = 0.02 (visit 2)",
        "shear = 0.02 (visit 2), refined to N = 100",
    ]
    last = plan_of(found).stages[-1]
    assert (last.kind, last.half_width, last.segments) == ("equilibrium", 0.1, 100)
    assert (last.parameters["shear"], last.parameters["span"]) == (0.02, 0.75)
    assert found.last() == last.parameters


def test_a_first_leg_may_refine_where_the_schedule_begins() -> None:
    found = config(STRIP + "schedule: [{half_width: 0.05}, {half_width: 0.1}]\nrefinement: [50, 100]\n")
    assert [stage.name for stage in plan_of(found).stages] == [
        "strip",
        "b = 0.05, refined to N = 100",
        "b = 0.1",
        "b = 0.1, refined to N = 100",
    ]


def test_a_schedule_in_the_half_width_is_that_of_widths() -> None:
    listed = config(RING + "widths: {from: 0.1, to: 0.7, steps: 6}\n")
    legs = config(RING + "schedule: [{half_width: {to: 0.7, steps: 6}}]\n")
    assert [goal.name for goal in goals(listed, listed.start())][1:] == [
        goal.name for goal in goals(legs, legs.start())
    ]
    assert [goal.to["half_width"] for goal in goals(legs, legs.start())] == list(listed.widths[1:])
    assert listed.legs == tuple(Leg({"half_width": b}) for b in listed.widths)


def test_levels_may_be_those_of_some_half_widths() -> None:
    found = config(
        STRIP + "schedule: [{shear: 0.1}, {half_width: 0.1}]\nrefinement: {levels: [50, 100], at: [0.1]}\n"
    )
    assert [s.name for s in plan_of(found).stages if s.segments == 100] == ["b = 0.1, refined to N = 100"]


def test_a_step_that_fails_is_halved_in_all_that_it_moves() -> None:
    ways = Goal({"shear": 0.4, "twist": 1.0}).ways({"shear": 0.0, "twist": 0.0})
    assert ways[0] == ("shear = 0.4, twist = 1", {"shear": 0.4, "twist": 1.0})
    assert ways[2] == (
        "shear = 0.1, twist = 0.25 on the way to shear = 0.4, twist = 1",
        {"shear": 0.1, "twist": 0.25},
    )


def test_a_branch_comes_last_and_speaks_of_its_parameter() -> None:
    found = config(
        STRIP
        + "schedule: [{shear: 0.1}, {arclength: {parameter: twist, to: pi/2, at: [1], max_step: 0.2}}]\n"
    )
    assert found.arclength is not None
    assert (found.arclength.parameter, found.arclength.max_step) == ("twist", 0.2)
    assert [stage.name for stage in plan_of(found).stages][2:] == [
        "a branch followed towards twist = 1.57079632679, meeting twist = 1",
        "a branch followed towards twist = 1.57079632679",
    ]


def test_a_given_state_may_begin_a_schedule() -> None:
    text = STRIP.replace("recipe: strip, segments: 50, half_width: 0.05", "state: 'x:1'")
    found = config(text + "schedule: [{shear: 0.1}]\nrefinement: [50, 100]\n")
    unopened, opened = plan_of(found), plan_of(found, (0.05, 50))
    assert [stage.half_width for stage in unopened.stages] == [None, None, None]
    assert [stage.half_width for stage in opened.stages] == [0.05, 0.05, 0.05]
    assert "half_width" not in unopened.stages[0].parameters


def test_the_template_is_the_one_of_the_documentation() -> None:
    assert yaml.safe_load(templates()["strip"])["topology"] == "open"
    found = config(templates()["strip"])
    assert len(plan_of(found).stages) == 1 + 5 + 2 + 1 + 2


@pytest.mark.slow
def test_the_template_of_a_strip_reaches_all_that_it_asks_for(tmp_path: Path) -> None:
    outcome = solve_config(config(templates()["strip"]), tmp_path)
    assert outcome.exit_code == 0
    assert len(outcome.targets) == 10
    assert outcome.notes == ()
