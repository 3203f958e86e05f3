"""`python -m paper [NAME ...]`: figures, tables, studies by name; without names all figures and the page."""

from __future__ import annotations

import os

# As in the command line: the number of threads decides the order of summation, hence the bytes of results.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import argparse
import sys
from pathlib import Path

from paper.families import MEMBERS
from paper.figures import ITEMS
from paper.library import Library
from paper.make import make
from paper.studies import STUDIES, Place, solve
from ribbon_cli.errors import RibbonError, TargetError, UsageError
from ribbon_cli.store import runs_root, suggest

CONFIGS = Path(__file__).parents[1] / "configs"
INTERRUPTED = 130


def main(words: list[str] | None = None) -> int:
    """Parse the command line, make what it names, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m paper", description=__doc__)
    kinds = f"figure-3.8, table-3.1, {', '.join(STUDIES)}, or one config of a study as {next(iter(MEMBERS))}"
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{kinds}; default: all figures")
    parser.add_argument("--configs", type=Path, default=CONFIGS, help="folder of the configs")
    parser.add_argument("--runs", help="folder of the runs; else RIBBON_RUNS, else ./runs")
    parser.add_argument(
        "--to", type=Path, help="folder of the figures; default: paper in the folder of the runs"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    given = parser.parse_args(words)
    place = Place(given.configs, runs_root(given.runs), given.quiet)
    try:
        return _make(given.names, place, given.to or place.runs / "paper")
    except RibbonError as error:
        _say(f"ribbon: {error}")
        return error.exit_code
    except KeyboardInterrupt:
        _say("ribbon: interrupted: everything committed is kept, and the same command resumes")
        return INTERRUPTED


def _make(names: list[str], place: Place, to: Path) -> int:
    """Make what is named, studies first. Raises UsageError for an unknown name."""
    known = (*ITEMS, *STUDIES, *MEMBERS)
    for name in names:
        if name not in known:
            shown = ", ".join((*ITEMS, *STUDIES))
            raise UsageError(f"nothing is called {name!r} (known: {shown}){suggest(name, known)}")
    for name in names:
        if name in STUDIES:
            STUDIES[name](place)
        elif name in MEMBERS:
            solve(name, place)
    items = [name for name in names if name in ITEMS]
    if names and not items:
        return 0
    # The table's bands take a minute, and its text is asked for: it is printed, and its progress shown.
    printed = [name for name in items if name == "table-3.1"]
    library = Library(place.configs, place.runs, progress=bool(printed) and not place.quiet)
    made = make(items, library, to, _say)
    for name in printed:
        sys.stdout.write(made[name].texts["txt"])
    failures = [line for name in made for line in made[name].failures]
    for line in failures:
        _say(f"ribbon: {line}")
    return TargetError.exit_code if failures else 0


def _say(text: str) -> None:
    """Write a line to standard error."""
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
