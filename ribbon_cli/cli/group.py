"""The group of commands: near misses, exit codes, and one line for whatever goes wrong."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import click

from ribbon_cli import store
from ribbon_cli.cli.output import complain, emit
from ribbon_cli.cli.settings import Settings
from ribbon_cli.errors import RibbonError, UsageError
from ribbon_cli.study.process import Stopped
from ribbon_cli.text import visible


class Unread(click.Command):
    """The name of a command, and the module that is imported once it is asked for: each has its own."""

    def __init__(self, name: str, home: str) -> None:
        super().__init__(name)
        self.home = home

    def read(self) -> click.Command:
        """The command itself."""
        found = vars(import_module(self.home)).values()
        return next(item for item in found if isinstance(item, click.Command) and item.name == self.name)


class RibbonGroup(click.Group):
    """A click group whose `main` turns every outcome into an exit code.

    Commands return theirs, None meaning 0. Errors give their `exit_code`: 2 usage, 3 targets, 4 store,
    5 lock; signals give 128 + number, and anything unforeseen 1.
    """

    def main(  # type: ignore[override]
        self, args: Sequence[str] | None = None, prog_name: str | None = None, **extra: Any
    ) -> None:
        """Run a command line, by default the process's own, and exit."""
        words = list(sys.argv[1:] if args is None else args)
        # A shell asks for completions: nobody would read a message.
        completing = "_RIBBON_COMPLETE" in os.environ
        settings = Settings(argv=("ribbon", *words), quiet=completing)
        extra |= {"standalone_mode": False, "obj": settings}
        try:
            code = super().main(words, "ribbon", **extra)
        except (Exception, Stopped) as error:  # noqa: BLE001  (the one place where all errors end)
            code = 1 if completing else _fail(error, settings)
        sys.exit(code if isinstance(code, int) else 0)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Show the help to those who type `ribbon` alone."""
        if not args and not ctx.resilient_parsing:
            emit(ctx.get_help())
            ctx.exit()
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order of use, which is that of their definition."""
        return list(self.commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name."""
        found = self.commands.get(cmd_name)
        if isinstance(found, Unread):
            found = self.commands[cmd_name] = found.read()
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command. Raises UsageError with a near miss if there is none."""
        if not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            hint = store.suggest(args[0], self.commands) or "; `ribbon --help` lists the commands"
            raise UsageError(f"no such command {args[0]!r}{hint}")
        return super().resolve_command(ctx, args)


def _fail(error: BaseException, settings: Settings) -> int:
    """Say in one line what went wrong, after the traceback for those who want it; return the exit code."""
    if settings.debug and not isinstance(error, Stopped | click.Abort):
        complain("".join(traceback.format_exception(error)).rstrip())
    text, code = _describe(error, settings)
    complain(text if hasattr(error, "mistakes") else visible(text))  # one line, whatever a file is called
    return code


def _describe(error: BaseException, settings: Settings) -> tuple[str, int]:
    """The line for an error, and its exit code."""
    if isinstance(error, Stopped | click.Abort):
        number = error.number if isinstance(error, Stopped) else signal.SIGINT
        kept = ": everything committed is kept, and the same command resumes" if settings.commits else ""
        return f"ribbon: interrupted by {signal.Signals(number).name}{kept}", 128 + number
    if isinstance(error, click.ClickException):
        return f"ribbon: {_usage(error)}", UsageError.exit_code
    if isinstance(error, RibbonError):
        # A config's errors stay as they are, since editors jump to FILE:LINE:COLUMN.
        return str(error) if hasattr(error, "mistakes") else f"ribbon: {error}", error.exit_code
    reason = " ".join(str(error).split())
    name = type(error).__name__
    text = f"{name}: {reason}" if reason else name
    return f"ribbon: internal error: {text} (run again with --debug)", 1


def _usage(error: click.ClickException) -> str:
    """Click's message in our form: one line, what is wrong and what to do."""
    message = " ".join(error.message.split()).rstrip(".")
    possible = getattr(error, "possibilities", None)
    ctx = getattr(error, "ctx", None)
    if not possible and isinstance(error, click.UsageError):
        message = " ".join(error.format_message().split()).rstrip(".")
    hint = f"did you mean {possible[0]}?" if possible else ""
    if not hint and ctx is not None:
        hint = f"`{ctx.command_path} --help` tells more"
    text = f"{message}; {hint}" if hint else message
    return text[:1].lower() + text[1:]
