"""The reference of commands, from click.

`python tests/command_pages.py > docs/reference/commands.md` writes it.
"""

from __future__ import annotations

import inspect
import re
import sys

import click

from ribbon_cli.cli.main import cli

HEAD = """\
# Commands

`ribbon COMMAND -h` shows the same. Data go to standard output, progress and messages to standard error.
STATE, RUN and REF are [references](references.md), CONFIG is the path of [a config](config.md).
[Exit codes](exit-codes.md) are the same for all commands.
"""


def page() -> str:
    """The whole page, in the order in which `ribbon --help` lists the commands."""
    context = click.Context(cli, info_name="ribbon")
    shared = [f"## Options of every command\n\n{options(cli)}"]
    sections = [section(name, cli.get_command(context, name)) for name in cli.list_commands(context)]
    return "\n".join([HEAD, *shared, *sections])


def section(name: str, command: click.Command | None) -> str:
    """A command: how it is called, what it does, and its own options."""
    assert command is not None
    context = click.Context(command, info_name=f"ribbon {name}")
    usage = " ".join(command.collect_usage_pieces(context))
    parts = [f"## ribbon {name}", f"`ribbon {name} {usage}`", words(command.help or "")]
    common = {option.name for option in cli.params}
    own = [option for option in command.params if option.name not in common]
    if any(isinstance(option, click.Option) for option in own):
        parts.append(options(command, common))
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def words(text: str) -> str:
    """Help in paragraphs; what click is told not to wrap is indented."""
    paragraphs = []
    for part in inspect.cleandoc(text).split("\n\n"):
        if part.startswith("\b"):
            lines = part.splitlines()[1:]
            paragraphs.append("\n".join(f"    {line.strip()}" for line in lines))
        else:
            paragraphs.append(re.sub(r"\s+", " ", part).strip())
    return "\n\n".join(paragraphs)


def options(command: click.Command, without: set[str | None] = frozenset()) -> str:
    """A table of a command's options."""
    rows = ["| option | meaning |", "|---|---|"]
    for option in command.params:
        if isinstance(option, click.Option) and option.name not in without:
            rows.append(f"| {spelling(option)} | {meaning(option)} |")
    return "\n".join(rows) + "\n"


def spelling(option: click.Option) -> str:
    """An option with what it takes."""
    takes = "" if option.is_flag else f" {option.metavar or option.type.name.upper()}"
    if isinstance(option.type, click.Choice) and not option.metavar:
        takes = " " + r"\|".join(option.type.choices)
    return ", ".join(f"`{name}{takes}`" for name in option.opts)


def meaning(option: click.Option) -> str:
    """An option's help, and whether it may be repeated."""
    text = re.sub(r"\s+", " ", option.help or "").replace("|", r"\|")
    default = f"Default: {option.default}." if option.show_default else ""
    return " ".join(part for part in (text, default, "May be repeated." if option.multiple else "") if part)


if __name__ == "__main__":
    sys.stdout.write(page())
