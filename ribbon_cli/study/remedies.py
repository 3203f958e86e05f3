"""What to do where a solve did not come to the state that was asked for, after the sentence that says so.

The sentences of statuses are stored with states, which are never changed; what they advise may be.
"""

from __future__ import annotations

from ..solver.status import Status

_MORE = "more segments N (`segments`), or another recipe or state to start from"
_REMEDIES = {
    Status.LEFT_TOPOLOGY: f"Take smaller steps{{}}, {_MORE}.",
    Status.OTHER_SHAPE: f"Take smaller steps{{}}, {_MORE}.",
    Status.STALLED: f"Take smaller steps{{}}, {_MORE}.",
    Status.ITERATION_LIMIT: f"Take smaller steps{{}}, {_MORE}.",
    Status.NOT_FINITE: f"Take smaller steps{{}}, {_MORE}.",
    Status.LEFT_BRANCH: "Take smaller steps{}, or follow the branch by arclength.",
    Status.INVERTED_FACET: "Take more segments N, or a narrower band.",
    Status.SADDLE: "Another N may have a minimum; `widths: {{arclength: ...}}` goes on along saddles.",
    Status.UNDECIDED: "`ribbon spectrum` shows the mode in question; another N may decide.",
}


def remedied(message: str, status: Status | str, steps: str = "") -> str:
    """A sentence of a solve with what to do about its status; `steps` says where smaller ones are had."""
    remedy = _REMEDIES.get(Status(status))
    return message if remedy is None else f"{message} {remedy.format(f' ({steps})' if steps else '')}"
