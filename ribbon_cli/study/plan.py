"""The stages that a config resolves to, in the order in which they are run."""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right, insort
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..config import Arclength, Config
from ..digits import duration, memory
from ..facts import TOLERANCE, same_value, same_width
from ..parts import HALF_WIDTH, PARAMETERS
from ..recipes import RECIPES

SECONDS_PER_STATE = 0.05
SECONDS_PER_SEGMENT = 1.2e-4
SPECTRUM_SECONDS = 4e-8
"""Costs seen on a 2.6 GHz core: a stage with its certificate and file, Newton steps (linear in N), and a
full spectrum (cubic in N). They make an estimate, not a promise."""

_CROSSING = re.compile(r"branch from (\d{1,12}) side ")
STEPS = "`steps` of the recipe"
"""Where a way to the first state has its steps, for those that have any."""
LARGE = 6400
MEMORY_PER_SEGMENT = 36 * 1024
"""Segments from which the cost of a level is worth a remark, and the bytes a segment that its solve takes at
most."""


@dataclass(frozen=True)
class PlannedStage:
    """One solve: `kind` as in the store, half-width, number of segments and all parameters that it aims at.

    The half-width and N are None, and not among the parameters, where they are those of a state that is only
    opened when the study runs.
    """

    name: str
    kind: str
    half_width: float | None
    segments: int | None
    parameters: Mapping[str, float] = field(default_factory=dict)


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


@dataclass(frozen=True)
class Goal:
    """What a step of a schedule is to reach: parameters by name, all others staying where they are.

    `visit` counts how often a schedule has come to these values, `ends_leg` says that a leg ends there, where
    it is refined. `stage` is the name of the stage that ends there, if it is not that of the values, and
    `kind` the kind of its state.
    """

    to: Mapping[str, float]
    visit: int = 1
    ends_leg: bool = True
    stage: str = ""
    kind: str = "equilibrium"

    @property
    def one(self) -> str | None:
        """The parameter that moves, None where several do together."""
        return next(iter(self.to)) if len(self.to) == 1 else None

    def distance(
        self, here: Mapping[str, float | None], there: Mapping[str, float | None] | None = None
    ) -> float:
        """How far a place is from the goal or from another place, by the parameter that moves first."""
        name, end = next(iter(self.to.items()))
        return abs((end if there is None else there[name] or 0.0) - (here[name] or 0.0))

    def holds(self, here: Mapping[str, float]) -> bool:
        """Whether a place is the goal, to the last digit."""
        return all(here[name] == value for name, value in self.to.items())

    def reached(self, here: Mapping[str, float | None], length: float) -> bool:
        """Whether a place is the goal, but for rounding."""
        return all(same_value(name, here[name] or 0.0, value, length) for name, value in self.to.items())

    @property
    def name(self) -> str:
        """The stage that ends there, which is the key by which a run is resumed."""
        return self.stage or place_name(self.to, self.visit)

    def refined(self, segments: int) -> str:
        """The stage that ends there on a finer level."""
        return f"{self.name}, refined to N = {segments}"

    def ways(self, here: Mapping[str, float]) -> list[tuple[str, dict[str, float]]]:
        """Stage names and targets to try from a place: all the way, half of it, a quarter, ..."""
        out = [(self.name, dict(self.to))]
        for j in range(1, MOST_HALVINGS + 1):
            part = {name: here[name] + (value - here[name]) / 2**j for name, value in self.to.items()}
            out.append((f"{place_name(part)} on the way to {self.name}", part))
        return out


def place_name(values: Mapping[str, float], visit: int = 1) -> str:
    """Parameters with their values, in the order of the table of parameters, as stages are named by them."""
    names = values if len(values) == 1 else [name for name in PARAMETERS if name in values]
    told = [f"{PARAMETERS[name].symbol} = {values[name] + 0.0:.12g}" for name in names]
    return ", ".join(told) + (f" (visit {visit})" if visit > 1 else "")


def goals(config: Config, start: Mapping[str, float]) -> list[Goal]:
    """The goals of a config's widths or schedule in order; `start` holds the parameters of the guess."""
    if not config.schedule:
        return [Goal({HALF_WIDTH: b}, visit) for b, visit in visits(config.widths)]
    here, out = dict(start), []
    count: Counter[str] = Counter()
    for leg in config.schedule:
        targets = leg.targets(here)
        for k, target in enumerate(targets, start=1):
            name = place_name(target)
            count[name] += 1
            out.append(Goal(target, count[name], k == len(targets)))
        here |= leg.to
    return out


def refined_at(config: Config, half_width: float) -> tuple[int, ...]:
    """Levels beyond the first that a width is refined to."""
    at = config.refinement.at
    return config.refinement.levels[1:] if at is None or half_width in at else ()


def start_name(config: Config) -> str:
    """The stage that frees the initial guess."""
    recipe = config.guess.recipe
    return "given state" if recipe == "state" else RECIPES[recipe].freed


def steps_of(config: Config) -> str | None:
    """Where a config has smaller steps on the way to the first state; None where there are none."""
    return STEPS if "steps" in config.guess.settings else None


def start_width(config: Config, half_width: float) -> float:
    """Half-width at which the guess is freed: the first that the config names, if rounding parts them."""
    widths = config.widths
    return widths[0] if widths and same_width(widths[0], half_width) else half_width


def start_kind(config: Config, half_width: float | None) -> str:
    """Kind of the freed guess: an equilibrium where its width is the first that the config names, or where a
    schedule begins.
    """
    return "equilibrium" if not config.widths or half_width == config.widths[0] else "intermediate"


