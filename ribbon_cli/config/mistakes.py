"""What is wrong with a config: mistakes with positions, and the error that carries them all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

from ribbon_cli.errors import UsageError

MOST_MISTAKES = 50
"""Reading stops here: nobody corrects more at once, and a hostile file must not cost more."""

_SHOWN = 48  # characters of a value quoted in a message


@dataclass(frozen=True)
class Mistake:
    """One thing wrong with a config.

    `line` and `column` count from 1; both are 0 where the whole file is meant (it does not exist).
    `field` is the path of the offending key (`widths[2]`, `spectrum.modes`), empty where there is none.
    """

    line: int
    column: int
    field: str
    message: str


class ConfigError(UsageError):
    """A config that cannot be used. `mistakes` holds all that was found, in the order of the file.

    Its text has a line for each, `mobius.yaml:7:14: widths[2]: must be > 0, got -0.5`.
    """

    def __init__(self, path: str, mistakes: Iterable[Mistake]) -> None:
        self.path = path
        self.mistakes = tuple(sorted(mistakes, key=lambda p: (p.line, p.column)))
        super().__init__(path, self.mistakes)

    def __str__(self) -> str:
        file = self.path if self.path.isprintable() else ascii(self.path)
        return "\n".join(_line(file, mistake) for mistake in self.mistakes)


def _line(file: str, mistake: Mistake) -> str:
    where = f"{file}:{mistake.line}:{mistake.column}" if mistake.line else file
    return f"{where}: {mistake.field}: {mistake.message}" if mistake.field else f"{where}: {mistake.message}"


class Mistakes:
    """Collects the mistakes of one file while reading goes on."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.found: list[Mistake] = []

    def add(self, line: int, column: int, field: str, message: str) -> None:
        """Record a mistake; raises `ConfigError` when `MOST_MISTAKES` are reached."""
        self.found.append(Mistake(line, column, field, message))
        if len(self.found) >= MOST_MISTAKES:
            raise self.error()

    def error(self) -> ConfigError:
        """The error to raise with everything found so far."""
        found = list(self.found)
        if len(found) >= MOST_MISTAKES:
            last = max(found, key=lambda p: (p.line, p.column))
            found.append(Mistake(last.line, last.column, "", f"reading stopped after {len(found)} problems"))
        return ConfigError(self.path, found)


def shown(text: str) -> str:
    """`text` fit for one line of a message: shortened, anything that is not printable escaped."""
    short = text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."
    return short if short and short.isprintable() else ascii(short)


def near_miss(word: str, known: Iterable[str]) -> str | None:
    """The one of `known` that `word` was most likely meant to be, or None."""
    if len(word) > _SHOWN:
        return None

    matches = get_close_matches(word.lower(), list(known), n=1)
    return matches[0] if matches else None
