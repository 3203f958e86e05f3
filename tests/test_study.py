"""Configs run from guess to refinement: schedules, halving, given states, contact, missed targets."""

from __future__ import annotations

import atexit
import subprocess
import sys
from functools import cache
from pathlib import Path
from shutil import copytree, rmtree
from tempfile import mkdtemp

import pytest
from store_support import make_record

from ribbon_cli.analysis import run_table
from ribbon_cli.config import Config, ConfigError, parse_config
from ribbon_cli.errors import LockedError, UsageError
from ribbon_cli.store import Run, encode
from ribbon_cli.study import Outcome, given_band, plan_of, refine_state, solve_config, standing
from ribbon_cli.study.progress import Event, Note, Stage

SMALL = """
name: small
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 20, half_width: 0.3, steps: 8}
spectrum: {modes: 0, full_up_to: 0}
"""


def config(text: str, name: str = "small.yaml") -> Config:
    return parse_config(text, name)


@cache
def small_runs() -> Path:
    """A folder with the run of SMALL, which many tests go on from."""
    root = Path(mkdtemp(prefix="small-"))
    atexit.register(rmtree, root, ignore_errors=True)
    assert solve_config(config(SMALL), root).exit_code == 0
    return root


def solve_small(root: Path) -> Outcome:
    """SMALL as solved before: in a copy of its run nothing is new."""
    copytree(small_runs(), root, dirs_exist_ok=True)
    return solve_config(config(SMALL), root)


class Recorder:
    """A progress that remembers."""

    def __init__(self) -> None:
        self.stages: list[tuple[str, int, int]] = []
        self.notes: list[str] = []

    def __call__(self, event: Event) -> None:
        if isinstance(event, Stage):
            self.stages.append((event.name, event.index, event.total))
        elif isinstance(event, Note):
            self.notes.append(event.text)


def test_a_schedule_reaches_its_widths_and_levels(tmp_path: Path) -> None:
    text = SMALL + "widths: {from: 0.3, to: 0.5, steps: 2}\nrefinement: {levels: [20, 40], at: [0.5]}\n"
    watch = Recorder()
    outcome = solve_config(config(text), tmp_path, progress=watch)
    assert [(t.half_width, t.segments) for t in outcome.targets] == [
        (0.3, 20),
        (0.4, 20),
        (0.5, 20),
        (0.5, 40),
    ]
    assert all(t.certified for t in outcome.targets)
    assert outcome.exit_code == 0
    planned = plan_of(config(text)).stages
    assert [name for name, _, _ in watch.stages] == [stage.name for stage in planned]
    states = outcome.run.states(all=True)
    assert {s.kind for s in states} == {"auxiliary", "saddle", "equilibrium"}
    assert all(s.linking_number == pytest.approx(0.5, abs=1e-9) for s in states if s.kind != "auxiliary")


def test_a_schedule_goes_back_by_continuation(tmp_path: Path) -> None:
    """The second visit of a width is a solve of its own, from the state before it."""
    text = SMALL + "widths: [0.3, 0.4, 0.3]\nrefinement: [20, 40]\n"
    watch = Recorder()
    outcome = solve_config(config(text), tmp_path, progress=watch)
    assert outcome.exit_code == 0
    assert [(t.half_width, t.segments) for t in outcome.targets] == [
        (b, n) for b in (0.3, 0.4, 0.3) for n in (20, 40)
    ]
    labels = [t.label for t in outcome.targets]
    assert len(set(labels)) == 6
    records = [outcome.run.load(label) for label in labels]
    assert [r.stage for r in records[2:]] == [
        "b = 0.4",
        "b = 0.4, refined to N = 40",
        "b = 0.3 (visit 2)",
        "b = 0.3 (visit 2), refined to N = 40",
    ]
    assert [r.parent for r in records[1:]] == [labels[k] for k in (0, 0, 2, 2, 4)]
    assert records[4].energy == pytest.approx(records[0].energy, rel=1e-12)
    assert [name for name, _, _ in watch.stages] == [stage.name for stage in plan_of(config(text)).stages]
    assert solve_config(config(text), tmp_path).new_states == 0


