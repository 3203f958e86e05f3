"""What a config says, resolved: frozen records of plain Python values."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import yaml

from ribbon_cli.facts import same_value
from ribbon_cli.parts import CLOSED, HALF_WIDTH, Ends, Loads, Material, Parts

METRICS = ("euclidean", "physical")


@dataclass(frozen=True)
class Guess:
    """Where the first state comes from: a recipe, or (`recipe` "state") a stored state.

    `segments` N and `half_width` b are None with a state, which brings its own. `settings` are the recipe's
    other keys. `state` is what to open, a reference or an absolute path; `state_as_written` is what the
    config says, at `line` and `column` of its file. `keep_saddle` asks for the stationary point next to the
    state, whatever its index.
    """

    recipe: str
    segments: int | None = None
    half_width: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    state: str | None = None
    state_as_written: str | None = None
    keep_saddle: bool = False
    line: int = field(default=0, compare=False)
    column: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Refinement:
    """The numbers of segments to solve with, each double the one before.

    `levels` starts at the guess's segments; it is empty when a state's own mesh is all that is asked for.
    `at` holds the widths that are refined, exactly as they stand in `Config.widths`; None means all, and
    the widths left out are solved on the first level alone.
    """

    levels: tuple[int, ...]
    at: tuple[float, ...] | None = None


@dataclass(frozen=True)
class SpectrumRequest:
    """How much of the eigen-spectrum to store with a state.

    `modes` lowest modes besides rotations, in each of `metrics`; all of them where N <= `full_up_to`.
    """

    modes: int = 12
    full_up_to: int = 200
    metrics: tuple[str, ...] = METRICS


@dataclass(frozen=True)
class ContactRequest:
    """What is done where a band meets itself.

    `kind` is `record` (note it and go on through), `stop`, or `forces`: the band rests on itself, its
    features at least `gap` apart, in the unit of length.
    """

    kind: str = "record"
    gap: float = 0.0

    @property
    def forces(self) -> bool:
        """Whether contact forces are on."""
        return self.kind == FORCES

    @property
    def in_words(self) -> str:
        """As the command line spells it: `forces`, `gap=0.02`."""
        return f"gap={self.gap:.12g}" if self.gap else self.kind

    def said(self) -> str | dict[str, float]:
        """In a config's own layout."""
        return {"gap": self.gap} if self.gap else self.kind


FORCES = "forces"
CONTACT_KINDS = ("record", "stop", FORCES)
"""What a config may ask for where a band meets itself."""
STOPS = ("fold", "stability-lost", "contact")
"""Events at which a branch can be asked to stop."""


@dataclass(frozen=True)
class Arclength:
    """A request to follow a branch by pseudo-arclength continuation in a `parameter`, the half-width b.

    It begins towards `to`, with `both` in both directions, and ends where b leaves the range of the start's
    width, `to` and `back_to`; at the first of the events in `stop_at`; or after `steps`. The widths `at`
    are met exactly. `max_step` is the longest step, in the rms change of tangents and rulings. `switch` is
    how many times over the branches that cross at branch points are followed too.
    """

    to: float
    back_to: float | None = None
    both: bool = False
    at: tuple[float, ...] = ()
    max_step: float = 0.1
    steps: int = 500
    stop_at: tuple[str, ...] = ()
    switch: int = 0
    parameter: str = HALF_WIDTH

    def outside(self, value: float, start: float, length: float | None) -> str:
        """Why a branch that begins at `start` never meets a value; empty where it may."""
        ends = (start, self.to, self.to if self.back_to is None else self.back_to)
        low, high = min(ends), max(ends)
        if low <= value <= high or any(same_value(self.parameter, value, end, length) for end in ends):
            return ""
        return f"must be between {low:.12g} and {high:.12g}, where the branch is followed"


@dataclass(frozen=True)
class Leg:
    """Parameters that move together, from where they are to the values `to`.

    It takes `steps` equal steps, each of which ends in a state that is asked for; None: one step, which the
    solver divides as it needs.
    """

    to: Mapping[str, float]
    steps: int | None = None

    def targets(self, here: Mapping[str, float]) -> list[dict[str, float]]:
        """The values at the end of each step; `here` holds those that the leg begins at."""
        count = self.steps or 1
        parts = [
            {name: _between(here[name], end, j, count) for name, end in self.to.items()}
            for j in range(1, count)
        ]
        return [*parts, dict(self.to)]


def _between(start: float, end: float, j: int, steps: int) -> float:
    """The value after j of so many steps, zero where rounding alone keeps it from being zero."""
    value = start + j * (end - start) / steps
    return 0.0 if abs(value) <= 1e-12 * max(abs(start), abs(end)) else value


