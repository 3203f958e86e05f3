"""What a config says, resolved: frozen records of plain Python values."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

METRICS = ("euclidean", "physical")


@dataclass(frozen=True)
class Guess:
    """Where the first state comes from: a recipe, or (`recipe` "state") a stored state.

    `segments` N and `half_width` b are None with a state, which brings its own. `settings` are the recipe's
    other keys. `state` is what to open, a reference
    or an absolute path; `state_as_written` is what the config says, at `line` and `column` of its file.
    `keep_saddle` asks for the stationary point next to the state, whatever its index.
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


STOPS = ("fold", "stability-lost", "contact")
"""Events at which a branch can be asked to stop."""


@dataclass(frozen=True)
class Arclength:
    """What a branch is followed for, by pseudo-arclength continuation in the half-width b.

    It begins towards `to`, with `both` also the other way, and ends where b leaves the range of the start's
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


@dataclass(frozen=True)
class Config:
    """A whole config, checked and resolved.

    `half_twists` n means the linking number n/2, sign included; `length` is the midline's. `widths` are
    half-widths b in the order of solving, empty where a state's own width is all that is asked for. With
    `arclength` a branch is followed instead. `text` is the file as written, `path` as the user gave it.
    """

    name: str
    half_twists: int
    length: float
    discretisation: str
    guess: Guess
    widths: tuple[float, ...]
    refinement: Refinement
    spectrum: SpectrumRequest
    contact: str
    text: str
    path: str
    arclength: Arclength | None = None

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
            "topology": {"half_twists": self.half_twists},
            "length": self.length,
            "discretisation": self.discretisation,
            "initial_guess": (
                {"state": guess.state_as_written, **({"saddle": "keep"} if guess.keep_saddle else {})}
                if guess.recipe == "state"
                else _recipe(guess)
            ),
        }
        if self.widths:
            part["widths"] = list(self.widths)
        if self.arclength is not None:
            part["widths"] = {"arclength": _said(self.arclength)}
        if levels:
            part["refinement"] = levels if at is None else {"levels": levels, "at": list(at)}
        part["spectrum"] = vars(self.spectrum) | {"metrics": list(self.spectrum.metrics)}
        part["contact"] = self.contact
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
    """The fields of a record that say something, in a config's own layout."""
    said = {name: value for name, value in vars(record).items() if value}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in said.items()}


def dump_resolved(config: Config) -> str:
    """`config.resolved()` as YAML text, a line for each setting where it fits."""
    return yaml.safe_dump(
        config.resolved(), sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
