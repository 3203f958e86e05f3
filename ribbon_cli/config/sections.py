"""The sections of a config, each read by a function that returns what it could make of them.

Where a value is wrong, the problem is recorded and None (or nothing) stands for it, so that the sections
after it can still be checked for what does not depend on it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping
from itertools import pairwise

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Limit, Reader, close, got
from ribbon_cli.config.recipes import SEGMENTS
from ribbon_cli.config.types import METRICS, Guess, Refinement, SpectrumRequest

MAX_WIDTHS = 10_000
MAX_HALF_TWISTS = 100
_LENGTHS = (1e-9, 1e9)  # keeps lengths, widths and their powers far from overflow
_MAX_LEVELS = 20  # more doublings than lie between the fewest and the most segments
_WIDTHS = (
    "a list as [0.1, 0.2, 0.5], a range as {from: 0.1, to: 1.5, steps: 28} "
    "or a branch as {arclength: {to: 0.2}}"
)
_LEVELS = "a list as [50, 100, 200], or {levels: [50, 100, 200], at: [0.5]}"

Found = Mapping[str, Node]
"""The values of a mapping by key."""


def topology(reader: Reader, node: Node | None) -> int | None:
    """The number of half-twists, with its sign."""
    if node is None:
        return None
    required = {"half_twists": "0 for a cylinder, 1 or -1 for a Moebius band"}
    value = reader.mapping(node, "topology", ("half_twists",), required=required).get("half_twists")
    if value is None:
        return None
    return reader.integer(value, "topology.half_twists", -MAX_HALF_TWISTS, MAX_HALF_TWISTS)


def length(reader: Reader, node: Node | None) -> float | None:
    """The midline's length, 2 pi where the config does not say."""
    if node is None:
        return 2.0 * math.pi
    return reader.positive(node, "length", low=_LENGTHS[0], below=(_LENGTHS[1], "the limit for a length"))


def choice(reader: Reader, found: Found, key: str, choices: tuple[str, ...]) -> str:
    """One of `choices`, the first where the config does not say."""
    node = found.get(key)
    return (reader.word(node, key, choices) if node else None) or choices[0]


def widths(reader: Reader, node: Node | None, limit: Limit | None, guess: Guess) -> tuple[float, ...] | None:
    """The half-widths b to solve for, in order; the guess's own where the config does not say."""
    if node is None:
        return (guess.half_width,) if guess.half_width is not None else ()
    if node.kind == "mapping":
        return _width_range(reader, node, limit)
    if node.kind == "scalar":
        reader.report(node, "widths", f"must be {_WIDTHS}, got {got(node)}")
        return None
    items = reader.items(node, "widths", MAX_WIDTHS)
    values = [reader.positive(item, field, limit) for item, field in items]
    for (item, field), before, value in zip(items[1:], values, values[1:], strict=False):
        if before is not None and value is not None and close(before, value):
            reader.report(item, field, f"must differ from the width before it, got {got(item)} again")
    known = tuple(value for value in values if value is not None)
    return known if known and len(known) == len(values) else None


def _width_range(reader: Reader, node: Node, limit: Limit | None) -> tuple[float, ...] | None:
    """b_j = from + j (to - from)/steps, j = 0..steps: the schedule (3.2)-(3.3) of Koldaev (2022)."""
    required = {"from": "the first half-width", "to": "the last half-width", "steps": "the number of steps"}
    found = reader.mapping(node, "widths", required, required=required)
    first, last = (
        reader.positive(found[key], f"widths.{key}", limit) if key in found else None
        for key in ("from", "to")
    )
    steps = reader.integer(found["steps"], "widths.steps", 1, MAX_WIDTHS - 1) if "steps" in found else None
    if first is None or last is None:
        return None
    if close(first, last):
        reader.report(found["to"], "widths.to", f"must differ from widths.from, got {got(found['to'])}")
        return None
    if steps is None:
        return None
    # The last one exactly as written, whatever the rounding of the formula.
    values = (*(first + j * (last - first) / steps for j in range(steps)), last)
    if any(close(a, b) for a, b in pairwise(values)):
        reader.report(found["steps"], "widths.steps", f"must leave the widths apart, got {steps}: take fewer")
        return None
    return values


