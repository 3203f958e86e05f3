"""Which keys each recipe for an initial guess takes, and which topologies it can make.

A new recipe is a new row of `RECIPES` (and a field of `Guess` for each key that no other recipe has).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Count:
    """An integer setting from `low` to `high`, even where `even`; required where `default` is None."""

    low: int
    high: int
    default: int | None = None
    even: bool = False

    @property
    def expected(self) -> str:
        """What to give, in words."""
        return f"an {'even ' if self.even else ''}integer from {self.low} to {self.high}"


@dataclass(frozen=True)
class HalfWidth:
    """A half-width b, 0 < b < length; required."""

    default: None = None
    expected: str = "the half-width to start from"


Setting = Count | HalfWidth


SEGMENTS = Count(8, 100_000)


@dataclass(frozen=True)
class Recipe:
    """The settings of one recipe, and the half-twists it can make: `fits`, in words `half_twists`.

    For n of them it needs at least `fewest(n)` segments, and a half-width below `widest(n)` times the length.
    """

    settings: dict[str, Setting]
    fits: Callable[[int], bool]
    half_twists: str
    fewest: Callable[[int], int] = lambda _: SEGMENTS.low
    widest: Callable[[int], float] = lambda _: 1.0


_EVEN = Count(SEGMENTS.low, SEGMENTS.high, even=True)
_WIDTH = HalfWidth()
_MESH: dict[str, Setting] = {"segments": SEGMENTS, "half_width": _WIDTH}

RECIPES: dict[str, Recipe] = {
    "cylinder": Recipe(_MESH, lambda n: n == 0, "0"),
    "twist": Recipe(
        {**_MESH, "steps": Count(1, 10_000, default=50)},
        lambda n: abs(n) == 1,  # beyond half a turn the band turns over at the seam: recipes.twist
        "1 or -1",
    ),
    "eversion": Recipe(
        {"segments": _EVEN, "half_width": _WIDTH, "steps": Count(1, 10_000, default=25)},
        lambda n: n == 0,
        "0",
    ),
    "schoenke": Recipe(
        _MESH,
        lambda n: abs(n) >= 3,
        "3 or more, or -3 or less",
        lambda n: 8 * abs(n),
        lambda n: math.tan(math.pi / abs(n)) / (2 * abs(n)),  # recipes.schoenke.widest
    ),
}


def topology_problem(name: str, half_twists: int) -> str | None:
    """Why the recipe cannot make a band with so many half-twists, and which can; None if it can."""
    recipe = RECIPES[name]
    if recipe.fits(half_twists):
        return None
    others = [other for other, rule in RECIPES.items() if rule.fits(half_twists)]
    hint = (
        f"take {' or '.join(others)}" if others else "no recipe makes these: start from a state, {state: ...}"
    )
    needs = f"needs half_twists {recipe.half_twists}, got {half_twists}"
    return f"{name} does not fit the topology: {needs}; {hint}"
