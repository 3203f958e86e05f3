"""What a table of keys is made of: keys, and the kinds of values that they take.

The table itself is `config.table.CONFIG`, of which each recipe has its part (`recipes/`). The reader, the
JSON Schema and the documentation's table follow from it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Integer:
    """An integer from `low` to `high`, even where `even`."""

    low: int
    high: int
    even: bool = False

    @property
    def expected(self) -> str:
        """What to give, in words."""
        return f"an {'even ' if self.even else ''}integer from {self.low} to {self.high}"


@dataclass(frozen=True)
class Number:
    """A finite number > `above`, not less than `low`, less than `below`, which messages call `limit`, and at
    most `high`.
    """

    low: float = 0.0
    below: float | None = None
    limit: str = ""
    unit: str = ""
    above: float | None = 0.0
    high: float | None = None


@dataclass(frozen=True)
class Word:
    """One of `choices`."""

    choices: tuple[str, ...]


@dataclass(frozen=True)
class Vector:
    """A list of three numbers, the components along x, y and z."""

    of: Number


@dataclass(frozen=True)
class Flag:
    """True or false."""


@dataclass(frozen=True)
class Text:
    """Printable text of at most `longest` characters that a `pattern` describes, whatever YAML takes it for.

    The pattern means the same to Python and to ECMAScript, which schemas are written for.
    """

    expected: str
    pattern: str
    longest: int

    def fits(self, text: str) -> bool:
        """Whether the text is one that is described."""
        return 0 < len(text) <= self.longest and re.fullmatch(self.pattern, text) is not None


@dataclass(frozen=True)
class Items:
    """A list of 1 to `at_most` items, each given `once` where that is asked for."""

    of: Integer | Number | Word | Text | Section
    at_most: int
    once: bool = False


@dataclass(frozen=True)
class Section:
    """A mapping with these keys and no others; `name` and `about` tell it from others at the same place."""

    keys: tuple[Key, ...]
    name: str = ""
    about: str = ""


@dataclass(frozen=True)
class Either:
    """One of several kinds of values, told apart by what stands there; `expected` says which in a message."""

    kinds: tuple[Number | Word | Items | Section, ...]
    expected: str = ""


Takes = Integer | Number | Word | Vector | Flag | Text | Items | Section | Either


@dataclass(frozen=True)
class Key:
    """A key of a section: its name, the values that it takes, and its meaning in a sentence.

    `default` is what stands for it, as a config would say it, or in words `otherwise`; `required` says of a
    key that must be there what to give.
    """

    name: str
    takes: Takes
    meaning: str
    default: Any = None
    required: str = ""
    otherwise: str = ""
    examples: tuple[Any, ...] = ()


SEGMENTS = Integer(8, 1_000_000)
HALF_WIDTH = Number(unit="length")
