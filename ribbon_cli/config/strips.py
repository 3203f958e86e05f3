"""The parts of a problem: topology, ends, material and loads; and which problems cannot be solved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ribbon_cli.config.document import Node
from ribbon_cli.config.reader import Found, Reader
from ribbon_cli.config.table import ENDS, LOADS, MATERIAL, TOPOLOGY
from ribbon_cli.keys import Section
from ribbon_cli.parts import FREE, HINGED, Ends, Loads, Material, Parts

OPEN = "open"
Topology = int | str | None
"""Half-twists of a closed band, `OPEN`, or None where it is not known."""


def topology(reader: Reader, node: Node | None) -> Topology:
    """The kind of band or strip."""
    if node is None:
        return None
    if node.kind == "mapping":
        before, refused = reader.count, {OPEN: "does not go with half_twists: a strip is topology: open"}
        twists: int | None = reader.section(node, "topology", TOPOLOGY, refused).read("half_twists")
        return twists if reader.count == before else None
    if node.kind == "scalar" and node.text == OPEN:
        return OPEN
    reader.wrong(node, "topology", "must be {half_twists: 1} for a closed band, or open for a strip")
    return None


def sigma(found: Topology) -> int:
    """+1 of a two-sided band, -1 of a one-sided one, 0 of an open strip."""
    return 0 if isinstance(found, str) else (-1 if (found or 0) % 2 else 1)


def parts(reader: Reader, node: Node, top: Found, kind: Topology) -> Parts | None:
    """Ends, material and loads; None where something is wrong with them. `node` is the whole config."""
    before = reader.count
    material = _section(reader, top, "material", MATERIAL)
    if kind is None:
        return None
    if kind != OPEN:
        for name, why in (("ends", "ends"), ("loads", "frame that loads could have a direction in")):
            if name in top.nodes:
                top.report(name, f"a closed band has no {why}: remove it, or give topology: open")
        if material is not None and sigma(kind) < 0 and material.get("natural_curvature"):
            why = "a natural curvature turns over at the seam of a one-sided band: remove it"
            reader.report(top.nodes["material"], "material.natural_curvature", why)
        return Parts(None, Material(**material or {})) if reader.count == before else None
    if "ends" not in top.nodes:
        reader.report(
            node, "ends", "is missing: give where the strip's end is, as {span: 0.75}, or {end: free}"
        )
    ends, loads = _section(reader, top, "ends", ENDS), _section(reader, top, "loads", LOADS)
    if reader.count > before or ends is None:
        return None
    held = _ends(reader, top.nodes["ends"], ends)
    if loads and not any(loads["gravity_direction"]):
        _at(reader, top, "loads.gravity_direction", "must not be zero")
    if held is None or reader.count > before:
        return None
    found = Parts(held, Material(**material or {}), _loads(loads))
    problem = flat(found, reader.length or math.inf)
    if problem is not None:
        reader.report(top.nodes["ends"], "ends", problem)
    return found


def _section(reader: Reader, top: Found, name: str, section: Section) -> dict[str, Any] | None:
    """The values of a section, its defaults where it is not given; None where something is wrong in it."""
    if name not in top.nodes:
        return {}
    before = reader.count
    values = reader.section(top.nodes[name], name, section).values()
    return values if reader.count == before else None


def _ends(reader: Reader, node: Node, values: Mapping[str, Any]) -> Ends | None:
    """The ends; a free end takes no other keys."""
    before = reader.count
    given = {key.text: key for key in node.items[::2]}
    if values["end"] == FREE:
        for name in given:
            if name not in ("start", "end", "start_eta"):
                reader.report(given[name], f"ends.{name}", f"a free end has no {name}: remove it")
    elif values["span"] is None:
        reader.report(node, "ends.span", "is missing: give the end's place along the start's tangent")
    said = {name: value for name, value in values.items() if name in given}
    return Ends(**said) if reader.count == before else None


def _loads(values: Mapping[str, Any] | None) -> Loads:
    """The loads, with a direction of length one; a direction that has it to rounding is not changed."""
    loads = Loads(**values or {})
    length = math.hypot(*loads.gravity_direction)
    if abs(length - 1.0) <= 1e-12:
        return loads
    x, y, z = loads.gravity_direction
    return replace(loads, gravity_direction=(x / length, y / length, z / length))


def flat(found: Parts, length: float) -> str | None:
    """Why a strip cannot be solved with such parts: it does not reach its end, or lies flat, where its
    rulings and forces are not determined; None if it can.
    """
    ends = found.ends
    if ends is None:
        return None
    undetermined = "and its rulings are undetermined"
    if ends.end != FREE:
        distance = math.hypot(ends.span, ends.lift, ends.shear)
        away = f"at (span, lift, shear) the end is {distance:.6g} away from the start"
        if distance > length * (1.0 + 1e-12):
            return f"cannot be reached: {away}, which must be less than the length {length:g}"
        if distance >= length * (1.0 - 1e-12):
            return (
                f"{away}, the length {length:g}, so that the strip is flat, {undetermined}: bring it nearer"
            )
        return None
    if found.material.natural_curvature:
        return None
    forces = list(_forces(found.loads))
    if not forces:
        return f"a strip with a free end is flat without loads or natural curvature, {undetermined}"
    first = forces[0]
    along = all(_cross(first, force) <= 1e-12 * math.hypot(*first) * math.hypot(*force) for force in forces)
    if ends.start == HINGED and along:
        return f"a strip with a hinged start and a free end hangs flat along its loads, {undetermined}"
    if all(force[1] == force[2] == 0.0 and force[0] > 0.0 for force in forces):
        return f"a strip with a free end is flat where it is pulled along its tangent, {undetermined}"
    return None


def not_planar(found: Parts) -> Iterator[tuple[str, str]]:
    """The keys, each with what is found, that lead a strip out of its plane, where the guess is made."""
    if found.ends is not None:
        yield from ((f"ends.{name}", f"{v:g}") for name in ("shear", "twist") if (v := found.value(name)))
    loads = found.loads
    if loads.gravity and loads.gravity_direction[2]:
        yield "loads.gravity", f"{loads.gravity:g} along {list(loads.gravity_direction)}"
    for name in ("end_force", "point_force"):
        if z := getattr(loads, name)[2]:
            yield f"loads.{name}[2]", f"{z:g}"


def report_not_planar(reader: Reader, top: Found, found: Parts) -> None:
    """Record what leads a strip out of the plane in which its recipe makes it."""
    for field, value in not_planar(found):
        name = field.removesuffix("[2]").partition(".")[2]
        moved = f"{name}_z" if field.endswith("]") else name
        why = f"must be 0 at the start, where the recipe strip makes a planar shape, got {value}"
        _at(reader, top, field, f"{why}: move {moved} in `schedule`")


def without(name: str, kind: Topology, found: Parts) -> str:
    """The message about a parameter that a problem does not have."""
    if found.ends is not None:
        what = "a strip with a free end"
    else:
        what = "a one-sided band" if sigma(kind) < 0 else "a closed band"
    return f"{what} has no {name}; it has {', '.join(found.names(sigma(kind)))}"


def _forces(loads: Loads) -> Iterator[tuple[float, float, float]]:
    """The loads that are not zero, as vectors."""
    x, y, z = (loads.gravity * part for part in loads.gravity_direction)
    yield from (force for force in ((x, y, z), loads.end_force, loads.point_force) if any(force))


def _cross(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _at(reader: Reader, top: Found, field: str, message: str) -> None:
    """Record a mistake at the value of a key inside a section."""
    section, _, name = field.partition(".")
    node = top.nodes[section]
    values = {key.text: value for key, value in zip(node.items[::2], node.items[1::2], strict=True)}
    reader.report(values[name.partition("[")[0]], field, message)
