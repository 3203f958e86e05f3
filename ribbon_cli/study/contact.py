"""Where a schedule first meets self-contact: the width located between two states, at every level.

Between a state without contact and one with it, the width is bisected, each half solved for and certified on
the branch like any other step. The touching end of the last bracket is stored, the other end is named in its
events. On finer levels the bracket is searched for about the coarser one's width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.band import Array, State
from ..model.contact import Contact, self_contact
from ..solver.continuation import Move, to_width
from ..solver.status import Result, Status
from ..store import Summary
from .records import multipliers_of, state_of
from .steps import Steps

WITHIN = 1e-5
"""Width of the last bracket, as part of l / 2 pi."""
SEARCH = 0.005
"""First step of the search for a bracket on a finer level, as part of l / 2 pi; it doubles."""
MOST_SEARCHES = 7


@dataclass(frozen=True)
class FirstContact:
    """The least width known to touch on N segments, and the label of its state."""

    segments: int
    half_width: float
    label: int


@dataclass(frozen=True)
class _End:
    """One end of a bracket: a state on the branch, and how it was reached if it was solved for here."""

    state: State
    multipliers: Array
    contact: Contact
    move: Move | None = None
    result: Result | None = None

    @property
    def half_width(self) -> float:
        return self.state.band.half_width


def locate_contact(
    steps: Steps, before: Summary, after: Summary, levels: Sequence[int]
) -> tuple[FirstContact, ...]:
    """Locate the contact that begins (or ends) between two states of a branch, then on finer `levels`.

    Empty if none does, or if a step between them fails, which is noted. What is stored already is loaded.
    """
    if before.self_contact == after.self_contact or not (before.certified and after.certified):
        return ()
    free, touching = (after, before) if before.self_contact else (before, after)
    stage = f"contact between b = {before.half_width:.12g} and b = {after.half_width:.12g}"
    record = steps.journal.finished(stage)
    if record is None:
        record = _bisect(steps, _end(steps, free), _end(steps, touching), stage, free.label)
    found = [] if record is None else [record]
    side = math.copysign(1.0, free.half_width - touching.half_width)
    for n in levels if record is not None else ():
        finer = _on_level(steps, found[-1], n, stage, side)
        if finer is None:
            break
        found.append(finer)
    out = tuple(FirstContact(r.segments, r.half_width, r.label) for r in found)
    if out:
        steps.journal.note(_sentence(out))
    return out


def _end(steps: Steps, stored: Summary) -> _End:
    record = steps.journal.load(stored)
    state = state_of(record)
    return _End(state, multipliers_of(record), _contact(state))


def _contact(state: State) -> Contact:
    band = state.band
    return self_contact(state.u, state.g, band.sigma * state.g[0], band.half_width, band.h)


def _solved(steps: Steps, start: _End, half_width: float, stage: str) -> _End | None:
    """The branch at another width, from the nearer end; None, with a note, where no minimum is found."""
    steps.begin(stage, half_width, start.state.band.segments)
    move = to_width(start.state, start.multipliers, half_width, steps.options)
    result = steps.checked(move.result)
    if result.status is not Status.MINIMUM:
        steps.journal.note(f"{stage}: not located, at b = {half_width:.12g}: {result.message}")
        return None
    return _End(result.state, result.multipliers, _contact(result.state), move, result)


def _bisect(steps: Steps, free: _End, touching: _End, stage: str, parent: int) -> Summary | None:
    """Halve the bracket to `WITHIN` from its free end, whose label is `parent`; store its touching end."""
    clock = steps.journal.clock()
    within = WITHIN * free.state.band.length / (2.0 * math.pi)
    while abs(free.half_width - touching.half_width) > within:
        middle = _solved(steps, free, 0.5 * (free.half_width + touching.half_width), stage)
        if middle is None:
            return None
        if middle.contact.contact:
            touching = middle
        else:
            free = middle
    if touching.move is None:  # it begins within a bracket's width of where the step ended
        again = _solved(steps, free, touching.half_width, stage)
        if again is None:
            return None
        touching = again
    if not touching.contact.contact:
        steps.journal.note(f"{stage}: not located, no contact up to b = {touching.half_width:.12g}")
        return None
    assert touching.move is not None
    assert touching.result is not None
    word = "first contact" if touching.half_width > free.half_width else "contact ends"
    i, j = (int(k) + 1 for k in touching.contact.pairs[0])
    event = (
        f"{word}: facets {i} and {j} meet at b = {touching.half_width:.10g}, "
        f"at b = {free.half_width:.10g} none do (clearance {free.contact.clearance:.2g})"
    )
    return steps.store_move(
        touching.move,
        touching.result,
        clock,
        kind="intermediate",
        stage=stage,
        parent=parent,
        failures=(event,),
    )


def _on_level(steps: Steps, coarse: Summary, n: int, stage: str, side: float) -> Summary | None:
    """First contact on a finer level, bracketed by steps from the coarser one's width.

    `side` is the sign of the widths without contact, seen from those with it.
    """
    name = f"{stage}, N = {n}"
    known = steps.journal.finished(name)
    if known is not None:
        return known
    refined = steps.refine(coarse, n, f"{name}, refined at the coarser level's", "intermediate")
    if isinstance(refined, str) or not refined.certified:
        steps.journal.note(refined if isinstance(refined, str) else f"{name}: {refined.message}")
        return None
    here = _end(steps, refined)
    step = SEARCH * refined.length / (2.0 * math.pi)
    for _ in range(MOST_SEARCHES):
        towards = side if here.contact.contact else -side
        there = _solved(steps, here, here.half_width + towards * step, name)
        if there is None:
            return None
        if there.contact.contact != here.contact.contact:
            free, touching = (there, here) if here.contact.contact else (here, there)
            return _bisect(steps, free, touching, name, refined.label)
        here, step = there, 2.0 * step
    steps.journal.note(f"{name}: not located within {abs(here.half_width - refined.half_width):.3g}")
    return None


def _sentence(found: Sequence[FirstContact]) -> str:
    """All levels in a line, with the limit that the last three tend to."""
    text = ", ".join(f"b = {c.half_width:.6g} (N = {c.segments})" for c in found)
    limit = extrapolated([c.half_width for c in found])
    if limit is None:
        return f"first contact at {text}"
    return f"first contact at {text}, tending to {limit[0]:.6g} +- {limit[1]:.1g}, with order {limit[2]:.2f}"


def extrapolated(widths: Sequence[float]) -> tuple[float, float, float] | None:
    """Limit, its error bar and the order of widths on grids that double; None where they have no trend.

    The last three are taken. With differences d_1 and d_2 the order is log2(d_1 / d_2) and the limit, by
    Aitken's process, b_3 + d_2^2 / (d_1 - d_2); its distance from b_3 is the bar. The trend must
    shrink by a factor between 1.5 and 10, and be larger than the brackets.
    """
    if len(widths) < 3:
        return None
    first, second, third = widths[-3:]
    one, two = second - first, third - second
    if two == 0.0 or abs(two) < 3.0 * WITHIN or not 1.5 <= one / two <= 10.0:
        return None
    rest = two * two / (one - two)
    return third + rest, abs(rest), math.log2(one / two)
