"""What differs between two observations of a case: states, exit codes, JSON, text and files, one by one."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .normal import Words, plain
from .observe import Observation, Printed
from .states import DAMAGED, StateFile, attributes, datasets, differing, states_below

KINDS = {
    "state": "states that one side lacks",
    "hash": "states whose content_sha256 alone differs",
    "dataset": "datasets of states",
    "attribute": "attributes in state files",
    "exit": "exit codes",
    "json": "values in JSON, changed or removed",
    "json-added": "values in JSON, added",
    "text": "lines on standard output",
    "message": "lines on standard error",
    "file": "other files",
}
_RUN_FILES = ("config.yaml", "resolved.yaml", "log.jsonl")
_LONGEST = 160


@dataclass(frozen=True)
class Difference:
    """One difference: its kind, its case, where (a command, a state, a file), and the path in that."""

    kind: str
    case: str
    where: str
    path: str
    detail: str


@dataclass(frozen=True)
class Compared:
    """The differences of a case, and how much was compared."""

    differences: tuple[Difference, ...]
    states: int
    steps: int
    documents: int
    files: int


def compare(case: str, before: Observation, after: Observation) -> Compared:
    """Compare what came of a case in two builds."""
    states = states_below(before.work), states_below(after.work)
    words = Words(before.places, states[0].values()), Words(after.places, states[1].values())
    found = list(_states(*states))
    pairs = list(zip(before.steps, after.steps, strict=True))
    for one, two in pairs:
        found += _printed(one, two, words)
    names = _files(before.work) | _files(after.work)
    for name in sorted(names):
        found += _file(name, before.work / name, after.work / name, words)
    return Compared(
        tuple(Difference(kind, case, where, path, detail) for kind, where, path, detail in found),
        len(states[0].keys() | states[1].keys()),
        len(pairs),
        sum(_is_document(one) for one, _ in pairs),
        len(names),
    )


Found = Iterator[tuple[str, str, str, str]]
"""Kind, where, path and detail of differences."""


def _states(first: dict[str, StateFile], second: dict[str, StateFile]) -> Found:
    """Differing states, and of each the datasets and attributes that differ."""
    runs: set[Path] = set()
    for place in sorted(first.keys() | second.keys()):
        if place not in second or place not in first:
            yield "state", place, "", "missing" if place in first else "added"
            continue
        one, two = first[place], second[place]
        if one.content == two.content == DAMAGED:
            continue
        datasets_differ = list(differing(datasets(one.path), datasets(two.path)))
        if one.content != two.content and not datasets_differ:
            yield "hash", place, "content_sha256", f"{one.content} -> {two.content}"
        for path, detail in datasets_differ:
            yield "dataset", place, path, detail
        # Attributes say what a dataset is: they are the same in all states of a run.
        if (run := one.path.parents[1]) not in runs:
            runs.add(run)
            for path, detail in _tree(attributes(one.path), attributes(two.path)):
                yield "attribute", place, path, detail


def _is_document(step: Printed) -> bool:
    return "--json" in step.text.split()


def _printed(one: Printed, two: Printed, words: tuple[Words, Words]) -> Found:
    """What a step printed, and its exit code."""
    if one.code != two.code:
        yield "exit", one.text, "", f"{one.code} -> {two.code}"
    texts = words[0].of(one.stdout), words[1].of(two.stdout)
    documents = [_parsed(text) for text in texts] if _is_document(one) else [None, None]
    if all(document is not None for document in documents):
        yield from _documents(one.text, *documents)
    else:
        yield from _lines("text", one.text, *texts)
    yield from _lines("message", one.text, words[0].of(one.stderr), words[1].of(two.stderr))


def _parsed(text: str) -> Any:
    """A JSON document without what always differs; None of what is none."""
    try:
        return plain(json.loads(text))
    except json.JSONDecodeError:
        return None


def _documents(where: str, one: Any, two: Any) -> Found:
    """Values that differ in two JSON documents, those that were added apart."""
    for path, detail in _tree(one, two):
        yield "json-added" if detail.startswith("added: ") else "json", where, path, detail


def _tree(one: Any, two: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Paths at which two documents differ, and how; members of lists by number."""
    if isinstance(one, list) and isinstance(two, list):
        one, two = dict(enumerate(one)), dict(enumerate(two))
    if isinstance(one, dict) and isinstance(two, dict):
        for key in [*one, *(key for key in two if key not in one)]:
            below = f"{path}.{key}" if path else str(key)
            if key not in two:
                yield below, f"removed: {_short(one[key])}"
            elif key not in one:
                yield below, f"added: {_short(two[key])}"
            else:
                yield from _tree(one[key], two[key], below)
    # Not by ==, for which 1, 1.0 and True are one.
    elif json.dumps(one) != json.dumps(two):
        yield path, f"{_short(one)} -> {_short(two)}"


