"""What a problem is made of besides its strip: ends, material and loads; and its parameters by name.

Plain values, without arrays: configs are read into them, files keep them, and `model` computes with them.
Directions are in the start's frame: x along the strip's tangent there, z along its ruling (for eta = 0),
y = z cross x. The bending energy is E = int H^2 da, so that energies have no unit and the planar bending
stiffness is the half-width: forces have the unit 1/length, moments none, weights per area 1/length^3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

Vector = tuple[float, float, float]

CLAMPED, HINGED, FREE = "clamped", "hinged", "free"
STARTS, FINISHES = (CLAMPED, HINGED), (CLAMPED, HINGED, FREE)
"""What the two ends of a strip may be; a hinge holds its point and ruling, and turns about the ruling."""


@dataclass(frozen=True)
class Ends:
    """How a strip is held at its ends.

    The end's midpoint is at (span, lift, shear), in the unit of the length, and its frame is
    R_x(twist) R_z(tilt), angles in radians. `start_eta` and `end_eta` are cotangents of the angle between
    ruling and tangent. Of a free end none of these is used.
    """

    start: str = CLAMPED
    end: str = CLAMPED
    span: float = math.nan
    lift: float = 0.0
    shear: float = 0.0
    twist: float = 0.0
    tilt: float = 0.0
    start_eta: float = 0.0
    end_eta: float = 0.0


@dataclass(frozen=True)
class Material:
    """Natural curvature along the midline, in 1/length, and Poisson's ratio."""

    natural_curvature: float = 0.0
    poisson: float = 0.0


@dataclass(frozen=True)
class Loads:
    """Dead loads: `gravity` is the weight per area, `end_force` acts on the end's midpoint, and
    `point_force` on the midline at the part `point_at` (0 to 1) of the length."""

    gravity: float = 0.0
    gravity_direction: Vector = (0.0, -1.0, 0.0)
    end_force: Vector = (0.0, 0.0, 0.0)
    point_force: Vector = (0.0, 0.0, 0.0)
    point_at: float = 0.5


@dataclass(frozen=True)
class Parameter:
    """A scalar that a problem may depend on; `kind` is its dimension and `part` where it is kept."""

    name: str
    kind: str
    part: str
    meaning: str

    def weight(self, length: float) -> float:
        """The factor that makes a change of it a pure number, for a strip of some length."""
        if self.kind == "length":
            return 2.0 * math.pi / length
        return (length / (2.0 * math.pi)) ** {"angle": 0, "curvature": 1, "force": 1, "gravity": 3}[self.kind]

    @property
    def symbol(self) -> str:
        """The name in sentences and stage names: `b` for the half-width."""
        return "b" if self.name == HALF_WIDTH else self.name


HALF_WIDTH = "half_width"
PARAMETERS: Mapping[str, Parameter] = {
    row.name: row
    for row in (
        Parameter(HALF_WIDTH, "length", "", "half-width b of the strip"),
        Parameter("span", "length", "ends", "place of the end along the start's tangent"),
        Parameter("lift", "length", "ends", "place of the end across the start's tangent and ruling"),
        Parameter("shear", "length", "ends", "place of the end along the start's ruling"),
        Parameter("twist", "angle", "ends", "turn of the end's frame about the start's tangent"),
        Parameter("tilt", "angle", "ends", "turn of the end's frame about the ruling, before the twist"),
        Parameter("gravity", "gravity", "loads", "weight per area"),
        Parameter("end_force_x", "force", "loads", "dead force on the end along the start's tangent"),
        Parameter("end_force_y", "force", "loads", "dead force on the end across tangent and ruling"),
        Parameter("end_force_z", "force", "loads", "dead force on the end along the start's ruling"),
        Parameter("point_force_x", "force", "loads", "dead point force along the start's tangent"),
        Parameter("point_force_y", "force", "loads", "dead point force across tangent and ruling"),
        Parameter("point_force_z", "force", "loads", "dead point force along the start's ruling"),
        Parameter("natural_curvature", "curvature", "material", "curvature of the midline without loads"),
    )
}
"""Every parameter by its name, in the order in which they are listed."""
_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Parts:
    """Ends, material and loads; `ends` is None where the band is closed."""

    ends: Ends | None = None
    material: Material = field(default_factory=Material)
    loads: Loads = field(default_factory=Loads)

    def value(self, name: str) -> float:
        """The value of a parameter other than the half-width. Raises KeyError for one it does not have."""
        vector, axis = _component(name)
        holder = getattr(self, PARAMETERS[name].part)
        if holder is None:
            raise KeyError(name)
        found = getattr(holder, vector)
        return float(found if axis is None else found[axis])

    def with_value(self, name: str, value: float) -> Parts:
        """The parts with a parameter other than the half-width at another value."""
        vector, axis = _component(name)
        part = PARAMETERS[name].part
        holder = getattr(self, part)
        new: float | Vector = value
        if axis is not None:
            old = list(getattr(holder, vector))
            old[axis] = value
            new = (old[0], old[1], old[2])
        return replace(self, **{part: replace(holder, **{vector: new})})

    def names(self, sigma: int) -> tuple[str, ...]:
        """The parameters that a problem with these parts has; a natural curvature turns over at a one-sided
        seam, `sigma` = -1."""
        return tuple(name for name in PARAMETERS if self._has(name, sigma))

    def _has(self, name: str, sigma: int) -> bool:
        part = PARAMETERS[name].part
        if part == "":
            return True
        if part == "material":
            return sigma >= 0
        if self.ends is None:
            return False
        if part == "loads":
            return True
        return self.ends.end != FREE


def _component(name: str) -> tuple[str, int | None]:
    """The field that a parameter is kept in and, of a vector, its component."""
    if name.startswith(("end_force_", "point_force_")):
        return name[:-2], _AXES[name[-1]]
    return name, None


CLOSED = Parts()
"""A closed band, nothing else."""
