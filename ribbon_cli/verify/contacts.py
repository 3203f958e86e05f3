"""Whether what a file says of a band that rests on itself follows from its shape and its forces.

Gaps are computed again, and the audit over all pairs is repeated, which knows nothing of the pairs that the
file names. That forces hold the band in equilibrium is told by its residuals, and what a certificate asks for
besides is asked again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..model.touching import Shape
from ..model.touching_audit import audit
from ..model.touching_gaps import places
from ..solver.resting import RestingProblem
from ..solver.resting_certificate import PENETRATION, certified
from ..solver.resting_exchange import OFF
from ..solver.resting_set import DEPTH
from ..solver.status import STATIONARY, Result, Status
from ..store import Contacts, StateRecord

RELATIVE = 1e-9
"""Relative difference up to which lengths agree, beside the rounding of the gaps."""


def check_contacts(
    record: StateRecord, again: Contacts | None, problem: RestingProblem, result: Result, rounding: float
) -> Iterator[str]:
    """Lines on wrong numbers in /contacts; `again` are those of the shape, which may be off by `rounding`."""
    contacts = record.contacts
    if contacts is None or again is None:
        return
    if not contacts.gap >= 0.0:
        yield f"/contacts/gap is {contacts.gap:.10g}"
    names = contacts.names()
    for k in np.flatnonzero(~_near(contacts.value, again.value, rounding)):
        at = f"/contacts/value[{k}] ({names[k]})"
        yield f"{at} is {contacts.value[k]:.10g}, recomputed {again.value[k]:.10g}"
    for name in ("excluded", "clearance", "penetration"):
        stored, found = getattr(contacts, name), getattr(again, name)
        if not _near(stored, found, rounding):
            yield f"/contacts/{name} is {stored:.10g}, recomputed {found:.10g}"
    if record.clearance != contacts.clearance:
        yield f"clearance is {record.clearance:.10g}, and /contacts/clearance {contacts.clearance:.10g}"
    if record.self_contact != contacts.touching:
        count, word = len(contacts), str(record.self_contact).lower()
        yield f"self_contact is {word} with {count} contacts and a penetration of {contacts.penetration:.1e}"
    if result.status in STATIONARY:
        yield from _off_features(contacts, problem, result)
    yield from _judged(record, problem, result)


def _near(stored: np.ndarray | float, found: np.ndarray | float, rounding: float) -> np.ndarray:
    near: np.ndarray = np.abs(np.subtract(stored, found)) <= rounding + RELATIVE * np.abs(found)
    return near


def _off_features(contacts: Contacts, problem: RestingProblem, result: Result) -> Iterator[str]:
    """Contacts whose place is beside their features: no force can act there."""
    at = places(Shape.of(result.state, problem.gap), problem.pairs)
    off = np.maximum(-at, at - 1.0).max(axis=1, initial=0.0)
    for k in np.flatnonzero(~(off <= OFF)):
        yield f"contact {k} ({contacts.names()[k]}) is off its features by {off[k]:.1e} of their size"


def _judged(record: StateRecord, problem: RestingProblem, result: Result) -> Iterator[str]:
    """The status, as the certificate has it."""
    assert record.contacts is not None
    gap = problem.gap
    found = audit(Shape.of(result.state, gap), gap + DEPTH * record.length)
    if result.status is Status.GAP_LOST and not found.lacks(gap) > PENETRATION * record.length:
        yield f"status is gap-lost, but no more than {max(found.lacks(gap), 0.0):.1e} is lacking"
    if result.status not in (Status.MINIMUM, Status.SADDLE):
        return
    for k in np.flatnonzero(~(record.contacts.force >= 0.0)) if record.certified else ():
        pulls = f"/contacts/force[{k}] ({record.contacts.names()[k]}) pulls: {record.contacts.force[k]:.3g}"
        yield f"certified, but {pulls}"
    judged = certified(problem, replace(result, detail=""), found)
    if judged.status is not result.status:
        yield f"status is {record.status}, recomputed {judged.status.value} {judged.detail}"
