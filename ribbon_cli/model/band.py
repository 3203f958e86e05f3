"""Bands, their discrete states and their multipliers, as frozen values.

A closed band of midline length l and half-width b is a strip cut into N flat facets, h = l/N.
Facet i lies between nodes i and i+1; rulings sit at nodes, tangents and xi at facets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..parts import CLOSED, FREE, HALF_WIDTH, Parts
from .ends import finish_frame, start_frame

Array = NDArray[np.float64]


class Discretisation(StrEnum):
    """How xi enters the energy at a node, Koldaev (2022), (2.15)."""

    THESIS = "thesis"
    """F at the average: F((xi_i + xi_{i-1}) / 2)."""
    VALUE_AVERAGE = "value-average"
    """Average of F: (F(xi_i) + F(xi_{i-1})) / 2."""


@dataclass(frozen=True)
class Band:
    """What is fixed while a band is deformed.

    `segments` is N; `half_width` b and `length` l share one unit of length; `sigma` is +1 where
    the seam joins like sides and -1 on a one-sided band: g_{N+1} = sigma g_1, xi_0 = sigma xi_N.
    Raises ValueError for values outside these ranges.
    """

    segments: int
    half_width: float
    length: float = 2.0 * math.pi
    sigma: int = 1
    discretisation: Discretisation = Discretisation.THESIS
    parts: Parts = CLOSED

    def __post_init__(self) -> None:
        if self.segments < 3:
            raise ValueError(f"a band needs at least 3 segments, got {self.segments}")
        if not (math.isfinite(self.half_width) and self.half_width > 0):
            raise ValueError(f"half-width must be positive and finite, got {self.half_width}")
        if not (math.isfinite(self.length) and self.length > 0):
            raise ValueError(f"length must be positive and finite, got {self.length}")
        if self.sigma not in ((1, -1) if self.closed else (0,)):
            raise ValueError(
                f"sigma must be +1 or -1 on a closed band, 0 on a strip with ends, got {self.sigma}"
            )

    @property
    def h(self) -> float:
        """Length of a facet's midline, l/N."""
        return self.length / self.segments

    @property
    def closed(self) -> bool:
        """Whether the strip is joined to itself."""
        return self.parts.ends is None

    @property
    def parameters(self) -> dict[str, float]:
        """Every parameter that the problem has, by name, with its value."""
        return {name: self.parameter(name) for name in self.parts.names(self.sigma)}

    def parameter(self, name: str) -> float:
        """The value of a parameter. Raises KeyError for one that the problem does not have."""
        return self.half_width if name == HALF_WIDTH else self.parts.value(name)

    def with_parameter(self, name: str, value: float) -> Band:
        """Return the band with a parameter at another value."""
        if name == HALF_WIDTH:
            return self.with_half_width(value)
        return replace(self, parts=self.parts.with_value(name, value))

    def with_half_width(self, half_width: float) -> Band:
        """Return the band with another half-width."""
        return replace(self, half_width=half_width)

    def with_segments(self, segments: int) -> Band:
        """Return the band cut into another number of facets."""
        return replace(self, segments=segments)


