"""Running the command line in tests: in this process, and as a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from inspect import signature
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from ribbon_cli.cli.main import cli
from ribbon_cli.store import list_runs

ESCAPE = "\x1b"
COMMAND = [sys.executable, "-m", "ribbon_cli"]

QUICK_RING = """\
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 12, half_width: 0.1}
widths: [0.1, 0.5]
refinement: [12, 24]
"""

QUICK_MOBIUS = """\
name: mobius
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 24, half_width: 0.1, steps: 10}
widths: [0.1, 0.2]
refinement: [24, 48]
spectrum: {modes: 4, full_up_to: 0}
"""

QUICK_SCHOENKE = """\
name: three
topology: {half_twists: -3}
discretisation: value-average
initial_guess: {recipe: schoenke, segments: 24, half_width: 0.2}
widths: [0.2, 0.25]
refinement: [24, 48]
spectrum: {modes: 4, full_up_to: 24}
"""

QUICK_BRANCH = """\
name: branch
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 24, half_width: 0.1, steps: 6}
widths: {arclength: {to: 0.4, at: [0.2], max_step: 0.3}}
spectrum: {modes: 2, full_up_to: 0}
"""


def ribbon(*args: str | Path, **options: Any) -> Result:
    """Run a command line in this process."""
    separate = {"mix_stderr": False} if "mix_stderr" in signature(CliRunner).parameters else {}  # click < 8.2
    return CliRunner(**separate).invoke(cli, [str(arg) for arg in args], **options)


def ribbon_json(*args: str | Path, code: int = 0) -> Any:
    """Run a command line with --json; the document that it prints, and nothing else, to standard output."""
    result = ribbon(*args, "--json")
    assert result.exit_code == code, result.output
    return parse_json(result.stdout)


def parse_json(text: str) -> Any:
    """One document without NaN or infinities, which JSON does not have."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)


def environment(**changes: str) -> dict[str, str]:
    """This process's environment without what would change the command line's behaviour."""
    kept = {k: v for k, v in os.environ.items() if k not in ("RIBBON_RUNS", "NO_COLOR", "FORCE_COLOR")}
    return kept | changes


def content_hashes(root: Path) -> dict[int, str]:
    """Content hashes by label of the one run in a folder of runs, checked against the files."""
    (made,) = list_runs(root)
    for label in made.entries():
        made.load(label)
    return {state.label: state.content_sha256 for state in made.states(all=True)}


def states_on_disk(folder: Path) -> int:
    """How many state files lie below `folder`/runs, committed or not."""
    return len(list(folder.glob("runs/*/states/*.h5")))


def stop_after(process: subprocess.Popen[str], folder: Path, states: int, number: int) -> str:
    """Send a signal as soon as so many states are on disk, and wait for the end; standard error."""
    while states_on_disk(folder) < states and process.poll() is None:
        time.sleep(0.001)
    process.send_signal(number)
    return process.communicate(timeout=60)[1]


def spawn(*args: str | Path, cwd: Path, **changes: str) -> subprocess.Popen[str]:
    """Start `ribbon` as a process."""
    return subprocess.Popen(
        [*COMMAND, *map(str, args)],
        cwd=cwd,
        env=environment(**changes),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(*args: str | Path, cwd: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """Run `ribbon` as a process to its end."""
    with spawn(*args, cwd=cwd, **changes) as process:
        stdout, stderr = process.communicate(timeout=240)
    return subprocess.CompletedProcess(process.args, process.returncode, stdout, stderr)
