"""Branches of a run: the store's table, resume after a kill, `ribbon continue`, configs."""

from __future__ import annotations

import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import content_hashes, ribbon, ribbon_json, spawn, states_on_disk, stop_after

from ribbon_cli.config import Arclength, ConfigError, parse_config
from ribbon_cli.solver.status import Status
from ribbon_cli.store import Run
from ribbon_cli.study import stepping

DATA = Path(__file__).parent / "data"
FOLD = 0.112567997723

CONFIG = f"""\
name: fold
topology: {{half_twists: 1}}
initial_guess: {{state: {DATA / "pi-b0.1-N50-second-minimum.npz"}}}
widths: {{arclength: {{to: 0.12, back_to: 0.09, at: [0.11]}}}}
spectrum: {{modes: 2, full_up_to: 0, metrics: [physical]}}
"""

EVERTED = """\
name: everted
topology: {half_twists: 0}
initial_guess: {recipe: eversion, segments: 40, half_width: 0.08, steps: 10}
widths: {arclength: {to: 0.105, switch: 1}}
spectrum: {modes: 0, full_up_to: 0}
"""


@pytest.fixture(scope="module")
def fold_run(tmp_path_factory):
    """A run with a branch around a fold: its folder, and what `ribbon solve --json` said."""
    folder = tmp_path_factory.mktemp("fold")
    (folder / "fold.yaml").write_text(CONFIG)
    return folder, ribbon_json("solve", folder / "fold.yaml", "--runs", folder / "runs", "-q")


def test_a_branch_is_a_table_in_the_store(fold_run):
    folder, solved = fold_run
    (branch,) = solved["branches"]
    assert branch["name"] == "branch up"
    assert (branch["reason"], branch["half_width"]) == ("range", 0.09)
    shown = ribbon_json("show", "fold", "--runs", folder / "runs")
    assert shown["branches"] == solved["branches"]
    points = branch["points"]
    assert [point["half_width"] for point in points if point["type"] == "width"] == [0.11, 0.11, 0.09]
    fold = next(point for point in points if point["type"] == "fold")
    assert fold["half_width"] == pytest.approx(FOLD, rel=1e-9)
    assert (fold["index_before"], fold["index_after"], fold["status"]) == (0, 1, "undecided")
    assert fold["negative_eigenvalues"] is None
    assert abs(fold["lowest_eigenvalue"]) < 1e-8
    lengths = [point["arclength"] for point in points]
    assert lengths == sorted(lengths)
    for point in points:
        assert point["linking_number"] == pytest.approx(0.5, abs=1e-6)
        before = point["arclength"] < fold["arclength"]
        if point["type"] != "fold":
            assert point["status"] == ("minimum" if before else "saddle")
            assert (point["lowest_eigenvalue"] > 0) is before
            assert point["negative_eigenvalues"] == (0 if before else 1)


def test_a_branch_around_a_fold_is_drawn(fold_run, tmp_path):
    folder, _ = fold_run
    path = tmp_path / "branch.svg"
    ribbon_json("plot", "fold", "branch", "-o", path, "--runs", folder / "runs")
    text = path.read_text(encoding="utf-8")
    for words in ("branch up", "stable", "index 1", "fold", "Branches in the width: 1, folds: 1."):
        assert words in text
    assert "branch point<" not in text


def test_requested_widths_are_equilibria_and_nothing_else_is(fold_run):
    folder, solved = fold_run
    listed = ribbon_json("ls", "fold", "--runs", folder / "runs")
    assert [state["half_width"] for state in listed] == [0.1, 0.11, 0.11, 0.09]
    assert [state["certified"] for state in listed] == [True, True, False, False]
    assert all("branch" in state for state in listed[1:])
    assert solved["exit_code"] == 0, "unstable points on a branch are no failure"
    assert len(solved["states"]) == 1


def test_text_shows_the_branch(fold_run):
    folder, _ = fold_run
    text = ribbon("show", "fold", "--runs", folder / "runs").stdout
    assert "branch up, from state 1" in text
    assert "fold" in text
    assert "0 to 1" in text
    assert "ends at b = 0.09 (range): The end of the range of widths." in text


