"""`python -m bench.sweeps`: a sweep by one worker, by two and on Dask; and one of 1000 runs, once done."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ribbon_cli.store import list_runs

from .machine import machine
from .store import processor

DOCUMENT = Path(__file__).parents[1] / "docs" / "benchmarks-sweeps.md"
FAMILY = """\
name: family
config:
  initial_guess: {segments: 100}
vary:
  - topology.half_twists: [0, 1, 3]
    initial_guess.recipe: [cylinder, twist, schoenke]
  - initial_guess.half_width: {from: 0.1, to: 0.29, steps: 19}
"""
MANY = """\
name: many
config:
  topology: {half_twists: 0}
  initial_guess: {recipe: cylinder, segments: 12}
  spectrum: {modes: 0, full_up_to: 0}
vary:
  - initial_guess.half_width: {from: 0.05, to: 0.3, steps: 999}
"""
WAYS = {
    "1 worker": ("--workers", "1"),
    "2 workers": ("--workers", "2"),
    "`--dask local`, 2 workers": ("--workers", "2", "--dask", "local"),
}
FASTER, SLOWER = 1.8, 1.15
"""How many times two workers are faster than one, at least; and Dask slower than two workers, at most."""
LIMIT, MEMORY = 3.0, 300.0
"""Seconds for what is done with a finished sweep of 1000 runs, and MiB of the process that controls one."""
_COMMAND = """\
import atexit, sys
def tell():
    with open("/proc/self/status") as status:
        line = next(line for line in status if line.startswith("VmHWM:"))
    with open("peak", "w") as file:
        file.write(line.split()[1])
atexit.register(tell)
from ribbon_cli.cli.main import main
main()
"""


def timed(folder: Path, *words: str) -> tuple[float, float, float]:
    """Seconds of a command line, those of processor in it and its workers, and the MiB of its own process."""
    started, before = time.perf_counter(), processor()
    done = subprocess.run(
        [sys.executable, "-c", _COMMAND, *words], cwd=folder, capture_output=True, check=False
    )
    took = time.perf_counter() - started
    if done.returncode:
        raise RuntimeError(f"{words}: exit code {done.returncode}: {done.stderr.decode()[-300:]}")
    busy = processor() - before
    sys.stderr.write(f"{' '.join(words)}: {took:.2f} s, {busy:.2f} s of processor\n")
    return took, busy, int((folder / "peak").read_text()) / 1024.0


def contents(root: Path) -> dict[str, list[str]]:
    """Content hashes of every run."""
    return {run.name: [state.content_sha256 for state in run.states(all=True)] for run in list_runs(root)}


def main() -> int:
    """Measure, and write the page; 1 where a limit is not kept or bytes differ."""
    load = os.getloadavg()[0]
    lines = [
        "# Benchmarks of sweeps",
        "",
        f"By `make bench-sweep` on a {machine()},",
        f"at a load of {load:.1f} before it began. Sweeps are run one after the other: other load",
        "disturbs their ratios.",
        "",
        "60 runs at N = 100, cylinders, π-bands and 3π-bands of 20 widths each, with whole spectra:",
        "",
        "| way | seconds | of processor | MiB of the controlling process |",
        "|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder, took, found = Path(name), {}, []
        (folder / "family.yaml").write_text(FAMILY, encoding="utf-8")
        (folder / "many.yaml").write_text(MANY, encoding="utf-8")
        for number, (way, options) in enumerate(WAYS.items()):
            root = f"runs-{number}"
            took[way], busy, peak = timed(folder, "sweep", "family.yaml", "--runs", root, *options)
            found.append(contents(folder / root))
            lines.append(f"| {way} | {took[way]:.1f} | {busy:.1f} | {peak:.0f} |")
        one, two, dask = took.values()
        same = all(other == found[0] for other in found)
        lines += [
            "",
            f"Two workers are {one / two:.2f} times faster than one (at least {FASTER:g}), Dask takes "
            f"{dask / two:.2f} times as long as they do (at most {SLOWER:g}).",
            f"The states' bytes are {'equal' if same else 'NOT equal'} in all three.",
            "",
            f"A sweep of 1000 runs of a state each; once done at most {LIMIT:g} seconds, and {MEMORY:g} MiB:",
            "",
            "| command | seconds | of processor | MiB of the controlling process |",
            "|---|---|---|---|",
        ]
        seconds, busy, peak = timed(folder, "sweep", "many.yaml", "--runs", "runs", "-q")
        lines.append(f"| `ribbon sweep`, all to be solved | {seconds:.2f} | {busy:.2f} | {peak:.0f} |")
        kept = peak <= MEMORY
        for what, words in (
            ("`ribbon sweep`, finished", ("sweep", "many.yaml")),
            ("`ribbon ls SWEEP`", ("ls", "many")),
            ("`ribbon table SWEEP`", ("table", "many", "-o", "many.csv")),
        ):
            seconds, busy, peak = timed(folder, *words, "--runs", "runs")
            kept &= seconds <= LIMIT and peak <= MEMORY
            lines.append(f"| {what} | {seconds:.2f} | {busy:.2f} | {peak:.0f} |")
    DOCUMENT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write("\n".join(lines) + "\n")
    return int(not (same and kept and one / two >= FASTER and dask / two <= SLOWER))


if __name__ == "__main__":
    sys.exit(main())
