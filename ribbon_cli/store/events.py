"""The lines of a run's log, by kind.

What readers rely on is checked here, whatever a line's checksum says.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeGuard

from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.store.summaries import Fields, Summary, are_texts, fits, is_label

_HEXADECIMAL = "0123456789abcdef"
_VERSION = re.compile(r"[1-9]\d{0,3}\.\d{1,4}")
_NUMBER: set[type] = {int, float}
_BRANCH_END = Fields(
    {"branch": {str}, "start": {int}, "reason": {str}, "half_width": _NUMBER, "message": {str}}
)
_STAGE_GIVEN_UP = Fields({"stage": {str}, "parent": {int}, "status": {str}, "detail": {str}})
_LABEL: set[type] = {int, type(None)}
_SURVEY_END = Fields({"climb": {int}, "status": {str}, "found": _LABEL, "stored": _LABEL})
_SURVEY_FOLLOWED = Fields(
    {
        "found": {int},
        "segments": {int},
        "word": {str},
        "label": _LABEL,
        "distance": {*_NUMBER, type(None)},
        "why": {str},
    }
)
_MISSING = "is missing, or of another type"
BRANCH_END = "branch-end"
"""The event that says why a branch ends."""
GIVEN_UP = "stage-given-up"
"""The event of a stage that could not be reached from a state; the same command need not try it again."""
SURVEY_START = "survey-start"
"""The event of a survey's start that was explored."""
SURVEY_FOLLOWED = "survey-followed"
"""The event of an equilibrium of a survey that was looked for on a finer mesh."""
REMOVED = "states-removed"
"""The event that removes states from a run: once it is in the log they are gone, even if files are left."""

_Line = tuple[str, str, bytes]
"""What every event begins with: kind, time and body."""
Place = tuple[float | None, int]
"""A half-width, None where it is not known, and N."""


@dataclass(frozen=True)
class Event:
    """A line of the log. `body` is its JSON, including what only a newer version understands.

    Logs have thousands of lines, and hardly any is asked for more than its fields: no document is kept.
    """

    kind: str
    time: str
    body: bytes

    @property
    def document(self) -> dict[str, Any]:
        """All that the line says, read anew each time."""
        document: dict[str, Any] = json.loads(self.body)
        return document


@dataclass(frozen=True)
class Created(Event):
    """The first line: the format's version, and the hashes of the config files by name."""

    format_version: str
    files: dict[str, str]


@dataclass(frozen=True)
class Entry(Event):
    """A state that was committed: its summary, and the hash of its file."""

    sha256: str
    state: Summary


@dataclass(frozen=True)
class Lost(Event):
    """A state whose file was damaged or missing, its stage and its summary, as far as these are told."""

    label: int
    reason: str
    stage: str | None
    state: Summary | None


@dataclass(frozen=True)
class Ended(Event):
    """The end of a solve: the targets that it missed, and those that lay beyond the event it stopped at."""

    missed: tuple[Place, ...]
    beyond: tuple[Place, ...]


@dataclass(frozen=True)
class BranchEnd(Event):
    """Why and where a branch ends that was begun at the state with the label `start`."""

    branch: str
    start: int
    reason: str
    half_width: float
    message: str
    parameter: str = HALF_WIDTH
    value: float | None = None


@dataclass(frozen=True)
class GivenUp(Event):
    """How a stage failed that was solved for from the state with the label `parent`."""

    stage: str
    parent: int
    status: str
    detail: str


@dataclass(frozen=True)
class SurveyEnd:
    """Where a way from a start of a survey ended: the number of modes climbed, a status, the label of the
    state that was found first of the equilibrium there, and that of the state stored of it, if one was.
    """

    climb: int
    status: str
    found: int | None
    stored: int | None


@dataclass(frozen=True)
class SurveyStart(Event):
    """What came of a survey's start, by its number."""

    start: int
    ends: tuple[SurveyEnd, ...]


@dataclass(frozen=True)
class SurveyFollowed(Event):
    """What came of a survey's equilibrium, named by the state found first of it, on a finer mesh: a word, the
    label of the state there, how far it is from the coarser one, and why there is none.
    """

    found: int
    segments: int
    word: str
    label: int | None
    distance: float | None
    why: str


@dataclass(frozen=True)
class Removed(Event):
    """States that were removed from the run, and branches whose ends no longer count."""

    labels: tuple[int, ...]
    branches: tuple[str, ...]


def read_event(document: Any, body: bytes) -> Event:
    """Return an event of a run's log, also of unknown kind, by what its JSON says.

    Raises ValueError for anything else.
    """
    if not isinstance(document, dict) or not isinstance(document.get("event"), str):
        raise ValueError("it is not an event")
    if not isinstance(document.get("time"), str):
        raise ValueError("it has no time")
    line = (document["event"], document["time"], body)
    make = _KINDS.get(document["event"])
    return make(line, document) if make else Event(*line)