def test_the_same_line_again_finds_everything(fold_run):
    folder, solved = fold_run
    before = content_hashes(folder / "runs")
    again = ribbon_json("solve", folder / "fold.yaml", "--runs", folder / "runs", "-q")
    assert again["new_states"] == 0
    assert again["branches"] == solved["branches"]
    assert content_hashes(folder / "runs") == before


@pytest.mark.faults
def test_killed_and_resumed_a_branch_has_the_same_bytes(fold_run, tmp_path):
    """SIGKILL after so many states, and again further on, then the same line once more."""
    folder, _ = fold_run
    expected = content_hashes(folder / "runs")
    (tmp_path / "fold.yaml").write_text(CONFIG)
    for states in (4, 11):
        with spawn("solve", "fold.yaml", "-q", cwd=tmp_path) as process:
            stop_after(process, tmp_path, states, signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL
        kept = states_on_disk(tmp_path)
        assert states <= kept < len(expected)
    resumed = ribbon_json("solve", tmp_path / "fold.yaml", "--runs", tmp_path / "runs", "-q")
    assert resumed["new_states"] == len(expected) - kept
    assert content_hashes(tmp_path / "runs") == expected


@pytest.fixture(scope="module")
def one_run(tmp_path_factory):
    """A folder of runs, in which one holds the second minimum alone."""
    folder = tmp_path_factory.mktemp("one")
    (folder / "one.yaml").write_text(CONFIG.replace("name: fold", "name: one").replace("widths:", "#"))
    ribbon_json("solve", folder / "one.yaml", "--runs", folder / "runs", "-q")
    return folder / "runs"


@pytest.fixture
def given(one_run, tmp_path):
    """A copy of that run to go on from: the options that name it."""
    shutil.copytree(one_run, tmp_path / "runs")
    return ("--runs", tmp_path / "runs", "-q")


def test_continue_along_the_branch(given):
    document = ribbon_json("continue", "one:1", "--to", "0.12", "--arclength", "--stop-at", "fold", *given)
    assert document["end"]["reason"] == "fold"
    assert document["end"]["half_width"] == pytest.approx(FOLD, rel=1e-9)
    assert document["points"][-1]["type"] == "fold"
    assert {"label", "type", "half_width", "energy"} <= document["points"][0].keys()


@pytest.mark.long
def test_continue_goes_on_along_the_branch(given):
    document = ribbon_json("continue", "one:1", "--to", "0.12", "--arclength", "--stop-at", "fold", *given)
    further = ribbon_json("continue", "one:1", "--to", "0.12", "--back-to", "0.09", "--arclength", *given)
    assert further["end"] == {
        "reason": "range",
        "half_width": 0.09,
        "message": "The end of the range of widths.",
    }
    assert further["points"][: len(document["points"])] == document["points"]
    # A shorter look back at it changes nothing.
    ribbon_json("continue", "one:1", "--to", "0.12", "--arclength", "--stop-at", "fold", *given)
    (branch,) = ribbon_json("show", "one", *given)["branches"]
    assert branch["reason"] == "range"
    assert branch["points"] == further["points"]


@pytest.mark.long
def test_continue_from_a_saddle(given):
    """The far side of a fold can be named, and followed back over it."""
    first = ribbon_json("continue", "one:1", "--to", "0.12", "--back-to", "0.1", "--arclength", *given)
    last = first["points"][-1]
    assert (last["half_width"], last["status"]) == (0.1, "saddle")
    ref = f"one:{last['label']}"
    back = ribbon_json("continue", ref, "--to", "0.12", "--arclength", "--stop-at", "fold", *given)
    assert back["end"]["half_width"] == pytest.approx(FOLD, rel=1e-9)
    assert (back["points"][-1]["index_before"], back["points"][-1]["index_after"]) == (1, 0)


@pytest.mark.parametrize(
    "to",
    [pytest.param("0.114", marks=pytest.mark.long), pytest.param("0.2", marks=pytest.mark.branches)],
)
def test_natural_continuation_stops_before_the_fold(given, monkeypatch, to):
    """It keeps its last good state, and says what it met and what would go on."""
    document = ribbon_json("continue", "one:1", "--to", to, *given, code=3)
    assert document["end"]["reason"] == "step-too-small"
    assert "seems to turn back (fold) near b = 0.112" in document["end"]["message"]
    assert "--arclength continues around folds" in document["end"]["message"]
    assert document["end"]["half_width"] < FOLD
    assert document["points"][-1]["half_width"] == document["end"]["half_width"] > 0.11
    assert {point["status"] for point in document["points"]} == {"minimum"}
    monkeypatch.setattr(stepping, "to_band", None)  # what failed is kept, and is not tried again
    again = ribbon_json("continue", "one:1", "--to", to, *given, code=3)
    assert (again["new_states"], again["end"]) == (0, document["end"])


def test_a_step_that_was_halved_is_not_tried_again(given, monkeypatch):
    """Nor is the lock taken: the halves are stored, and the log keeps which steps failed from where."""
    honest = stepping.to_band

    def fragile(state, multipliers, band, *rest):
        move = honest(state, multipliers, band, *rest)
        if band.half_width - state.band.half_width > 0.006:
            return replace(move, result=replace(move.result, status=Status.ITERATION_LIMIT))
        return move

    monkeypatch.setattr(stepping, "to_band", fragile)
    words = ("continue", "one:1", "--to", "0.108", *given)
    document = ribbon_json(*words)
    assert [point["type"] for point in document["points"]] == ["step", "width"]
    monkeypatch.setattr(stepping, "to_band", None)
    monkeypatch.delattr(Run, "writing")
    again = ribbon_json(*words)
    assert (again["new_states"], again["points"]) == (0, document["points"])


def test_natural_continuation_meets_widths_and_locates_contact(tmp_path):
    (tmp_path / "wide.yaml").write_text(
        CONFIG.replace("name: fold", "name: wide")
        .replace("widths:", "#")
        .replace("0.1-N50-second-minimum", "0.5-N50")
        .replace("half_twists: 1", "half_twists: -1")
    )
    options = ("--runs", tmp_path / "runs", "-q")
    ribbon_json("solve", tmp_path / "wide.yaml", *options)
    words = ("continue", "wide:1", "--to", "1.55", "--at", "1.2", "--stop-at", "contact", *options)
    document = ribbon_json(*words)
    assert document["end"]["reason"] == "contact"
    # Past b = 1.2159 the minimum is the twin in the other grid phase; the branch itself touches at 1.4933.
    assert document["end"]["half_width"] == pytest.approx(1.5043, abs=1e-4)
    assert [p["half_width"] for p in document["points"] if p["type"] == "width"] == [1.2]
    last = document["points"][-1]
    assert (last["type"], last["self_contact"], last["status"]) == ("contact", True, "minimum")
    states = ribbon_json("ls", "wide", "--all", *options)
    free = max(state["half_width"] for state in states if not state["self_contact"])
    assert 0.0 < last["half_width"] - free <= 1e-5
    assert ribbon_json(*words)["new_states"] == 0
    beyond = ribbon_json("continue", "wide:1", "--to", "1.55", "--at", "1.2", *options)
    assert (beyond["end"]["reason"], beyond["end"]["half_width"]) == ("range", 1.55)
    found = [(p["type"], p["half_width"]) for p in beyond["points"] if p["self_contact"]]
    assert found == [("contact", last["half_width"]), ("width", 1.55)]


def test_continue_with_too_few_steps_says_so(given):
    document = ribbon_json("continue", "one:1", "--to", "0.12", "--arclength", "--steps", "2", *given)
    assert document["end"]["reason"] == "step-limit"
    assert document["end"]["message"] == "The limit on the number of steps."
    more = ribbon_json("continue", "one:1", "--to", "0.12", "--arclength", "--stop-at", "fold", *given)
    assert more["end"]["reason"] == "fold"
    assert more["points"][:2] == document["points"][:2]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--to", "0.1", "--arclength"), "has b = 0.1 already"),
        (("--to", "7", "--arclength"), "--to: must be a half-width between 0 and the length 6.28319, got 7"),
        (("--to", "-1", "--arclength"), "must be > 0"),
        (("--to", "zero", "--arclength"), "must be a number such as 0.5"),
        (("--to", "0.2", "--both", "--arclength"), "--both needs --back-to"),
        (("--to", "0.2", "--both"), "--both needs --arclength"),
        (("--to", "0.2", "--switch", "1"), "--switch needs --arclength"),
    ],
)
def test_continue_refuses_in_one_line(given, words, message):
    result = ribbon("continue", "one:1", *words, *given)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.long
