"""States that were lost, and marked by a repair, are computed again: a study ends as if none had been."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from ribbon_cli.config import parse_config
from ribbon_cli.errors import StoreError
from ribbon_cli.solver.status import Status
from ribbon_cli.store import Run
from ribbon_cli.store.log import format_line
from ribbon_cli.study import solve_config, stepping
from ribbon_cli.verify import judge_runs

SPECTRUM = "spectrum: {modes: 0, full_up_to: 0}\n"

# Of the twist's one step, and of the step in width, the whole fails and parts succeed.
HALVED = """\
name: halved
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 20, half_width: 0.3, steps: 1}
widths: [0.4]
"""

EVERTED = """\
name: everted
topology: {half_twists: 0}
initial_guess: {recipe: eversion, segments: 40, half_width: 0.03, steps: 2}
widths: [0.03]
"""

CONSTRUCTED = """\
name: constructed
topology: {half_twists: -3}
initial_guess: {recipe: schoenke, segments: 24, half_width: 0.2}
widths: [0.2, 0.25]
refinement: [24, 48]
"""

BRANCH = f"""\
name: branch
topology: {{half_twists: 1}}
initial_guess: {{state: {Path(__file__).parent / "data" / "pi-b0.1-N50-second-minimum.npz"}}}
widths: {{arclength: {{to: 0.12, back_to: 0.105, at: [0.11]}}}}
"""


@pytest.fixture
def short_steps(monkeypatch):
    """Steps of more than 0.06 in b fail."""
    honest = stepping.to_band

    def fragile(state, multipliers, band, *rest):
        move = honest(state, multipliers, band, *rest)
        if abs(band.half_width - state.band.half_width) > 0.06:
            return replace(move, result=replace(move.result, status=Status.ITERATION_LIMIT))
        return move

    monkeypatch.setattr(stepping, "to_band", fragile)


def stages(run: Run) -> dict[str, int]:
    """Labels of the states that end stages, by stage."""
    return {state.stage: state.label for state in run.states(all=True) if state.kind != "saddle"}


def lose(run: Run, *labels: int) -> None:
    for label in labels:
        run.state_path(label).unlink()
    assert run.repair() == [f"states/{label:04d}.h5 is missing: marked as lost" for label in labels]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(HALVED, id="twist"),
        pytest.param(EVERTED, id="eversion", marks=pytest.mark.faults),
        pytest.param(CONSTRUCTED, id="schoenke", marks=pytest.mark.faults),
    ],
)
def test_whichever_state_is_lost_the_study_ends_the_same(text, tmp_path, short_steps, monkeypatch):
    config = parse_config(text + SPECTRUM, "band.yaml")
    whole = solve_config(config, tmp_path / "whole").run
    for stage, label in stages(whole).items():
        root = tmp_path / f"without-{label}"
        shutil.copytree(tmp_path / "whole", root)
        run = Run.open(root / whole.name)
        lose(run, label)
        again = solve_config(config, root)
        assert again.failures == (), stage
        # A halved step on the way to what is there is not needed any more.
        assert again.new_states == ("0.25/1" not in stage and "0.625/1" not in stage and "way" not in stage)
        pairs = judge_runs(whole, Run.open(run.path))
        assert all(pair.equal for pair in pairs if pair.stage != stage or again.new_states), stage
        with monkeypatch.context() as patch:
            patch.delattr(Run, "writing")  # what is finished is passed over without the lock
            assert solve_config(config, root).new_states == 0


@pytest.mark.parametrize("parent", [None, 2, 3, 7, 0, -1, 2**62])
def test_no_parent_that_a_log_names_leads_astray(parent, tmp_path):
    """Be it the state itself or one that never was: that is damage, after whose repair nothing is computed
    again; nor is it where nobody is named."""
    config = parse_config(CONSTRUCTED + SPECTRUM, "band.yaml")
    first = solve_config(config, tmp_path)
    entries = [event.document for event in first.run.events()]
    (freed,) = (e for e in entries if e["event"] == "state" and e["state"]["stage"] == "construction freed")
    assert (freed["state"]["label"], freed["state"]["parent"]) == (2, 1)
    freed["state"]["parent"] = parent
    first.run.log_path.write_bytes(b"".join(map(format_line, entries)))
    if parent is not None:
        with pytest.raises(StoreError, match=f"log.jsonl:3: damaged line: state {parent}, the parent of"):
            solve_config(config, tmp_path)
        assert first.run.repair()
    again = solve_config(config, tmp_path)
    assert again.new_states == 0
    assert again.targets == first.targets


def test_the_state_before_a_halved_step_may_be_lost(tmp_path, short_steps, monkeypatch):
    """Where to go on from there is read off what is stored, and no label that is gone is asked for."""
    config = parse_config(HALVED + SPECTRUM, "band.yaml")
    whole = solve_config(config, tmp_path / "whole").run
    commit = Run.commit_soon

    def interrupted(run, label, make):
        commit(run, label, make)
        if "on the way" in make.args[0].stage:
            run.settle()
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Run, "commit_soon", interrupted)
        with pytest.raises(KeyboardInterrupt):
            solve_config(config, tmp_path / "killed")
    run = Run.open(tmp_path / "killed" / whole.name)
    lose(run, stages(run)["twisted band freed"])
    assert solve_config(config, tmp_path / "killed").failures == ()
    assert all(pair.equal for pair in judge_runs(whole, Run.open(run.path)))


@pytest.mark.faults
def test_events_of_a_branch_that_were_lost_are_met_again(tmp_path):
    """A fold or a width that was asked for lies within a step, whose end is stored all the same."""
    config = parse_config(BRANCH + SPECTRUM, "band.yaml")
    first = solve_config(config, tmp_path)
    (course,) = first.branches
    events = [point for point in course.points if point.type != "step"]
    assert [point.type for point in events] == ["width", "fold", "width", "width"]
    lose(Run.open(first.run.path), *(point.label for point in events))
    again = solve_config(config, tmp_path)
    assert again.new_states == len(events)
    (found,) = again.branches
    assert [replace(point, label=0) for point in found.points] == [
        replace(point, label=0) for point in course.points
    ]
    assert solve_config(config, tmp_path).branches == again.branches
    assert solve_config(config, tmp_path).new_states == 0


MET = f"""\
name: met
topology: {{half_twists: -1}}
initial_guess: {{state: {Path(__file__).parent / "data" / "pi-b0.1-N50-saddle.npz"}}}
"""


def test_a_saddle_that_is_lost_is_met_again(tmp_path):
    """Though the state that ended its stage is stored: that one stays, and the saddle is as it was."""
    config = parse_config(MET + SPECTRUM, "band.yaml")
    whole = solve_config(config, tmp_path).run
    (saddle,) = (state for state in whole.states(all=True) if state.kind == "saddle")
    before = whole.load(saddle.label)
    lose(Run.open(whole.path), saddle.label)
    again = solve_config(config, tmp_path)
    assert again.new_states == 1
    (met,) = (state for state in again.run.states(all=True) if state.kind == "saddle")
    assert met.stage == saddle.stage
    assert again.run.load(met.label).energy == before.energy
    assert [target.label for target in again.targets] == [1 + saddle.label]
    assert solve_config(config, tmp_path).new_states == 0


def test_the_missing_file_of_a_saddle_is_noticed(tmp_path):
    """As a missing equilibrium is, though the state that ended the saddle's stage is there."""
    config = parse_config(MET + SPECTRUM, "band.yaml")
    run = solve_config(config, tmp_path).run
    (saddle,) = (state for state in run.states(all=True) if state.kind == "saddle")
    Run.open(run.path).state_path(saddle.label).unlink()
    with pytest.raises(StoreError, match=r"0001\.h5: "):
        solve_config(config, tmp_path)
