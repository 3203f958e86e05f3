"""A committed state that is read from its file only when something of it is needed that its summary lacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from ribbon_cli.facts import kinds_of
from ribbon_cli.store.record import StateRecord

_FIELDS = frozenset(field.name for field in fields(StateRecord))
_OPTIONAL = frozenset({"parent", "parent_ref", "negative_eigenvalues"})


class StoredRecord(StateRecord):
    """A `StateRecord` of which the log's summary is known at once, and the rest is read on first use.

    Resuming a run of thousands of states needs the arrays of one or two. Reading may raise StoreError.
    """

    @classmethod
    def of(cls, state: Mapping[str, Any], read: Callable[[], StateRecord]) -> StoredRecord:
        """Make the record of a summary; `read` reads the whole."""
        record = object.__new__(cls)
        known = record.__dict__
        for part in (state, state.get("topology", {})):
            for key, value in part.items():
                # What JSON could not hold is null there: not-a-number is read with the rest.
                if key in _FIELDS and (value is not None or key in _OPTIONAL):
                    known[key] = value
        if state.get("branch") is None:
            known["branch"] = None
        else:  # the summary's is a part of it
            del known["branch"]
        known["events"] = tuple(state.get("events") or ())
        known["event_kinds"] = kinds_of(known["events"], state.get("event_kinds"))
        known["_read"] = read
        return record


class _Unread:
    """A field that is not known yet. What is known lies in the record's `__dict__`, which goes before."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, record: StoredRecord | None, owner: type) -> Any:
        if record is None:
            return self
        own = record.__dict__
        if "_read" in own:
            own.update(own.pop("_read")().__dict__)
        if self._name not in own:
            raise AttributeError(self._name)
        return own[self._name]


for _name in _FIELDS:
    _field = _Unread()
    _field.__set_name__(StoredRecord, _name)
    setattr(StoredRecord, _name, _field)
