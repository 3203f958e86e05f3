"""The energy terms that a problem may have besides bending: one row each."""

from __future__ import annotations

from .band import Band
from .bending import NaturalCurvature
from .end_force import EndForce
from .free_corner import FreeCorner
from .gravity import Gravity
from .point_force import PointForce
from .term import Term

TERMS: tuple[type[Term], ...] = (NaturalCurvature, Gravity, FreeCorner, EndForce, PointForce)


def terms_of(band: Band) -> tuple[Term, ...]:
    """All terms of a band's problem, active or not; none is on a closed band without natural curvature."""
    return tuple(term(band) for term in TERMS)
