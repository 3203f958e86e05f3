"""Texts that others wrote, fit to be shown: names, logs, configs and labels may hold anything."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from unicodedata import category


def visible(text: str, keep: str = "") -> str:
    """Return a text with every character escaped that would not be seen, but might be obeyed.

    These are the controls, which a terminal takes for orders, marks that turn the direction of what follows,
    line and paragraph separators, halves of surrogate pairs and whatever else does not print. Spaces of any
    width stay, and what is in `keep`.
    """
    rest = text
    for character in keep:
        rest = rest.replace(character, "")
    if rest.isprintable():  # asked of the whole: long tables are nearly always
        return text
    return "".join(
        c if c.isprintable() or c in keep or category(c) == "Zs" else c.encode("unicode_escape").decode()
        for c in text
    )


def in_a_line(error: Exception) -> str:
    """What an error says, on one line; its kind where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__


def aligned(rows: Sequence[Sequence[str]], left: Container[int] = ()) -> str:
    """Rows of cells in columns two spaces apart; columns are aligned on the right but for those `left`."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    form = "  ".join(f"{{:{'<' if k in left else '>'}{width}}}" for k, width in enumerate(widths))
    return "\n".join(form.format(*row).rstrip() for row in rows)


def pipes(rows: Sequence[Sequence[str]], left: Container[int] = ()) -> str:
    """The same as a pipe table of Markdown, the heads first."""
    rule = [":---" if k in left else "---:" for k in range(len(rows[0]))]
    return "\n".join(f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:]))


def listed(words: Iterable[str], most: int = 12) -> str:
    """The first few of some words, and how many there are besides: `a, b and 3 more`."""
    words = list(words)
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def ranges(labels: Sequence[int]) -> str:
    """Ascending labels, those that follow each other as first to last: `3, 5-8`."""
    runs: list[list[int]] = []
    for label in labels:
        if runs and label == runs[-1][-1] + 1:
            runs[-1].append(label)
        else:
            runs.append([label])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
