"""A process that solves from one start and prints its peak memory before and after, in MiB."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from ribbon_cli.model.band import Band, State

from .ours import SIGMA, solved


def peak() -> float:
    """Peak resident memory of this program so far, in MiB.

    From Linux's own count for the program, since that of `resource` starts from what the parent had.
    Raises RuntimeError where there is no such count.
    """
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError("/proc/self/status has no VmHWM: peak memory cannot be measured here")


def main(path: str) -> None:
    """Solve from the start kept in a file of `bench.single.memory`."""
    with np.load(path) as kept:
        band = Band(len(kept["u"]), float(kept["half_width"]), sigma=SIGMA)
        start = State(band, kept["u"], kept["g"], kept["xi"])
    before = peak()
    solved(start)
    print(json.dumps({"before": before, "after": peak()}))


if __name__ == "__main__":
    main(sys.argv[1])
