"""The entry point `ribbon`: one thread for BLAS, all commands, signals."""

from __future__ import annotations

import gc
import os
import signal
import sys

import click

import ribbon_cli
from ribbon_cli.cli.completion import SHELLS, register_bash, script
from ribbon_cli.cli.group import RibbonGroup, Unread
from ribbon_cli.cli.output import emit, emit_json
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import UsageError
from ribbon_cli.study.process import ONE_THREAD, heed

# Whatever the environment says; none of the imports above brings in NumPy.
os.environ |= ONE_THREAD


def _version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the version and leave; looked up only now, because that takes time."""
    if value and not ctx.resilient_parsing:
        emit(f"ribbon {ribbon_cli.__version__}")
        ctx.exit()


@click.group(cls=RibbonGroup, name="ribbon", context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Print the version.",
)
@common_options
def cli() -> None:
    """Compute equilibria of unstretchable elastic bands, with a certificate for each.

    \b
    A start:
      ribbon init mobius-pi
      ribbon check mobius-pi.yaml
      ribbon solve mobius-pi.yaml
      ribbon convergence-table mobius-pi
    A state is named RUN:LABEL (mobius-pi:12), RUN@b=0.5,N=400, or by its file.
    """


@click.command()
@click.argument("shell", type=click.Choice(SHELLS), required=False, metavar=f"[{'|'.join(SHELLS)}]")
@common_options
@pass_settings
def completion(settings: Settings, shell: str | None) -> None:
    """Print a script for completion by Tab.

    The shell then completes commands, options, runs and labels. SHELL is by default the one in use.

    \b
    bash:  eval "$(ribbon completion bash)"
    zsh:   eval "$(ribbon completion zsh)"
    fish:  ribbon completion fish | source
    """
    name = shell or os.path.basename(os.environ.get("SHELL", ""))
    if name not in SHELLS:
        raise UsageError(f"which shell? name one of {', '.join(SHELLS)}")
    text = script(cli, name, "ribbon")
    emit_json({"shell": name, "script": text}) if settings.json else emit(text)


# In the order of use, each with the module that it is in.
_COMMANDS = {
    **dict.fromkeys(("init", "check"), "config_commands"),
    "solve": "solve_commands",
    "sweep": "sweep_command",
    "survey": "survey_command",
    "refine": "solve_commands",
    "continue": "continue_command",
    "convergence-table": "table_command",
    "spectrum": "spectrum_command",
    **dict.fromkeys(("ls", "show"), "store_commands"),
    "table": "rows_command",
    "compare": "compare_command",
    "path": "run_commands",
    "verify": "verify_command",
    **dict.fromkeys(("repair", "rerun", "pack", "unpack"), "run_commands"),
    "rm": "rm_command",
    "plot": "plot_command",
    "export": "export_command",
    "report": "report_command",
    "schema": "config_commands",
}
for _name, _home in _COMMANDS.items():
    cli.add_command(Unread(_name, f"ribbon_cli.cli.{_home}"))
cli.add_command(completion)


def main() -> None:
    """Run the process's command line and exit; SIGINT gives 130, SIGTERM 143."""
    heed(signal.SIGINT, signal.SIGTERM)
    for stream in (sys.stdout, sys.stderr):
        # A file's name that is no text, or a locale without Greek, must not end a run.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    register_bash()
    try:
        cli.main()
    finally:
        gc.disable()  # what is left goes with the process; a last search takes as long as a small listing
