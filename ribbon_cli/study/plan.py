"""The stages that a config resolves to, in the order in which they are run."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Sequence
from dataclasses import dataclass

from ..config import Config
from ..facts import TOLERANCE, same_width
from ..recipes import RECIPES

SECONDS_PER_STATE = 0.05
SECONDS_PER_SEGMENT = 1.2e-4
SPECTRUM_SECONDS = 4e-8
"""Costs seen on a 2.6 GHz core: a stage with its certificate and file, Newton steps (linear in N), and a
full spectrum (cubic in N). They make an estimate, not a promise."""


@dataclass(frozen=True)
class PlannedStage:
    """One solve: `kind` as in the store, half-width and number of segments it aims at.

    The last two are None where they are those of a state that is only opened when the study runs.
    """

    name: str
    kind: str
    half_width: float | None
    segments: int | None


@dataclass(frozen=True)
class Plan:
    """All stages, an estimate of their cost in seconds, and remarks."""

    stages: tuple[PlannedStage, ...]
    cost: float
    notes: tuple[str, ...]


MOST_HALVINGS = 8
"""A step is given up when 1/256 of it fails too."""


def visits(widths: Sequence[float]) -> list[tuple[float, int]]:
    """Each width of a schedule with how often it has come so far, from 1."""
    ordered: list[float] = []  # those before, so that thousands of widths cost no more than sorting them
    out = []
    for b in widths:
        insort(ordered, b)
        same = bisect_right(ordered, b * (1.0 + TOLERANCE)) - bisect_left(ordered, b * (1.0 - TOLERANCE))
        out.append((b, same))
    return out


def width_name(half_width: float, visit: int = 1) -> str:
    """The stage that ends at a requested width; a schedule may come back to it."""
    return f"b = {half_width:.12g}" + (f" (visit {visit})" if visit > 1 else "")


def refinement_name(half_width: float, segments: int, visit: int = 1) -> str:
    """The stage that ends at a requested width and level."""
    return f"{width_name(half_width, visit)}, refined to N = {segments}"


def width_steps(here: float, half_width: float, visit: int) -> list[tuple[str, float]]:
    """Stage names and widths to try on the way to a width: all the way, half of it, a quarter, ..."""
    goal = width_name(half_width, visit)
    out = [(goal, half_width)]
    for j in range(1, MOST_HALVINGS + 1):
        part = here + (half_width - here) / 2**j
        out.append((f"{width_name(part)} on the way to {goal}", part))
    return out


def refined_at(config: Config, half_width: float) -> tuple[int, ...]:
    """Levels beyond the first that a width is refined to."""
    at = config.refinement.at
    return config.refinement.levels[1:] if at is None or half_width in at else ()


def start_name(config: Config) -> str:
    """The stage that frees the initial guess."""
    recipe = config.guess.recipe
    return "given state" if recipe == "state" else RECIPES[recipe].freed


def start_width(config: Config, half_width: float) -> float:
    """Half-width at which the guess is freed: the first that the config names, if rounding parts them."""
    widths = config.widths
    return widths[0] if widths and same_width(widths[0], half_width) else half_width


def start_kind(config: Config, half_width: float | None) -> str:
    """Kind of the freed guess: an equilibrium where its width is the first that the config names."""
    return "equilibrium" if not config.widths or half_width == config.widths[0] else "intermediate"


def plan_of(config: Config, given: tuple[float, int] | None = None) -> Plan:
    """Resolve a config into its stages; `given`: half-width and segments of the state that it starts from."""
    guess = config.guess
    half_width, first = given or (guess.half_width, guess.segments)
    half_width = None if half_width is None else start_width(config, half_width)
    names = () if guess.recipe == "state" else RECIPES[guess.recipe].stages(guess.settings)
    stages = [PlannedStage(name, "auxiliary", half_width, first) for name in names]
    widths = config.widths
    kind = start_kind(config, half_width)
    named = kind == "equilibrium"
    stages.append(PlannedStage(start_name(config), kind, half_width, first))
    places: list[tuple[float | None, int]] = [*visits(widths)] or [(half_width, 1)]
    for k, (b, visit) in enumerate(places):
        if not (k == 0 and named):
            stages.append(PlannedStage(width_name(b or 0.0, visit), "equilibrium", b, first))
        for n in refined_at(config, b) if b is not None else config.refinement.levels[1:]:
            name = refinement_name(b, n, visit) if b is not None else f"refined to N = {n}"
            stages.append(PlannedStage(name, "equilibrium", b, n))
    branch = config.arclength
    if branch is not None:
        words = f"a branch followed towards b = {branch.to:.12g}" + (
            ", and the other way" if branch.both else ""
        )
        stages += [PlannedStage(f"{words}, meeting b = {b:.12g}", "equilibrium", b, first) for b in branch.at]
        stages.append(PlannedStage(words, "intermediate", branch.to, first))
    cost = sum(_cost(config, s) for s in stages)
    halving = "a step in width that fails is halved; what that adds is not counted"
    notes = (halving,) if len(widths) > 1 or not named else ()
    if branch is not None:
        notes = (*notes, f"a branch takes up to {branch.steps} steps; what they cost is not counted")
    return Plan(tuple(stages), cost, (*guess_notes(config), *notes))


def guess_notes(config: Config) -> tuple[str, ...]:
    """What is worth knowing about an initial guess that is not wrong."""
    recipe, segments = config.guess.recipe, config.guess.segments
    if recipe == "state" or segments is None:
        return ()
    return RECIPES[recipe].notes(config.half_twists, segments)


def _cost(config: Config, stage: PlannedStage) -> float:
    n = stage.segments or 100
    cost = SECONDS_PER_STATE + 6 * SECONDS_PER_SEGMENT * n
    if stage.kind == "equilibrium" and n <= config.spectrum.full_up_to:
        cost += SPECTRUM_SECONDS * n**3
    return cost
