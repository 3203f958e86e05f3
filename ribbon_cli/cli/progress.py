"""Progress of a solve on standard error, as far as the shared options want it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ribbon_cli import study
from ribbon_cli.api.console import console
from ribbon_cli.cli.output import complain
from ribbon_cli.cli.settings import Settings


@contextmanager
def progress(settings: Settings) -> Iterator[study.Progress | None]:
    """The progress to hand to a study; None when the user wants quiet."""
    if settings.quiet:
        yield None
        return
    with console(settings.verbose, complain) as shown:
        yield shown