def test_a_step_that_fails_is_halved_and_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of more than 0.06 in b are made to fail; the schedule gets there by halves and says so."""
    from dataclasses import replace

    from ribbon_cli.solver.status import Status
    from ribbon_cli.study import stepping as module

    honest = module.to_band

    def fragile(state, multipliers, band, *rest):
        move = honest(state, multipliers, band, *rest)
        if abs(band.half_width - state.band.half_width) > 0.06:
            return replace(move, result=replace(move.result, status=Status.ITERATION_LIMIT))
        return move

    monkeypatch.setattr(module, "to_band", fragile)
    outcome = solve_config(config(SMALL + "widths: [0.4]\n"), tmp_path)
    assert outcome.exit_code == 0
    states = outcome.run.states(all=True)
    widths = [(s.kind, s.half_width) for s in states if s.kind in ("intermediate", "equilibrium")]
    assert widths == [("intermediate", 0.3), ("intermediate", pytest.approx(0.35)), ("equilibrium", 0.4)]
    halved = next(s for s in states if s.half_width == pytest.approx(0.35))
    assert "to 0.4 failed, halved" in halved.events[0]
    assert any("halved" in note for note in outcome.notes)
    again = solve_config(config(SMALL + "widths: [0.4]\n"), tmp_path)
    assert again.new_states == 0


@pytest.mark.long
def test_twist_steps_that_fail_are_halved_and_reported(tmp_path: Path) -> None:
    """Half a turn at once turns facets inside out; in parts it goes, and the band is the same."""
    whole = solve_config(config(SMALL), tmp_path)
    text = SMALL.replace("steps: 8", "steps: 1")
    outcome = solve_config(config(text), tmp_path)
    assert outcome.exit_code == 0
    states = outcome.run.states(all=True)
    twisted = [state for state in states if state.kind == "auxiliary"]
    assert [state.stage for state in twisted] == ["twist 0.25/1", "twist 0.625/1", "twist 1/1"]
    assert any("a step from twist 0/1 to 1 failed, halved" in event for event in twisted[0].events)
    assert states[-1].energy == pytest.approx(whole.run.states()[-1].energy, rel=1e-12)
    watch = Recorder()
    assert solve_config(config(text), tmp_path, progress=watch).new_states == 0
    assert watch.stages == [("twist 1/1", 1, 2), ("twisted band freed", 2, 2)]


def test_the_minimum_of_an_auxiliary_problem_is_called_that(tmp_path: Path) -> None:
    run = solve_small(tmp_path).run
    kinds = {state.kind: state.message for state in run.states(all=True)}
    assert kinds["auxiliary"].startswith("Converged to a minimum of the auxiliary problem")
    assert "auxiliary" not in kinds["equilibrium"]


def test_a_twist_that_cannot_be_done_says_how_far_it_came(tmp_path: Path) -> None:
    outcome = solve_config(config(SMALL.replace("segments: 20", "segments: 8")), tmp_path)
    assert outcome.exit_code == 3
    (failure,) = outcome.failures
    assert failure.startswith("b = 0.3, N = 8: not reached: no step from twist 4/8 succeeds: ")


def test_a_width_out_of_reach_is_a_failure_that_names_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    from ribbon_cli.solver.status import Status
    from ribbon_cli.study import stepping as module

    honest = module.to_band

    def blocked(state, multipliers, band, *rest):
        move = honest(state, multipliers, band, *rest)
        status = Status.LEFT_TOPOLOGY if band.half_width > 0.35 else move.result.status
        return replace(move, result=replace(move.result, status=status))

    monkeypatch.setattr(module, "to_band", blocked)
    outcome = solve_config(config(SMALL + "widths: [0.3, 0.4, 0.5]\nrefinement: [20, 40]\n"), tmp_path)
    assert outcome.exit_code == 3
    assert [t.reached for t in outcome.targets] == [True, True, False, False, False, False]
    assert len(outcome.failures) == 4
    assert all("passed through itself" in line for line in outcome.failures)
    monkeypatch.setattr(module, "to_band", honest)
    assert (
        solve_config(config(SMALL + "widths: [0.3, 0.4, 0.5]\nrefinement: [20, 40]\n"), tmp_path).exit_code
        == 0
    )


def test_a_schedule_that_ended_does_not_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a step that failed, the width before it is not reached again by standing still."""
    from dataclasses import replace

    from ribbon_cli.solver.status import Status
    from ribbon_cli.study import stepping as module

    honest = module.to_band

    def blocked(*args):
        move = honest(*args)
        return replace(move, result=replace(move.result, status=Status.STALLED))

    monkeypatch.setattr(module, "to_band", blocked)
    outcome = solve_config(config(SMALL + "widths: [0.3, 0.4, 0.3]\n"), tmp_path)
    assert [t.reached for t in outcome.targets] == [True, False, False]


