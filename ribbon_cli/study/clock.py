"""What one state costs in time and memory, for its provenance."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..store.log import utc_now
from ..store.provenance import Facts, gather

Origin = Path | Mapping[str, str | int | float] | None
"""Where a config comes from: its folder, or what an earlier state's provenance says of its repository."""


@dataclass
class Clock:
    """Measures what one state cost, for its provenance."""

    argv: Sequence[str]
    origin: Origin
    config: Facts = field(default_factory=dict)
    started: str = field(default_factory=utc_now)
    wall: float = field(default_factory=time.perf_counter)
    cpu: float = field(default_factory=time.process_time)

    def facts(self) -> dict[str, str | int | float]:
        """Provenance since the clock was made."""
        facts = gather(
            self.argv,
            self.origin if isinstance(self.origin, Path) else None,
            **self.config,
            started=self.started,
            wall_seconds=time.perf_counter() - self.wall,
            cpu_seconds=time.process_time() - self.cpu,
            peak_memory_bytes=_peak_memory(),
        )
        return dict(facts) | (dict(self.origin) if isinstance(self.origin, Mapping) else {})


def _peak_memory() -> int:
    """Most bytes of memory that this process had; macOS counts bytes, others kibibytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
