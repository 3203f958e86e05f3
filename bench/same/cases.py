"""Cases: files to begin with, and command lines to run one after another. See the head of `cases.yaml`."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

CASES = Path(__file__).with_name("cases.yaml")
ROOT = Path(__file__).parents[2]
_KEYS = {"case", "quick", "needs", "files", "copy", "run"}
_EXIT = re.compile(r"(.*\S)\s+=>\s+(\d+)")
_FILE_STEPS = ("remove", "spoil")


class CaseError(Exception):
    """The list of cases or of expectations is wrong."""


@dataclass(frozen=True)
class Step:
    """One command line of `ribbon` with the exit code that it has, or something done to files.

    `action` is `ribbon`, or `remove` or `spoil` with a pattern of files.
    """

    action: str
    words: tuple[str, ...]
    code: int = 0

    @property
    def text(self) -> str:
        """The step as people read it."""
        return shlex.join(self.words) if self.action == "ribbon" else f"{self.action} {self.words[0]}"


@dataclass(frozen=True)
class Case:
    """A folder's files by name, and the steps that are run in it.

    A build without the file `needs` is not asked.
    """

    name: str
    quick: bool
    files: dict[str, bytes] = field(repr=False)
    steps: tuple[Step, ...]
    needs: str = ""

    def key(self, *more: str) -> str:
        """A short hash of all that the case's results depend on, but for the program."""
        digest = hashlib.sha256(json.dumps(more).encode())
        for name, data in sorted(self.files.items()):
            digest.update(f"{name}\0{len(data)}\0".encode() + data)
        digest.update(json.dumps([(step.action, step.words) for step in self.steps]).encode())
        return digest.hexdigest()[:12]


def read_cases(path: Path = CASES) -> tuple[Case, ...]:
    """The cases of a file. Raises CaseError."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        cases = tuple(_case(item, document.get("sets", {})) for item in document["cases"])
    except (OSError, yaml.YAMLError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise CaseError(f"{path}: {type(error).__name__}: {error}") from error
    names = [case.name for case in cases]
    if len(names) != len(set(names)):
        raise CaseError(f"{path}: two cases have one name")
    return cases


def _case(item: dict[str, Any], sets: dict[str, list[str]]) -> Case:
    """One case of the file."""
    if unknown := set(item) - _KEYS:
        raise CaseError(f"case {item.get('case')!r}: unknown key {min(unknown)!r}; known are {sorted(_KEYS)}")
    files = {name: text.encode() for name, text in item.get("files", {}).items()}
    files |= {name: (ROOT / source).read_bytes() for name, source in item.get("copy", {}).items()}
    steps = tuple(step for entry in item["run"] for step in _steps(entry, sets))
    return Case(item["case"], bool(item.get("quick", False)), files, steps, item.get("needs", ""))


def _steps(entry: str | dict[str, str], sets: dict[str, list[str]]) -> Iterator[Step]:
    """The steps of an entry: a command line, a set of them about something, or what is done to files."""
    if isinstance(entry, str):
        ended = _EXIT.fullmatch(entry)
        words, code = (ended[1], int(ended[2])) if ended else (entry, 0)
        yield Step("ribbon", tuple(shlex.split(words)), code)
        return
    ((name, about),) = entry.items()
    if name in _FILE_STEPS:
        yield Step(name, (about,))
        return
    if name not in sets:
        raise CaseError(f"{name!r} is no set of commands, nor one of {', '.join(_FILE_STEPS)}")
    for line in sets[name]:
        yield from _steps(line.replace("{}", about), {})
