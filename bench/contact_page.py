"""The section of `bench.contact`."""

from __future__ import annotations

from .contact import (
    BY,
    MOST_BARRIER,
    MOST_POLISH,
    MOST_SECONDS,
    PARTS,
    ROOT,
    TOUCHES_NOTHING,
    WAY,
    Contact,
    ContactCost,
    Steps,
)
from .document import Part
from .tables import Rule, table

BARRIER, POLISH = "down a barrier", "to rest"


def contact_part(found: Contact) -> Part:
    """The part of the page."""
    return Part("contact", _rules(found), _section(found))


def _kinds(cost: ContactCost) -> tuple[tuple[str, Steps], ...]:
    return ("without contact", cost.free), (BARRIER, cost.barrier), (POLISH, cost.polish)


def _rules(found: Contact) -> list[Rule]:
    """What is required of bands at rest, with the figures found."""
    finest, most = found.costs[-1], {BARRIER: MOST_BARRIER, POLISH: MOST_POLISH}
    out = []
    for name, steps in _kinds(finest)[1:]:
        ratio = steps.seconds / finest.free.seconds
        text = (
            f"a Newton step {name} at most {most[name]:g} times one without contact at N = {finest.segments}"
        )
        out.append((f"{text}: {ratio:.2f}", ratio <= most[name]))
    if found.seconds is not None:
        text = f"`{WAY.relative_to(ROOT)}` within {MOST_SECONDS:g} s: {found.seconds:.1f} s"
        out.append((text, found.seconds <= MOST_SECONDS))
    return out


def _section(found: Contact) -> str:
    """The section, Markdown."""
    lines = []
    for cost in found.costs:
        for name, steps in _kinds(cost):
            each = [f"{1000 * steps.part(part):.2f}" for part in PARTS]
            kind = (str(cost.segments), name, str(steps.count), str(steps.border), str(steps.patterns))
            middle = f"{1000 * steps.seconds:.2f}", f"{steps.seconds / cost.free.seconds:.2f}"
            mean = f"{1000 * steps.mean:.2f}", f"{steps.mean / cost.free.mean:.2f}"
            lines.append((*kind, *each, *middle, *mean))
    head = ("N", "step", "steps", "border", "patterns", *PARTS, "all", "ratio", "mean", "ratio")
    return f"""## Bands at rest on themselves

Milliseconds of the processor, medians over the steps of a way. A pi band of b = {TOUCHES_NOTHING:g} that
touches nothing is widened by {BY:g}: its gaps are opened, and a barrier of the widest reach leads down. The
same places are gone through again, for the steps without contact and with the barrier. Its lists of pairs,
patterns and their symbolic factors are made on the way, in a few of the steps: *mean* has them. Steps to
rest, with gaps as rows, are at places between the end of the barrier and the shape at rest. *Collisions*
tests the motion of each step; pairs are among the derivatives.

{table(head, lines)}"""
