"""The one base class of every error that a user can meet, and its leaves."""

from __future__ import annotations


class RibbonError(Exception):
    """Something a user can act on: one line that says what went wrong and what to do.

    `exit_code` is the process's exit code when the error ends a command.
    """

    exit_code = 1


class UsageError(RibbonError):
    """A command, reference or option that makes no sense as given."""

    exit_code = 2


class TargetError(RibbonError):
    """A target was not reached, or an equilibrium has no certificate."""

    exit_code = 3


class StoreError(RibbonError):
    """The store is damaged, or cannot be written."""

    exit_code = 4


class LockedError(RibbonError):
    """Another process writes to this run."""

    exit_code = 5


class RibbonWarning(UserWarning):
    """What a program has to know of a result, and is no error: no certificate, a band that meets itself."""
