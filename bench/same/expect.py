"""Differences that are expected: a YAML list of patterns, each with its reason."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from pathlib import Path

import yaml

from .cases import CaseError
from .differences import KINDS, Difference

_FIELDS = tuple(item.name for item in fields(Difference))


@dataclass(frozen=True)
class Expected:
    """Patterns (`*`, `?`, `[...]`) by the difference's fields, all of which must match, and why."""

    patterns: dict[str, str]
    reason: str

    def matches(self, difference: Difference) -> bool:
        """Whether this is one of those expected."""
        return all(fnmatchcase(getattr(difference, name), glob) for name, glob in self.patterns.items())


def read_expected(path: Path) -> tuple[Expected, ...]:
    """The expectations of a file. Raises CaseError."""
    try:
        items = yaml.safe_load(path.read_text(encoding="utf-8")) or []
        return tuple(_expected(item) for item in items)
    except (OSError, yaml.YAMLError, TypeError, AttributeError) as error:
        raise CaseError(f"{path}: {type(error).__name__}: {error}") from error


def _expected(item: dict[str, str]) -> Expected:
    """One entry."""
    patterns = {key: str(value) for key, value in item.items() if key != "reason"}
    if unknown := set(patterns) - set(_FIELDS):
        raise CaseError(f"expected: unknown key {min(unknown)!r}; known are reason, {', '.join(_FIELDS)}")
    if not patterns or not item.get("reason"):
        raise CaseError(f"expected: {item}: give a reason, and at least one of {', '.join(_FIELDS)}")
    if not any(fnmatchcase(kind, patterns.get("kind", "*")) for kind in KINDS):
        raise CaseError(f"expected: kind {patterns['kind']!r} is none of {', '.join(KINDS)}")
    return Expected(patterns, str(item["reason"]))


def split(
    differences: Iterable[Difference], expected: tuple[Expected, ...]
) -> tuple[list[Difference], list[int]]:
    """The differences that nobody expected, and how many each expectation covers."""
    left, covered = [], [0] * len(expected)
    for difference in differences:
        hits = [k for k, item in enumerate(expected) if item.matches(difference)]
        for k in hits:
            covered[k] += 1
        if not hits:
            left.append(difference)
    return left, covered
