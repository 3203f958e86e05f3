"""Which keys each recipe for an initial guess takes, and which topologies it can make.

A new recipe is a new row of `RECIPES` (and a field of `Guess` for each key that no other recipe has).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ribbon_cli.config.keys import Integer, Key, Number

SEGMENTS = Integer(8, 100_000)
EVEN_SEGMENTS = replace(SEGMENTS, even=True)
STEPS = Integer(1, 10_000)
HALF_WIDTH = Number(unit="length")


@dataclass(frozen=True)
class Recipe:
    """The keys of one recipe and what it does; the half-twists it can make: `fits`, in words `half_twists`.

    For n of them it needs at least `fewest(n)` segments, and a half-width below `widest(n)` times the length.
    """

    keys: tuple[Key, ...]
    about: str
    fits: Callable[[int], bool]
    half_twists: str
    fewest: Callable[[int], int] = lambda _: SEGMENTS.low
    widest: Callable[[int], float] = lambda _: 1.0


def _segments(takes: Integer = SEGMENTS) -> Key:
    return Key("segments", takes, "number N of facets", required=takes.expected, examples=(50,))


def _steps(default: int) -> Key:
    return Key("steps", STEPS, "auxiliary problems on the way to the first state", default)


_WIDTH = Key(
    "half_width", HALF_WIDTH, "half-width b of the first state", required="the half-width to start from"
)

RECIPES: dict[str, Recipe] = {
    "cylinder": Recipe(
        (_segments(), _WIDTH), "a regular polygon with rulings along the axis", lambda n: n == 0, "0"
    ),
    "twist": Recipe(
        (_segments(), _WIDTH, _steps(50)),
        "a cylinder cut open, one end turned by half a turn, and closed again",
        lambda n: abs(n) == 1,  # beyond half a turn the band turns over at the seam: recipes.twist
        "1 or -1",
    ),
    "eversion": Recipe(
        (_segments(EVEN_SEGMENTS), _WIDTH, _steps(25)),
        "a cylinder of which half is turned inside out",
        lambda n: n == 0,
        "0",
    ),
    "schoenke": Recipe(
        (_segments(), _WIDTH),
        "a construction of flat and cylindrical pieces, for 3 half-twists and more",
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
