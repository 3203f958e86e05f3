"""The section `widths: {arclength: ...}`: a branch followed with the half-width as an unknown."""

from __future__ import annotations

from itertools import combinations

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Limit, Reader, close, got
from ribbon_cli.config.types import STOPS, Arclength, Guess

MAX_STEPS = 100_000
MAX_SWITCH = 5
MAX_AT = 1000
LARGEST_STEP = 1.0
_KEYS = ("to", "back_to", "both", "at", "max_step", "steps", "stop_at", "switch")


def is_arclength(node: Node | None) -> bool:
    """Whether the section `widths` asks for arclength continuation."""
    return (
        node is not None
        and node.kind == "mapping"
        and any(key.text == "arclength" for key in node.items[::2])
    )


def arclength(reader: Reader, node: Node, limit: Limit | None, guess: Guess) -> Arclength | None:
    """What the branch is followed for; None with what is wrong recorded."""
    found = reader.mapping(
        node,
        "widths",
        ("arclength",),
        refused=dict.fromkeys(
            ("from", "to", "steps"), "does not go with arclength: give it inside of arclength"
        ),
    )
    inner = found.get("arclength")
    if inner is None:
        return None
    field = "widths.arclength"
    given = reader.mapping(inner, field, _KEYS, required={"to": "the half-width to go towards"})
    widths = {
        key: reader.positive(given[key], f"{field}.{key}", limit) if key in given else None
        for key in ("to", "back_to")
    }
    at = _widths_at(reader, given["at"], f"{field}.at", limit) if "at" in given else ()
    default = Arclength(1.0)
    both = (
        reader.word(given["both"], f"{field}.both", ("true", "false")) == "true" if "both" in given else False
    )
    if both and "back_to" not in given:
        reader.report(given["both"], f"{field}.both", "needs back_to, the half-width to go to the other way")
    step = default.max_step
    if "max_step" in given:
        above = (LARGEST_STEP, "the longest step along a branch")
        step = reader.positive(given["max_step"], f"{field}.max_step", above) or step
    counts = {
        key: reader.integer(given[key], f"{field}.{key}", low, high) if key in given else None
        for key, low, high in (("steps", 1, MAX_STEPS), ("switch", 0, MAX_SWITCH))
    }
    stops = _stops(reader, given["stop_at"], f"{field}.stop_at") if "stop_at" in given else ()
    if widths["to"] is None:
        return None
    _check_apart(reader, given, widths, guess, field)
    return Arclength(
        to=widths["to"],
        back_to=widths["back_to"],
        both=both,
        at=at,
        max_step=step,
        steps=counts["steps"] or default.steps,
        stop_at=stops,
        switch=counts["switch"] or 0,
    )


def _check_apart(
    reader: Reader, given: dict[str, Node], widths: dict[str, float | None], guess: Guess, field: str
) -> None:
    """Start, `to` and `back_to` must differ."""
    named = [
        ("the guess's half_width", guess.half_width),
        ("to", widths["to"]),
        ("back_to", widths["back_to"]),
    ]
    for (first, one), (second, other) in combinations(named, 2):
        if one is not None and other is not None and close(one, other):
            # A branch that comes back may end at the width it began at.
            if second == "back_to" and first != "to":
                continue
            reader.report(
                given[second], f"{field}.{second}", f"must differ from {first}, got {got(given[second])}"
            )


def _widths_at(reader: Reader, node: Node, field: str, limit: Limit | None) -> tuple[float, ...]:
    chosen: list[float] = []
    for item, path in reader.items(node, field, MAX_AT):
        value = reader.positive(item, path, limit)
        if value is not None and any(close(value, other) for other in chosen):
            reader.report(item, path, f"must be given once, got {got(item)} again")
        elif value is not None:
            chosen.append(value)
    return tuple(sorted(chosen))


def _stops(reader: Reader, node: Node, field: str) -> tuple[str, ...]:
    chosen = {reader.word(item, path, STOPS) for item, path in reader.items(node, field, len(STOPS))}
    return tuple(word for word in STOPS if word in chosen)
