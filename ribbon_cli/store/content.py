"""Hash of the scientific part of a state: what was computed, whatever machine and program computed it.

docs/format.md specifies it so that others can recompute it from a file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ribbon_cli.store.fields import flatten, is_scientific, value_dtype, value_shape
from ribbon_cli.store.layout import FORMAT
from ribbon_cli.store.record import StateRecord

if TYPE_CHECKING:
    from ribbon_cli.store.fields import Value


def values_sha256(values: Mapping[str, Value]) -> str:
    """Return the content hash of a file's values, a mapping from path to value.

    SHA-256 over `ribbon-state content 1` and a line feed, then for every path outside /provenance, in
    ascending order of its UTF-8 bytes: path, dtype's name and the shape's numbers joined by commas, each
    ended by a zero byte; then the data, in C order: numbers little-endian, truth values one byte 0 or 1,
    texts each as their length in bytes (little-endian, 8 bytes) and their UTF-8 bytes.
    """
    digest = hashlib.sha256(f"{FORMAT} content 1\n".encode())
    for path in sorted(values, key=str.encode):
        if not is_scientific(path):
            continue
        value = values[path]
        shape = ",".join(map(str, value_shape(value)))
        digest.update(f"{path}\0{value_dtype(value)}\0{shape}\0".encode())
        if isinstance(value, str | tuple):
            for text in (value,) if isinstance(value, str) else value:
                encoded = text.encode()
                digest.update(len(encoded).to_bytes(8, "little") + encoded)
        else:
            digest.update(value.tobytes())
    return digest.hexdigest()


def content_sha256(record: StateRecord) -> str:
    """Return the content hash of a record, the same as its file's. Raises ValueError as `flatten` does."""
    return values_sha256({field.item.path: field.value for field in flatten(record)})
