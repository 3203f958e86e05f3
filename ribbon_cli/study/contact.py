"""Where a schedule first meets self-contact: the parameter located between two states, at every level.

Between a state without contact and one with it, the half-width (or what else moves) is bisected, each half
solved for and certified on the branch like any other step. The touching end of the last bracket is stored,
the other end is named in its events. On finer levels the bracket is searched for about the coarser one's
place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..facts import event
from ..model.band import Array, State
from ..model.contact import Contact, self_contact
from ..parts import HALF_WIDTH, PARAMETERS
from ..store import Summary
from .failure import Failure
from .records import multipliers_of, state_of
from .stepping import step_to
from .walk import Ended, Stage, Walk, bracketed

WITHIN = 1e-5
"""Length of the last bracket: of a half-width, as part of l / 2 pi."""
SEARCH = 0.005
"""First step of the search for a bracket on a finer level, likewise; it doubles."""
MOST_SEARCHES = 7


@dataclass(frozen=True)
class FirstContact:
    """The first value known to touch on N segments, and the label of its state."""

    segments: int
    value: float
    label: int


@dataclass(frozen=True)
class _End:
    """One end of a bracket: a state on the branch, and how it was reached if it was solved for here."""

    state: State
    multipliers: Array
    contact: Contact
    solved: Ended | None = None

    @property
    def self_contact(self) -> bool:
        """Whether facets meet."""
        return self.contact.contact


@dataclass(frozen=True)
class _Way:
    """The parameter that is bisected, and the unit of brackets in it."""

    name: str
    unit: float

    def of(self, end: _End) -> float:
        """The value at one end."""
        return end.state.band.parameter(self.name)


def locate_contact(
    walk: Walk, before: Summary, after: Summary, levels: Sequence[int], parameter: str = HALF_WIDTH
) -> tuple[FirstContact, ...]:
    """Locate the contact that begins (or ends) between two states of a branch, then on finer `levels`.

    The step between them moves a `parameter`.

    Empty if none does, or if a step between them fails, which is noted. What is stored already is loaded.
    """
    if before.self_contact == after.self_contact or not (before.certified and after.certified):
        return ()
    free, touching = (after, before) if before.self_contact else (before, after)
    symbol, way = PARAMETERS[parameter].symbol, _Way(parameter, _unit(parameter, free.length))
    values = [state.parameters[parameter] or 0.0 for state in (before, after)]
    name = f"contact between {symbol} = {values[0]:.12g} and {symbol} = {values[1]:.12g}"
    stage = Stage(name, free.half_width, free.segments, "intermediate", free.label)
    record = walk.end_of(stage, lambda: _located(walk, _end(walk, free), _end(walk, touching), name, way))
    found: list[Summary] = []
    side = math.copysign(1.0, values[0] - values[1]) * (1.0 if free is before else -1.0)
    left = list(levels)
    while not isinstance(record, Failure):
        found.append(record)
        if not left:
            break
        record = _on_level(walk, record, left.pop(0), name, side, way)
    if isinstance(record, Failure):
        walk.journal.note(record.sentence)
    out = tuple(FirstContact(r.segments, r.parameters[parameter] or 0.0, r.label) for r in found)
    if out:
        walk.journal.note(_sentence(out, symbol))
    return out


def _unit(parameter: str, length: float) -> float:
    if parameter == HALF_WIDTH:
        return length / (2.0 * math.pi)
    return 1.0 / PARAMETERS[parameter].weight(length)


def _end(walk: Walk, stored: Summary) -> _End:
    record = walk.journal.load(stored)
    state = state_of(record)
    return _End(state, multipliers_of(record), _contact(state))


def _contact(state: State) -> Contact:
    band, end = state.band, state.next_rulings()[-1]
    return self_contact(state.u, state.g, end, band.half_width, band.h, closed=band.closed)


def _solved(walk: Walk, start: _End, value: float, stage: str, way: _Way) -> _End | Failure:
    """The branch at another value, from the nearer end."""
    target = {way.name: value}
    walk.begin(stage, target.get(HALF_WIDTH, start.state.band.half_width), start.state.band.segments)
    end = step_to(walk, start.state, start.multipliers, target)
    if isinstance(end, Failure):
        symbol = PARAMETERS[way.name].symbol
        return replace(end, kind="located", values={"stage": stage, "end": value, "symbol": symbol})
    state = end.result.state
    return _End(state, end.result.multipliers, _contact(state), end)


def _located(walk: Walk, free: _End, touching: _End, stage: str, way: _Way) -> Ended | Failure:
    """Halve the bracket to `WITHIN` from its free end; its touching end."""
    free, touching, why = bracketed(
        free, touching, WITHIN * way.unit, way.of, lambda end, value: _solved(walk, end, value, stage, way)
    )
    if why is not None:
        return why
    if touching.solved is None:  # it begins within a bracket's width of where the step ended
        again = _solved(walk, free, way.of(touching), stage, way)
        if isinstance(again, Failure):
            return again
        touching = again
    if not touching.self_contact:
        symbol = PARAMETERS[way.name].symbol
        detail = f"not located, no contact up to {symbol} = {way.of(touching):.12g}"
        return Failure("solve", None, detail, {"stage": stage})
    assert touching.solved is not None
    first, second = (int(k) + 1 for k in touching.contact.pairs[0])
    met = event(
        "first-contact" if way.of(touching) > way.of(free) else "contact-ends",
        first=first,
        second=second,
        touching=way.of(touching),
        free=way.of(free),
        clearance=free.contact.clearance,
        symbol=PARAMETERS[way.name].symbol,
    )
    return replace(touching.solved, before=(met,))


def _on_level(walk: Walk, coarse: Summary, n: int, stage: str, side: float, way: _Way) -> Summary | Failure:
    """First contact on a finer level, bracketed by steps from the coarser one's place.

    `side` is the sign of the values without contact, seen from those with it.
    """
    name = f"{stage}, N = {n}"
    known = walk.journal.finished(name)
    if known is not None and not walk.journal.lacks_saddle(name):
        return known
    refined = walk.refine(coarse, n, f"{name}, refined at the coarser level's", "intermediate")
    if isinstance(refined, Failure):
        return refined
    if not refined.certified:
        return Failure("solve", None, refined.message, {"stage": name})
    goal = Stage(name, refined.half_width, n, "intermediate", refined.label)
    return walk.end_of(goal, lambda: _searched(walk, _end(walk, refined), name, side, way))


def _searched(walk: Walk, here: _End, name: str, side: float, way: _Way) -> Ended | Failure:
    """The contact's end of a bracket that is searched for about a state, in steps that double."""
    start, step = way.of(here), SEARCH * way.unit
    for _ in range(MOST_SEARCHES):
        towards = side if here.self_contact else -side
        there = _solved(walk, here, way.of(here) + towards * step, name, way)
        if isinstance(there, Failure):
            return there
        if there.self_contact != here.self_contact:
            free, touching = (there, here) if here.self_contact else (here, there)
            return _located(walk, free, touching, name, way)
        here, step = there, 2.0 * step
    detail = f"not located within {abs(way.of(here) - start):.3g}"
    return Failure("solve", None, detail, {"stage": name})


def _sentence(found: Sequence[FirstContact], symbol: str) -> str:
    """All levels in a line, with the limit that the last three tend to."""
    text = ", ".join(f"{symbol} = {c.value:.6g} (N = {c.segments})" for c in found)
    limit = extrapolated([c.value for c in found])
    if limit is None:
        return f"first contact at {text}"
    return f"first contact at {text}, tending to {limit[0]:.6g} +- {limit[1]:.1g}, with order {limit[2]:.2f}"


def extrapolated(values: Sequence[float]) -> tuple[float, float, float] | None:
    """Limit, its error bar and the order of values on grids that double; None where they have no trend.

    The last three are taken. With differences d_1 and d_2 the order is log2(d_1 / d_2) and the limit, by
    Aitken's process, b_3 + d_2^2 / (d_1 - d_2); its distance from b_3 is the bar. The trend must
    shrink by a factor between 1.5 and 10, and be larger than the brackets.
    """
    if len(values) < 3:
        return None
    first, second, third = values[-3:]
    one, two = second - first, third - second
    if two == 0.0 or abs(two) < 3.0 * WITHIN or not 1.5 <= one / two <= 10.0:
        return None
    rest = two * two / (one - two)
    return third + rest, abs(rest), math.log2(one / two)