def refinement(
    reader: Reader, node: Node | None, guess: Guess, known_widths: tuple[float, ...] | None
) -> Refinement:
    """The levels, each double the one before and the first the guess's, and the widths refined."""
    if node is None:
        return Refinement((guess.segments,) if guess.segments is not None else ())
    if node.kind == "scalar":
        reader.report(node, "refinement", f"must be {_LEVELS}, got {got(node)}")
        return Refinement(())
    if node.kind != "mapping":
        return Refinement(_levels(reader, node, "refinement", guess.segments))
    required = {"levels": "the numbers of segments"}
    found = reader.mapping(node, "refinement", ("levels", "at"), required=required)
    levels: tuple[int, ...] = ()
    if "levels" in found:
        levels = _levels(reader, found["levels"], "refinement.levels", guess.segments)
    at = _refined_widths(reader, found["at"], known_widths) if "at" in found else None
    return Refinement(levels, at)


def _levels(reader: Reader, node: Node, field: str, first: int | None) -> tuple[int, ...]:
    levels: list[int] = []
    expected, reason = first, "the guess's segments"
    for item, path in reader.items(node, field, _MAX_LEVELS):
        level = reader.integer(item, path, SEGMENTS.low, SEGMENTS.high)
        if level is not None and expected is not None and level != expected:
            reader.report(item, path, f"must be {expected}, {reason}, got {level}")
        if level is not None:
            levels.append(level)
        expected, reason = None if level is None else 2 * level, "twice the level before"
    return tuple(levels)


def _refined_widths(reader: Reader, node: Node, known: tuple[float, ...] | None) -> tuple[float, ...]:
    """The widths to refine, as they stand in `known`; not checked against it where that is None."""
    chosen: dict[float, None] = {}
    ordered = sorted(known or ())
    for item, field in reader.items(node, "refinement.at", MAX_WIDTHS):
        value = reader.positive(item, field)
        if value is None or known is None:
            continue
        place = bisect_left(ordered, value)
        nearest = min(
            ordered[max(place - 1, 0) : place + 1], key=lambda width: abs(width - value), default=None
        )
        if nearest is None or not close(nearest, value):
            hint = f" (nearest: {nearest:g})" if nearest is not None else ", and there are none: give widths"
            reader.report(item, field, f"must be one of the widths, got {got(item)}{hint}")
        elif nearest in chosen:
            reader.report(item, field, f"must be given once, got {got(item)} again")
        else:
            chosen[nearest] = None
    return tuple(chosen)


def spectrum(reader: Reader, node: Node | None) -> SpectrumRequest:
    """How much of the eigen-spectrum to store."""
    default = SpectrumRequest()
    if node is None:
        return default
    found = reader.mapping(node, "spectrum", ("modes", "full_up_to", "metrics"))
    modes: int | None = default.modes
    full_up_to: int | None = default.full_up_to
    if "modes" in found:
        modes = reader.integer(found["modes"], "spectrum.modes", 0, 1000)
    if "full_up_to" in found:
        full_up_to = reader.integer(found["full_up_to"], "spectrum.full_up_to", 0, 2000)
    metrics = _metrics(reader, found["metrics"]) if "metrics" in found else default.metrics
    return SpectrumRequest(modes or 0, full_up_to or 0, metrics)


def _metrics(reader: Reader, node: Node) -> tuple[str, ...]:
    """The metrics asked for, in the one order that they are kept in."""
    chosen: set[str] = set()
    for item, field in reader.items(node, "spectrum.metrics", len(METRICS)):
        metric = reader.word(item, field, METRICS)
        if metric in chosen:
            reader.report(item, field, f"must be given once, got {metric} again")
        elif metric is not None:
            chosen.add(metric)
    return tuple(metric for metric in METRICS if metric in chosen)
