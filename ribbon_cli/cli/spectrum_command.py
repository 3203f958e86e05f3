"""`ribbon spectrum`: eigenvalues with bounds, modes with names, a verdict; and their convergence."""

from __future__ import annotations

import click

from ribbon_cli import analysis, api, report, store
from ribbon_cli.api.targets import check_target
from ribbon_cli.cli.completion import complete_any, complete_file
from ribbon_cli.cli.output import complain, deliver, json_text, say, teller, text_format
from ribbon_cli.cli.settings import Settings, common_options, pass_settings
from ribbon_cli.errors import TargetError, UsageError

METRICS = ("physical", "euclidean", "folding")
_FORMATS = ("text", "markdown", "csv", "json", "npz")


@click.command()
@click.argument("ref", metavar="STATE|RUN", shell_complete=complete_any)
@click.option(
    "--metric",
    type=click.Choice(METRICS),
    default="physical",
    show_default=True,
    help="How the size of a mode is measured.",
)
@click.option(
    "--modes", metavar="K", type=click.IntRange(1), help="Number of lowest modes (12, with --convergence 6)."
)
@click.option("--full", is_flag=True, help="All 2N-3 eigenvalues, by dense algebra; for a RUN, at each N.")
@click.option("--convergence", is_flag=True, help="For a RUN: the lowest eigenvalues over N, orders, limits.")
@click.option("--format", "style", type=click.Choice(_FORMATS), help="Default: text.")
@click.option("-o", "--output", metavar="PATH", shell_complete=complete_file, help="Write to a file instead.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
@common_options
@pass_settings
def spectrum(
    settings: Settings,
    ref: str,
    metric: str,
    modes: int | None,
    full: bool,
    convergence: bool,
    style: str | None,
    output: str | None,
    overwrite: bool,
) -> int:
    """Eigenvalues, modes by name, and stability.

    Each mode of a STATE is labelled: rotation, sliding (along the band), checkerboard (of the
    discretisation) or mode. Its parity under each symmetry of the state is given. With --convergence, a table
    of a RUN over N.
    """
    style = text_format(settings, style)
    if full and (convergence or modes):
        raise UsageError("--full lists every mode: leave out --modes and --convergence")
    if style == "npz" and (output is None or convergence or not store.names_state(ref)):
        raise UsageError("--format npz holds the modes of one STATE: name it, and the file with -o")
    if output is not None:
        check_target(output, overwrite)
    told: report.spectra.Told
    failures: tuple[str, ...] = ()
    if convergence:
        run = store.find_run(settings.root, ref)
        told, failures = analysis.spectral_convergence(run, metric, modes or 6)
    elif full and not store.names_state(ref):
        told = analysis.run_spectra(store.find_run(settings.root, ref), metric)
    else:
        archive = output if style == "npz" else None
        told = _analyse(settings, ref, metric, modes, full, archive, overwrite)
        if archive is not None:
            return 0
    write = report.spectra.render
    deliver(settings, json_text(told.document()) if style == "json" else write(told, style), output)
    for failure in failures:
        complain(f"ribbon: {failure}")
    return TargetError.exit_code if failures else 0


def _analyse(
    settings: Settings,
    ref: str,
    metric: str,
    modes: int | None,
    full: bool,
    archive: str | None,
    overwrite: bool,
) -> report.spectra.StateSpectrum:
    """One state's spectrum; its modes go to the npz file `archive`, if that is asked for."""
    run, record, _ = api.open_state(ref, settings.runs, teller(settings))
    found = analysis.stability_of(record, metric, modes or 12, full)
    if archive is not None:
        store.write_arrays(archive, analysis.arrays_of(record, found, run.name if run else ""), overwrite)
        say(settings, f"wrote {archive}")
    return analysis.told_of(record, found, run.name if run else None)
