"""The words by which listings tell how runs and states stand."""

from __future__ import annotations

from ..solver.status import Status

RUN_STATUSES = ("complete", "running", "waiting", "failed", "damaged", "unknown")
"""Words for a run as a whole: all targets certified; being written to; targets left; targets missed; ..."""
STATE_STATUSES = (*(status.value for status in Status), "missing", "unreadable", "damaged")
"""Words for a state: outcomes of a solve, or what has become of its file."""
