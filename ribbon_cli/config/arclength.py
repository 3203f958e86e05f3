"""The section `widths: {arclength: ...}`: a branch followed with the half-width as an unknown."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Found, Limit, Reader, close, got
from ribbon_cli.config.table import ARCLENGTH, BRANCH, RANGE
from ribbon_cli.config.types import STOPS, Arclength, Guess


def is_arclength(node: Node | None) -> bool:
    """Whether the section `widths` asks for arclength continuation."""
    return (
        node is not None
        and node.kind == "mapping"
        and any(key.text == "arclength" for key in node.items[::2])
    )


def arclength(reader: Reader, node: Node, limit: Limit | None, guess: Guess) -> Arclength | None:
    """What the branch is followed for; None with what is wrong recorded."""
    refused = "does not go with arclength: give it inside of arclength"
    inner = reader.section(
        node, "widths", BRANCH, dict.fromkeys((key.name for key in RANGE.keys), refused)
    ).nodes.get("arclength")
    if inner is None:
        return None
    field = "widths.arclength"
    found = reader.section(inner, field, ARCLENGTH)
    to, back_to = found.read("to", limit), found.read("back_to", limit)
    at = _widths_at(reader, found.items("at", limit))
    both: bool | None = found.read("both")
    if both and "back_to" not in found.nodes:
        needed = "needs back_to, the half-width to go to the other way"
        reader.report(found.nodes["both"], found.path("both"), needed)
    rest = {name: found.read(name) for name in ("max_step", "steps", "switch")}
    chosen = {word for _, _, word in found.items("stop_at")}
    if to is None:
        return None
    _check_apart(reader, found, (to, back_to), guess)
    stops = tuple(word for word in STOPS if word in chosen)
    return Arclength(to, back_to, bool(both), at, stop_at=stops, **rest)


def _check_apart(reader: Reader, found: Found, ends: tuple[float, float | None], guess: Guess) -> None:
    """Start, `to` and `back_to` must differ."""
    named = [("the guess's half_width", guess.half_width), ("to", ends[0]), ("back_to", ends[1])]
    for (first, one), (second, other) in combinations(named, 2):
        if one is not None and other is not None and close(one, other):
            # A branch that comes back may end at the width it began at.
            if second == "back_to" and first != "to":
                continue
            node = found.nodes[second]
            reader.report(node, found.path(second), f"must differ from {first}, got {got(node)}")


def _widths_at(reader: Reader, items: Iterable[tuple[Node, str, float | None]]) -> tuple[float, ...]:
    chosen: list[float] = []
    for item, path, value in items:
        if value is not None and any(close(value, other) for other in chosen):
            reader.report(item, path, f"must be given once, got {got(item)} again")
        elif value is not None:
            chosen.append(value)
    return tuple(sorted(chosen))
