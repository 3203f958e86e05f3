"""Files that are about to be written: they are checked before anything is computed."""

from __future__ import annotations

import os

from ribbon_cli.errors import UsageError

OVERWRITE = "add --overwrite, or choose another with -o"
"""What to do about a file that exists, in a command; a program's own words are in `IN_PYTHON`."""
IN_PYTHON = "pass overwrite=True, or choose another"


def check_target(path: str | os.PathLike[str], overwrite: bool, hint: str = OVERWRITE) -> None:
    """Check a file that is about to be written.

    Raises UsageError where it is a folder or a device, exists and is not to be overwritten, or would lie in
    no folder.
    """
    option = "" if hint == IN_PYTHON else " with -o"
    if os.fspath(path) == "-":
        raise UsageError("-o -: name a file; without -o, text goes to standard output")
    if os.path.isdir(path):
        raise UsageError(f"{path}: is a folder: name a file{option}")
    if os.path.exists(path) and not os.path.isfile(path):
        raise UsageError(f"{path}: is not a regular file, and would be replaced by one: {hint}")
    if os.path.lexists(path) and not overwrite:
        raise UsageError(f"{path}: exists already and is not replaced: {hint}")
    folder = os.path.dirname(path) or "."
    if not os.path.isdir(folder):
        raise UsageError(f"{path}: its folder does not exist: make it first, or choose another{option}")
