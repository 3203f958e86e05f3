"""Surveys: random starts, equilibria told apart and followed, counted; resumed, and on several processes."""

from __future__ import annotations

import json
import math
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import run, spawn, states_on_disk
from click.testing import CliRunner
from test_everted_moebius import load, start

from ribbon_cli import api, surveys
from ribbon_cli.cli.main import cli
from ribbon_cli.config import Config, parse_config
from ribbon_cli.errors import UsageError
from ribbon_cli.model.band import Band
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.random_shapes import random_start
from ribbon_cli.model.topology import linking_number
from ribbon_cli.pages.survey import survey_page
from ribbon_cli.parts import CLOSED, Ends
from ribbon_cli.solver.arclength import nearest
from ribbon_cli.solver.climbing import climb
from ribbon_cli.store import Run, list_runs
from ribbon_cli.store.events import SurveyStart
from ribbon_cli.store.log import format_line, parse_line
from ribbon_cli.study import standing
from ribbon_cli.study.acceptance import options_for
from ribbon_cli.study.status import Counts
from ribbon_cli.surveys import Findings, Request, findings, survey_config
from ribbon_cli.surveys.census import accumulation, estimate
from ribbon_cli.surveys.explore import End, Task, explore
from ribbon_cli.surveys.pool import WorkerDiedError, in_order
from ribbon_cli.surveys.run import survey_band
from ribbon_cli.surveys.shapes import Kinds, Shape, distance
from ribbon_cli.surveys.text import survey_text

CONFIG = """
name: small
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 16, half_width: 0.2, steps: 8}
spectrum: {modes: 0, full_up_to: 0}
"""
STRIP = """
name: arch
topology: open
ends: {start: clamped, end: clamped, span: 0.8*2*pi}
initial_guess: {recipe: strip, segments: 12, half_width: 0.1}
spectrum: {modes: 0, full_up_to: 0}
"""
REQUEST = Request(starts=5, climb=1)


class StopHereError(Exception):
    """A stop in the middle of a survey."""


def made(text: str = CONFIG) -> Config:
    return parse_config(text, "small.yaml")