@dataclass(frozen=True, eq=False)
class State:
    """A discrete configuration: tangents u (N,3), rulings g (N,3) and xi (N,).

    All are dimensionless; b g_i is the half-ruling from the midline to the strip's edge. `g_end` (3,) is
    g_{N+1} of a strip with ends, None on closed bands.
    """

    band: Band
    u: Array
    g: Array
    xi: Array
    g_end: Array | None = None

    def __post_init__(self) -> None:
        n = self.band.segments
        if self.u.shape != (n, 3) or self.g.shape != (n, 3) or self.xi.shape != (n,):
            raise ValueError(
                f"state of {n} segments needs u ({n},3), g ({n},3), xi ({n},); "
                f"got {self.u.shape}, {self.g.shape}, {self.xi.shape}"
            )
        if (self.g_end is None) is not self.band.closed:
            raise ValueError("a strip with ends needs the ruling at its end, a closed band has none")

    @classmethod
    def from_vector(cls, band: Band, x: Array) -> State:
        """Unpack the node-major vector x (7N,) of (u_i, g_i, xi_i); see `vector`."""
        y = np.asarray(x, dtype=np.float64).reshape(band.segments, 7)
        g, end = y[:, 3:6].copy(), None
        if band.parts.ends is not None:
            end, g[0] = g[0].copy(), start_frame(band.parts.ends).ruling
        return cls(band, y[:, :3].copy(), g, y[:, 6].copy(), end)

    def vector(self) -> Array:
        """Pack into the node-major vector x (7N,) of (u_i, g_i, xi_i).

        On a strip with ends g_1 is given, and g_{N+1} has its place.
        """
        x = np.column_stack((self.u, self.g, self.xi))
        if self.g_end is not None:
            x[0, 3:6] = self.g_end
        return x.ravel()

    def next_rulings(self) -> Array:
        """Rulings at each facet's far node, g_{i+1} (N,3), with g_{N+1} = sigma g_1 on a closed band."""
        g = np.roll(self.g, -1, axis=0)
        g[-1] = self.band.sigma * self.g[0] if self.g_end is None else self.g_end
        return g

    def on(self, band: Band) -> State:
        """The same u, g, xi as a state of another band of as many segments; an end that is held takes g
        along."""
        x, ends = self.vector(), band.parts.ends
        if ends is not None and ends.end != FREE:
            x[3:6] = finish_frame(ends).ruling
        return State.from_vector(band, x)


@dataclass(frozen=True)
class Multipliers:
    """Discrete reaction forces in the normalisation of Koldaev (2022), (1.58): |u|^2 - 1.

    lambda_1..lambda_5 (N,) approximate the continuous fields, to second order in h but for lambda_3: with
    g_i.u_i in the second row, as (2.18) has it, lambda_3 does so to first and lambda_3 - h lambda_2 eta to
    second order. lambda_1, lambda_4, lambda_5 sit at facets and lambda_2, lambda_3 at nodes, (2.48).
    gamma (3,) is the closure force; on a strip, the force of its end's clamp (zero at a free end). `end` is
    the multiplier of a strip's end row: of (t_B - u_N).g_{N+1}, else of |g_{N+1}|^2 - (g_{N+1}.u_N)^2 - 1;
    lambda_2 is not-a-number at node 1 there, whose ruling is held.
    """

    lambda_1: Array
    lambda_2: Array
    lambda_3: Array
    lambda_4: Array
    lambda_5: Array
    gamma: Array
    end: float | None = None

    @classmethod
    def from_vector(cls, band: Band, y: Array) -> Multipliers:
        """Unpack (5N+3,) ordered node by node, closure last; a strip with a free end has none."""
        segments = band.segments
        node = y[: 5 * segments].reshape(segments, 5)
        one, two, three, four, five = (node[:, k].copy() for k in range(5))
        gamma = np.zeros(3)
        gamma[: y.size - 5 * segments] = y[5 * segments :]
        if band.closed:
            return cls(one, two, three, four, five, gamma)
        end, two[0] = float(two[0]), math.nan
        return cls(one, two, three, four, five, gamma, end)

    def vector(self, closing: int = 3) -> Array:
        """Pack into (5N+3,) ordered node by node, closure last; `closing` is 0 for a strip with a free
        end."""
        fields = (self.lambda_1, self.lambda_2, self.lambda_3, self.lambda_4, self.lambda_5)
        node = np.column_stack(fields)
        if self.end is not None:
            node[0, 1] = self.end
        return np.concatenate((node.ravel(), self.gamma[:closing]))

    @classmethod
    def zeros(cls, band: Band) -> Multipliers:
        """All multipliers zero."""
        return cls.from_vector(band, np.zeros(5 * band.segments + 3))
