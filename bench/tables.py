"""What the sections of a page share: rules with their figures, tables, milliseconds."""

from __future__ import annotations

Rule = tuple[str, bool]
"""A requirement in words with its figure, and whether it is met."""


def table(head: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """A table, Markdown."""
    rows = [head, tuple("---" for _ in head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def required(rules: list[Rule]) -> str:
    """The table of rules."""
    return table(("required", "met"), [(text, "yes" if met else "**no**") for text, met in rules])


def milliseconds(seconds: float) -> str:
    """Seconds as milliseconds."""
    return f"{1000 * seconds:.1f}" if seconds < 0.1 else f"{1000 * seconds:.0f}"
