"""How a program receives the progress of a study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ribbon_cli import study
from ribbon_cli.api.console import console

Watcher = Callable[[study.Event], object] | bool | None
"""A callable that gets every event; True for the console's progress on standard error; None for silence."""


@contextmanager
def watched(progress: Watcher) -> Iterator[study.Progress | None]:
    """The progress to pass to a study. Raises TypeError for anything else."""
    if progress is True:
        with console() as shown:
            yield shown
    elif progress is None or progress is False:
        yield None
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress must be a callable, True or None, got {type(progress).__name__}")
