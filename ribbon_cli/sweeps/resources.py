"""How many runs a machine can take at once."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from pathlib import Path

from ..config import Config

_MIB = 1 << 20
_PROCESS = 170 * _MIB
"""A worker with its libraries and a small run."""
_SEGMENT = 80 << 10
"""What a segment adds at the finest level of a run: 48 to 65 KiB were seen from N = 800 to 6400."""
_DENSE = 5 * 8
"""Bytes for each entry of the square matrix that a full spectrum takes: five arrays of doubles were seen."""
_GROUP = Path("/sys/fs/cgroup")
_MEMORY_FILES = (
    ("memory.max", "memory.current", "memory.stat"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat"),
)
"""Where control groups of both versions keep a limit, what is used, and of what."""


def memory_of(configs: Iterable[Config]) -> int:
    """Bytes of the largest of these runs, in a process of its own: an estimate on the safe side."""
    return max((_memory(config) for config in configs), default=_PROCESS)


def _memory(config: Config) -> int:
    levels = (*config.refinement.levels, config.guess.segments or 0)
    full = max((n for n in levels if n <= config.spectrum.full_up_to), default=0)
    return _PROCESS + _SEGMENT * max(levels) + _DENSE * (7 * full) ** 2


def cores() -> int:
    """Processors that this process may use: by its affinity, and by the limit of its control group."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota, _, period = _text(_GROUP / "cpu.max").partition(" ")
    if quota.isdecimal() and period.strip().isdecimal():
        count = min(count, math.ceil(int(quota) / int(period)))
    return max(1, count)


def free_memory() -> int | None:
    """Bytes that further processes may take, None where that is not known."""
    known = []
    for line in _text(Path("/proc/meminfo")).splitlines():
        name, _, rest = line.partition(":")
        if name == "MemAvailable":
            known.append(int(rest.split()[0]) << 10)
    for most, now, stat in _MEMORY_FILES:
        limit, used = _text(_GROUP / most).strip(), _text(_GROUP / now).strip()
        if limit.isdecimal() and used.isdecimal():
            # Files that were read stay in memory until it is needed.
            spare = dict(line.split(maxsplit=1) for line in _text(_GROUP / stat).splitlines())
            known.append(max(0, int(limit) - int(used) + int(spare.get("inactive_file", 0))))
    return min(known, default=None)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except (OSError, ValueError):
        return ""


def workers_for(asked: int | None, configs: Iterable[Config]) -> tuple[int, str]:
    """How many worker processes to start, and a word on why they are fewer than asked for.

    No more than there are runs, processors, and memory for.
    """
    runs = list(configs)
    need, there = memory_of(runs), free_memory()
    fit = len(runs) if there is None else there // need
    wanted = asked or cores()
    bounds = {f"{cores()} processors": cores(), f"memory for {fit}, of {need // _MIB} MiB each": fit}
    taken = max(1, min(wanted, len(runs), *bounds.values()))
    if asked is not None and taken < min(asked, len(runs)):
        why = min(bounds, key=lambda word: bounds[word])
        return taken, f"{asked} workers asked for, {taken} taken: there are {why}"
    return taken, ""
