"""The options that every command shares, before or after its name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ribbon_cli import store
from ribbon_cli.cli.completion import complete_folder

_Command = TypeVar("_Command", bound=Callable[..., Any])


@dataclass
class Settings:
    """The values of the shared options, and facts about this process.

    `runs` is None unless the option is given. `argv` is the command line, for the provenance. `commits` is
    set by commands that store states: it decides what an interruption's message promises.
    """

    runs: str | None = None
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    debug: bool = False
    argv: tuple[str, ...] = ("ribbon",)
    commits: bool = False

    @property
    def root(self) -> Path:
        """Folder of the runs."""
        return store.runs_root(self.runs)


def _remember(ctx: click.Context, parameter: click.Parameter, value: Any) -> None:
    """Keep an option's value where it was given, so that a default after the command changes nothing."""
    settings = ctx.ensure_object(Settings)
    if value:
        setattr(settings, str(parameter.name), value)


def _help(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the help and leave, by `emit`, which knows of full disks and of readers that have gone."""
    if value and not ctx.resilient_parsing:
        from ribbon_cli.cli.output import emit

        emit(ctx.get_help())
        ctx.exit()


def _shared(*names: str, callback: Callable[..., Any] = _remember, **more: Any) -> Callable[..., Any]:
    """An option that every command has; its value goes to the callback, not to the command."""
    return click.option(*names, expose_value=False, callback=callback, **more)


_RUNS = "Folder of the runs. Default: RIBBON_RUNS, else ./runs."
_OPTIONS = (
    _shared("--runs", metavar="DIR", shell_complete=complete_folder, help=_RUNS),
    _shared("--json", is_flag=True, help="Print one JSON document instead of text."),
    _shared("-q", "--quiet", is_flag=True, help="No progress, and no messages except errors."),
    _shared("-v", "--verbose", is_flag=True, help="More detail, such as every Newton step."),
    _shared("--debug", is_flag=True, help="Show the traceback of an error."),
    _shared("-h", "--help", is_flag=True, is_eager=True, callback=_help, help="Show this message and exit."),
)


def common_options(command: _Command) -> _Command:
    """Give a command the shared options; their values are in `Settings`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


pass_settings = click.make_pass_decorator(Settings, ensure=True)
"""Hand a command its `Settings` as first argument."""
