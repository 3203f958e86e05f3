"""The section `schedule`: legs in which parameters move together, and a branch at its end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ribbon_cli.config import strips
from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Found, Reader
from ribbon_cli.config.sections import branch_of
from ribbon_cli.config.table import ARCLENGTHS, LEG, LEGS, STEPPED, VALUES
from ribbon_cli.config.types import Arclength, Leg
from ribbon_cli.facts import same_value
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS, Parts

Read = tuple[tuple[Leg, ...], Arclength | None]


def schedule(reader: Reader, node: Node, kind: strips.Topology, parts: Parts, half_width: float) -> Read:
    """The legs, and the branch that follows them; `half_width` is the guess's, not a number if unknown."""
    legs: list[Leg] = []
    branch: Arclength | None = None
    here = {name: parts.value(name) for name in parts.names(strips.sigma(kind))[1:]} | {
        HALF_WIDTH: half_width
    }
    for k, (item, field, _) in enumerate(reader.items(node, "schedule", LEGS)):
        found = reader.section(item, field, LEG)
        for name in found.nodes.keys() & PARAMETERS.keys() - here.keys():
            found.report(name, strips.without(name, kind, parts))
        if "arclength" in found.nodes:
            branch = _branch(reader, found, k == len(node.items) - 1, kind, parts, here)
            continue
        if item.kind == "mapping" and not item.items:
            reader.report(item, field, "moves nothing: it names no parameter")
        leg = _leg(reader, found)
        if leg is None or not leg.to.keys() <= here.keys():
            continue
        stays = all(same_value(name, here[name], value, reader.length) for name, value in leg.to.items())
        if stays and (k > 0 or leg.steps is not None):
            where = ", ".join(f"{name} = {here[name]:g}" for name in leg.to)
            reader.report(item, field, f"moves nothing: the leg begins at {where}")
        here |= leg.to
        moved = parts
        for name in here.keys() - {HALF_WIDTH}:
            moved = moved.with_value(name, here[name])
        if why := strips.flat(moved, reader.length or math.inf):
            reader.report(item, field, why)
        legs.append(leg)
    return tuple(legs), branch


def half_widths_of(legs: Sequence[Leg], start: float | None) -> tuple[float, ...]:
    """The half-widths at the ends of legs, as far as they are known."""
    found, here = [], start
    for leg in legs:
        here = leg.to.get(HALF_WIDTH, here)
        found.append(here)
    return tuple(b for b in found if b is not None)


def _leg(reader: Reader, found: Found) -> Leg | None:
    """The values that a leg goes to; None where one is wrong."""
    to: dict[str, float | None] = {}
    steps: dict[str, int] = {}
    for name, node in found.nodes.items():
        if node.kind != "mapping":
            to[name] = reader.read(node, found.path(name), VALUES[name])
            continue
        inner = reader.section(node, found.path(name), STEPPED[name])
        to[name] = inner.read("to")
        if count := inner.read("steps"):
            steps[name] = count
    for (first, one), (second, other) in zip(list(steps.items())[:-1], list(steps.items())[1:], strict=True):
        if one != other:
            found.report(
                second, f"takes {other} steps and {first} {one}: the parameters of one leg move together"
            )
    known = {name: value for name, value in to.items() if value is not None}
    if not known or len(known) < len(to):
        return None
    return Leg(known, next(iter(steps.values()), None))


def _branch(
    reader: Reader, found: Found, last: bool, kind: strips.Topology, parts: Parts, here: Mapping[str, float]
) -> Arclength | None:
    """The branch that a leg asks for."""
    if not last:
        found.report("arclength", "must be the last leg")
    for name in found.nodes.keys() - {"arclength"}:
        found.report(name, "does not go with arclength: give it a leg of its own")
    node, path = found.nodes["arclength"], found.path("arclength")
    given = {key.text: value for key, value in zip(node.items[::2], node.items[1::2], strict=True)}
    named = given["parameter"].text if "parameter" in given else HALF_WIDTH
    name = named if named in PARAMETERS else "span"  # whose values may be anything
    inner = reader.section(node, path, ARCLENGTHS[name])
    if name not in here and named == name:
        inner.report("parameter", strips.without(name, kind, parts))
    start = here.get(named)
    known = start is not None and not math.isnan(start)
    return branch_of(reader, inner, "where it begins", start if known else None)
