"""What pictures, files and pages say of a state's standing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.store import StateRecord, Summary

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


def linking_name(states: Iterable[Summary | StateRecord]) -> str:
    """What the stored linking number is called: between separated ends no curves are linked."""
    return "Tw + Wr" if {state.sigma for state in states} == {0} else "Lk"


def others_in_words(state: Summary | StateRecord) -> str:
    """The parameters besides the half-width that are not zero."""
    others = ((name, value) for name, value in state.parameters.items() if name != HALF_WIDTH and value)
    return ", ".join(f"{name} = {value:.10g}" for name, value in others)
