"""The config files of a run, as written and as resolved, against the hashes that its log keeps of them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ribbon_cli.errors import StoreError
from ribbon_cli.store.atomic import put_aside, write_atomic
from ribbon_cli.store.events import Created, Event
from ribbon_cli.store.folder import CONFIG, RESOLVED
from ribbon_cli.store.hdf5 import decode_bytes, read_bytes
from ribbon_cli.store.root import named

_KEYS = {CONFIG: "config_text", RESOLVED: "config_resolved"}
"""Where a state's provenance keeps the config files."""
CHANGED = "not the bytes that the run was made with"


def committed(events: Iterable[Event]) -> dict[str, str]:
    """Hashes of the config files by name, from a log's first line; empty if that is lost."""
    files = next((event.files for event in events if isinstance(event, Created)), {})
    return {name: sha for name, sha in files.items() if name in (CONFIG, RESOLVED)}


def differing(folder: Path, hashes: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    """Config files that are not those of the hashes, each with a reason."""
    for name, wanted in hashes.items():
        path = folder / name
        try:
            found = hashlib.sha256(read_bytes(path)).hexdigest()
        except StoreError as error:
            yield path, str(error).removeprefix(f"{path}: ")
        else:
            if found != wanted:
                yield path, CHANGED


def require(folder: Path, events: Iterable[Event]) -> None:
    """Refuse to continue if a config file was changed or is gone: new states would claim to come from it.

    Raises StoreError.
    """
    for path, reason in differing(folder, committed(events)):
        raise StoreError(
            f"{path}: {reason}; `ribbon repair {named(folder)}` restores it from a state, "
            "`ribbon solve --fresh` keeps the run aside and starts over"
        )


def contradiction(folder: Path, hashes: Mapping[str, str], states: Iterable[Path]) -> dict[str, str]:
    """Hashes of the config files that the states keep, where a log names others which nobody has.

    Else nothing. The states are the truth, and such a line of the log can be no one's.
    """
    wanting = {path.name for path, _ in differing(folder, hashes)}
    if not wanting:
        return {}
    kept = {name: _kept_text(states, key, None) for name, key in _KEYS.items()}
    if not any(kept[name] and not _kept_text(states, _KEYS[name], hashes[name]) for name in wanting):
        return {}
    return {name: hashlib.sha256(text).hexdigest() for name, text in kept.items() if text is not None}


def restore(folder: Path, hashes: Mapping[str, str], states: Iterable[Path]) -> list[str]:
    """Write config files anew that are missing or not those of the hashes, from what a state's provenance
    keeps; return a line for each thing done, or that cannot be. Raises StoreError.
    """
    notes = []
    for name, key in _KEYS.items():
        path, wanted = folder / name, hashes.get(name)
        there = read_bytes(path) if path.is_file() else None
        if there is None and os.path.lexists(path):
            notes.append(f"renamed {name} to {put_aside(path).name}: not a file")
        if there is not None and (wanted is None or hashlib.sha256(there).hexdigest() == wanted):
            continue
        text = _kept_text(states, key, wanted)
        if text is None:
            what = "missing" if there is None else CHANGED
            notes.append(f"{name} is {what}, and no state keeps it")
            continue
        if there is not None:
            put_aside(path)
        write_atomic(path, text)
        notes.append(f"restored {name} from a state's provenance")
    return notes


def _kept_text(states: Iterable[Path], key: str, wanted: str | None) -> bytes | None:
    """A config file's text from the provenance of the first state that keeps the right one, None if none
    does.
    """
    for path in states:
        try:
            text = decode_bytes(read_bytes(path), str(path)).provenance.get(key)
        except StoreError:
            continue
        data = text.encode() if isinstance(text, str) else None
        if data is not None and (wanted is None or hashlib.sha256(data).hexdigest() == wanted):
            return data
    return None


def present(folder: Path) -> dict[str, bytes]:
    """The config files that a run still has. Raises StoreError."""
    return {name: read_bytes(folder / name) for name in (CONFIG, RESOLVED) if (folder / name).is_file()}
