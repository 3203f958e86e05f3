"""The entry point `ribbon`: one thread for BLAS, all commands, signals."""

from __future__ import annotations

import gc
import os
import signal
import sys

import click

import ribbon_cli
from ribbon_cli.cli.compare_command import compare
from ribbon_cli.cli.completion import SHELLS, register_bash, script
from ribbon_cli.cli.config_commands import check, init, schema
from ribbon_cli.cli.continue_command import continue_
from ribbon_cli.cli.export_command import export
from ribbon_cli.cli.group import RibbonGroup
from ribbon_cli.cli.output import emit, emit_json
from ribbon_cli.cli.plot_command import plot
from ribbon_cli.cli.report_command import report_page
from ribbon_cli.cli.rm_command import rm
from ribbon_cli.cli.rows_command import table
from ribbon_cli.cli.run_commands import pack, path, repair, rerun, unpack
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.cli.solve_commands import refine, solve
from ribbon_cli.cli.spectrum_command import spectrum
from ribbon_cli.cli.store_commands import ls, show
from ribbon_cli.cli.survey_command import survey
from ribbon_cli.cli.sweep_command import sweep
from ribbon_cli.cli.table_command import convergence_table
from ribbon_cli.cli.verify_command import verify
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


_COMMANDS = (
    *(init, check, solve, sweep, survey, refine, continue_, convergence_table, spectrum),
    *(ls, show, table, compare, path, verify, repair, rerun, pack, unpack, rm),
    *(plot, export, report_page, schema, completion),
)
for _command in _COMMANDS:
    cli.add_command(_command)


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