def test_handedness_changes_the_linking_number_and_nothing_else(tmp_path: Path) -> None:
    right = solve_small(tmp_path)
    left = solve_config(config(SMALL.replace("half_twists: 1", "half_twists: -1")), tmp_path)
    a, b = right.run.states()[-1], left.run.states()[-1]
    assert b.energy == pytest.approx(a.energy, rel=1e-10)
    assert a.linking_number == pytest.approx(0.5, abs=1e-9)
    assert b.linking_number == pytest.approx(-0.5, abs=1e-9)
    assert b.writhe == pytest.approx(-a.writhe, abs=1e-9)


def test_a_given_state_starts_a_run(tmp_path: Path) -> None:
    first = solve_small(tmp_path)
    ref = f"{first.run.name}:{first.targets[0].label}"
    text = f"name: again\ntopology: {{half_twists: 1}}\ninitial_guess: {{state: '{ref}'}}\nwidths: [0.35]\n"
    outcome = solve_config(config(text), tmp_path)
    assert outcome.exit_code == 0
    states = outcome.run.states(all=True)
    assert states[0].stage == "given state"
    assert states[0].energy == pytest.approx(first.run.states()[-1].energy, rel=1e-12)
    assert states[-1].half_width == 0.35


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("half_twists: 1", "half_twists: -1"), "which is half_twists: 1, where the config says"),
        (("widths", "refinement: [40, 80]\nwidths"), "its first level must be that of the given state"),
    ],
)
def test_a_given_state_must_fit(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    first = solve_small(tmp_path)
    guess = f"initial_guess: {{state: '{first.run.name}:10'}}"
    text = "name: again\ntopology: {half_twists: 1}\n" + guess + "\nwidths: [0.35]\n"
    with pytest.raises(ConfigError, match=words) as caught:
        solve_config(config(text.replace(*change)), tmp_path)
    (problem,) = caught.value.mistakes
    assert (problem.line, problem.column, problem.field) == (3, 24, "initial_guess.state")
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith("again")] == []


@pytest.mark.long
def test_contact_ends_a_schedule_if_asked_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ribbon_cli.model.contact import Contact
    from ribbon_cli.study import records

    honest = records.self_contact

    def touching(u, g, g_end, half_width, h, **how):
        found = honest(u, g, g_end, half_width, h, **how)
        return Contact(half_width > 0.35, found.pairs, found.clearance)

    monkeypatch.setattr(records, "self_contact", touching)
    text = SMALL + "widths: [0.3, 0.4, 0.5]\ncontact: HOW\n"
    stopped = solve_config(config(text.replace("HOW", "stop")), tmp_path)
    assert [(t.half_width, t.reached) for t in stopped.targets] == [(0.3, True), (0.4, True), (0.5, False)]
    assert any("touches itself from b = 0.4" in note for note in stopped.notes)
    assert (stopped.exit_code, stopped.failures) == (0, ())
    (beyond,) = (target for target in stopped.targets if target.beyond)
    assert beyond.message == (
        "not reached: the band touches itself from b = 0.4: contact: stop ends the schedule"
    )
    facts = standing(stopped.run)
    counts = facts.counts
    assert (facts.status, counts.complete, counts.done, counts.waiting) == ("complete", True, 2, 0)
    recorded = solve_config(config(text.replace("HOW", "record")), tmp_path)
    assert [t.half_width for t in recorded.targets] == [0.3, 0.4, 0.5]
    assert [s.self_contact for s in recorded.run.states()] == [False, True, True]


