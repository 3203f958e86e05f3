"""Typed reading of nodes: each method gives a value, or None with the mistake recorded."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ribbon_cli.config.document import Node
from ribbon_cli.config.mistakes import Mistakes, near_miss, shown
from ribbon_cli.expression import ExpressionError, evaluate
from ribbon_cli.facts import same_width
from ribbon_cli.keys import Flag, Integer, Items, Number, Section, Takes, Text, Vector, Word

_INTEGER = re.compile(r"[+-]?(?:0|[1-9][0-9]{0,17})")
_BOOLEANS = frozenset({"yes", "no", "true", "false", "on", "off"})  # to YAML 1.1
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_QUOTED = 40  # characters of a quoted text in a message
NUMBER = "a number such as 0.5, 1e-3, 2*pi or pi/30"
_NOT_FINITE = re.compile(r"[+-]?\.?(?:inf|nan)", re.IGNORECASE)

_NONE: Mapping[str, str] = {}


def is_null(node: Node) -> bool:
    """Whether the node is YAML's null: nothing at all, `~` or `null`."""
    return node.kind == "scalar" and not node.quoted and node.text in _NULLS


def got(node: Node) -> str:
    """A description of the node's value, for the end of a message."""
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
    """Reads the values of one document, recording what is wrong with them in `mistakes`.

    Numbers in the unit of the length must be less than `length`, once that is known.
    """

    def __init__(self, mistakes: Mistakes) -> None:
        self.length: float | None = None
        self._mistakes = mistakes

    @property
    def count(self) -> int:
        """The number of mistakes so far."""
        return len(self._mistakes.found)

    def report(self, node: Node, field: str, message: str) -> None:
        """Record a mistake at `node`."""
        self._mistakes.add(node.line, node.column, field, message)

    def section(self, node: Node, field: str, section: Section, refused: Mapping[str, str] = _NONE) -> Found:
        """The values of a section by key; none where the node is not a mapping.

        Keys must belong to the section and be given once, with a value. `refused` gives the reason why a key
        must not be there. A key with a mistake, or whose name was most likely misspelt, has an invalid node.
        """
        known = tuple(key.name for key in section.keys)
        found: dict[str, Node] = {}
        if node.kind != "mapping":
            self.wrong(node, field, f"must be a mapping {{{', '.join(f'{key}: ...' for key in known)}}}")
            return Found(self, field, section, found)
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
                self._unknown(key, path, known, section.name, found)
            elif is_null(value):
                self.report(key, path, "has no value: give one, or leave the key out")
                found[key.text] = Node(key.line, key.column, "invalid")
            else:
                found[key.text] = value
        # A section with only unknown keys was meant as something else.
        misunderstood = field != "" and not found and bool(first_line)
        for wanted in section.keys:
            if wanted.required and wanted.name not in found and not misunderstood:
                self.report(node, prefix + wanted.name, f"is missing: give {wanted.required}")
        return Found(self, field, section, found)

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

    def items(self, node: Node, field: str, takes: Items) -> Iterator[tuple[Node, str, Any]]:
        """The items of a list, each with its field path and its value, None of a section.

        There are none where there are none to read.
        """
        if node.kind != "list":
            self.wrong(node, field, "must be a list")
        elif not node.items:
            self.report(node, field, "must have at least one item, got an empty list")
        elif len(node.items) > takes.at_most:
            self.report(node, field, f"must have at most {takes.at_most} items, got {len(node.items)}")
        else:
            for index, item in enumerate(node.items):
                path = f"{field}[{index}]"
                yield item, path, None if isinstance(takes.of, Section) else self.read(item, path, takes.of)

    def read(self, node: Node, field: str, takes: Takes) -> Any:
        """A value of the kind that a key takes; of a list its values, each once, in order."""
        match takes:
            case Integer():
                return self._integer(node, field, takes)
            case Number():
                return self._number(node, field, takes)
            case Word():
                return self._word(node, field, takes.choices)
            case Flag():
                word = self._word(node, field, ("true", "false"))
                return None if word is None else word == "true"
            case Text():
                return self._text(node, field, takes)
            case Items():
                return self._ordered(node, field, takes)
            case Vector():
                return self._vector(node, field, takes)
        raise TypeError(f"{field}: holds values of its own")

    def _ordered(self, node: Node, field: str, takes: Items) -> tuple[Any, ...] | None:
        """The right values of a list, ascending, words in the order of the choices; None without a list."""
        chosen: list[Any] = []
        for item, path, value in self.items(node, field, takes):
            if value is None:
                continue
            if not any(
                value == other if isinstance(value, str) else same_width(value, other) for other in chosen
            ):
                chosen.append(value)
            elif takes.once:
                shown_value = value if isinstance(value, str) else got(item)
                self.report(item, path, f"must be given once, got {shown_value} again")
        if node.kind != "list":
            return None
        return tuple(sorted(chosen, key=takes.of.choices.index if isinstance(takes.of, Word) else None))

    def _vector(self, node: Node, field: str, takes: Vector) -> tuple[float, ...] | None:
        if node.kind != "list" or len(node.items) != 3:
            found = f"a list of {len(node.items)}" if node.kind == "list" else got(node)
            if node.kind != "invalid":
                self.report(node, field, f"must be a list of three numbers, as [0, -1, 0], got {found}")
            return None
        values = [self._number(item, f"{field}[{k}]", takes.of) for k, item in enumerate(node.items)]
        known = tuple(value for value in values if value is not None)
        return known if len(known) == len(values) else None

    def _number(self, node: Node, field: str, takes: Number) -> float | None:
        below, limit = takes.below, takes.limit
        if takes.unit:
            below, limit = self.length, "the band's length"
        if node.kind != "scalar" or node.quoted or node.text in _NULLS or node.text.lower() in _BOOLEANS:
            self.wrong(node, field, f"must be {NUMBER}")
            return None
        if _NOT_FINITE.fullmatch(node.text):
            self.wrong(node, field, "must be finite")
            return None
        try:
            value = evaluate(node.text)
        except ExpressionError as error:
            self.report(node, field, f"must be {NUMBER}, got {got(node)} ({error})")
            return None
        if takes.above is not None and value <= takes.above:
            self.wrong(node, field, f"must be > {takes.above:g}")
            return None
        if value < takes.low:
            self.wrong(node, field, f"must be at least {takes.low:g}")
            return None
        if below is not None and value >= below:
            self.wrong(node, field, f"must be < {below:g}" + (f", {limit}" if limit else ""))
            return None
        if takes.high is not None and value > takes.high:
            self.wrong(node, field, f"must be at most {takes.high:g}")
            return None
        return value

    def _integer(self, node: Node, field: str, takes: Integer) -> int | None:
        if node.kind == "scalar" and not node.quoted and _INTEGER.fullmatch(node.text):
            value = int(node.text)
            if takes.low <= value <= takes.high:
                return value
        self.wrong(node, field, f"must be an integer from {takes.low} to {takes.high}")
        return None

    def _word(self, node: Node, field: str, choices: tuple[str, ...]) -> str | None:
        if node.kind == "scalar" and node.text in choices:
            return node.text
        meant = near_miss(node.text, choices) if node.kind == "scalar" else None
        hint = f", did you mean {meant}?" if meant else ""
        if node.kind != "invalid":
            self.report(node, field, f"must be {_or(choices)}, got {got(node)}{hint}")
        return None

    def _text(self, node: Node, field: str, takes: Text) -> str | None:
        text = node.text
        if node.kind == "scalar" and not is_null(node) and text.isprintable() and takes.fits(text):
            return text
        self.wrong(node, field, f"must be {takes.expected}")
        return None

    def wrong(self, node: Node, field: str, expected: str) -> None:
        """Record `expected` and what was found, unless the node's mistake is already recorded."""
        if node.kind != "invalid":
            self.report(node, field, f"{expected}, got {got(node)}")


