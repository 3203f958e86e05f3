"""What pictures and pages say of a state's standing."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ribbon_cli.store import StateRecord


def verdict(record: StateRecord) -> str:
    """Whether a state is certified, and as what: an auxiliary problem's minimum is none of the band."""
    if record.kind == "auxiliary":
        status = "minimum of the auxiliary problem" if record.certified else record.status
        return f"auxiliary, {status}: no equilibrium of the band"
    if record.certified:
        return "certified minimum"
    words = dict.fromkeys((record.kind, record.status))
    return f"{', '.join(words)}: no certificate"


def standing(record: StateRecord) -> str:
    """What has to be said of a state beside certified ones, in a word or two; empty for those."""
    if record.kind == "auxiliary":
        return "auxiliary"
    return "" if record.certified else "no certificate"
