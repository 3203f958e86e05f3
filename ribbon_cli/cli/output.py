"""Writes data to standard output and messages to standard error."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import click

from ribbon_cli import store
from ribbon_cli.cli.settings import Settings
from ribbon_cli.errors import RibbonError, UsageError
from ribbon_cli.text import visible

_LAYOUT = "\n\t"
"""Characters of our own output that are no text."""


def emit(text: str) -> None:
    """Write data to standard output, with nothing in it that a terminal would obey.

    A reader that has gone (`ribbon ls | head -1`) is not a failure: the rest is dropped, and the exit code
    still describes the work done. Raises RibbonError when the output cannot be written: a full disk.
    """
    try:
        click.echo(visible(text.removesuffix("\n"), _LAYOUT))
    except BrokenPipeError:
        _discard_output()
    except OSError as error:
        _discard_output()
        raise RibbonError(f"standard output cannot be written: {error.strerror or error}") from error


def emit_path(path: str) -> None:
    """Write a path to standard output: to a program byte for byte, whatever its name; to people as `emit`."""
    stream = sys.stdout
    if path.isprintable() or stream.isatty() or "\n" in path or not hasattr(stream, "buffer"):
        emit(path)
        return
    stream.flush()
    stream.buffer.write(os.fsencode(path) + b"\n")


def emit_json(value: Any) -> None:
    """Write one JSON document to standard output."""
    emit(json_text(value))


def json_text(value: Any) -> str:
    """A JSON document; not-a-number and infinities are null."""
    return json.dumps(store.log.to_json(value), indent=2, allow_nan=False) + "\n"


def _discard_output() -> None:
    """Let whatever is still buffered vanish, or the interpreter would complain about it when it exits."""
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError, AttributeError):
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


def say(settings: Settings, text: str) -> None:
    """Write a message to standard error unless the user wants quiet."""
    if not settings.quiet:
        complain(text)


def teller(settings: Settings) -> Callable[[str], None]:
    """A callable that passes messages to `say`, for functions that find something worth telling."""
    return partial(say, settings)


def warn(settings: Settings, text: str) -> None:
    """Write a warning to standard error unless there is nothing to warn of, or the user wants quiet."""
    if text:
        say(settings, f"warning: {text}")


def complain(text: str) -> None:
    """Write to standard error, even if quiet; if it cannot be written, nothing happens."""
    try:
        click.echo(visible(text, _LAYOUT), err=True)
    except OSError:
        return


def deliver(settings: Settings, text: str, path: str | None) -> None:
    """Write data to standard output or, where the user names one, to a file; `check_target` came before."""
    if path is None:
        emit(text)
        return

    store.write_atomic(path, text.encode(), overwrite=True)
    say(settings, f"wrote {path}")


def text_format(settings: Settings, form: str | None) -> str:
    """The format to write: --json and --format are two ways to say it. Raises UsageError if they disagree."""
    if settings.json and form not in (None, "json"):
        raise UsageError(f"--json and --format {form} exclude each other: give one")
    return "json" if settings.json else form or "text"
