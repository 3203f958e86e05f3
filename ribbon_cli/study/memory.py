"""How a process that solves on fine grids keeps the memory that it has."""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""mallopt(3): how much may be free at the heap's end, how many pieces may have a mapping of their own, and
how many heaps threads may have: what one of them frees then serves the others."""
_MOST_FREE = 1 << 30


def hold_memory() -> None:
    """Let what is freed serve the next array, for the rest of the process.

    By default glibc maps each large array anew, and the system fills its pages with zeros when they are first
    touched: a third of the time on fine grids, where arrays of a hundred megabytes come and go. The peak
    stays within a few per cent. Does nothing where the C library is not glibc.
    """
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_MAX, 0)
        mallopt(_ARENA_MAX, 1)
        mallopt(_TRIM_THRESHOLD, _MOST_FREE)
