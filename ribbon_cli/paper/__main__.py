"""`python -m ribbon_cli.paper [NAME ...]`: make figures and tables; without names all, and the page."""

from __future__ import annotations

import os

# As in the command line: the number of threads decides the order of summation, hence the bytes of results.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import argparse
import sys
from pathlib import Path

from ribbon_cli.errors import RibbonError, UsageError
from ribbon_cli.paper.make import make
from ribbon_cli.store import runs_root


def main() -> int:
    """Parse the command line, make what it names, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m ribbon_cli.paper", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="figure-3.8, table-3.1, ...; default: all")
    parser.add_argument("--configs", type=Path, default=Path("configs"), help="folder of the configs")
    parser.add_argument("--runs", help="folder of the runs; else RIBBON_RUNS, else ./runs")
    parser.add_argument(
        "--to", type=Path, help="folder of the figures; default: paper in the folder of the runs"
    )
    arguments = parser.parse_args()
    runs = runs_root(arguments.runs)
    try:
        make(arguments.names, arguments.configs, runs, arguments.to or runs / "paper", _say)
    except RibbonError as error:
        _say(f"ribbon: {error}")
        return error.exit_code if isinstance(error, UsageError) else 1
    return 0


def _say(text: str) -> None:
    """Write a line to standard error."""
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
