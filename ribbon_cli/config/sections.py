"""The sections of a config, each read by a function that returns what it could read.

Where a value is wrong, the problem is recorded and the value is None (or left out). So the sections after it
can still be checked as far as they do not depend on it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from itertools import combinations, pairwise
from typing import Any

from ribbon_cli.config.document import Node
from ribbon_cli.config.mistakes import near_miss
from ribbon_cli.config.reader import Found, Reader, got
from ribbon_cli.config.table import (
    ARCLENGTH,
    BRANCH,
    CONTACT,
    GAP,
    LEVEL_LIST,
    LEVELS_AT,
    RANGE,
    REFINEMENT,
    WIDTH_LIST,
    WIDTHS,
)
from ribbon_cli.config.types import CONTACT_KINDS, FORCES, Arclength, ContactRequest, Guess, Refinement
from ribbon_cli.facts import same_value, same_width
from ribbon_cli.parts import HALF_WIDTH

ListItems = Iterable[tuple[Node, str, Any]]
"""What `Reader.items` gives."""


def widths(reader: Reader, node: Node | None, guess: Guess) -> tuple[float, ...] | Arclength | None:
    """The half-widths b to solve for, in order, or a branch; the guess's own where there is no section."""
    if node is None:
        return (guess.half_width,) if guess.half_width is not None else ()
    if node.kind == "mapping":
        keys = {key.text for key in node.items[::2]}
        return _branch(reader, node, guess) if "arclength" in keys else _width_range(reader, node)
    if node.kind == "scalar":
        reader.report(node, "widths", f"must be {WIDTHS.expected}, got {got(node)}")
        return None
    items = list(reader.items(node, "widths", WIDTH_LIST))
    for (_, _, before), (item, field, value) in pairwise(items):
        if before is not None and value is not None and same_width(before, value):
            reader.report(item, field, f"must differ from the width before it, got {got(item)} again")
    known = tuple(value for _, _, value in items if value is not None)
    return known if known and len(known) == len(items) else None


def _branch(reader: Reader, node: Node, guess: Guess) -> Arclength:
    """The request for a branch; its start, `to` and `back_to` must differ."""
    refused = "does not go with arclength: give it inside of arclength"
    outer = reader.section(node, "widths", BRANCH, dict.fromkeys((key.name for key in RANGE.keys), refused))
    found = reader.section(outer.nodes["arclength"], "widths.arclength", ARCLENGTH)
    return branch_of(reader, found, "the guess's half_width", guess.half_width)


def branch_of(reader: Reader, found: Found, begins: str, start: float | None) -> Arclength:
    """A branch from a start, called `begins` in messages, which its ends must differ from."""
    branch = Arclength(**found.values())
    name = branch.parameter or HALF_WIDTH
    if branch.both and "back_to" not in found.nodes:
        what = "half-width" if name == HALF_WIDTH else name
        found.report("both", f"needs back_to, the {what} to go to the other way")
    named = {begins: start, "to": branch.to, "back_to": branch.back_to}
    for (first, one), (second, other) in combinations(named.items() if branch.to is not None else (), 2):
        # A branch that comes back may end at the width it began at.
        apart = second == "to" or first == "to"
        if apart and one is not None and other is not None and same_value(name, one, other, reader.length):
            found.report(second, f"must differ from {first}, got {got(found.nodes[second])}")
    whole = bool(branch.at) and len(branch.at) == len(found.nodes["at"].items)
    if start is not None and branch.to is not None and whole:
        for item, field, value in found.items("at"):
            if why := branch.outside(value, start, reader.length):
                reader.report(item, field, f"{why}, got {got(item)}")
    return branch


def _width_range(reader: Reader, node: Node) -> tuple[float, ...] | None:
    """b_j = from + j (to - from)/steps, j = 0..steps: the schedule (3.2)-(3.3) of Koldaev (2022)."""
    found = reader.section(node, "widths", RANGE)
    first, last, steps = found.values().values()
    if first is None or last is None:
        return None
    if same_width(first, last):
        found.report("to", f"must differ from widths.from, got {got(found.nodes['to'])}")
        return None
    if steps is None:
        return None
    # The last one exactly as written, whatever the rounding of the formula.
    values = (*(first + j * (last - first) / steps for j in range(steps)), last)
    if any(same_width(a, b) for a, b in pairwise(values)):
        found.report("steps", f"must keep the widths distinct, got {steps}: take fewer")
        return None
    return values


def refinement(
    reader: Reader, node: Node | None, guess: Guess, known_widths: tuple[float, ...] | None
) -> Refinement:
    """The levels, each double the one before and the first the guess's, and the widths refined."""
    if node is None:
        return Refinement((guess.segments,) if guess.segments is not None else ())
    if node.kind == "scalar":
        reader.report(node, "refinement", f"must be {REFINEMENT.expected}, got {got(node)}")
        return Refinement(())
    if node.kind != "mapping":
        return Refinement(_levels(reader, reader.items(node, "refinement", LEVEL_LIST), guess.segments))
    found = reader.section(node, "refinement", LEVELS_AT)
    levels = _levels(reader, found.items("levels"), guess.segments)
    at = _refined_widths(reader, found.items("at"), known_widths) if "at" in found.nodes else None
    return Refinement(levels, at)


def _levels(reader: Reader, items: ListItems, first: int | None) -> tuple[int, ...]:
    levels: list[int] = []
    expected, reason = first, "the guess's segments"
    for item, path, level in items:
        if level is not None and expected is not None and level != expected:
            reader.report(item, path, f"must be {expected}, {reason}, got {level}")
        if level is not None:
            levels.append(level)
        expected, reason = None if level is None else 2 * level, "twice the level before"
    return tuple(levels)


def _refined_widths(reader: Reader, items: ListItems, known: tuple[float, ...] | None) -> tuple[float, ...]:
    """The widths to refine, as they stand in `known`; not checked against it where that is None."""
    chosen: dict[float, None] = {}
    ordered = sorted(known or ())
    for item, field, value in items:
        if value is None or known is None:
            continue
        place = bisect_left(ordered, value)
        nearest = min(
            ordered[max(place - 1, 0) : place + 1], key=lambda width: abs(width - value), default=None
        )
        if nearest is None or not same_width(nearest, value):
            hint = f" (nearest: {nearest:g})" if nearest is not None else ", and there are none: give widths"
            reader.report(item, field, f"must be one of the widths, got {got(item)}{hint}")
        elif nearest in chosen:
            reader.report(item, field, f"must be given once, got {got(item)} again")
        else:
            chosen[nearest] = None
    return tuple(chosen)


def contact(reader: Reader, node: Node | None) -> ContactRequest | None:
    """What is done where the band meets itself; None where it is wrong."""
    if node is None:
        return ContactRequest()
    if node.kind == "mapping":
        gap = reader.section(node, "contact", GAP).read("gap")
        return None if gap is None else ContactRequest(FORCES, abs(gap))
    if node.kind != "scalar" or not near_miss(node.text, CONTACT_KINDS):
        reader.wrong(node, "contact", f"must be {CONTACT.expected}")
        return None
    kind = reader.read(node, "contact", CONTACT.kinds[0])
    return None if kind is None else ContactRequest(kind)
