"""The studies behind pages of the documentation, run as a user runs them: solve, follow, list."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import ribbon_cli as ribbon
from paper.families import FAMILIES, member
from paper.limits import limits_text
from ribbon_cli.cli.settings import Settings
from ribbon_cli.cli.solve_commands import report
from ribbon_cli.errors import TargetError

STUDIED = (
    "ring",
    "paper/ring-value-average",
    "paper/mobius-pi-coarse",
    "paper/mobius-pi-coarse-value-average",
)
"""Configs whose spectra are compared under both rules."""
TO_CONTACT = ("--to", "1.0", "--arclength", "--stop-at", "contact")


@dataclass(frozen=True)
class Place:
    """Where a study finds its configs and puts its runs; `quiet` leaves out progress."""

    configs: Path
    runs: Path
    quiet: bool = False


def solve(name: str, place: Place) -> None:
    """Solve a member of a family and print what `ribbon solve` prints. Raises TargetError as it exits."""
    outcome = ribbon.solve(member(place.configs, name), runs=place.runs, progress=not place.quiet)
    if report(Settings(runs=str(place.runs), quiet=place.quiet), outcome):
        raise TargetError(f"{name}: not all of it was reached")


def everted_cylinder(place: Place) -> None:
    """The branches of docs/everted-cylinder.md, from stored recipes to contact."""
    for name in FAMILIES["everted-branch-40"]:
        solve(name, place)
    for n in (40, 80, 160, 320):
        _command(place, "continue", f"everted-branch-{n}@b=0.3,N={n}", *TO_CONTACT)


def everted_moebius(place: Place) -> None:
    """The two families of docs/everted-moebius.md, from stored saddles; the second to contact."""
    for name in FAMILIES["studies/everted-moebius-a-80"]:
        solve(name, place)
    for n in (80, 160, 320):
        _command(place, "continue", f"everted-moebius-b-{n}@b=0.3,N={n}", *TO_CONTACT)


def checkerboard(place: Place) -> None:
    """Both rules side by side: all Euclidean eigenvalues, then the lowest physical ones over N."""
    for config in STUDIED:
        outcome = ribbon.solve(place.configs / f"{config}.yaml", runs=place.runs)
        name = outcome.run.short_name
        if outcome.failures:
            raise TargetError(f"{name}: {'; '.join(outcome.failures)}")
        sys.stdout.write(f"== {name}\n")
        _command(place, "spectrum", name, "--full", "--metric", "euclidean")
        _command(place, "spectrum", name, "--convergence")


def contact_limits(place: Place) -> None:
    """The table of docs/contact-gallery.md: bands at rest on themselves towards the widest there can be."""
    sys.stdout.write(limits_text(place.configs, place.runs, not place.quiet))


STUDIES: dict[str, Callable[[Place], None]] = {
    "everted-cylinder": everted_cylinder,
    "everted-moebius": everted_moebius,
    "checkerboard": checkerboard,
    "contact-limits": contact_limits,
}
"""Studies by the name of their make target."""


def _command(place: Place, *words: str) -> None:
    """A command of `ribbon` on the study's runs. Raises TargetError where it fails; it has said why."""
    sys.stdout.flush()
    quiet = ("-q",) if place.quiet else ()
    line = (sys.executable, "-m", "ribbon_cli", *quiet, "--runs", os.fspath(place.runs), *words)
    if subprocess.run(line, check=False).returncode:
        raise TargetError(f"ribbon {' '.join(words)}: failed")
