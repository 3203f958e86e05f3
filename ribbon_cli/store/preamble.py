"""The head of a state file: a hash of every byte behind it, and the state's summary, both readable without
HDF5.

HDF5 leaves the first bytes of a file, its user block, to whoever wrote it. Here they are a line of text with
the hash, and a line of JSON, padded with zero bytes. So damage anywhere in a file is seen before HDF5 reads
it, and a lost log is rebuilt without opening each state.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any

from ribbon_cli.errors import StoreError
from ribbon_cli.store.layout import FORMAT, FORMAT_VERSION
from ribbon_cli.store.log import parse_json

_LINE = re.compile(rb"ribbon-state (\d{1,4}\.\d{1,4}) sha256 ([0-9a-f]{64})\n")
_LENGTH = len(f"{FORMAT} {FORMAT_VERSION} sha256 \n") + 64
_SMALLEST = 2048
"""HDF5 looks for its own beginning at 0, 512, 1024, 2048, ...; most summaries fit here."""
_OTHERS = {
    b'{"event":': ", but as the log of a run: name the run",
    b"PK\x03\x04": ", but as an archive: an npz file is read when its name ends in .npz",
    b"version https://git-lfs": ", but as a pointer of git-lfs: `git lfs pull` fetches the file itself",
}
"""What other files begin with that are likely to be taken for states."""
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def block_size(summary: dict[str, Any]) -> int:
    """Size of the user block that holds a summary: a power of two."""
    size = _SMALLEST
    while size < _LENGTH + len(_json(summary)):
        size *= 2
    return size


def seal(image: bytes, summary: dict[str, Any]) -> bytes:
    """Return a file's bytes with its user block, so far empty, filled."""
    size = block_size(summary)
    rest = _json(summary).ljust(size - _LENGTH, b"\0") + image[size:]
    digest = hashlib.sha256(rest).hexdigest()
    return f"{FORMAT} {FORMAT_VERSION} sha256 {digest}\n".encode() + rest


def check_version(data: bytes, source: str) -> None:
    """Refuse a file of a newer major version, however it goes on. Raises StoreError."""
    found = re.match(rb"ribbon-state (\d{1,4})\.(\d{1,4}) ", data)
    if found:
        refuse_newer(f"{int(found[1])}.{int(found[2])}", source)


def refuse_newer(version: str, source: object, known: str = FORMAT_VERSION) -> None:
    """Raise StoreError for a major version newer than the one that is known; ValueError for none."""
    if int(version.partition(".")[0]) > int(known.partition(".")[0]):
        raise StoreError(f"{source}: written in format {version}, newer than {known}: update ribbon")


def head_version(data: bytes) -> str | None:
    """The format's version in a file's head, None for a file without one."""
    found = _LINE.match(data)
    return found[1].decode() if found else None


def check_seal(data: bytes) -> dict[str, Any] | None:
    """Return the summary in a file's head, None for a file without one, as in format 1.0.

    Raises ValueError where the file's bytes are not those that the hash was made of.
    """
    if data.startswith(_SIGNATURE):
        return None
    found = _LINE.match(data)
    if found is None:
        likely = next((what for start, what in _OTHERS.items() if data.startswith(start)), "")
        raise ValueError("it begins neither as a state file nor as HDF5" + likely)
    rest = memoryview(data)[found.end() :]
    if hashlib.sha256(rest).hexdigest().encode() != found[2]:
        raise ValueError("its bytes are not those that were written")
    try:
        summary = parse_json(data[found.end() : data.index(b"\n", found.end())])
    except ValueError as error:
        raise ValueError("its summary cannot be read") from error
    if not isinstance(summary, dict):
        raise ValueError("its summary cannot be read")
    return summary


def _json(summary: dict[str, Any]) -> bytes:
    """A summary's line."""
    text = json.dumps(summary, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.encode() + b"\n"
