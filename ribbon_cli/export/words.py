"""What pictures, files and pages say of a state's standing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from ribbon_cli import digits, store
from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.text import listed

if TYPE_CHECKING:
    from ribbon_cli.store import StateRecord, Summary

MEETS_ITSELF = "touches or passes through itself (no contact forces)"
"""Of a state whose facets meet: which of the two it does is not stored, and nothing holds facets apart."""
MOST_LABELS = 8
"""Most states that a sentence names."""


def meets_unheld(state: StateRecord | Summary) -> bool:
    """Whether facets meet that no contact forces hold apart."""
    return state.self_contact and state.contacts is None


def meeting(state: StateRecord | Summary) -> str:
    """How a band meets itself, in words: without forces, or at rest on contacts; empty where it does not."""
    if not state.self_contact:
        return ""
    if state.contacts is None:
        return MEETS_ITSELF
    count, force, gap = _held(state)
    if not count:
        return "crosses itself"
    number = f"{count} contact{'s' * (count > 1)}" + (f" with a gap of {gap:.10g}" if gap else "")
    return f"rests on itself at {number}, forces of {digits.significant(force, 6)} in all"


def _held(state: StateRecord | Summary) -> tuple[int, float, float]:
    """Of a state computed with contact forces the number of contacts, their forces' sum, and the gap."""
    if isinstance(state, store.Summary):
        return state.contacts or 0, state.contact_force or 0.0, state.contact_gap or 0.0
    kept = state.contacts
    return (0, 0.0, 0.0) if kept is None else (len(kept), kept.total_force, kept.gap)


def verdict(record: StateRecord) -> str:
    """Whether a state is certified, and as what: an auxiliary problem's minimum is none of the band. Then, of
    a band whose facets meet, how they do.
    """
    return ", ".join(filter(None, [_certificate(record), meeting(record)]))


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
    contact = "self-contact" if meets_unheld(record) else "on itself" if record.self_contact else ""
    return ", ".join(filter(None, [word, contact]))


def contact_warning(records: Sequence[StateRecord]) -> str:
    """A sentence on the states of a picture or file whose facets meet without forces; empty where none do."""
    found = [record for record in records if meets_unheld(record)]
    if not found:
        return ""
    if len(records) == 1:
        return f"state {found[0].label} {MEETS_ITSELF}"
    labels = listed((str(record.label) for record in found), MOST_LABELS)
    words = "touch or pass through themselves (no contact forces)"
    return f"of {len(records)} states {len(found)} {words}: {labels}"


def linking_name(states: Iterable[Summary | StateRecord]) -> str:
    """What the stored linking number is called: between separated ends no curves are linked."""
    return "Tw + Wr" if {state.sigma for state in states} == {0} else "Lk"


def others_in_words(state: Summary | StateRecord) -> str:
    """The parameters besides the half-width that are not zero."""
    others = ((name, value) for name, value in state.parameters.items() if name != HALF_WIDTH and value)
    return ", ".join(f"{name} = {value:.10g}" for name, value in others)
