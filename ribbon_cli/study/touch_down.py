"""Where contact begins or ends between two states with contact forces: located from the free side.

The way between them is halved. Each half is solved for without contact from the free end, and looked at over
all pairs of features. The free end of the last bracket is stored, with the event: a certified state that all
but touches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..facts import event
from ..model.band import Array, State
from ..parts import PARAMETERS
from ..solver.status import Status
from ..store import Summary
from . import resting
from .failure import Failure
from .plan import place_name
from .records import multipliers_of, rest_of, state_of
from .stepping import step_to
from .walk import Ended, Stage, Walk, bracketed

WITHIN = 1e-6
"""Width of the last bracket: of a half-width as part of l / 2 pi, of others by their weights."""


@dataclass(frozen=True)
class _Way:
    """The straight way from the free state's parameters to the touching one's."""

    free: Mapping[str, float]
    touching: Mapping[str, float]
    length: float

    @classmethod
    def between(cls, free: Summary, touching: Summary) -> _Way:
        pairs = (
            (name, value or 0.0, touching.parameters[name] or 0.0) for name, value in free.parameters.items()
        )
        moved = [(name, here, there) for name, here, there in pairs if here != there]
        return cls({n: a for n, a, _ in moved}, {n: b for n, _, b in moved}, free.length)

    def at(self, part: float) -> dict[str, float]:
        """The parameters that move, at a part of the way."""
        return {name: here + part * (self.touching[name] - here) for name, here in self.free.items()}

    @property
    def size(self) -> float:
        """How far the parameters move, as pure numbers."""
        apart = ((name, abs(self.touching[name] - here)) for name, here in self.free.items())
        return max(gone * PARAMETERS[name].weight(self.length) for name, gone in apart)


@dataclass(frozen=True)
class _End:
    """One end of a bracket, at a part of the way; the touching one need not have been solved for."""

    part: float
    self_contact: bool
    state: State
    multipliers: Array
    solved: Ended | None = None


def locate(walk: Walk, before: Summary, after: Summary, prefix: str = "") -> Summary | Failure | None:
    """Where contact begins or ends between two states of which one follows the other; its state is stored.

    None where neither happens. The stage's name begins with `prefix`.
    """
    if bool(before.contacts) == bool(after.contacts):
        return None
    free, touching = (after, before) if before.contacts else (before, after)
    way = _Way.between(free, touching)
    word = "touch" if free is before else "lift"
    named = [
        place_name({name: state.parameters[name] or 0.0 for name in way.free}) for state in (before, after)
    ]
    stage = Stage(
        f"{prefix}{word} between {named[0]} and {named[1]}",
        free.half_width,
        free.segments,
        "intermediate",
        free.label,
    )
    found = walk.reach(stage, lambda: _located(walk, free, way, word, stage.name))
    if isinstance(found, Failure):
        walk.journal.note(found.sentence)
    return found


def _located(walk: Walk, free: Summary, way: _Way, word: str, stage: str) -> Ended | Failure:
    """The free end of the last bracket."""
    assert walk.gap is not None
    record = walk.journal.load(free)
    rest = rest_of(record, walk.gap)
    start = Ended(rest.problem, rest.result, record.method)
    first = _End(0.0, False, state_of(record), multipliers_of(record), start)
    last = _End(1.0, True, first.state, first.multipliers)

    def step(here: _End, part: float) -> _End | Failure:
        return _solved(walk, here, part, way, stage)

    low, high, why = bracketed(first, last, WITHIN / way.size, lambda end: end.part, step)
    if why is None and high.solved is None:
        again = step(low, 1.0)
        why = again if isinstance(again, Failure) else None
        if not isinstance(again, Failure) and not again.self_contact:
            detail = f"not located: without contact nothing touches up to {place_name(way.touching)}"
            why = Failure("solve", None, detail, {"stage": stage})
    if why is not None:
        return why
    assert low.solved is not None
    bracket = max(
        abs(b - a) for a, b in zip(way.at(low.part).values(), way.at(high.part).values(), strict=True)
    )
    met = event(word, place=place_name(way.at(low.part)), bracket=bracket)
    return Ended(low.solved.problem, low.solved.result, low.solved.method, (*low.solved.events, met))


def _solved(walk: Walk, start: _End, part: float, way: _Way, stage: str) -> _End | Failure:
    """The band without contact at a part of the way, and whether it would pass through itself."""
    assert walk.gap is not None
    target = way.at(part)
    end = step_to(walk, start.state, start.multipliers, target)
    if isinstance(end, Failure) and end.status is Status.UNDECIDED and end.attempt is not None:
        end = end.attempt  # where contact begins does not ask for its index, as where sliding is too soft
    if resting.passes(end, start.state, walk.gap):
        return _End(part, True, start.state, start.multipliers, end if isinstance(end, Ended) else None)
    if isinstance(end, Failure):
        return replace(end, kind="solve", values={"stage": stage})
    end = resting.at_rest(end, walk.gap)
    return _End(part, False, end.result.state, end.result.multipliers, end)
