"""What a recipe is: its card, which a config is checked by, and the way to its first state.

A card says which keys the recipe takes, which topologies it can make and which stages it passes through. The
way consists of auxiliary problems that are solved one after another (`Turning`), and of states that are made
without solving (`Making`). `study` walks it, stores each stage, and frees where it ends. A config is checked
without NumPy, so a recipe's file imports at its top nothing that loads it: mathematics come by `doors.Later`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..keys import HALF_WIDTH, SEGMENTS, Integer, Key

if TYPE_CHECKING:
    from ..model.band import Band, State
    from ..model.problem import Prescription

Settings = Mapping[str, Any]
"""A recipe's own settings by key: those besides `segments` and `half_width`, which every recipe has."""


class NotMadeError(ValueError):
    """A state cannot be made without solving; the text says why, and what to change."""


@dataclass(frozen=True)
class Turn:
    """One auxiliary problem: stage `index` of `count`, rulings turned so far.

    The index is not whole where a step that failed was halved. `guard` says what is wrong with a state on the
    way, None if nothing is.
    """

    word: str
    index: float
    count: int
    prescription: Prescription
    guard: Callable[[State], str | None]

    @property
    def name(self) -> str:
        """The stage's name, its key in a run."""
        return turn_name(self.word, self.index, self.count)


def turn_name(word: str, index: float, count: int) -> str:
    """The name of an auxiliary problem's stage."""
    return f"{word} {index:.10g}/{count}"


@dataclass(frozen=True)
class Turning:
    """Auxiliary problems from `first` to `count`, from the state `start` on; each begins at the one before.

    `turn` makes the problem after so many steps, whole or not. `method` is kept with each state.
    """

    method: str
    start: State
    count: int
    turn: Callable[[float], Turn]
    first: int = 1


@dataclass(frozen=True)
class Made:
    """A state that was made without solving, and how.

    `changes` is a dataclass with those fields of its record that do not follow from the state, if there are
    such.
    """

    state: State
    method: str
    changes: object = None


@dataclass(frozen=True)
class Making:
    """Stages that are made without solving, by name.

    `make` is given the number of the stage, from 0, and the state that the part before this one ended at. It
    raises NotMadeError where it cannot.
    """

    stages: tuple[str, ...]
    make: Callable[[int, State | None], Made]


@dataclass(frozen=True)
class Way:
    """The way to the state that is freed: its parts in order, or that state itself, `ready`.

    `method` is kept with the state that freeing leads to.
    """

    method: str
    parts: tuple[Turning | Making, ...] = ()
    ready: State | None = None


@dataclass(frozen=True)
class Recipe:
    """The card of a recipe.

    It makes bands of the half-twists that `fits` takes, in words `half_twists`; an `open` one makes strips
    with ends instead, and a `resting` one bands that rest on themselves from the beginning. For n of them it
    needs at least `fewest(n)` segments, and a half-width below `widest(n)` times the length; `notes` are
    remarks on n and a number of segments that are not wrong.
    `stages` are the names of what it passes through, `passes` the same in words, and `freed` the stage in
    which its last state is freed; these names are keys in runs and never change. `way` is given the band, n
    and the settings. `keys` are its own, besides `segments` and `half_width`.
    """

    name: str
    about: str
    half_twists: str
    fits: Callable[[int], bool]
    passes: str
    freed: str
    way: Callable[[Band, int, Settings], Way]
    stages: Callable[[Settings], tuple[str, ...]] = lambda _: ()
    keys: tuple[Key, ...] = ()
    segments: Integer = SEGMENTS
    fewest: Callable[[int], int] = lambda _: SEGMENTS.low
    widest: Callable[[int], float] = lambda _: 1.0
    notes: Callable[[int, int], tuple[str, ...]] = lambda _, __: ()
    open: bool = False
    resting: bool = False

    @property
    def all_keys(self) -> tuple[Key, ...]:
        """The keys of every recipe, and this one's own."""
        number, width = "number N of facets", "half-width b of the first state"
        return (
            Key("segments", self.segments, number, required=self.segments.expected, examples=(50,)),
            Key("half_width", HALF_WIDTH, width, required="the half-width to start from"),
            *self.keys,
        )

    @property
    def row(self) -> str:
        """The beginning of its row in docs/recipes.md."""
        return f"| `{self.name}` | {self.half_twists} | {self.passes} |"


def steps_key(default: int) -> Key:
    """The key of the number of auxiliary problems."""
    return Key("steps", Integer(1, 10_000), "auxiliary problems on the way to the first state", default)
