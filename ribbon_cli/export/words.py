"""What pictures, files and pages say of a state's standing."""

from __future__ import annotations

from collections.abc import Sequence

from ribbon_cli.store import StateRecord

MEETS_ITSELF = "touches or passes through itself (no contact forces)"
"""Of a state whose facets meet: which of the two it does is not stored, and nothing holds facets apart."""
MOST_LABELS = 8
"""Most states that a sentence names."""


def verdict(record: StateRecord) -> str:
    """Whether a state is certified, and as what: an auxiliary problem's minimum is none of the band. Then, of
    a band whose facets meet, that they do.
    """
    return f"{_certificate(record)}, {MEETS_ITSELF}" if record.self_contact else _certificate(record)


def _certificate(record: StateRecord) -> str:
    """Whether a state is certified, and as what."""
    if record.kind == "auxiliary":
        status = "minimum of the auxiliary problem" if record.certified else record.status
        return f"auxiliary, {status}: no equilibrium of the band"
    if record.certified:
        return "certified minimum"
    words = dict.fromkeys((record.kind, record.status))
    return f"{', '.join(words)}: no certificate"


def standing(record: StateRecord) -> str:
    """What has to be said of a state beside certified ones, in a word or two; empty for those."""
    word = "auxiliary" if record.kind == "auxiliary" else "" if record.certified else "no certificate"
    return ", ".join(filter(None, [word, "self-contact" if record.self_contact else ""]))


def contact_warning(records: Sequence[StateRecord]) -> str:
    """A sentence on those states of a picture or file whose facets meet; empty where none do."""
    meeting = [record for record in records if record.self_contact]
    if not meeting:
        return ""
    if len(records) == 1:
        return f"state {meeting[0].label} {MEETS_ITSELF}"
    labels = ", ".join(str(record.label) for record in meeting[:MOST_LABELS])
    more = f" and {len(meeting) - MOST_LABELS} more" if len(meeting) > MOST_LABELS else ""
    words = "touch or pass through themselves (no contact forces)"
    return f"of {len(records)} states {len(meeting)} {words}: {labels}{more}"
