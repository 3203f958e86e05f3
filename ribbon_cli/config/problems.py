"""What is wrong with a config: problems with positions, and the error that carries them all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ribbon_cli.errors import UsageError

MAX_PROBLEMS = 50
"""Reading stops here: nobody mends more at once, and a hostile file must not cost more."""

_SHOWN = 48  # characters of a value quoted in a message


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a config.

    `line` and `column` count from 1; both are 0 where the whole file is meant (it does not exist).
    `field` is the path of the offending key (`widths[2]`, `spectrum.modes`), empty where there is none.
    """

    line: int
    column: int
    field: str
    message: str


class ConfigError(UsageError):
    """A config that cannot be used. `problems` holds all that was found, in the order of the file.

    Its text has a line for each, `mobius.yaml:7:14: widths[2]: must be > 0, got -0.5`.
    """

    def __init__(self, path: str, problems: Iterable[Problem]) -> None:
        self.path = path
        self.problems = tuple(sorted(problems, key=lambda p: (p.line, p.column)))
        super().__init__(path, self.problems)

    def __str__(self) -> str:
        file = self.path if self.path.isprintable() else ascii(self.path)
        return "\n".join(_line(file, problem) for problem in self.problems)


def _line(file: str, problem: Problem) -> str:
    where = f"{file}:{problem.line}:{problem.column}" if problem.line else file
    return f"{where}: {problem.field}: {problem.message}" if problem.field else f"{where}: {problem.message}"


class Problems:
    """Collects the problems of one file while reading goes on."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.found: list[Problem] = []

    def add(self, line: int, column: int, field: str, message: str) -> None:
        """Record a problem; raises `ConfigError` when `MAX_PROBLEMS` are reached."""
        self.found.append(Problem(line, column, field, message))
        if len(self.found) >= MAX_PROBLEMS:
            raise self.error()

    def error(self) -> ConfigError:
        """The error to raise with everything found so far."""
        found = list(self.found)
        if len(found) >= MAX_PROBLEMS:
            last = max(found, key=lambda p: (p.line, p.column))
            found.append(Problem(last.line, last.column, "", f"reading stopped after {len(found)} problems"))
        return ConfigError(self.path, found)


def shown(text: str) -> str:
    """`text` fit for one line of a message: shortened, anything that is not printable escaped."""
    short = text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."
    return short if short and short.isprintable() else ascii(short)


def near_miss(word: str, known: Iterable[str]) -> str | None:
    """The one of `known` that `word` was most likely meant to be, or None."""
    if len(word) > _SHOWN:
        return None
    from difflib import get_close_matches

    matches = get_close_matches(word.lower(), list(known), n=1)
    return matches[0] if matches else None