RING_BRANCH = """
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 10, half_width: 0.2}
widths: {arclength: {to: 0.3, back_to: 0.1, at: [0.15, 0.3], max_step: 0.5}}
spectrum: {modes: 0, full_up_to: 0}
"""


def test_a_value_that_no_branch_met_is_a_target_missed(tmp_path: Path) -> None:
    missed = solve_config(config(RING_BRANCH), tmp_path)
    (left,) = (target for target in missed.targets if not target.reached)
    assert (left.half_width, left.beyond) == (0.15, False)
    assert missed.exit_code == 3
    assert missed.failures == ("b = 0.15, N = 10: not met by any branch: branch up ends at b = 0.3 (range)",)
    counts = standing(missed.run).counts
    assert (counts.done, counts.waiting, counts.failed) == (2, 0, 1)
    stopped = solve_config(config(RING_BRANCH.replace("max_step", "steps: 1, max_step")), tmp_path)
    assert [target.beyond for target in stopped.targets if not target.reached] == [True, True]
    assert any("0.15: not met by any branch" in note for note in stopped.notes)
    assert stopped.exit_code == 0
    assert standing(stopped.run).status == "complete"
    both = solve_config(config(RING_BRANCH.replace("max_step", "both: true, max_step")), tmp_path)
    assert (both.exit_code, standing(both.run).status) == (0, "complete")


def test_a_value_outside_of_a_branch_from_a_given_state_is_refused(tmp_path: Path) -> None:
    run = solve_config(config(RING_BRANCH.replace("[0.15, 0.3]", "[0.3]")), tmp_path).run
    given = RING_BRANCH.replace(
        "{recipe: cylinder, segments: 10, half_width: 0.2}", f"{{state: '{run.name}:1'}}"
    )
    with pytest.raises(UsageError, match=r"widths\.arclength\.at: must be between 0\.1 and 0\.3, where"):
        solve_config(config(given.replace("0.15", "0.05").replace("name: ring", "name: given")), tmp_path)


def test_refinement_by_hand(tmp_path: Path) -> None:
    first = solve_small(tmp_path)
    label = first.targets[0].label
    ref = f"{first.run.name}:{label}"
    smooth = refine_state(tmp_path, ref, levels=2)
    assert [t.segments for t in smooth.targets] == [40, 80]
    odd = refine_state(tmp_path, ref, to=50)
    assert [(t.segments, t.certified) for t in odd.targets] == [(50, True)]
    split = refine_state(tmp_path, ref, to=80, method="split")
    energies = {(s.segments, s.method): s.energy for s in split.run.states(all=True)}
    assert energies[80, "facets split in two"] == pytest.approx(
        next(e for (n, m), e in energies.items() if n == 80 and m.startswith("smooth")), rel=1e-9
    )
    assert refine_state(tmp_path, ref, levels=2).new_states == 0
    parents = {s.label: s.parent for s in split.run.states(all=True)}
    assert parents[smooth.targets[0].label] == label


