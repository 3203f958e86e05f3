"""What a line of a run's log must say, whatever its checksum: readers take its fields for granted."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from ribbon_cli.store.layout import BRANCH, STATE, Item

_SHA256 = re.compile(r"[0-9a-f]{64}")
_TOPOLOGY = ("half_twists", "sigma")
_NONE: set[type] = {type(None)}
_JSON: dict[str, set[type]] = {
    "bool": {bool},
    "utf-8": {str},
    "int64": {int},
    "float64": {int, float} | _NONE,
}
"""What a value may be in JSON, by the type that it has in a file; not-a-number is null."""


def _types(items: Iterable[Item]) -> dict[str, frozenset[type]]:
    """The types by field; no class is taken for another, as bool is for int by `isinstance`."""
    found = {}
    for item in items:
        types: set[type] = {list} if item.dims else _JSON[item.dtype]
        found[item.field] = frozenset(types | _NONE if item.optional else types)
    return found


_OF_STATE = _types(item for item in STATE if item.summary and item.field not in _TOPOLOGY)
_OF_TOPOLOGY = _types(item for item in STATE if item.field in _TOPOLOGY)
_OF_BRANCH = _types(item for item in BRANCH if item.summary)
_BRANCH_END = {
    "branch": frozenset({str}),
    "start": frozenset({int}),
    "reason": frozenset({str}),
    "half_width": frozenset({int, float}),
    "message": frozenset({str}),
}
_STAGE_GIVEN_UP = {
    "stage": frozenset({str}),
    "parent": frozenset({int}),
    "status": frozenset({str}),
    "detail": frozenset({str}),
}
_POSITIVE = ("half_width", "segments", "length")
_VERSION = re.compile(r"[1-9]\d{0,3}\.\d{1,4}")
_LARGEST = 2**63
"""Bound of whole numbers, as in a file."""
LABELS = 10**12
"""Bound of the labels that a line may name."""
REMOVED = "states-removed"
"""The event that takes states out of a run: once it is in the log they are gone, whatever files are left."""

GIVEN_UP = "stage-given-up"
"""The event of a stage that was not reached from a state, and that the same command need not try again."""


def check_event(entry: Any) -> dict[str, Any]:
    """Return an event of a run's log, unknown kinds too. Raises ValueError for what is none."""
    if not isinstance(entry, dict) or not isinstance(entry.get("event"), str):
        raise ValueError("it is not an event")
    if not isinstance(entry.get("time"), str):
        raise ValueError("it has no time")
    if entry["event"] in _CHECKS:
        _CHECKS[entry["event"]](entry)
    return entry


def removed(events: Iterable[Mapping[str, Any]]) -> dict[int, Mapping[str, Any]]:
    """The entries of the states that were removed, by label; only what was stored before can be."""
    there: dict[int, Mapping[str, Any]] = {}
    gone: dict[int, Mapping[str, Any]] = {}
    for event in events:
        if event["event"] == "state":
            there[event["state"]["label"]] = event
            gone.pop(event["state"]["label"], None)
        elif event["event"] == REMOVED:
            gone |= {label: there.pop(label) for label in event["labels"] if label in there}
    return gone


def _created(entry: dict[str, Any]) -> None:
    if entry.get("format") != "ribbon-run":
        raise ValueError("it is not of a run")
    files = entry.get("files")
    if not isinstance(files, dict) or not all(_is_sha256(sha) for sha in files.values()):
        raise ValueError("it has no hashes of the config files")
    version = entry.get("format_version")
    if not isinstance(version, str) or not _VERSION.fullmatch(version):
        raise ValueError("it has no version of the format")


def _state(entry: dict[str, Any]) -> None:
    state = entry.get("state")
    if not isinstance(state, dict) or not _is_label(state.get("label")):
        raise ValueError("it has no state with a label")
    if not _is_sha256(entry.get("sha256")) or entry.get("file") != f"states/{state['label']:04d}.h5":
        raise ValueError(f"it does not name the file of state {state['label']} with its hash")
    of = f"of state {state['label']} is missing, or of another type"
    _require(state, _OF_STATE, of)
    kinds = state.get("event_kinds", [""] * len(state["events"]))
    if not isinstance(kinds, list) or not _are_texts(kinds) or len(kinds) != len(state["events"]):
        raise ValueError(f"event_kinds {of}")
    for name in _POSITIVE:
        if not (state[name] or 0) > 0:
            raise ValueError(f"{name} of state {state['label']} is not positive")
    _require(state.get("topology"), _OF_TOPOLOGY, of)
    if state.get("branch") is None:
        return
    if state["parent"] is None:
        raise ValueError(f"state {state['label']} is a point of a branch, and has no parent")
    _require(state["branch"], _OF_BRANCH, of)


def _lost(entry: dict[str, Any]) -> None:
    if not _is_label(entry.get("label")):
        raise ValueError("it names no state")


def _ended(entry: dict[str, Any]) -> None:
    for places in (entry.get("missed"), entry.get("beyond", [])):
        if not isinstance(places, list) or not all(_is_place(place) for place in places):
            raise ValueError("its missed targets are not pairs of a half-width and N")


def _branch_end(entry: dict[str, Any]) -> None:
    _require(entry, _BRANCH_END, "is missing, or of another type")


def _given_up(entry: dict[str, Any]) -> None:
    _require(entry, _STAGE_GIVEN_UP, "is missing, or of another type")


def _removed(entry: dict[str, Any]) -> None:
    labels, branches = entry.get("labels"), entry.get("branches")
    if not isinstance(labels, list) or not all(map(_is_label, labels)):
        raise ValueError("it does not name states by their labels")
    if not isinstance(branches, list) or not _are_texts(branches):
        raise ValueError("it does not name branches")


_CHECKS = {
    "created": _created,
    "state": _state,
    "state-lost": _lost,
    "ended": _ended,
    "branch-end": _branch_end,
    GIVEN_UP: _given_up,
    REMOVED: _removed,
}


def _require(fields: Any, types: Mapping[str, frozenset[type]], of: str) -> None:
    """Raise ValueError unless a part of a summary has all these fields, each of one of its types."""
    found = fields if isinstance(fields, dict) else {}
    for name, allowed in types.items():
        value = found.get(name, _require)  # which is no value at all
        kind = type(value)
        if kind in allowed:
            if kind is float:
                if math.isfinite(value):  # as 1e999 is not
                    continue
            elif kind is int:
                if -_LARGEST <= value < _LARGEST:
                    continue
            elif kind is not list or _are_texts(value):
                continue
        raise ValueError(f"{name} {of}")


def _are_texts(values: list[Any]) -> bool:
    return all(isinstance(text, str) for text in values)


def _is_label(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 < value < LABELS


def _is_sha256(value: Any) -> bool:
    return isinstance(value, str) and _SHA256.fullmatch(value) is not None


def _is_place(value: Any) -> bool:
    """Whether a value is a half-width, or null where that is not known, and N."""
    return (
        isinstance(value, list)
        and len(value) == 2
        and (value[0] is None or type(value[0]) in (int, float))
        and type(value[1]) is int
    )