def removed(events: Iterable[Event]) -> dict[int, Entry]:
    """The entries of the states that were removed, by label; only what was stored before can be."""
    there: dict[int, Entry] = {}
    gone: dict[int, Entry] = {}
    for event in events:
        if isinstance(event, Entry):
            there[event.state.label] = event
            gone.pop(event.state.label, None)
        elif isinstance(event, Removed):
            gone |= {label: there.pop(label) for label in event.labels if label in there}
    return gone


def _created(line: _Line, document: dict[str, Any]) -> Created:
    if document.get("format") != "ribbon-run":
        raise ValueError("it is not of a run")
    files = document.get("files")
    if not isinstance(files, dict) or not all(_is_sha256(sha) for sha in files.values()):
        raise ValueError("it has no hashes of the config files")
    version = document.get("format_version")
    if not isinstance(version, str) or not _VERSION.fullmatch(version):
        raise ValueError("it has no version of the format")
    return Created(*line, version, files)


def _state(line: _Line, document: dict[str, Any]) -> Entry:
    state, sha256 = Summary.read(document.get("state")), document.get("sha256")
    if not _is_sha256(sha256) or document.get("file") != f"states/{state.label:04d}.h5":
        raise ValueError(f"it does not name the file of state {state.label} with its hash")
    return Entry(*line, sha256, state)


def _lost(line: _Line, document: dict[str, Any]) -> Lost:
    if not is_label(document.get("label")):
        raise ValueError("it names no state")
    state, reason = document.get("state"), str(document.get("reason", "its file was missing"))
    stage = state.get("stage") if isinstance(state, dict) else None
    known = None
    with suppress(ValueError):
        known = Summary.read(state)
    stage = stage if isinstance(stage, str) else None
    return Lost(*line, document["label"], reason, stage, known)


def _ended(line: _Line, document: dict[str, Any]) -> Ended:
    return Ended(*line, _places(document.get("missed")), _places(document.get("beyond", [])))


def _branch_end(line: _Line, document: dict[str, Any]) -> BranchEnd:
    found = _BRANCH_END.checked(document, _MISSING)
    name, value = document.get("parameter", HALF_WIDTH), document.get("value")
    if name not in PARAMETERS or not (value is None or (type(value) in _NUMBER and fits(value))):
        raise ValueError("parameter or value is of another type")
    return BranchEnd(*line, **found, parameter=name, value=value)


def _given_up(line: _Line, document: dict[str, Any]) -> GivenUp:
    found = _STAGE_GIVEN_UP.checked(document, _MISSING)
    return GivenUp(*line, **found)


def _survey_start(line: _Line, document: dict[str, Any]) -> SurveyStart:
    start, ends = document.get("start"), document.get("ends")
    if type(start) is not int or not isinstance(ends, list):
        raise ValueError("it does not name a start with its ends")
    found = tuple(SurveyEnd(**_SURVEY_END.checked(end, _MISSING)) for end in ends)
    return SurveyStart(*line, start, found)


def _survey_followed(line: _Line, document: dict[str, Any]) -> SurveyFollowed:
    found = _SURVEY_FOLLOWED.checked(document, _MISSING)
    return SurveyFollowed(*line, **found)


def _removed(line: _Line, document: dict[str, Any]) -> Removed:
    labels, branches = document.get("labels"), document.get("branches")
    if not isinstance(labels, list) or not all(map(is_label, labels)):
        raise ValueError("it does not name states by their labels")
    if not isinstance(branches, list) or not are_texts(branches):
        raise ValueError("it does not name branches")
    return Removed(*line, tuple(labels), tuple(branches))


_KINDS: dict[str, Callable[[_Line, dict[str, Any]], Event]] = {
    "created": _created,
    "state": _state,
    "state-lost": _lost,
    "ended": _ended,
    BRANCH_END: _branch_end,
    GIVEN_UP: _given_up,
    SURVEY_START: _survey_start,
    SURVEY_FOLLOWED: _survey_followed,
    REMOVED: _removed,
}


def _is_sha256(value: Any) -> TypeGuard[str]:
    return isinstance(value, str) and len(value) == 64 and not value.strip(_HEXADECIMAL)


def _places(values: Any) -> tuple[Place, ...]:
    if not isinstance(values, list) or not all(map(_is_place, values)):
        raise ValueError("its missed targets are not pairs of a half-width and N")
    return tuple((b, n) for b, n in values)


def _is_place(value: Any) -> bool:
    """Whether a value is a half-width, or null where that is not known, and N."""
    return (
        isinstance(value, list)
        and len(value) == 2
        and (value[0] is None or type(value[0]) in (int, float))
        and type(value[1]) is int
    )