def test_levels_on_the_way_stand_in_the_convergence_table(tmp_path: Path) -> None:
    """As if each level had been asked for: the order is seen, and the limit has its error bar."""
    runs = [solve_small(tmp_path / name) for name in ("to", "levels")]
    ref = f"{runs[0].run.name}:{runs[0].targets[0].label}"
    refine_state(tmp_path / "to", ref, to=160)
    refine_state(tmp_path / "levels", ref, levels=3)
    passed, asked = (run_table(outcome.run) for outcome in runs)
    assert [row.segments for row in passed.rows] == [20, 40, 80, 160]
    assert passed.extrapolations == asked.extrapolations
    assert passed.extrapolations[0].error is not None
    kinds = [state.kind for state in runs[0].run.states(all=True) if state.segments in (40, 80)]
    assert kinds == ["intermediate", "intermediate"]


def test_a_refinement_that_exists_is_named_and_not_stored_again(tmp_path: Path) -> None:
    """Whoever made it: the config, a refinement by hand, or the state itself has such an N."""
    first = solve_config(config(SMALL + "widths: [0.3, 0.4]\nrefinement: [20, 40, 80]\n"), tmp_path)
    at = {(t.half_width, t.segments): t.label for t in first.targets}
    run, count = first.run, len(first.run.entries())
    for ref, wanted in (("N=20", 80), ("N=20", 40), ("N=80", 40), ("N=40", 40), ("N=40", 20)):
        again = refine_state(tmp_path, f"{run.name}@b=0.4,{ref}", to=wanted)
        (target,) = again.targets
        assert (target.label, target.certified, again.exit_code) == (at[0.4, wanted], True, 0)
        assert (again.new_states, len(run.entries())) == (0, count)
        assert again.notes[-1:] == (
            f"state {target.label} has b = 0.4 and N = {wanted} already: nothing new is stored",
        )
    levels = refine_state(tmp_path, f"{run.name}@b=0.3,N=20", levels=3)
    assert [t.label for t in levels.targets] == [at[0.3, 40], at[0.3, 80], count + 1]
    assert run.load(count + 1).parent == at[0.3, 80]
    assert refine_state(tmp_path, f"{run.name}@b=0.3,N=20", to=160).targets == levels.targets[-1:]
    # By splitting it would be reached in another way, and is.
    assert refine_state(tmp_path, f"{run.name}@b=0.3,N=20", levels=1, method="split").new_states == 1


def test_a_refinement_of_another_band_is_not_taken_for_this_ones(tmp_path: Path) -> None:
    """The same width and N, reached from another state: on another visit of the schedule."""
    text = SMALL + "widths: [0.3, 0.4, 0.3]\nrefinement: {levels: [20, 40], at: [0.4]}\n"
    first = solve_config(config(text), tmp_path)
    one, _, _, other = (target.label for target in first.targets)
    made = refine_state(tmp_path, f"{first.run.name}:{one}", to=40)
    assert made.new_states == 1
    assert refine_state(tmp_path, f"{first.run.name}:{other}", to=40).new_states == 1
    assert refine_state(tmp_path, f"{first.run.name}:{one}", to=40).targets == made.targets


def test_what_is_refined_keeps_the_revision_of_its_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The runs may lie in another repository than the config did, or the config's may have moved on."""
    from ribbon_cli.store import provenance

    places = {"configs": "a" * 40, "runs": "b" * 40}
    monkeypatch.setattr(
        provenance,
        "_git",
        lambda folder: {
            "git_revision": places["runs" if "runs" in folder else "configs"],
            "git_dirty": 0,
        },
    )
    (tmp_path / "configs").mkdir()
    first = solve_config(config(SMALL, str(tmp_path / "configs" / "small.yaml")), tmp_path / "runs")
    assert first.run.load(1).provenance["git_revision"] == places["configs"]
    made = refine_state(tmp_path / "runs", f"{first.run.name}:{first.targets[0].label}", levels=1)
    assert first.run.load(made.targets[0].label or 0).provenance["git_revision"] == places["configs"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give either"),
        ({"to": 40, "levels": 1}, "give either"),
        ({"levels": 0}, "at least 1"),
        ({"levels": 30}, "a band has at most 1000000 segments"),
        ({"to": 1_000_001}, "a band has at most 1000000 segments, got 1000001"),
        ({"to": 4}, "at least 8"),
        ({"to": 50, "method": "split"}, "not 20 times a power of 2"),
    ],
)
def test_refinements_that_make_no_sense(tmp_path: Path, options: dict, words: str) -> None:
    first = solve_small(tmp_path)
    with pytest.raises(UsageError, match=words):
        refine_state(tmp_path, f"{first.run.name}:{first.targets[0].label}", **options)