def hashes(run: Run) -> list[str]:
    return [state.content_sha256 for state in run.states(all=True)]


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A survey that nothing interrupted, in one process."""
    return survey_config(made(), tmp_path_factory.mktemp("runs"), REQUEST).run


# --- starts ---


@pytest.mark.parametrize("half_twists", [0, 1, -1, 3])
def test_random_bands_are_bands_of_their_linking_number(half_twists: int) -> None:
    band = Band(30, 0.2, sigma=-1 if half_twists % 2 else 1)
    for seed in range(3):
        state = random_start(band, half_twists, np.random.default_rng(seed))
        assert state is not None
        found = linking_number(state.u, state.g, band.sigma, band.h).linking_number
        assert found == pytest.approx(half_twists / 2)
        assert np.abs(Problem(band).constraints(state.vector())).max() < 1e-9


@pytest.mark.parametrize("end", ["clamped", "hinged", "free"])
def test_random_strips_are_held_at_their_ends(end: str) -> None:
    parts = replace(CLOSED, ends=Ends("clamped", end, span=4.0))
    band = Band(20, 0.2, sigma=0, parts=parts)
    shapes = [random_start(band, 0, np.random.default_rng(seed)) for seed in range(3)]
    for state in shapes:
        assert state is not None
        assert np.abs(Problem(band).constraints(state.vector())).max() < 1e-9
    assert np.abs(shapes[0].u - shapes[1].u).max() > 0.1


def test_a_start_depends_on_its_number_and_the_seed_alone() -> None:
    task = Task(Band(16, 0.2, sigma=-1), 1, 7, 3, (0,))
    first, again, other = (explore(t)[0].result for t in (task, task, replace(task, start=4)))
    assert first is not None
    assert again is not None
    assert other is not None
    assert (first.x == again.x).all()
    assert not (first.x == other.x).all()


# --- ways up ---


def test_a_climb_leads_to_a_saddle_of_the_index_asked_for() -> None:
    """From a point beside family A at N = 80 a climb along one mode leads back to it."""
    found = nearest(load(start("A", 80)))
    problem = Problem(found.state.band)
    moved = found.x + 1e-4 * np.random.default_rng(1).normal(size=found.x.size)
    end = climb(problem, moved, 1)
    shape = Shape.of(end)
    assert shape is not None
    assert (shape.index, shape.inflections, shape.symmetry) == (1, 3, "C2")
    assert end.energy == pytest.approx(found.energy, abs=1e-9)
    assert end.kkt_residual < 1e-9


def test_a_climb_tells_how_it_ended_in_vain() -> None:
    found = nearest(load(start("A", 80)))
    problem = Problem(found.state.band)
    moved = found.x + 1e-2 * np.random.default_rng(1).normal(size=found.x.size)
    assert climb(problem, moved, 1, most_steps=2).status.value == "iteration-limit"
    assert climb(problem, moved, 1, lambda state: "(no.)").status.value == "left-topology"


# --- telling apart ---


@pytest.fixture(scope="module")
def usual() -> Shape:
    """The usual band at b = 0.1, N = 48."""
    ends = explore(Task(Band(48, 0.1, sigma=-1), 1, 1, 1, (0,)))
    assert ends[0].result is not None
    shape = Shape.of(ends[0].result)
    assert shape is not None
    return shape


def test_the_two_places_of_a_band_on_its_mesh_are_one_equilibrium(usual: Shape) -> None:
    """A minimum with its inflection on a facet, a saddle with it on a node."""
    shape = usual
    assert (shape.index, shape.inflections) == (0, 1)
    kinds = Kinds(options_for(1).guard)
    kind = kinds.add(1, shape)
    saddle = next(twin for twin in kind.twins if twin.index == 1)
    assert saddle.energy == pytest.approx(0.930949, abs=1e-6)
    assert kinds.of(saddle) is kind
    other = Kinds(options_for(1).guard)
    known = other.add(1, saddle)
    assert other.of(shape) is known  # which on this mesh only the minimum's own way tells


def test_mirror_images_and_relabelled_states_are_one(usual: Shape) -> None:
    shape = usual
    state = shape.state
    q = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    u, g = np.roll(state.u, 5, axis=0), np.roll(state.g, 5, axis=0)
    g[:5] *= state.band.sigma
    moved = replace(shape, state=replace(state, u=u @ q.T, g=g @ q.T))
    assert moved.is_(shape)
    assert not replace(moved, energy=1.001 * shape.energy).is_(shape)


def test_the_distance_to_a_finer_mesh_is_small_of_one_band_alone() -> None:
    coarse, fine = load(start("A", 80)), load(start("A", 160))
    assert distance(coarse, fine) < 0.1
    assert distance(load(start("B", 80)), fine) > 0.2


# --- counts ---


def test_estimates_of_a_textbook_sample() -> None:
    """By hand: 10 species, 4 once and 2 twice in 30 hits."""
    counts = [1, 1, 1, 1, 2, 2, 3, 4, 5, 10]
    found = estimate(counts)
    assert found is not None
    assert (found.hits, found.found, found.once, found.twice) == (30, 10, 4, 2)
    assert found.coverage == pytest.approx(1 - 4 / 30)
    assert found.chao1 == pytest.approx(10 + 29 / 30 * 4 * 3 / 6)
    coverage, pairs = 26 / 30, 2 * 2 + 6 + 12 + 20 + 90
    spread = max(10 / coverage * pairs / (30 * 29) - 1, 0)
    assert found.ace == pytest.approx(10 / coverage + 4 / coverage * spread)
    assert estimate([]) is None
    assert estimate([1, 1]).ace is None


def test_accumulation_ends_at_what_was_found() -> None:
    counts = [1, 2, 3, 14]
    curve = accumulation(counts)
    assert curve[0] == (1, pytest.approx(1.0))
    assert curve[-1] == (20, pytest.approx(4.0))
    rng, every = np.random.default_rng(3), np.repeat(np.arange(4), counts)
    drawn = np.mean([np.unique(rng.permutation(every)[:7]).size for _ in range(4000)])
    assert dict(curve)[7] == pytest.approx(drawn, abs=0.05)


# --- whole surveys ---


def test_a_survey_finds_the_usual_band(surveyed: Run) -> None:
    found = findings(surveyed)
    assert (found.starts, found.segments, sum(found.ends.values())) == (5, 16, 10)
    lowest = found.equilibria[0]
    assert (lowest.index, lowest.inflections, lowest.symmetry, lowest.verdict) == (0, 1, "C2", "continuum")
    assert lowest.segments == (32, 64, 128)
    assert all(
        row.verdict in ("continuum", "mesh", "open") and (row.why or not row.why) for row in found.equilibria
    )
    assert sum(row.hits for row in found.equilibria) == found.ends["minimum"] + found.ends.get("saddle", 0)


def test_its_states_are_those_of_an_ordinary_run(surveyed: Run) -> None:
    states = surveyed.states()
    assert surveyed.short_name == "small-survey-1-climb-1"
    assert all(state.kind == "equilibrium" for state in states)
    assert {state.status for state in states} <= {"minimum", "saddle"}
    for state in states:
        surveyed.load(state.label)


def test_a_finished_survey_computes_nothing(surveyed: Run) -> None:
    log = surveyed.log_path.read_bytes()
    outcome = survey_config(made(), surveyed.path.parent, REQUEST)
    assert outcome.new_states == 0
    assert surveyed.log_path.read_bytes() == log


@pytest.mark.parametrize(
    "after", [7, pytest.param(2, marks=pytest.mark.long), pytest.param(4, marks=pytest.mark.long)]
)
def test_an_interrupted_survey_goes_on_to_the_same_bytes(surveyed: Run, tmp_path: Path, after: int) -> None:
    count = 0

    def watch(event: object) -> None:
        nonlocal count
        count += 1
        if count == after:
            raise StopHereError

    with pytest.raises(StopHereError):
        survey_config(made(), tmp_path, REQUEST, progress=watch)
    (stopped,) = list_runs(tmp_path)
    # A survey does not wait for what its config names, and how many starts it was to take is not kept.
    assert (standing(stopped).status, standing(stopped).counts) == ("unknown", Counts())
    again = survey_config(made(), tmp_path, REQUEST).run
    assert (standing(again).status, standing(again).counts) == ("complete", Counts(complete=True))
    assert hashes(again) == hashes(surveyed)
    assert plain(findings(again)) == plain(findings(surveyed))


def test_a_survey_that_finds_nothing_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "ribbon_cli.surveys.explore.explore",
        lambda task: [End(climb, "left-topology", None) for climb in task.climbs],
    )
    run = survey_config(made(), tmp_path, Request(starts=8)).run
    assert survey_text(findings(run)) == (
        "8 starts, 8 ways from them: left-topology 8\n"
        "no equilibrium was found at b = 0.2, N = 16: 8 of 8 ways led through the band itself; take more "
        "starts, or `contact: forces`, with which a band rests on itself"
    )
    assert b'<p class="no">no equilibrium was found at b = 0.2, N = 16: 8 of 8' in survey_page(run)
    assert (standing(run).status, standing(run).counts) == ("complete", Counts(complete=True))


@pytest.mark.long
def test_a_state_whose_line_was_lost_is_taken_again(surveyed: Run, tmp_path: Path) -> None:
    """A kill between a state's commit and the line of its start."""

    def watch(event: object) -> None:
        if "a new equilibrium" in str(event):
            raise StopHereError

    with pytest.raises(StopHereError):
        survey_config(made(), tmp_path, REQUEST, progress=watch)
    again = survey_config(made(), tmp_path, REQUEST).run
    assert hashes(again) == hashes(surveyed)


