"""Every command that writes, killed at any moment: no committed state is lost, no half file bears a final
name, and the same line again succeeds.
"""

from __future__ import annotations

import random
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_support import ribbon
from fault_support import child, contents, kill_after, wait

from ribbon_cli.cli.main import cli
from ribbon_cli.store import Run, list_runs
from ribbon_cli.store.pack import read_pack

CONFIG = """\
name: killed
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 8, half_width: 0.1}
widths: [0.1, 0.2]
spectrum: {modes: 2, full_up_to: 0}
"""
LINES = {
    "pack": ("pack", "killed", "-o", "out/a.pack.h5"),
    "unpack": ("unpack", "whole.pack.h5", "--runs", "out"),
    "rm": ("rm", "killed", "--yes"),
    "repair": ("repair", "killed"),
    "rerun": ("rerun", "killed", "--into", "out"),
    "refine": ("refine", "killed:1", "--to", "16"),
    "continue": ("continue", "killed:1", "--to", "0.12", "--arclength"),
    "export": ("export", "killed:1", "--to", "npz", "-o", "out/a.npz"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A run and its pack; every command is tried here, so that children find everything imported."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "killed.yaml").write_text(CONFIG)
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        here.delenv("RIBBON_RUNS", raising=False)
        assert ribbon("solve", "killed.yaml").exit_code == 0
        assert ribbon("pack", "killed", "-o", "whole.pack.h5").exit_code == 0
        shutil.copytree(folder, folder.with_name("tried"))
        here.chdir(folder.with_name("tried"))
        Path("out").mkdir()
        for name in sorted(LINES, key=lambda name: name == "rm"):
            assert ribbon(*LINES[name]).exit_code == 0, name
    return folder


def line(name: str) -> Callable[[], int]:
    """One of the commands, in this process."""

    def action() -> int:
        try:
            cli.main([*LINES[name], "-q"])
        except SystemExit as left:
            return int(left.code or 0)
        return 0

    return action


def whole(folder: Path) -> None:
    """Whatever bears a final name is whole: each run that is there, each pack, each export."""
    for root in ("runs", "out"):
        for run in list_runs(folder / root):
            contents(run)
            assert not [path for path in run.path.rglob("*.damaged-*") if name_of(path) not in DAMAGED]
    for path in (folder / "out").glob("*.h5"):
        if not path.name.startswith("."):
            assert len(list(read_pack(path)[1])) > 3
    for path in (folder / "out").glob("*.npz"):
        if not path.name.startswith("."):
            with np.load(path) as archive:
                assert all(np.asarray(archive[key]).size >= 0 for key in archive)


DAMAGED = {"0003.h5"}
"""What `repair` is to put aside."""


def name_of(path: Path) -> str:
    return path.name.partition(".damaged-")[0]


def prepare(made: Path, folder: Path, name: str) -> dict[int, str]:
    """A copy of the run to work on, for `repair` a damaged one; the hashes of its states."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(made, folder)
    (folder / "out").mkdir()
    (run,) = list_runs(folder / "runs")
    kept = contents(run)
    if name == "repair":
        lines = run.log_path.read_bytes().splitlines(keepends=True)
        run.log_path.write_bytes(lines[0] + b"nonsense\n" + b"".join(lines[2:]))
        (run.path / "states" / "0003.h5").write_bytes(b"nothing")
        (run.path / "config.yaml").unlink()
    return kept


def kills(made: Path, folder: Path, name: str, count: int, seed: int, patch: pytest.MonkeyPatch) -> int:
    """Kill the command so many times at random, then let it end; how many it was still running for."""
    chance = random.Random(f"{name} {seed}")
    folder = folder / "here"
    patch.delenv("RIBBON_RUNS", raising=False)
    took = []
    for _ in range(2):  # the first is cold, and the quicker one is what kills are to fall into
        patch.chdir(folder.parent)
        prepare(made, folder, name)
        patch.chdir(folder)
        started = time.monotonic()
        assert wait(child(line(name))) == 0
        took.append(time.monotonic() - started)
    seconds, killed = min(took), 0
    for _ in range(count):
        patch.chdir(folder.parent)
        kept = prepare(made, folder, name)
        patch.chdir(folder)
        for _ in range(chance.choice((1, 1, 2))):
            killed += kill_after(child(line(name)), chance.uniform(0.0, 1.1 * seconds))
            runs = list_runs("runs")
            if name == "rm":
                assert len(runs) <= 1
            if name == "repair":
                for label in kept:
                    assert Run(runs[0].path).state_path(label).is_file()
            else:
                whole(folder)
                for run in runs:
                    assert kept.items() <= contents(run).items()
        code = wait(child(line(name)))
        done = "rm" if not list_runs("runs") else "unpack" if list_runs("out") else "other"
        is_done = name == done or any((folder / "out").glob("a.*"))
        assert code == 0 or (code == 2 and is_done), (name, code)
        whole(folder)
        if name == "rm":
            assert list_runs("runs") == []
            continue
        (run,) = list_runs("runs")
        assert kept.items() <= contents(run).items()
        if count > 1:
            assert ribbon("verify", "killed").exit_code == 0
    return killed


QUICK = ("repair", "rm")
EACH_LINE = [pytest.param(name, marks=() if name in QUICK else pytest.mark.long) for name in LINES]


@pytest.mark.parametrize("name", EACH_LINE)
def test_a_killed_command_can_be_given_again(made, tmp_path, monkeypatch, name):
    kills(made, tmp_path, name, 1, 1, monkeypatch)


@pytest.mark.faults
@pytest.mark.parametrize("name", LINES)
def test_many_kills_of_a_command(made, tmp_path, monkeypatch, figure, name):
    killed = kills(made, tmp_path, name, 40, 2, monkeypatch)
    figure(f"{killed} kills")
    assert killed >= 10
