"""Which keys each recipe for an initial guess takes, and which topologies it can make.

A new recipe is a new row of `RECIPES` (and a field of `Guess` for each key that no other recipe has).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Count:
    """An integer setting from `low` to `high`; required where `default` is None."""

    low: int
    high: int
    default: int | None = None

    @property
    def expected(self) -> str:
        """What to give, in words."""
        return f"an integer from {self.low} to {self.high}"


@dataclass(frozen=True)
class HalfWidth:
    """A half-width b, 0 < b < length; required."""

    default: None = None
    expected: str = "the half-width to start from"


Setting = Count | HalfWidth


@dataclass(frozen=True)
class Recipe:
    """The settings of one recipe, and the half-twists it can make: `fits`, in words `half_twists`."""

    settings: dict[str, Setting]
    fits: Callable[[int], bool]
    half_twists: str


SEGMENTS = Count(8, 100_000)
_STEPS = Count(1, 10_000, default=50)
_MESH: dict[str, Setting] = {"segments": SEGMENTS, "half_width": HalfWidth()}

RECIPES: dict[str, Recipe] = {
    "cylinder": Recipe(_MESH, lambda n: n == 0, "0"),
    "twist": Recipe({**_MESH, "steps": _STEPS}, lambda n: n in (1, -1), "1 or -1"),
}


def topology_problem(name: str, half_twists: int) -> str | None:
    """Why the recipe cannot make a band with so many half-twists, and which can; None if it can."""
    recipe = RECIPES[name]
    if recipe.fits(half_twists):
        return None
    others = [other for other, rule in RECIPES.items() if rule.fits(half_twists)]
    hint = f"take {' or '.join(others)}" if others else "start from a state: {state: ...}"
    needs = f"needs half_twists {recipe.half_twists}, got {half_twists}"
    return f"{name} does not fit the topology: {needs}; {hint}"