@pytest.mark.long
def test_workers_change_nothing(surveyed: Run, tmp_path: Path) -> None:
    several = survey_config(made(), tmp_path, replace(REQUEST, workers=2)).run
    assert hashes(several) == hashes(surveyed)
    assert plain(findings(several)) == plain(findings(surveyed))


@pytest.mark.long
def test_a_survey_that_is_killed_goes_on_to_the_same_bytes(surveyed: Run, tmp_path: Path) -> None:
    """Its workers end with it, and what they had in hand is computed again."""
    (tmp_path / "small.yaml").write_text(CONFIG)
    words = ("survey", "small.yaml", "--starts", "5", "--climb", "1", "-q", "--workers", "2")
    for wanted in (1, 2, 4):
        with spawn(*words, cwd=tmp_path) as process:
            while states_on_disk(tmp_path) < wanted and process.poll() is None:
                time.sleep(0.005)
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            workers = children.read_text().split() if children.exists() else []
            process.send_signal(signal.SIGKILL)
            process.communicate(timeout=60)
        deadline = time.monotonic() + 60
        while any(Path(f"/proc/{worker}").exists() for worker in workers) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not [worker for worker in workers if Path(f"/proc/{worker}").exists()]
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (again,) = list_runs(tmp_path / "runs")
    assert hashes(again) == hashes(surveyed)
    assert plain(findings(again)) == plain(findings(surveyed))


