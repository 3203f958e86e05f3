"""A run's append-only log: one JSON object a line, each with its own checksum.

A line counts once its line feed is there: what a kill or a full disk leaves after the last one is
ignored by readers and cut off by the next writer. So is a last line with zero bytes in it, which JSON never
has: a power cut leaves those where a file has grown and not all of its new blocks were written. Damage
anywhere else is an error.
"""

from __future__ import annotations

import gc
import json
import math
import os
import re
import stat
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ribbon_cli.errors import StoreError
from ribbon_cli.store.atomic import is_passing, without_waiting, write_all, write_error
from ribbon_cli.store.events import Event, read_event
from ribbon_cli.store.root import named

_TAIL = len(',"crc32":"01234567"}')
_DEEPEST = 50
"""Deepest nesting of a line; far from where Python's recursion ends."""


def utc_now() -> str:
    """Current time, UTC, in ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def to_json(value: Any) -> Any:
    """Return a copy in JSON's types: not-a-number and infinities are None, tuples are lists."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    return value


def format_line(document: dict[str, Any]) -> bytes:
    """Return an event's line: compact JSON whose last member is the CRC-32 of the object without it."""
    body = json.dumps(to_json(document), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return body[:-1] + f',"crc32":"{zlib.crc32(body):08x}"}}\n'.encode()


def parse_line(line: bytes) -> Event:
    """Return a line's event. Raises ValueError for a damaged line."""
    body = line[:-_TAIL] + b"}"
    if line[-_TAIL:] != f',"crc32":"{zlib.crc32(body):08x}"}}'.encode():
        raise ValueError("its checksum does not match")
    return read_event(parse_json(body), body)


def parse_json(body: bytes) -> Any:
    """Return the value of a JSON text: a line, a state's head or a note.

    Raises ValueError, also for what could not be written again.
    """
    text = body.decode()
    if body.count(b"[") + body.count(b"{") > _DEEPEST and _depth(text) > _DEEPEST:
        raise ValueError("it is nested too deeply")
    entry: Any = _DECODER.decode(text)
    if "\\" in text:  # no text that could not be written again: half a pair of surrogates
        json.dumps(entry, ensure_ascii=False).encode()
    return entry


def _no_number(word: str) -> float:
    """Refuse what Python reads as a number and JSON does not."""
    raise ValueError(f"{word} is no number in JSON")


_DECODER = json.JSONDecoder(parse_constant=_no_number)  # made once: it takes as long as reading a line


def _depth(text: str) -> int:
    """How deeply the arrays and objects of a JSON text are nested; brackets within texts are left out."""
    deepest = depth = 0
    for bracket in re.findall(r"[\[{\]}]", re.sub(r'"(?:[^"\\]|\\.)*"', "", text)):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def _unreadable(path: Path, error: OSError) -> StoreError:
    """One line for a log that cannot be read."""
    passing = isinstance(error, PermissionError)
    advice = "check the folder's permissions" if passing else _advice(path)
    return StoreError(f"{path}: cannot be read: {error.strerror}; {advice}")


def _advice(path: Path) -> str:
    """What to do about a damaged log."""
    return f"`ribbon repair {named(path.parent)}` rebuilds it"


def read_lines(path: Path, start: int = 0) -> list[bytes]:
    """Return the log's complete lines from an offset on. Raises StoreError when there is no log to read."""
    try:
        with open(path, "rb", opener=without_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise StoreError(f"{path}: not a file; {_advice(path)}")
            file.seek(start)
            data = file.read()
    except OSError as error:
        raise _unreadable(path, error) from error
    return data.split(b"\n")[:-1]


@contextmanager
def _all_is_kept() -> Iterator[None]:
    """Leave out the search for cyclic garbage, which takes longer the more there is: events have none."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class LogReader:
    """A log's events, of which only those are read that were appended since they were last asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._events: list[Event] = []
        self._end = 0
        self._last = b""
        self._seen: tuple[int, int, int] | None = None

    def events(self) -> list[Event]:
        """Return the events in order; not to be changed. Raises StoreError for a damaged line, naming it."""
        try:
            found = os.stat(self.path)
        except OSError as error:
            raise _unreadable(self.path, error) from error
        seen = (found.st_ino, found.st_size, found.st_mtime_ns)
        if seen != self._seen:
            grown = self._seen is not None and seen[0] == self._seen[0] and seen[1] > self._seen[1]
            self._seen = None
            if not (grown and self._read_on()):
                self._events, self._end, self._last = [], 0, b""
                self._read_on()
            self._seen = seen
        return self._events

    def look_again(self) -> None:
        """Open the log: only then does a network file system ask what other hosts appended to it.

        Raises StoreError when it cannot be read.
        """
        try:
            os.close(without_waiting(self.path, os.O_RDONLY | os.O_CLOEXEC))
        except OSError as error:
            raise _unreadable(self.path, error) from error

    @property
    def torn(self) -> bool:
        """Whether more than whole lines was there when the log was last read."""
        return self._seen is not None and self._seen[1] > self._end

    def _read_on(self) -> bool:
        """Read what was appended; return whether it was appended to what was read: a file that was put in
        the place of another may have got its inode number.
        """
        lines = read_lines(self.path, self._end - len(self._last))
        if self._last and (not lines or lines.pop(0) + b"\n" != self._last):
            return False
        if lines and b"\0" in lines[-1]:
            lines.pop()
        with _all_is_kept():
            for number, line in enumerate(lines, start=len(self._events) + 1):
                try:
                    self._events.append(parse_line(line))
                except ValueError as error:
                    raise StoreError(
                        f"{self.path}:{number}: damaged line: {error}; {_advice(self.path)}"
                    ) from error
        if lines:
            self._last = lines[-1] + b"\n"
            self._end += sum(map(len, lines)) + len(lines)
        return True


def salvage_log(path: Path) -> tuple[list[Event], int]:
    """Return the readable events of a damaged or missing log, and the number of unreadable lines.

    Raises StoreError if the log may be whole but cannot be read now.
    """
    events: list[Event] = []
    lost = 0
    try:
        lines = read_lines(path)
    except StoreError as error:
        if is_passing(error):
            raise
        return [], 0
    for line in lines:
        try:
            events.append(parse_line(line))
        except ValueError:
            lost += 1
    return events, lost


def append_log(path: Path, documents: Iterable[dict[str, Any]]) -> None:
    """Append events behind the last whole line and sync.

    Raises StoreError, after cutting off what was written of them.
    """
    data = b"".join(map(format_line, documents))
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
        try:
            size = _cut(descriptor)[1]
            try:
                write_all(descriptor, data)
                os.fsync(descriptor)
            except BaseException:
                with suppress(OSError):
                    os.ftruncate(descriptor, size)
                raise
        finally:
            # Once synced, the lines are there whatever closing says.
            with suppress(OSError):
                os.close(descriptor)
    except OSError as error:
        raise write_error(path, error) from error


def cut_torn_line(path: Path) -> bool:
    """Cut off what follows the last line feed; return whether there was anything. Raises StoreError."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        try:
            torn, _ = _cut(descriptor)
            return torn
        finally:
            os.close(descriptor)
    except FileNotFoundError as error:
        raise _unreadable(path, error) from error
    except OSError as error:
        raise write_error(path, error) from error


def _cut(descriptor: int) -> tuple[bool, int]:
    """Cut an open log behind its last line feed; return whether that took anything, and the size left."""
    size = os.fstat(descriptor).st_size
    end = _end_of_last_line(descriptor, size)
    before = _end_of_last_line(descriptor, end - 1)
    if b"\0" in os.pread(descriptor, end - before, before):
        end = before
    if end < size:
        os.ftruncate(descriptor, end)
        os.fsync(descriptor)
    return end < size, end


def _end_of_last_line(descriptor: int, size: int, step: int = 1 << 16) -> int:
    """Offset behind the last line feed, searched from the end. Raises OSError."""
    end = size
    while end > 0:
        start = max(0, end - step)
        found = os.pread(descriptor, end - start, start).rfind(b"\n")
        if found >= 0:
            return start + found + 1
        end = start
    return 0
