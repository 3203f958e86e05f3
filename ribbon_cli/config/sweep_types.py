"""What a sweep says, resolved: its points, each a config with the values that vary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ribbon_cli.config.types import Config, dump_resolved


@dataclass(frozen=True)
class Point:
    """One run of a sweep: the values that vary, by dotted key, and the config that comes of them.

    A value is a number, a text, a truth value, a tuple of these, or a mapping where a whole section varies.
    Of a key whose values are numbers all are integers, or all floats. `config` has no text: `written` has.
    """

    values: Mapping[str, Any]
    config: Config

    @property
    def name(self) -> str:
        """Name of its run, as a config gives it."""
        return self.config.name

    @cached_property
    def run(self) -> str:
        """Name of its run's folder, NAME-HASH8."""
        return f"{self.config.name}-{self.config.hash8()}"

    def written(self, sweep: str) -> Config:
        """The config with a text, as its run keeps it: resolved, and with a line on where it is from."""
        words = ", ".join(f"{key} = {value}" for key, value in self.values.items())
        return replace(
            self.config, text=f"# A point of the sweep {sweep}: {words}\n{dump_resolved(self.config)}"
        )


@dataclass(frozen=True)
class Sweep:
    """A whole sweep, checked: `keys` vary, in the order of the file; of `points` the last group's vary first.

    `groups` are the keys that go together.
    """

    name: str
    groups: tuple[tuple[str, ...], ...]
    points: tuple[Point, ...]
    text: str
    path: str

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary."""
        return tuple(key for group in self.groups for key in group)