def plain(found: Findings) -> Findings:
    """A survey's result without its run's folder."""
    return replace(found, run="")


@pytest.mark.long
def test_a_strip_between_clamps(tmp_path: Path) -> None:
    """The arch, and nothing of less energy."""
    run = survey_config(made(STRIP), tmp_path, Request(starts=8)).run
    lowest = findings(run).equilibria[0]
    assert (lowest.index, lowest.inflections, lowest.verdict) == (0, 2, "continuum")
    assert lowest.symmetry in ("C2v", "C2h", "Cs")


@pytest.mark.long
def test_both_everted_families_are_found_and_met_again(tmp_path: Path) -> None:
    text = CONFIG.replace(
        "segments: 16, half_width: 0.2, steps: 8", "segments: 48, half_width: 0.15, steps: 48"
    )
    run = survey_config(made(text), tmp_path, Request(starts=16, climb=2, workers=2)).run
    rows = {(row.index, row.inflections, row.symmetry): row for row in findings(run).equilibria}
    first, second = rows[1, 3, "C2"], rows[2, 3, "C2"]
    assert first.energy == pytest.approx(3.108295, abs=1e-6)
    assert second.energy == pytest.approx(3.434815, abs=1e-6)
    assert first.verdict == second.verdict == "continuum"
    assert not first.self_contact


# --- commands ---


def test_the_command_prints_a_table_and_writes_a_page(surveyed: Run, tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(CONFIG)
    words = [
        str(config),
        "--starts",
        "5",
        "--climb",
        "1",
        "--workers",
        "1",
        "--runs",
        str(surveyed.path.parent),
    ]
    page = tmp_path / "page.html"
    done = CliRunner().invoke(cli, ["survey", *words, "-o", str(page)])
    assert done.exit_code == 0, done.stderr
    assert "continuum" in done.stdout
    assert "5 starts, 10 ways from them" in done.stdout
    assert page.read_bytes() == survey_page(surveyed)
    found = json.loads(CliRunner().invoke(cli, ["survey", *words, "--json", "-q"]).stdout)
    assert found["equilibria"][0]["verdict"] == "continuum"
    assert found["new_states"] == 0
    text = page.read_text()
    assert text.count("<img") == len(found["equilibria"]) + 1


def test_report_makes_the_page_of_a_survey(surveyed: Run, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    root = str(surveyed.path.parent)
    done = CliRunner().invoke(cli, ["report", surveyed.short_name, "--runs", root, "-o", str(page)])
    assert done.exit_code == 0, done.stderr
    assert page.read_bytes() == survey_page(surveyed)


def test_the_door_for_programs(surveyed: Run) -> None:
    found = api.survey(made(), surveyed.path.parent, starts=5, climb=1)
    assert found == findings(surveyed)
    with pytest.raises(ValueError, match="1 or more"):
        api.survey(made(), surveyed.path.parent, starts=0)
    assert surveys.is_survey(surveyed)


def test_a_mesh_that_is_too_fine_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="at most 200 segments, got 400"):
        survey_band(made(CONFIG.replace("16", "400")), tmp_path)


# --- processes ---


def test_results_come_in_the_order_of_their_tasks() -> None:
    assert list(in_order(math.sqrt, [1.0, 4.0, 9.0, 16.0], 2)) == [1.0, 2.0, 3.0, 4.0]
    with pytest.raises(ValueError, match=r"domain|nonnegative"):
        list(in_order(math.sqrt, [1.0, -1.0], 2))


def test_a_worker_that_dies_is_told() -> None:
    with pytest.raises(WorkerDiedError, match="ended with 9"):
        list(in_order(os._exit, [9, 9], 2))


# --- lines of the log ---


def test_lines_of_surveys_are_checked_where_they_are_read() -> None:
    end = {"climb": 0, "status": "minimum", "found": 1, "stored": 1}
    line = {"event": "survey-start", "time": "now", "start": 3, "ends": [end]}
    event = parse_line(format_line(line)[:-1])
    assert isinstance(event, SurveyStart)
    assert event.ends[0].found == 1
    for wrong in ({"start": "3"}, {"ends": 1}, {"ends": [{"climb": 0}]}):
        with pytest.raises(ValueError, match=r"missing|name"):
            parse_line(format_line(line | wrong)[:-1])
