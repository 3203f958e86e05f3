"""What may differ between two runs of one program, taken out: folders, times, revisions, hashes of files."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from .states import DAMAGED, StateFile

# Facts of a process, in provenance and logs. `sha256`, `crc32` and the hashes of config files are of
# bytes that hold such facts; the config files themselves are compared.
_FACTS = {
    *("time", "started", "wall_seconds", "cpu_seconds", "peak_memory_bytes", "seconds"),
    *("code_revision", "code_dirty", "git_revision", "git_dirty", "pid", "host", "sha256", "crc32"),
    *("config.yaml", "resolved.yaml"),
}
_SECONDS = re.compile(r"\b(?:\d+ min )?\d+(?:\.\d+)? s\b|\b\d+ h \d\d min\b")
_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|\+00:00)?")
_FACT = "|".join(sorted(_FACTS))
_FACT_LINE = re.compile(rf"^(\s*(?:/provenance/)?(?:{_FACT})\s+)\S.*$", re.MULTILINE)
_FACT_CELL = re.compile(rf"(<td>(?:{_FACT})[^<]*</td><td>).*?(?=</td>)")

SHORT = 12
"""Characters of a content hash in captions."""


class Words:
    """The words of one side that stand for the same thing in the other: its folders, and its states' hashes.

    A state's content hash is replaced by the state's place, wherever it is printed: a state that differs is
    then told once, as that, and not again in every document that names its hash.
    """

    def __init__(self, places: tuple[str, str], states: Iterable[StateFile]) -> None:
        self.known = dict(zip(places, ("<here>", "<program>"), strict=True))
        for state in states:
            if state.content != DAMAGED:
                told = f"<content of {state.place}>"
                self.known |= {state.content: told, state.content[:SHORT]: told}
        self._pattern = re.compile("|".join(map(re.escape, sorted(self.known, key=len, reverse=True))))
        self._bytes = re.compile(self._pattern.pattern.encode())

    def of(self, text: str) -> str:
        """A text with what may differ replaced."""
        text = self._pattern.sub(lambda found: self.known[found[0]], text)
        for pattern in (_FACT_LINE, _FACT_CELL):
            text = pattern.sub(r"\1<fact>", text)
        return _TIME.sub("<time>", _SECONDS.sub("<seconds>", text))

    def of_bytes(self, data: bytes) -> bytes:
        """The bytes of a file with the folder and the hashes replaced, and nothing else."""
        return self._bytes.sub(lambda found: self.known[found[0].decode()].encode(), data)


def plain(value: Any) -> Any:
    """A document whose facts of a process are left out of comparison: they are there, whatever they say."""
    if isinstance(value, dict):
        path = value.get("path")
        if isinstance(path, str) and path.startswith("/provenance/"):
            return {"path": path}  # a pair of facts that are compared
        return {key: "<fact>" if key in _FACTS else plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value