def by_command(stage: str, stages: Mapping[int, str]) -> bool:
    """Whether a stage is one of `ribbon refine` or `ribbon continue`, and no config leads to it.

    `stages` are those of the run by label: a branch that crosses another is of whoever asked for that one.
    """
    left = dict(stages)  # each is looked at once, whatever a log says
    while crossing := _CROSSING.match(stage):
        stage = left.pop(int(crossing[1]), "")
    return stage.startswith(("state ", "from ", "branch from "))


def plan_of(config: Config, given: tuple[float, int] | None = None) -> Plan:
    """Resolve a config into its stages, what they cost and what there is to say of them; `given`: half-width
    and segments of the state that it starts from."""
    stages, moves = _stages(config, given)
    cost = sum(_cost(config, s) for s in stages)
    what = "" if config.schedule else " in width"
    halving = f"a step{what} that fails is halved; the additional stages are not counted"
    notes = (halving,) if moves else ()
    if (branch := config.arclength) is not None:
        notes = (*notes, f"a branch takes up to {branch.steps} steps; their cost is not counted")
    return Plan(
        tuple(stages),
        cost,
        (*guess_notes(config), *angle_notes(config), *notes, *level_notes(config, stages)),
    )


def stages_of(config: Config, given: tuple[float, int] | None = None) -> tuple[PlannedStage, ...]:
    """The stages alone."""
    return tuple(_stages(config, given)[0])


def _stages(config: Config, given: tuple[float, int] | None) -> tuple[list[PlannedStage], bool]:
    """The stages, and whether one of them moves a parameter."""
    guess = config.guess
    half_width, first = given or (guess.half_width, guess.segments)
    half_width = None if half_width is None else start_width(config, half_width)
    names = () if guess.recipe == "state" else RECIPES[guess.recipe].stages(guess.settings)
    stages = [PlannedStage(name, "auxiliary", half_width, first) for name in names]
    kind = start_kind(config, half_width)
    place = config.start(half_width)
    stages.append(_stage(start_name(config), kind, place, first))
    planned = goals(config, place)
    if not planned:
        stages += [
            _stage(_refined_start(half_width, n), "equilibrium", place, n)
            for n in config.refinement.levels[1:]
        ]
    moves = False
    for k, goal in enumerate(planned):
        stays = k == 0 and (_stays(config, goal, place) if config.schedule else kind == "equilibrium")
        place = {**place, **goal.to}
        if not stays:
            moves = True
            stages.append(_stage(goal.name, "equilibrium", place, first))
        for n in refined_at(config, place[HALF_WIDTH]) if goal.ends_leg else ():
            stages.append(_stage(goal.refined(n), "equilibrium", place, n))
    branch = config.arclength
    if branch is not None:
        for value in branch.at:
            at = {**place, branch.parameter: value}
            stages.append(_stage(meeting(branch, value), "equilibrium", at, first))
        end = {**place, branch.parameter: branch.to}
        stages.append(_stage(_towards(branch), "intermediate", end, first))
    return stages, moves


def _towards(branch: Arclength) -> str:
    """A branch in words."""
    words = f"a branch followed towards {PARAMETERS[branch.parameter].symbol} = {branch.to:.12g}"
    return words + (", and the other way" if branch.both else "")


def meeting(branch: Arclength, value: float) -> str:
    """The planned stage of a value that a branch is to meet."""
    return f"{_towards(branch)}, meeting {PARAMETERS[branch.parameter].symbol} = {value:.12g}"


def angle_notes(config: Config) -> tuple[str, ...]:
    """What angles beyond a whole turn come to: most likely they are meant in degrees."""
    places = [config.start(), *(leg.to for leg in config.schedule)]
    if (branch := config.arclength) is not None:
        ends = (branch.to, branch.back_to, *branch.at)
        places += [{branch.parameter: value} for value in ends if value is not None]
    notes = []
    for name, parameter in PARAMETERS.items():
        values = [place[name] for place in places if name in place]
        if parameter.kind == "angle" and values:
            most = max(values, key=abs)
            if abs(most) > 2.0 * math.pi * (1.0 + TOLERANCE):
                turns, meant = abs(most) / (2.0 * math.pi), math.radians(most)
                notes.append(
                    f"{name} = {most:.10g} is {turns:.3g} turns, as angles are in radians; "
                    f"{most:.10g} degrees are {meant:.6g}"
                )
    return tuple(notes)


def level_notes(config: Config, stages: Sequence[PlannedStage]) -> tuple[str, ...]:
    """What a solve on each of the large grids takes, spectra left out."""
    largest = {stage.segments: stage for stage in stages if (stage.segments or 0) >= LARGE}
    return tuple(
        f"N = {n}: about {duration(_cost(config, stage))} and {memory(MEMORY_PER_SEGMENT * n)} of memory each"
        for n, stage in largest.items()
        if n is not None
    )


def _stage(name: str, kind: str, place: Mapping[str, float], segments: int | None) -> PlannedStage:
    """A solve at a place; a parameter that is not a number is unknown."""
    known = place
    if any(map(math.isnan, place.values())):
        known = {parameter: value for parameter, value in place.items() if not math.isnan(value)}
    return PlannedStage(name, kind, known.get(HALF_WIDTH), segments, known)


def _refined_start(half_width: float | None, segments: int) -> str:
    """The stage that refines the freed guess, where a config names no width."""
    named = f"refined to N = {segments}"
    return named if half_width is None else Goal({HALF_WIDTH: half_width}).refined(segments)


def _stays(config: Config, goal: Goal, place: Mapping[str, float]) -> bool:
    """Whether a goal is where the schedule begins."""
    return all(same_value(name, place[name], value, config.length) for name, value in goal.to.items())


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