def test_auxiliary_states_are_not_refined(tmp_path: Path) -> None:
    first = solve_small(tmp_path)
    with pytest.raises(UsageError, match="auxiliary"):
        refine_state(tmp_path, f"{first.run.name}:1", levels=1)


def test_the_plan_of_a_given_state_is_what_is_run(tmp_path: Path) -> None:
    first = solve_small(tmp_path)
    guess = f"initial_guess: {{state: '{first.run.name}:{first.targets[0].label}'}}\n"
    for more in ("widths: [0.3, 0.35]\n", "widths: [0.35]\nrefinement: [20, 40]\n", ""):
        again = config("name: again\ntopology: {half_twists: 1}\n" + guess + more)
        band = given_band(again, tmp_path)
        assert band is not None
        plan = plan_of(again, (band.half_width, band.segments)).stages
        watch = Recorder()
        outcome = solve_config(again, tmp_path, progress=watch)
        assert [name for name, _, _ in watch.stages] == [stage.name for stage in plan]
        assert all(total == len(plan) for _, _, total in watch.stages)
        places = [(stage.half_width, stage.segments) for stage in plan if stage.kind == "equilibrium"]
        assert places == [(t.half_width, t.segments) for t in outcome.targets]


def test_a_finished_run_is_used_without_its_lock(tmp_path: Path) -> None:
    """It may be on a disk that is read only, or be refined by someone else at the time."""
    text = SMALL + "widths: [0.3, 0.35]\n"
    first = solve_config(config(text), tmp_path)
    refine_state(tmp_path, f"{first.run.name}:{first.targets[0].label}", levels=1)
    watch = Recorder()
    with Run.open(first.run.path).writing():
        again = solve_config(config(text), tmp_path, progress=watch)
        assert (again.new_states, again.exit_code) == (0, 0)
        assert again.targets == first.targets
        assert len(watch.stages) == len(plan_of(config(text)).stages)
        assert refine_state(tmp_path, f"{first.run.name}:{first.targets[0].label}", levels=1).new_states == 0
        with pytest.raises(LockedError):
            refine_state(tmp_path, f"{first.run.name}:{first.targets[1].label}", levels=1)


