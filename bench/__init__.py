"""Benchmarks: the peer solver and the comparisons that `make bench` prints."""

import os

# Before numpy is loaded, and for both contestants: one thread each, whatever the environment says.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{_library}_NUM_THREADS"] = "1"
