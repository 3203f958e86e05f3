"""Where the ends of a strip are, and how they move with span, lift, shear, twist and tilt.

All vectors are in the start's frame: x along the tangent, z along the ruling for eta = 0, y = z cross x. The
end's midpoint is at (span, lift, shear) and its frame is R_x(twist) R_z(tilt).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..parts import Ends

Array = NDArray[np.float64]

PLACES = {"span": 0, "lift": 1, "shear": 2}
TURNS = ("twist", "tilt")
_X = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Generators of rotations about x and z."""


@dataclass(frozen=True)
class EndFrame:
    """A clamp's tangent and ruling (3,), dimensionless, or their derivatives by a parameter."""

    tangent: Array
    ruling: Array


def start_frame(ends: Ends) -> EndFrame:
    """The start's tangent e_x and ruling g_1 = start_eta e_x + e_z."""
    return EndFrame(np.array([1.0, 0.0, 0.0]), np.array([ends.start_eta, 0.0, 1.0]))


def rotation(ends: Ends) -> Array:
    """R_x(twist) R_z(tilt) (3,3)."""
    out: Array = _turn(_X, ends.twist) @ _turn(_Z, ends.tilt)
    return out


@lru_cache(maxsize=8)
def finish_frame(ends: Ends) -> EndFrame:
    """The end's tangent R e_x and ruling g_{N+1} = R (end_eta e_x + e_z), not to be written to."""
    frame = _framed(rotation(ends), ends)
    frame.tangent.flags.writeable = frame.ruling.flags.writeable = False
    return frame


def finish_rate(ends: Ends, name: str, order: int = 1) -> EndFrame:
    """The first or second derivative of the end's frame by a parameter; zero for one that does not turn
    it."""
    if name not in TURNS:
        return EndFrame(np.zeros(3), np.zeros(3))
    first, second = _turn(_X, ends.twist), _turn(_Z, ends.tilt)
    for _ in range(order):
        first, second = (_X @ first, second) if name == "twist" else (first, _Z @ second)
    return _framed(first @ second, ends)


def displacement(ends: Ends) -> Array:
    """The end's midpoint (3,) from the start's, in the unit of the length."""
    return np.array([ends.span, ends.lift, ends.shear])


def displacement_rate(name: str) -> Array:
    """The derivative (3,) of the displacement by a parameter."""
    out = np.zeros(3)
    if name in PLACES:
        out[PLACES[name]] = 1.0
    return out


def _framed(turned: Array, ends: Ends) -> EndFrame:
    return EndFrame(turned @ np.array([1.0, 0.0, 0.0]), turned @ np.array([ends.end_eta, 0.0, 1.0]))


def _turn(generator: Array, angle: float) -> Array:
    """Rodrigues' rotation about an axis of coordinates."""
    out: Array = np.eye(3) + math.sin(angle) * generator + (1.0 - math.cos(angle)) * generator @ generator
    return out
