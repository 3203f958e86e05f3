"""How a process that solves on fine grids keeps the memory that it has."""

from __future__ import annotations

import ctypes
import sys
from typing import TYPE_CHECKING

from ..doors import Later

if TYPE_CHECKING:
    from ..solver import kkt
else:
    kkt = Later("ribbon_cli.solver.kkt")

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""mallopt(3): how much may be free at the heap's end, how many pieces may have a mapping of their own, and
how many heaps threads may have: what one of them frees then serves the others."""
_NEVER = -1
"""For the first of them, that memory is given back where `leave_grid` says so alone."""


def hold_memory() -> None:
    """Let what is freed serve the next array, for the rest of the process.

    By default glibc maps each large array anew, and the system fills its pages with zeros when they are first
    touched: a third of the time on fine grids, where arrays of a hundred megabytes come and go. Does nothing
    where the C library is not glibc.
    """
    for name, value in ((_MMAP_MAX, 0), (_ARENA_MAX, 1), (_TRIM_THRESHOLD, _NEVER)):
        _call("mallopt", name, value)


def leave_grid(segments: int) -> None:
    """Give back what solving on a fine grid leaves: another process may be at its spectra, which take as much
    again, and the next level is another grid."""
    if segments > kkt.FINE:
        kkt.let_go()
        _call("malloc_trim", 0)


def _call(name: str, *values: int) -> None:
    """Call a function of glibc, where this is the C library."""
    if sys.platform.startswith("linux"):
        function = getattr(ctypes.CDLL(None), name, None)
        if function is not None:
            function(*values)