def _lines(kind: str, where: str, one: str, two: str) -> Found:
    """Lines that differ."""
    if one == two:
        return
    first, second = one.splitlines(), two.splitlines()
    if first == second:
        yield kind, where, "end", "the last line's end differs"
    for tag, a, b, c, d in difflib.SequenceMatcher(None, first, second, autojunk=False).get_opcodes():
        if tag != "equal":
            yield kind, where, f"line {a + 1}", f"{_short(first[a:b])} -> {_short(second[c:d])}"


def _files(work: Path) -> set[str]:
    """Names of files that are compared: all but states."""
    names = (path.relative_to(work) for path in work.rglob("*") if path.is_file())
    return {str(name) for name in names if not (name.suffix == ".h5" and name.parent.name == "states")}


def _file(name: str, one: Path, two: Path, words: tuple[Words, Words]) -> Found:
    """A file that is no state: of a run, or written by a command."""
    if not (one.is_file() and two.is_file()):
        yield "file", name, "", "missing" if one.is_file() else "added"
        return
    if _is_ignored(one):
        return
    data = words[0].of_bytes(one.read_bytes()), words[1].of_bytes(two.read_bytes())
    if one.name == "log.jsonl":
        yield from _documents(name, *(_log(part) for part in data))
    elif one.suffix == ".json":
        yield from _documents(name, *(_parsed(part.decode()) for part in data))
    elif one.suffix == ".npz":
        yield from (
            ("file", name, *how)
            for how in differing(*(_arrays(p, w) for p, w in zip((one, two), words, strict=True)))
        )
    elif one.suffix == ".vtkhdf":
        yield from (("file", name, *how) for how in differing(datasets(one), datasets(two)))
    elif data[0] != data[1]:
        texts = [_decoded(part) for part in data]
        if None in texts:
            yield "file", name, "", f"{len(data[0])} bytes and {len(data[1])} bytes differ"
        else:
            yield from _lines("file", name, *(w.of(text) for w, text in zip(words, texts, strict=True)))


def _is_ignored(path: Path) -> bool:
    """Who held the lock, replaced logs, and files with whole states in them: packed runs and damaged files.

    They hold facts of a process. The states of a packed run are compared where it is unpacked.
    """
    return (
        path.name.startswith(("lock", "log.jsonl.old")) or path.suffix == ".h5" or ".h5.damaged" in path.name
    )


def _log(data: bytes) -> list[Any]:
    """A log's lines as documents."""
    return [_parsed(line) for line in data.decode().splitlines()]


def _arrays(path: Path, words: Words) -> dict[str, Any]:
    """The arrays of an npz file, texts in their common form."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    return {
        name: np.array(words.of(str(array))) if array.dtype.kind == "U" and array.ndim == 0 else array
        for name, array in arrays.items()
    }


def _decoded(data: bytes) -> str | None:
    """A file's text; None of a file that is none."""
    try:
        return None if b"\0" in data else data.decode()
    except UnicodeDecodeError:
        return None


def _short(value: Any) -> str:
    """A value in a few words."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 20]}...{text[-17:]}"
