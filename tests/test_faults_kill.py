"""A solve killed at any moment, inside of commits too, loses nothing and resumes to the same bytes."""

from __future__ import annotations

import random
import shutil
import time

import pytest
from cli_support import QUICK_BRANCH, QUICK_SCHOENKE
from fault_support import QUICK as LONGER
from fault_support import Marks, child, contents, kill_after, solve_in, wait

from ribbon_cli.store import list_runs

QUICK = LONGER.replace("steps: 4", "steps: 2")
"""Four states, one of them a saddle: less to compute between the commits, so more kills a minute."""


CONFIGS = {"twist": QUICK, "schoenke": QUICK_SCHOENKE, "branch": QUICK_BRANCH}
PARTS = ["twist"] * 6 + ["schoenke"] * 2 + ["branch"] * 2


@pytest.fixture(scope="module", params=["twist"])
def alone(request, tmp_path_factory):
    """A config, the hashes of its uninterrupted run, and how long that takes a forked child.

    It is run in this process first: children find everything imported, and spend their time in the solve.
    """
    text = CONFIGS[request.param]
    folder = tmp_path_factory.mktemp("alone")
    (folder / "quick.yaml").write_text(text)
    assert solve_in(folder) == 0
    (run,) = list_runs(folder / "runs")
    expected = contents(run)
    if request.param == "twist":
        assert [state.kind for state in run.states(all=True)].count("saddle") == 1
    shutil.rmtree(folder / "runs")
    started = time.monotonic()
    assert wait(child(lambda: solve_in(folder))) == 0
    seconds = time.monotonic() - started
    (run,) = list_runs(folder / "runs")
    assert contents(run) == expected
    return text, expected, seconds


def kills(alone, folder, monkeypatch, count: int, seed: int) -> int:
    """Kill that many solves, resume each to its end; how many kills fell into a commit."""
    text, expected, seconds = alone
    chance = random.Random(seed)
    marks = Marks()
    marks.watch(monkeypatch)
    inside = killed = 0
    while killed < count:
        shutil.rmtree(folder / "runs", ignore_errors=True)
        (folder / "quick.yaml").write_text(text)
        for _ in range(1 + (killed % 5 == 0)):  # now and then the resumed one is killed as well
            marks.memory[0] = 0
            pid = child(lambda: solve_in(folder))
            if killed % 2:
                time.sleep(chance.uniform(0.0, seconds))
                # Within a commit, or soon after: one takes a few milliseconds, or some tens on a slow disk.
                hit = kill_after(pid, chance.uniform(0.0, 1.2 * (marks.seconds or 0.03)), marks)
            else:
                hit = kill_after(pid, chance.uniform(0.0, 1.1 * seconds))
            killed += hit
            inside += hit and marks.committing
            if hit and (folder / "runs").is_dir():
                for run in list_runs(folder / "runs"):
                    kept = contents(run)
                    assert kept.items() <= expected.items()
        assert wait(child(lambda: solve_in(folder))) == 0
        (run,) = list_runs(folder / "runs")
        assert contents(run) == expected
        assert not [path for path in run.path.rglob("*") if ".damaged-" in path.name]
    return inside


@pytest.mark.long
def test_some_kills(alone, tmp_path, monkeypatch):
    assert kills(alone, tmp_path, monkeypatch, 4, seed=1) >= 1


@pytest.mark.faults
@pytest.mark.parametrize(
    ("alone", "part"),
    [(name, part) for part, name in enumerate(PARTS)],
    ids=[f"{name}-{part}" for part, name in enumerate(PARTS)],
    indirect=["alone"],
)
def test_five_hundred_kills(alone, tmp_path, monkeypatch, figure, part):
    """Fifty of the five hundred, at least ten of which must fall into a commit."""
    inside = kills(alone, tmp_path, monkeypatch, 50, seed=2 + part)
    figure(f"50 kills, {inside} of them inside a commit")
    assert inside >= 10
