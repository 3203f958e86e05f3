"""A state in a few JSON-able words: what `ribbon ls`, `ribbon show` and the log say about it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ribbon_cli.facts import kinds_of
from ribbon_cli.store.layout import BRANCH, STATE
from ribbon_cli.store.log import to_json
from ribbon_cli.store.record import StateRecord

_TOPOLOGY = ("half_twists", "sigma")


def summary(source: StateRecord | Mapping[str, Any], run: str | None = None) -> dict[str, Any]:
    """Return the summary of a record, or of a state's entry in the log, for the run named.

    Keys are the record's fields marked in layout.py, in that order, with `half_twists` and `sigma` together
    under `topology`, those of a point on a branch under `branch`, and `run` and `content_sha256`.
    Not-a-number is None. Both sources give the same.
    """
    state = describe(source) if isinstance(source, StateRecord) else source["state"]
    return {"run": run, **completed(state)}


def completed(state: Mapping[str, Any]) -> Mapping[str, Any]:
    """A summary of an earlier format with the kinds of its events, which it lacks."""
    if "event_kinds" in state:
        return state
    return {**state, "event_kinds": list(kinds_of(state["events"]))}


def describe(record: StateRecord, content: str | None = None) -> dict[str, Any]:
    """Summary of a record without the run's name; `content` is its content hash where that is known."""
    from ribbon_cli.store.content import content_sha256

    state: dict[str, Any] = {}
    for item in STATE:
        if item.field in _TOPOLOGY:
            state.setdefault("topology", {})[item.field] = getattr(record, item.field)
        elif item.summary:
            state[item.field] = _scalar(getattr(record, item.field), item.dtype)
    state["event_kinds"] = list(record.event_kinds or ())
    if record.branch is not None:
        state["branch"] = {
            item.field: _scalar(getattr(record.branch, item.field), item.dtype)
            for item in BRANCH
            if item.summary
        }
    state["content_sha256"] = content or content_sha256(record)
    return dict(to_json(state))


def agrees(state: Mapping[str, Any], record: StateRecord, content: str | None = None) -> bool:
    """Whether a stored summary is the record's; what a newer version has put into it is passed over."""
    known = completed(state)
    return all(key in known and known[key] == value for key, value in describe(record, content).items())


def _scalar(value: Any, dtype: str) -> Any:
    """Python's own scalar for a NumPy one; None and texts as they are."""
    if value is None or dtype == "utf-8":
        return value
    return {"float64": float, "int64": int, "bool": bool}[dtype](value)