class Found:
    """What a section of the document holds; `nodes` has the values that were given by key."""

    def __init__(self, reader: Reader, field: str, section: Section, nodes: dict[str, Node]) -> None:
        self.nodes = nodes
        self._reader = reader
        self._field = field
        self._keys = {key.name: key for key in section.keys}

    def path(self, name: str) -> str:
        """The field path of a key."""
        return f"{self._field}.{name}" if self._field else name

    def read(self, name: str) -> Any:
        """A key's value, or its default where it is not given; None where it is wrong (then recorded)."""
        key = self._keys[name]
        if name in self.nodes:
            return self._reader.read(self.nodes[name], self.path(name), key.takes)
        if isinstance(key.takes, Items):
            return key.default or ()
        spelled = isinstance(key.takes, Number) and isinstance(key.default, str)
        return evaluate(key.default) if spelled else key.default

    def values(self) -> dict[str, Any]:
        """The values of all keys, as `read` gives them: the fields of the record that holds the section."""
        return {name: self.read(name) for name in self._keys}

    def items(self, name: str) -> Iterator[tuple[Node, str, Any]]:
        """The items of a list, as `Reader.items` gives them; none where there is no such key."""
        takes = self._keys[name].takes
        if name in self.nodes and isinstance(takes, Items):
            yield from self._reader.items(self.nodes[name], self.path(name), takes)

    def report(self, name: str, message: str) -> None:
        """Record a mistake at a key's value."""
        self._reader.report(self.nodes[name], self.path(name), message)


def _or(words: tuple[str, ...]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
