"""`ribbon verify`: whether files are what was committed, and agree with their shapes."""

from __future__ import annotations

import click

from ribbon_cli import verify as verifying
from ribbon_cli.cli.completion import complete_checkable
from ribbon_cli.cli.continuum_command import show_continuum
from ribbon_cli.cli.output import complain, emit, emit_json, say, teller
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import StoreError


@click.command()
@click.argument("ref", metavar="[RUN|STATE|all]", default="all", shell_complete=complete_checkable)
@click.option("--continuum", is_flag=True, help="Compare a RUN or a STATE with the continuum instead.")
@common_options
@pass_settings
def verify(settings: Settings, ref: str, continuum: bool) -> int:
    """Check a RUN, a STATE or all runs.

    Files are compared with their committed hashes. All that follows from the stored shape is recomputed:
    energy, residuals, inertia, linking number, contact, geometry. The exit code is 4 if anything differs.
    """
    if continuum:
        return show_continuum(settings, ref)

    found = verifying.verify(settings.root, ref, teller(settings))
    if settings.json:
        emit_json(document(found))
    else:
        for problem in found.problems:
            emit(f"{problem.where}: {problem.what}")
    for finding in found.findings:
        if finding.note:
            say(settings, f"{finding.where}: {finding.what}")
    return conclude(settings, found)


def document(found: verifying.Verification) -> dict[str, object]:
    """A verification as JSON."""
    notes = [finding for finding in found.findings if finding.note]
    return {
        "ok": not found.problems,
        "runs": found.runs,
        "states": found.states,
        "problems": [{"where": f.where, "what": f.what} for f in found.problems],
        "notes": [{"where": f.where, "what": f.what} for f in notes],
    }


def conclude(settings: Settings, found: verifying.Verification) -> int:
    """Print the result in a line; return the exit code."""
    if not (found.runs or found.states or found.problems):
        say(settings, f"no runs in {settings.root} (see --runs): nothing to verify")
        return 0
    what = f"{found.runs} run{'s' * (found.runs != 1)}, " if found.runs else ""
    what += f"{found.states} state{'s' * (found.states != 1)}"
    if not found.problems:
        say(settings, f"{what}: all in order")
        return 0
    count = len(found.problems)
    problems = f"{count} problem{'s' * (count != 1)}"
    complain(f"ribbon: {problems} in {what}: `ribbon repair RUN` sets aside what is damaged")
    return StoreError.exit_code