def test_branches_that_cross_are_followed_to_both_sides(tmp_path):
    """The everted cylinder at N = 40 loses stability without a fold near b = 0.09986, at a pitchfork."""
    (tmp_path / "everted.yaml").write_text(EVERTED)
    solved = ribbon_json("solve", tmp_path / "everted.yaml", "--runs", tmp_path / "runs", "-q")
    main, plus, minus = solved["branches"]
    (point,) = [p for p in main["points"] if p["type"] == "branch-point"]
    assert point["half_width"] == pytest.approx(0.0998633225, abs=1e-9)
    assert (point["index_before"], point["index_after"]) == (0, 1)
    assert point["sliding_overlap"] < 1e-6
    assert [plus["name"], minus["name"]] == [f"branch from {point['label']} side {s}" for s in "+-"]
    assert plus["start"] == minus["start"] == point["label"]
    for one, other in zip(plus["points"], minus["points"], strict=True):
        assert one["energy"] == pytest.approx(other["energy"], rel=1e-8)
        assert one["half_width"] == pytest.approx(other["half_width"], rel=1e-8)
        assert one["label"] != other["label"]
    assert plus["points"][-1]["half_width"] == 0.08


# --- configs ---


def test_config_round_trip(tmp_path):
    text = CONFIG.replace("at: [0.11]", "at: [0.11], both: true, stop_at: [contact, fold], switch: 2")
    config = parse_config(text, tmp_path / "a.yaml")
    assert config.arclength == Arclength(
        to=0.12, back_to=0.09, both=True, at=(0.11,), stop_at=("fold", "contact"), switch=2
    )
    from ribbon_cli.config import dump_resolved

    again = parse_config(dump_resolved(config), tmp_path / "b.yaml")
    assert again.arclength == config.arclength
    assert again.scientific() == config.scientific() | {"initial_guess": again.scientific()["initial_guess"]}


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        ("{}", "widths.arclength.to: is missing: give the half-width to go towards"),
        ("{to: -1}", "widths.arclength.to: must be > 0, got -1"),
        (
            "{to: 0.2, stop_at: [bend]}",
            "widths.arclength.stop_at[0]: must be fold, stability-lost or contact",
        ),
        ("{to: 0.2, both: true}", "widths.arclength.both: needs back_to"),
        ("{to: 0.2, back_to: 0.2}", "widths.arclength.back_to: must differ from to, got 0.2"),
        ("{to: 0.2, max_step: 3}", "widths.arclength.max_step: must be < 1"),
        ("{to: 0.2, swich: 1}", "widths.arclength.swich: unknown key: did you mean switch?"),
        ("{to: 0.2, at: [0.1, 0.1]}", "widths.arclength.at[1]: must be given once, got 0.1 again"),
        ("{to: 0.1}", "widths.arclength.to: must differ from the guess's half_width, got 0.1"),
    ],
)
def test_config_messages(inner, message):
    text = (
        "name: a\ntopology: {half_twists: 1}\n"
        "initial_guess: {recipe: twist, segments: 24, half_width: 0.1, steps: 4}\n"
        f"widths: {{arclength: {inner}}}\n"
    )
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "a.yaml")
    found = [f"{problem.field}: {problem.message}" for problem in caught.value.mistakes]
    assert any(message in line for line in found), found


def test_a_branch_is_not_refined_and_does_not_mix_with_a_range():
    start = (
        "name: a\ntopology: {half_twists: 1}\ninitial_guess: {recipe: twist, segments: 24, half_width: 0.1}\n"
    )
    for rest, message in (
        (
            "widths: {arclength: {to: 0.2}}\nrefinement: [24, 48]\n",
            "refinement: a branch is followed on one level",
        ),
        ("widths: {arclength: {to: 0.2}, from: 0.1}\n", "widths.from: does not go with arclength"),
    ):
        with pytest.raises(ConfigError, match=message):
            parse_config(start + rest, "a.yaml")
