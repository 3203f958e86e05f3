"""What happened on the way to a state, and what a place is: values for programs, sentences for people.

A sentence is made here, from its fact, and is read by nobody: files keep the kind of each event beside its
sentence. Files of the formats 1.0 and 1.1 have sentences alone; `kind_of` knows their words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from string import Formatter
from typing import Any

from ribbon_cli.parts import HALF_WIDTH, PARAMETERS

TOLERANCE = 1e-9
"""Relative difference up to which two half-widths are one; schedules come with rounding errors."""


def same_width(a: float, b: float) -> bool:
    """Whether two half-widths are one."""
    return math.isclose(a, b, rel_tol=TOLERANCE)


def same_value(name: str, a: float, b: float, length: float | None) -> bool:
    """Whether two values of a parameter are one, of a strip of some length; half-widths as `same_width`."""
    if name == HALF_WIDTH:
        return same_width(a, b)
    return math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=TOLERANCE / PARAMETERS[name].weight(length or 1.0))


_SADDLE = "met a saddle of index {index} at E = {energy:.12g}"
_CONTACT = (
    "facets {first} and {second} meet at {symbol} = {touching:.10g}, at {symbol} = {free:.10g} none do "
    "(clearance {clearance:.2g})"
)
_INDEX = "{symbol} = {value:.12g}, index {before} to {after}"
_BY = "by the {mode} mode (overlap with sliding {overlap:.3f})"
_OTHER = "another minimum, perhaps"

EVENTS = {
    "width-halved": "a step from b = {start:.12g} to {end:.12g} failed, halved: {why}",
    "turn-halved": "a step from {turn} {start:.10g}/{count} to {end:.10g} failed, halved: {why}",
    "step-refused": "a step of {length:.3g} from {symbol} = {start:.12g} was refused: {why}",
    "phase-twin": f"grid phase: {_SADDLE}, its twin with the inflection on a {{phase}} is the minimum",
    "phase-slid": "grid phase: slid until the inflection sat on a {phase}",
    "saddle-left": f"{_SADDLE}, left along its negative direction",
    "no-start": "smooth prolongation: {why}",
    "start-saddle": f"{{method}}: {_SADDLE}",
    "start-failed": "{method}: {status} after {steps} steps",
    "another-minimum": (
        "another minimum: taken back to N = {segments} it has E = {energy:.9g}, not {expected:.9g}"
    ),
    "another-minimum-perhaps": f"{_OTHER}: taken back to N = {{segments}}, it ends as {{status}}",
    "another-minimum-unproved": f"{_OTHER}: it cannot be taken back to N = {{segments}} ({{why}})",
    "first-contact": f"first contact: {_CONTACT}",
    "contact-ends": f"contact ends: {_CONTACT}",
    "no-spectrum": "no spectrum: {why}",
    "closed": "{state}: {apart}: closed by fold angles, which turn facets by up to {angle}",
    "fold": f"fold at {_INDEX}",
    "branch-met": f"another branch is met where this one turns, at {_INDEX} "
    "(overlap with sliding {overlap:.3f})",
    "stability-lost": f"stability lost at {_INDEX}, {_BY}",
    "stability-gained": f"stability gained at {_INDEX}, {_BY}",
    "bifurcation": f"bifurcation at {_INDEX}, {_BY}",
    "contact-begins": "facets begin to touch at {symbol} = {value:.12g} (bracket {bracket:.1e})",
    "contact-ceases": "facets cease to touch at {symbol} = {value:.12g} (bracket {bracket:.1e})",
    "width-reached": "reached {symbol} = {value:.12g}",
    "value-reached": "came to {symbol} = {value:.12g}",
    "step-halved": "a step from {here} to {there} failed, halved: {why}",
    "touch": "contact begins at {place} (bracket {bracket:.1e})",
    "lift": "contact ends at {place} (bracket {bracket:.1e})",
    "contacts-change": "{before} contacts become {after} between {here} and {there} "
    "({gone} end, {new} begin)",
    "slopes-disagree": "the energy changed by {change:.6g}, where the slopes at both ends say "
    "{expected:.6g}: perhaps another branch",
}
"""Kinds of events by their words, which files keep, with their sentences."""
OTHER_MINIMA = frozenset(("another-minimum", "another-minimum-perhaps", "another-minimum-unproved"))
"""Kinds of events that say of a refinement that it ended in another minimum than it came from."""
UNKNOWN = "unknown"
"""The kind of an event of which only a sentence is known, and not one of this program's."""


@dataclass(frozen=True)
class Event:
    """Something that happened on the way to a state: one of `EVENTS`, with the numbers of its sentence."""

    kind: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return EVENTS[self.kind].format_map(self.values)


def event(kind: str, **values: Any) -> Event:
    """An event of a kind. Raises KeyError, when it is told, for values that its sentence lacks."""
    return Event(kind, values)


def kind_of(sentence: str) -> str:
    """The kind of an event in a file of format 1.0 or 1.1, whose sentences are those of `EVENTS`."""
    return next((kind for kind, pieces in _PIECES.items() if _has(sentence, pieces)), UNKNOWN)


def kinds_of(sentences: Iterable[str], kinds: Sequence[str] | None = None) -> tuple[str, ...]:
    """The kinds of events: those that are kept with them, else, of an older file, what their words tell."""
    return tuple(map(kind_of, sentences) if kinds is None else kinds)


def _has(sentence: str, pieces: list[str]) -> bool:
    """Whether a sentence has these pieces in order, and begins with the first."""
    if not sentence.startswith(pieces[0]):
        return False
    at = 0
    for piece in pieces:
        at = sentence.find(piece, at)
        if at < 0:
            return False
        at += len(piece)
    return True


_PIECES = {kind: [piece[0] for piece in Formatter().parse(text)] for kind, text in EVENTS.items()}
