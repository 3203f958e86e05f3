"""Run a case with a build, and keep all of it in a folder: files, exit codes, what was printed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from .builds import Build
from .cases import Case, CaseError, Step

WORK = "work"
"""The folder, in that of an observation, in which the commands were run."""
_NOTES = "observed.json"


@dataclass(frozen=True)
class Printed:
    """What came of a step, and the seconds of processor that it took."""

    text: str
    code: int
    stdout: str
    stderr: str
    seconds: float


@dataclass(frozen=True)
class Observation:
    """What came of a case: its folder and its steps; where it was run, and the tree of the program."""

    folder: Path
    steps: tuple[Printed, ...]
    places: tuple[str, str]

    @property
    def work(self) -> Path:
        """What the folder of the commands became."""
        return self.folder / WORK

    @property
    def seconds(self) -> float:
        """Seconds of processor."""
        return sum(step.seconds for step in self.steps)


def observe(case: Case, build: Build, folder: Path) -> Observation:
    """Run a case in a new folder; what is in the folder's place is removed."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # In a folder whose name is always as long: lines with it in them break at the same places.
    work = Path(tempfile.mkdtemp(prefix="same-")).resolve()
    try:
        for name, data in case.files.items():
            (work / name).write_bytes(data)
        steps = [_run(step, build, work) for step in case.steps]
        shutil.copytree(work, folder / WORK, symlinks=True)
    finally:
        shutil.rmtree(work)
    places = (str(work), str(build.tree))
    notes = {"places": places, "steps": [asdict(step) for step in steps]}
    # Written last: a folder without it is of an observation that did not end.
    (folder / _NOTES).write_text(json.dumps(notes, indent=1), encoding="utf-8")
    return Observation(folder, tuple(steps), places)


def kept(folder: Path) -> Observation | None:
    """The observation in a folder, if it is whole, and of this program's making."""
    try:
        notes = json.loads((folder / _NOTES).read_text(encoding="utf-8"))
        steps = tuple(Printed(**step) for step in notes["steps"])
        return Observation(folder, steps, tuple(notes["places"]))
    except (FileNotFoundError, TypeError):
        return None


def _run(step: Step, build: Build, work: Path) -> Printed:
    """Do one step."""
    if step.action != "ribbon":
        return Printed(step.text, _to_files(step, work), "", "", 0.0)
    with tempfile.TemporaryFile() as stdout, tempfile.TemporaryFile() as stderr:
        child = subprocess.Popen(
            build.command(*step.words),
            cwd=work,
            env=build.environment(),
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=stderr,
        )
        # The processor's seconds of this child alone: others run beside it.
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for stream in (stdout, stderr):
            stream.seek(0)
            texts.append(stream.read().decode(errors="backslashreplace"))
    return Printed(step.text, child.returncode, *texts, used.ru_utime + used.ru_stime)


def _to_files(step: Step, work: Path) -> int:
    """Remove files, or change a byte in the middle of each; there must be some. Raises CaseError."""
    paths = sorted(work.glob(step.words[0]))
    if not paths:
        raise CaseError(f"{step.text}: there is no such file in {work}")
    for path in paths:
        if step.action == "remove":
            path.unlink()
            continue
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(data)
    return 0
