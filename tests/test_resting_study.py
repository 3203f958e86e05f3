"""Studies with contact forces: schedules and `continue` through touch-down and lift-off, events, resume."""

from __future__ import annotations

import re
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import content_hashes, ribbon, ribbon_json, spawn, states_on_disk, stop_after

from ribbon_cli.config import ConfigError, parse_config
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import Motion, audit
from ribbon_cli.solver.status import Status
from ribbon_cli.study import solve_config, touch_down
from ribbon_cli.study.failure import Failure
from ribbon_cli.study.records import state_of
from ribbon_cli.study.stepping import step_to

CONFIG = """\
name: band
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 40, half_width: 1.5, steps: 8}
widths: [1.5, 1.55, 1.6]
spectrum: {modes: 0, full_up_to: 0}
contact: forces
"""
TOUCH = 1.54277


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A pi band of 40 facets that is widened until it rests on itself: its outcome and the folder of runs."""
    root = tmp_path_factory.mktemp("resting")
    return solve_config(parse_config(CONFIG, "band.yaml"), root), root


def _crossing(record) -> float:
    return audit(Shape.of(state_of(record)), 0.0).penetration / record.length


def test_a_schedule_goes_on_through_touch_down(solved):
    outcome, _ = solved
    run = outcome.run
    free, first, last = (run.load(target.label) for target in outcome.targets)
    assert outcome.exit_code == 0
    assert [target.half_width for target in outcome.targets] == [1.5, 1.55, 1.6]
    assert [len(state.contacts) for state in (free, first, last)] == [0, 2, 4]
    assert (free.self_contact, first.self_contact, last.self_contact) == (False, True, True)
    for state in (first, last):
        assert state.certified
        assert state.contacts.force.min() > 0.0
        assert np.abs(state.contacts.value).max() < 1e-11
        assert max(_crossing(state), state.contacts.penetration / state.length) <= 1e-9
    assert 0.0 < first.contacts.total_force < last.contacts.total_force
    assert last.events[-1] == "2 contacts become 4 between b = 1.55 and b = 1.6 (0 end, 2 begin)"
    assert last.event_kinds[-1] == "contacts-change"


def test_touch_down_is_located_from_the_free_side(solved):
    outcome, _ = solved
    (met,) = [state for state in outcome.run.states(all=True) if "touch" in state.event_kinds]
    assert (met.kind, met.certified, met.contacts, met.self_contact) == ("intermediate", True, 0, False)
    assert met.half_width == pytest.approx(TOUCH, abs=2e-6)
    assert 0.0 < met.clearance < 1e-4
    assert met.stage == "touch between b = 1.5 and b = 1.55"
    told = re.fullmatch(r"contact begins at b = (\S+) \(bracket (\S+)\)", met.events[-1])
    assert told is not None
    assert float(told[1]) == pytest.approx(met.half_width, rel=1e-11)
    assert float(told[2]) <= 1e-6


def test_touch_down_is_located_though_an_index_is_unknown(
    solved, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """On fine grids sliding may be too soft for a free state to settle: where it touches is known still."""
    shutil.copytree(solved[1], tmp_path / "runs")
    monkeypatch.chdir(tmp_path)

    def undecided(*given):
        end = step_to(*given)
        if isinstance(end, Failure):
            return end
        result = replace(end.result, status=Status.UNDECIDED, negative=None, detail="(So soft.)")
        return Failure("step", Status.UNDECIDED, result.detail, attempt=replace(end, result=result))

    monkeypatch.setattr(touch_down, "step_to", undecided)
    found = ribbon_json("continue", "band@b=1.5", "--to", "1.55", "--contact", "forces")
    touch, end = found["points"]
    assert (touch["type"], touch["status"], end["status"]) == ("touch", "undecided", "minimum")
    assert touch["half_width"] == pytest.approx(TOUCH, abs=2e-6)


def test_no_step_passes_through_the_band(solved):
    """Every state of the schedule against its parent, over all pairs; resting sheets slide a little."""
    outcome, _ = solved
    run = outcome.run
    named = [run.load(s.label) for s in run.states(all=True) if s.stage.startswith(("b =", "touch"))]
    assert len(named) == 3
    for state in named:
        motion = Motion(Shape.of(state_of(run.load(state.parent))), Shape.of(state_of(state)))
        met = motion.passages()
        assert not len(met) or motion.depth(met) < 1e-4 * state.length


def test_lift_off_on_the_way_back(solved, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """`continue` goes on with forces from a state that has some, and names where the band lifts."""
    shutil.copytree(solved[1], tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    line = ("continue", "band@b=1.55", "--to", "1.53")
    found = ribbon_json(*line)
    assert [point["type"] for point in found["points"]] == ["lift", "width"]
    assert [point["contacts"] for point in found["points"]] == [0, 0]
    lifted, end = found["points"]
    assert lifted["half_width"] == pytest.approx(TOUCH, abs=2e-6)
    assert (end["half_width"], end["status"]) == (1.53, "minimum")
    assert found["end"]["reason"] == "range"
    again = ribbon_json(*line)
    assert (again["new_states"], again["points"]) == (0, found["points"])
    (met,) = [s for s in ribbon_json("ls", "band", "--all") if "lift" in s["event_kinds"]]
    assert met["half_width"] == lifted["half_width"]


@pytest.mark.long
def test_continue_through_touch_down(solved, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    shutil.copytree(solved[1], tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    found = ribbon_json("continue", "band@b=1.5", "--to", "1.6", "--contact", "forces")
    assert [point["type"] for point in found["points"]] == ["touch", "width"]
    assert found["points"][0]["half_width"] == pytest.approx(TOUCH, abs=2e-6)
    known = solved[0].run.load(solved[0].targets[-1].label)
    assert found["points"][1]["energy"] == pytest.approx(known.energy, rel=1e-9)
    assert found["points"][1]["contact_force"] == pytest.approx(known.contacts.total_force, rel=1e-6)
    stopped = ribbon_json("continue", "band@b=1.5", "--to", "1.6", "--stop-at", "contact")
    assert stopped["end"]["reason"] == "contact"
    assert stopped["end"]["half_width"] == found["points"][0]["half_width"]
    assert stopped["new_states"] == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--contact", "record"), "rests on itself with 2 contacts, and without their forces"),
        (("--contact", "gap=0.01"), "rests on itself with 2 contacts at a gap of 0, which cannot be changed"),
    ],
)
def test_contacts_are_not_left_behind(solved, words, said):
    told = ribbon("continue", "band@b=1.55", "--to", "1.53", *words, "--runs", solved[1])
    assert told.exit_code == 2
    assert said in told.stderr
    assert len(told.stderr.splitlines()) <= 2  # which state was taken, and why nothing is done


@pytest.mark.long
def test_killed_and_resumed(solved, tmp_path: Path):
    """Killed in every stage from the first without contact on, and resumed: the same bytes."""
    (tmp_path / "band.yaml").write_text(CONFIG)
    expected = content_hashes(solved[1])
    for wanted in (len(expected) - 3, len(expected) - 1):
        with spawn("solve", "band.yaml", "-q", cwd=tmp_path) as process:
            stop_after(process, tmp_path, wanted, signal.SIGKILL)
        assert states_on_disk(tmp_path) >= wanted
    outcome = solve_config(parse_config(CONFIG, "band.yaml"), tmp_path / "runs")
    assert outcome.exit_code == 0
    assert content_hashes(tmp_path / "runs") == expected


@pytest.mark.long
def test_arclength_through_touch_down(solved, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    shutil.copytree(solved[1], tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    found = ribbon_json("continue", "band@b=1.5", "--to", "1.55", "--arclength", "--contact", "forces")
    touch, beyond, end = found["points"][-3:]
    assert (touch["type"], touch["contacts"]) == ("touch", 0)
    assert touch["half_width"] == pytest.approx(TOUCH, abs=2e-6)
    assert 0.0 < beyond["contact_force"] < end["contact_force"]
    known = solved[0].run.load(solved[0].targets[1].label)
    assert (end["half_width"], end["negative_eigenvalues"]) == (1.55, 0)
    assert end["energy"] == pytest.approx(known.energy, rel=1e-10)
    stopped = ribbon_json(
        *(
            "continue",
            "band@b=1.5",
            "--to",
            "1.55",
            "--arclength",
            "--contact",
            "forces",
            "--stop-at",
            "contact",
        )
    )
    assert (stopped["end"]["reason"], stopped["end"]["half_width"]) == ("contact", touch["half_width"])
    assert stopped["new_states"] == 0


@pytest.mark.long
def test_arclength_from_set_to_set_killed_and_resumed(
    solved, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """Where a second pair of contacts begins: the same states as step by step, and after a kill."""
    line = ("continue", "band@b=1.55", "--to", "1.6", "--arclength")
    ends = []
    for name in ("alone", "killed"):
        shutil.copytree(solved[1], tmp_path / name / "runs")
        monkeypatch.chdir(tmp_path / name)
        if name == "killed":
            with spawn(*line, "-q", cwd=tmp_path / name) as process:
                stop_after(process, tmp_path / name, len(content_hashes(solved[1])) + 2, signal.SIGKILL)
            assert process.returncode == -signal.SIGKILL
        ends.append((ribbon_json(*line)["points"], content_hashes(Path("runs"))))
    assert ends[0] == ends[1]
    points = ends[0][0]
    known = solved[0].run.load(solved[0].targets[-1].label)
    assert {point["type"] for point in points[:-1]} == {"step"}
    assert points[-1]["energy"] == pytest.approx(known.energy, rel=1e-10)
    assert points[-1]["contact_force"] == pytest.approx(known.contacts.total_force, rel=1e-7)
    assert [point["contacts"] for point in points] == sorted(point["contacts"] for point in points)
    told = [event for state in ribbon_json("ls", "band", "--all") for event in state["events"]]
    assert any(event.startswith("2 contacts become 4 between b = 1.584") for event in told)


@pytest.mark.long
def test_a_wide_guess_is_made_narrow_and_widened(solved, tmp_path: Path):
    text = CONFIG.replace("half_width: 1.5", "half_width: 1.6").replace("[1.5, 1.55, 1.6]", "[1.6]")
    outcome = solve_config(parse_config(text, "band.yaml"), tmp_path)
    assert outcome.exit_code == 0
    known = solved[0].run.load(solved[0].targets[-1].label)
    states = {state.stage: state for state in outcome.run.states(all=True)}
    narrow, wide = states["twisted band freed at b = 0.8"], states["twisted band freed"]
    assert (narrow.kind, narrow.contacts, narrow.half_width) == ("intermediate", 0, 0.8)
    assert (wide.kind, wide.contacts, wide.half_width) == ("equilibrium", 4, 1.6)
    assert wide.energy == pytest.approx(known.energy, rel=1e-10)
    assert solve_config(parse_config(text, "band.yaml"), tmp_path).new_states == 0


@pytest.mark.long
def test_a_study_begins_at_a_state_that_rests_on_itself(solved, tmp_path: Path):
    given = CONFIG.replace(
        "{recipe: twist, segments: 40, half_width: 1.5, steps: 8}", '{state: "band@b=1.6"}'
    )
    text = given.replace("name: band", "name: on").replace("[1.5, 1.55, 1.6]", "[1.6, 1.59]")
    outcome = solve_config(parse_config(text, "on.yaml"), tmp_path, references=solved[1])
    known = solved[0].run.load(solved[0].targets[-1].label)
    first, last = (outcome.run.load(target.label) for target in outcome.targets)
    assert first.energy == pytest.approx(known.energy, rel=1e-12)
    assert first.contacts.keys() == known.contacts.keys()
    assert (last.certified, len(last.contacts)) == (True, 4)
    without = parse_config(text.replace("contact: forces", "contact: stop"), "on.yaml")
    with pytest.raises(ConfigError, match="rests on itself with 4 contacts: it takes `contact: forces`"):
        solve_config(without, tmp_path / "other", references=solved[1])


@pytest.mark.long
def test_a_guess_that_passes_through_itself_without_contact_is_let_down_with_it(tmp_path):
    """Seven half-twists: on its way down the free band changes its linking number."""
    text = CONFIG.replace("half_twists: 1", "half_twists: 7").replace("[1.5, 1.55, 1.6]", "[0.0125]")
    text = re.sub(
        "initial_guess: .*", "initial_guess: {recipe: schoenke, segments: 60, half_width: 0.0125}", text
    )
    outcome = solve_config(parse_config(text, "seven.yaml"), tmp_path)
    assert outcome.exit_code == 0
    (target,) = outcome.targets
    state = outcome.run.load(target.label)
    assert state.certified
    assert len(state.contacts) > 0
    assert state.linking_number == pytest.approx(3.5, abs=1e-9)
    assert _crossing(state) <= 1e-9
