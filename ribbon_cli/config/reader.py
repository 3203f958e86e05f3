"""Typed reading of nodes: each method gives a value, or None with the problem recorded."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from ribbon_cli.config.document import Node
from ribbon_cli.config.problems import Problems, near_miss, shown
from ribbon_cli.expression import ExpressionError, evaluate

_INTEGER = re.compile(r"[+-]?(?:0|[1-9][0-9]{0,17})")
_BOOLEANS = frozenset({"yes", "no", "true", "false", "on", "off"})  # to YAML 1.1
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_QUOTED = 40  # characters of a quoted text in a message
_NUMBER = "a number such as 0.5, 1e-3, 2*pi or pi/30"
_NOT_FINITE = re.compile(r"[+-]?\.?(?:inf|nan)", re.IGNORECASE)

_NONE: Mapping[str, str] = {}

Limit = tuple[float, str]
"""A value and what it is, for messages."""


def is_null(node: Node) -> bool:
    """Whether the node is YAML's null: nothing at all, `~` or `null`."""
    return node.kind == "scalar" and not node.quoted and node.text in _NULLS


def got(node: Node) -> str:
    """What stands at the node, for the end of a message."""
    if node.kind == "list":
        return "a list"
    if node.kind == "mapping":
        return "a mapping"
    if node.quoted:
        return f"the text {node.text[:_QUOTED]!a}{'...' * (len(node.text) > _QUOTED)} (in quotes)"
    if is_null(node):
        return "nothing"
    if node.text.lower() in _BOOLEANS:
        return f"{node.text} (to YAML, true or false)"
    return shown(node.text)


class Reader:
    """Reads the values of one document, recording what is wrong with them in `problems`."""

    def __init__(self, problems: Problems) -> None:
        self._problems = problems

    def report(self, node: Node, field: str, message: str) -> None:
        """Record a problem at `node`."""
        self._problems.add(node.line, node.column, field, message)

    def mapping(
        self,
        node: Node,
        field: str,
        known: Iterable[str],
        *,
        required: Mapping[str, str] = _NONE,
        refused: Mapping[str, str] = _NONE,
        what: str = "",
    ) -> dict[str, Node]:
        """The values of a mapping by key; an empty dict where the node is none.

        Keys must be `known` and given once, with a value. `required` says for a key that must be there
        what to give, `refused` for one that must not be there why. A key with a problem, or whose name
        was most likely misspelt, has an invalid node. `what` names the owner of the keys in messages.
        """
        known = tuple(known)
        if node.kind != "mapping":
            self.wrong(node, field, f"must be a mapping {{{', '.join(f'{key}: ...' for key in known)}}}")
            return {}
        found: dict[str, Node] = {}
        first_line: dict[str, int] = {}
        prefix = f"{field}." if field else ""
        for key, value in zip(node.items[::2], node.items[1::2], strict=True):
            if key.kind != "scalar":
                self.wrong(key, field, "a key must be a word")
                continue
            path = prefix + shown(key.text)
            if key.text in first_line:
                self.report(key, path, f"duplicate key, first given on line {first_line[key.text]}")
                continue
            first_line[key.text] = key.line
            if key.text in refused:
                self.report(key, path, refused[key.text])
            elif key.text not in known:
                self._unknown(key, path, known, what, found)
            elif is_null(value):
                self.report(key, path, "has no value: give one, or leave the key out")
                found[key.text] = Node(key.line, key.column, "invalid")
            else:
                found[key.text] = value
        # A section made of nothing but unknown keys was meant as something else altogether.
        misunderstood = field != "" and not found and bool(first_line)
        for name, give in required.items():
            if name not in found and not misunderstood:
                self.report(node, prefix + name, f"is missing: give {give}")
        return found

    def _unknown(
        self, key: Node, path: str, known: tuple[str, ...], what: str, found: dict[str, Node]
    ) -> None:
        meant = near_miss(key.text, known)
        owner = f" for {what}" if what else ""
        if meant is None:
            self.report(key, path, f"unknown key{owner}: expected {_or(known)}")
            return
        self.report(key, path, f"unknown key{owner}: did you mean {meant}?")
        found.setdefault(meant, Node(key.line, key.column, "invalid"))

    def items(self, node: Node, field: str, at_most: int) -> list[tuple[Node, str]]:
        """The items of a list, each with its field path; empty where there are none to read."""
        if node.kind != "list":
            self.wrong(node, field, "must be a list")
        elif not node.items:
            self.report(node, field, "must have at least one item, got an empty list")
        elif len(node.items) > at_most:
            self.report(node, field, f"must have at most {at_most} items, got {len(node.items)}")
        else:
            return [(item, f"{field}[{index}]") for index, item in enumerate(node.items)]
        return []

    def positive(self, node: Node, field: str, below: Limit | None = None, low: float = 0.0) -> float | None:
        """A finite number > 0, less than `below` and not less than `low`."""
        if node.kind != "scalar" or node.quoted or node.text in _NULLS or node.text.lower() in _BOOLEANS:
            self.wrong(node, field, f"must be {_NUMBER}")
            return None
        if _NOT_FINITE.fullmatch(node.text):
            self.wrong(node, field, "must be finite")
            return None
        try:
            value = evaluate(node.text)
        except ExpressionError as error:
            self.report(node, field, f"must be {_NUMBER}, got {got(node)} ({error})")
            return None
        if value <= 0.0:
            self.wrong(node, field, "must be > 0")
            return None
        if value < low:
            self.wrong(node, field, f"must be at least {low:g}")
            return None
        if below is not None and value >= below[0]:
            self.wrong(node, field, f"must be < {below[0]:g}, {below[1]}")
            return None
        return value

    def integer(self, node: Node, field: str, low: int, high: int) -> int | None:
        """An integer from `low` to `high`, in decimal digits."""
        if node.kind == "scalar" and not node.quoted and _INTEGER.fullmatch(node.text):
            value = int(node.text)
            if low <= value <= high:
                return value
        self.wrong(node, field, f"must be an integer from {low} to {high}")
        return None

    def word(self, node: Node, field: str, choices: Iterable[str]) -> str | None:
        """One of `choices`."""
        choices = tuple(choices)
        if node.kind == "scalar" and node.text in choices:
            return node.text
        meant = near_miss(node.text, choices) if node.kind == "scalar" else None
        hint = f", did you mean {meant}?" if meant else ""
        if node.kind != "invalid":
            self.report(node, field, f"must be {_or(choices)}, got {got(node)}{hint}")
        return None

    def text(self, node: Node, field: str, expected: str) -> str | None:
        """A scalar's text, whatever YAML would take it for; not empty, and printable."""
        if node.kind == "scalar" and not is_null(node) and node.text and node.text.isprintable():
            return node.text
        self.wrong(node, field, f"must be {expected}")
        return None

    def wrong(self, node: Node, field: str, expected: str) -> None:
        """Record `expected` and what stands there instead, unless the node is on record already."""
        if node.kind != "invalid":
            self.report(node, field, f"{expected}, got {got(node)}")


def close(a: float, b: float) -> bool:
    """Whether two positive numbers are the same width: equal to 1e-9 relative, as references compare."""
    return math.isclose(a, b, rel_tol=1e-9)


def _or(words: tuple[str, ...]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
