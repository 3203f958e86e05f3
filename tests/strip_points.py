"""Folds and branch points of planar strips on our own branches, and their limits N -> infinity.

A branch is followed by arclength on each grid and its point located there. The scheme is of second order:
with the figures at N, 2N and 4N, one Richardson step removes the term in h^2, and the next that in h^4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from strip_support import band, planar, walked

from ribbon_cli.model.reactions import reactions
from ribbon_cli.parts import Ends
from ribbon_cli.solver.arclength import Point, Tangent, initial_tangent, point_of
from ribbon_cli.solver.branch import BranchOptions, advance
from ribbon_cli.solver.branch_events import Event
from ribbon_cli.solver.branch_switch import switch
from ribbon_cli.solver.status import Result

Array = NDArray[np.float64]
HALF_WIDTH = 0.05
GRIDS = (50, 100, 200, 400)
FIRST_STEP = 0.03
MOST_STEPS = 40


@dataclass(frozen=True)
class Limit:
    """Figures (k,) extrapolated to N -> infinity, by how much the last step of extrapolation changed them,
    and the orders observed between grids, finest last."""

    value: Array
    error: Array
    orders: Array

    def __str__(self) -> str:
        pairs = ", ".join(f"{v:.10f} +- {e:.0e}" for v, e in zip(self.value, self.error, strict=True))
        return f"{pairs}; orders {', '.join(f'{order:.3f}' for order in self.orders[-1])}"


def extrapolated(figures: Callable[[int], Array], grids: tuple[int, ...] = GRIDS) -> Limit:
    """The limit of figures (k,) on grids that double."""
    table = [np.array([figures(n) for n in grids])]
    steps = np.abs(np.diff(table[0], axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):  # of figures that are zero on every grid
        orders = np.log2(steps[:-1] / steps[1:])
    for power in (2, 4):
        table.append(table[-1][1:] + np.diff(table[-1], axis=0) / (2**power - 1))
    return Limit(table[2][-1], np.abs(table[2][-1] - table[1][-1]), orders)


def described(point: Point) -> Array:
    """Energy, the end's force x and y and its moment about z (4,), in units of b, of a strip in the plane."""
    found = reactions(point.problem, point.x, point.multipliers)
    out_of_plane = np.abs(point.x.reshape(-1, 7)[:, [2, 6]]).max()
    assert out_of_plane < 1e-9
    force, moment = found.force, found.moment
    return np.array([point.energy, force[0], force[1], moment[2]]) / point.problem.band.half_width


@lru_cache
def lifted(segments: int, lift: float) -> Result:
    """The strip of span 0.75, buckled to +y, its end lifted."""
    flat = planar(band(segments, Ends(span=0.75), half_width=HALF_WIDTH))
    return walked(flat, 3, lift=lift) if lift else flat


def until(point: Point, tangent: Tangent, kind: str, low: float, high: float) -> Event:
    """Follow a branch within [low, high] to the first event of a kind."""
    options, length = BranchOptions(low, high), FIRST_STEP
    for _ in range(MOST_STEPS):
        made = advance(point, tangent, length, options)
        for event in made.events:
            if event.type == kind:
                return event
        assert made.end is None, f"no {kind}: {made.end}"
        assert made.point is not None
        assert made.tangent is not None
        point, tangent, length = made.point, made.tangent, made.following
    raise AssertionError(f"no {kind} within {MOST_STEPS} steps")


def _begun(start: Result, parameter: str, way: int) -> tuple[Point, Tangent]:
    point = point_of(start.state, start.multipliers, parameter)
    return point, initial_tangent(point, way)


def limit(located: Callable[[int], Point]) -> Limit:
    """The limit of a point's parameter and what `described` has of it (5,)."""

    def figures(segments: int) -> Array:
        point = located(segments)
        return np.append(point.value, described(point))

    return extrapolated(figures)


@lru_cache
def fold_in_tilt(segments: int, lift: float) -> Event:
    """The fold of the strip of span 0.75, whose end is turned on."""
    fold = until(*_begun(lifted(segments, lift), "tilt", 1), "fold", -0.5, 1.5)
    assert (fold.before, fold.after) == (0, 1)
    return fold


@lru_cache
def branch_point_in_span(segments: int) -> Event:
    """Where the strip with the half turn's symmetry, lifted by 0.3 and let in from span 0.94, loses it."""
    taut = planar(band(segments, Ends(span=0.94, lift=0.3), half_width=HALF_WIDTH))
    found = until(*_begun(taut, "span", -1), "branch-point", 0.5, 0.952)
    assert (found.before, found.after) == (0, 1)
    return found


@lru_cache
def vertex_in_span(segments: int) -> Event:
    """The same point, met along the strips without this symmetry, which turn there."""
    found = until(*_begun(lifted(segments, 0.3), "span", 1), "branch-point", 0.5, 0.952)
    assert (found.before, found.after) == (0, 0)
    return found


@lru_cache
def branch_point_of_the_eight(segments: int) -> Event:
    """Near span 0, where the strip closes to a figure-eight."""
    buckled = planar(band(segments, Ends(span=0.1), half_width=HALF_WIDTH))
    found = until(*_begun(buckled, "span", -1), "branch-point", -0.05, 0.2)
    assert (found.before, found.after) == (0, 1)
    return found


def symmetric(segments: int, span: float) -> Point:
    """The strip with the half turn's symmetry beyond the branch point, a saddle."""
    here = branch_point_in_span(segments)
    found = until(here.point, here.tangent, "value", span, 0.952).point
    assert found.negative == 1
    return found


def sides(segments: int, span: float) -> list[Point]:
    """The strips without the symmetry on both sides of the branch point, at a span."""
    here = branch_point_in_span(segments)
    assert here.mode is not None
    out = []
    for side in (1, -1):
        met = switch(here.point, here.tangent, here.mode.tangent, side)
        out.append(until(met.point, met.tangent, "value", span, 0.952).point)
    assert [point.negative for point in out] == [0, 0]
    return out