def test_a_finished_run_is_not_written_to(tmp_path: Path) -> None:
    first = solve_small(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert solve_config(config(SMALL), tmp_path).targets == first.targets
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize("left", ["temporary file", "whole state", "torn state", "torn line"])
def test_what_an_interrupted_writer_left_is_cleared_though_all_is_solved(tmp_path: Path, left: str) -> None:
    first = solve_small(tmp_path)
    run, label = first.run, first.run.next_label
    match left:
        case "temporary file":
            (run.path / "states" / ".tmp-0099.h5-1").write_bytes(b"x")
            told = "removed the unfinished file"
        case "whole state":
            run.state_path(label).write_bytes(encode(make_record(label)))
            told = f"adopted state {label}"
        case "torn state":
            run.state_path(label).write_bytes(b"torn")
            told = f"renamed {run.state_path(label).name}"
        case _:
            with open(run.log_path, "ab") as log:
                log.write(b'{"event":"sta')
            told = "cut off an unfinished line"
    fresh = Run.open(run.path)
    assert fresh.has_leftovers
    watch = Recorder()
    again = solve_config(config(SMALL), tmp_path, progress=watch)
    assert (again.new_states, again.targets) == (0, first.targets)
    assert any(told in note for note in watch.notes), watch.notes
    fresh = Run.open(run.path)
    assert not fresh.has_leftovers
    assert (label in fresh.entries()) == (left == "whole state")
    assert log_is_whole(fresh)
    quiet = Recorder()
    assert solve_config(config(SMALL), tmp_path, progress=quiet).targets == first.targets
    assert not any(told in note for note in quiet.notes)


def log_is_whole(run: Run) -> bool:
    return run.log_path.read_bytes().endswith(b"\n")


def test_another_state_of_the_same_name_is_noticed(tmp_path: Path) -> None:
    """A run belongs to the numbers it started from, not only to the name of their file."""
    from ribbon_cli.store import export_npz

    first = solve_config(config(SMALL + "widths: [0.3, 0.35]\n"), tmp_path)
    one, two = (first.run.load(target.label) for target in first.targets)
    text = "name: again\ntopology: {half_twists: 1}\ninitial_guess: {state: start.npz}\n"
    again = config(text, str(tmp_path / "again.yaml"))
    export_npz(one, tmp_path / "start.npz")
    assert solve_config(again, tmp_path).run.states()[0].half_width == pytest.approx(0.3)
    export_npz(two, tmp_path / "start.npz", overwrite=True)
    with pytest.raises(UsageError, match="this run started from"):
        solve_config(again, tmp_path)
    fresh = solve_config(again, tmp_path, fresh=True)
    assert fresh.run.states()[0].half_width == pytest.approx(0.35)


RING = """
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 12, half_width: 0.3}
widths: [0.1*3, 0.5]
refinement: [12, 24]
"""


@pytest.mark.parametrize(
    ("length", "guess"),
    [("2*pi", "recipe: cylinder, segments: 12, half_width: 0.3"), ("6.2", "state: 'first:1'")],
)
def test_a_first_width_that_differs_by_rounding_is_the_one_that_is_named(
    tmp_path: Path, length: str, guess: str
) -> None:
    """0.1*3 is not 0.3 to the last bit, nor is a given state's width in another unit of length."""
    solve_config(config(RING.replace("ring", "first").replace("0.1*3", "0.3")), tmp_path)
    at = f"widths: [0.3*({length})/(2*pi)*(1 + 1e-13), 0.5]"
    text = RING.replace("widths: [0.1*3, 0.5]", f"length: {length}\n{at}")
    asked = config(text.replace("recipe: cylinder, segments: 12, half_width: 0.3", guess))
    outcome = solve_config(asked, tmp_path)
    assert [target.half_width for target in outcome.targets] == [asked.widths[0], asked.widths[0], 0.5, 0.5]
    assert standing(outcome.run).status == "complete"
    assert solve_config(asked, tmp_path).new_states == 0


@pytest.mark.parametrize("widths", ["[0.1, 0.2]\nrefinement: [12, 24]", "{arclength: {to: 0.12}}"])
def test_no_module_is_imported_once_states_are_stored(tmp_path: Path, widths: str) -> None:
    """In a run of hours it might be of another version than the one that its states name."""
    guess = "{recipe: cylinder, segments: 12, half_width: 0.1}"
    text = f"topology: {{half_twists: 0}}\ninitial_guess: {guess}\nwidths: {widths}\n"
    (tmp_path / "ring.yaml").write_text(text)
    code = (
        "import sys\n"
        "from ribbon_cli import solve\n"
        "from ribbon_cli.store import Run\n"
        "def ours(): return {name for name in sys.modules if name.startswith('ribbon_cli.')}\n"
        "known, commit = [], Run.commit_soon\n"
        "Run.commit_soon = lambda *words: (known.append(ours()), commit(*words))[1]\n"
        "assert solve('ring.yaml').new_states > 1\n"
        "assert 'ribbon_cli.study.contact' in known[0]\n"
        "sys.exit(str(sorted(ours() - known[0])) if ours() - known[0] else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
