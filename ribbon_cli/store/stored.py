"""A committed state that is read from its file only when something of it is needed that its summary lacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from ribbon_cli.store.record import StateRecord

_FIELDS = frozenset(field.name for field in fields(StateRecord))


class StoredRecord(StateRecord):
    """A `StateRecord` of which the log's summary is known at once, and the rest is read on first use.

    Resuming a run of thousands of states needs the arrays of one or two. Reading may raise StoreError.
    """

    @classmethod
    def of(cls, state: Mapping[str, Any], read: Callable[[], StateRecord]) -> StoredRecord:
        """Make the record of a summary; `read` reads the whole."""
        record = object.__new__(cls)
        known = {**state, **state.get("topology", {})}
        # What JSON could not hold is null there: not-a-number is read with the rest.
        optional = ("parent", "parent_ref", "negative_eigenvalues")
        known = {key: value for key, value in known.items() if value is not None or key in optional}
        if "branch" in known:
            del known["branch"]  # a part of it
        else:
            known["branch"] = None
        known["events"] = tuple(known.get("events", ()))
        record.__dict__.update({key: value for key, value in known.items() if key in _FIELDS})
        record.__dict__["_read"] = read
        return record

    def __getattribute__(self, name: str) -> Any:
        own = object.__getattribute__(self, "__dict__")
        if name in _FIELDS and name not in own and "_read" in own:
            own.update(own.pop("_read")().__dict__)
        return object.__getattribute__(self, name)