@dataclass(frozen=True)
class Config:
    """A whole config, checked and resolved.

    `half_twists` n means the linking number n/2, sign included, and is 0 of open strips, whose `parts` have
    ends; `length` is the midline's. `widths` are half-widths b in the order of solving, empty where a state's
    own width is all that is asked for, or where there is a `schedule`; `legs` are either. With `arclength` a
    branch is followed, after the schedule's legs or in place of widths. `text` is the file as written, `path`
    as the user gave it.
    """

    name: str
    half_twists: int
    length: float
    discretisation: str
    guess: Guess
    widths: tuple[float, ...]
    refinement: Refinement
    spectrum: SpectrumRequest
    contact: ContactRequest
    text: str
    path: str
    arclength: Arclength | None = None
    parts: Parts = CLOSED
    schedule: tuple[Leg, ...] = ()

    @property
    def open(self) -> bool:
        """Whether it is of an open strip."""
        return self.parts.ends is not None

    @property
    def sigma(self) -> int:
        """+1 of a two-sided band, -1 of a one-sided one, 0 of an open strip."""
        return 0 if self.open else (-1 if self.half_twists % 2 else 1)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The schedule; `widths` are a leg each."""
        return self.schedule or tuple(Leg({HALF_WIDTH: b}) for b in self.widths)

    def start(self, half_width: float | None = None) -> dict[str, float]:
        """The parameters at the guess, by name; `half_width` is that of a state that the guess comes from."""
        known = half_width if half_width is not None else self.guess.half_width
        others = {name: self.parts.value(name) for name in self.parts.names(self.sigma)[1:]}
        return {HALF_WIDTH: math.nan if known is None else known, **others}

    def last(self) -> dict[str, float]:
        """The parameters after the last leg."""
        return {**self.start(), **{name: value for leg in self.legs for name, value in leg.to.items()}}

    def resolved(self) -> dict[str, Any]:
        """Everything, spelled out with plain values in the config's own layout: itself a valid config."""
        scientific = self.scientific()
        if self.guess.state is not None:
            scientific["initial_guess"]["state"] = self.guess.state
        return {"name": self.name, **scientific}

    def scientific(self) -> dict[str, Any]:
        """The part that determines the states: all but the name, where files lie, and how it was spelled."""
        guess = self.guess
        levels, at = list(self.refinement.levels), self.refinement.at
        part: dict[str, Any] = {
            "topology": "open" if self.open else {"half_twists": self.half_twists},
            "length": self.length,
            "discretisation": self.discretisation,
            **_parts_said(self.parts),
            "initial_guess": (
                {"state": guess.state_as_written, **({"saddle": "keep"} if guess.keep_saddle else {})}
                if guess.recipe == "state"
                else _recipe(guess)
            ),
        }
        if self.widths:
            part["widths"] = list(self.widths)
        branch = [] if self.arclength is None else [{"arclength": _said(self.arclength)}]
        if self.schedule or (self.arclength is not None and self.arclength.parameter != HALF_WIDTH):
            part["schedule"] = [*map(_leg_said, self.schedule), *branch]
        elif branch:
            part["widths"] = branch[0]
        if levels:
            part["refinement"] = levels if at is None else {"levels": levels, "at": list(at)}
        part["spectrum"] = vars(self.spectrum) | {"metrics": list(self.spectrum.metrics)}
        part["contact"] = self.contact.said()
        return part

    def hash8(self) -> str:
        """First 8 hexadecimal digits of the SHA-256 of `scientific()` as canonical JSON (floats by repr)."""
        canonical = json.dumps(self.scientific(), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode("ascii")).hexdigest()[:8]


def _recipe(guess: Guess) -> dict[str, Any]:
    return {
        "recipe": guess.recipe,
        "segments": guess.segments,
        "half_width": guess.half_width,
        **guess.settings,
    }


def _said(record: Arclength) -> dict[str, Any]:
    """The fields of a record that are not empty, in a config's own layout."""
    said = {name: value for name, value in vars(record).items() if value and value != HALF_WIDTH}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in said.items()}


def _parts_said(parts: Parts) -> dict[str, Any]:
    """Ends, material and loads in a config's own layout; nothing of a plain closed band."""
    said = {}
    if parts.ends is not None:
        said["ends"] = {"start": parts.ends.start, "end": parts.ends.end, **_unusual(parts.ends)}
    said |= {"material": _unusual(parts.material), "loads": _unusual(parts.loads)}
    return {name: values for name, values in said.items() if values}


def _unusual(record: Ends | Material | Loads) -> dict[str, Any]:
    """The fields that are not at their defaults, so that a new field changes no hash."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    usual = {f.name: f.default for f in fields(record)}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
        if value != usual[name] and not (isinstance(value, float) and math.isnan(value))
    }


def _leg_said(leg: Leg) -> dict[str, Any]:
    """A leg in a config's own layout."""
    steps = {} if leg.steps is None else {"steps": leg.steps}
    return {name: {"to": value, **steps} if steps else value for name, value in leg.to.items()}


def dump_resolved(config: Config) -> str:
    """`config.resolved()` as YAML text, a line for each setting where it fits."""
    return yaml.safe_dump(
        config.resolved(), sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
