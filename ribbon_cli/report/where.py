"""Conditions on rows of a table: columns compared with values, `and`, `or`, `not`; nothing else.

Python's own parser reads the text. Only the nodes that are listed here are accepted, and nothing is
evaluated. A comparison with a missing value does not hold. Numbers are equal if they agree to 1e-9, as widths
in references are.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from ribbon_cli.errors import UsageError
from ribbon_cli.store import suggest

LONGEST = 2000
"""Most characters of a condition."""
EQUAL = 1e-9


class Condition(Protocol):
    """Tells whether it holds of a row."""

    def __call__(self, row: Mapping[str, Any], /) -> bool:
        """Whether it holds."""


_ORDERS: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_EQUALS: dict[type, bool] = {ast.Eq: True, ast.NotEq: False}
_WORDS = {"number": "a number", "text": "a text", "truth": "true or false"}


def condition(text: str, kinds: Mapping[str, str]) -> Condition:
    """The condition that a text states; `kinds` is `number`, `text` or `truth` for each column.

    Raises UsageError, one line with the place in the text, for what is not understood.
    """
    return _Reader(text, kinds).read()


class _Reader:
    def __init__(self, text: str, kinds: Mapping[str, str]) -> None:
        self._text = text
        self._kinds = kinds

    def read(self) -> Condition:
        if len(self._text) > LONGEST:
            raise UsageError(f"--where: at most {LONGEST} characters, got {len(self._text)}")
        try:
            tree = ast.parse(self._text.strip(), mode="eval")
        except SyntaxError as error:
            raise UsageError(self._message(error.offset or 1, f"not a condition: {error.msg}")) from None
        except (ValueError, RecursionError, MemoryError) as error:
            raise UsageError(self._message(1, f"not a condition: {error}")) from None
        try:
            return self._condition(tree.body)
        except RecursionError:
            raise UsageError(self._message(1, "not a condition: nested too deeply")) from None

    def _condition(self, node: ast.expr) -> Condition:
        match node:
            case ast.BoolOp(op=op, values=values):
                parts = [self._condition(value) for value in values]
                together = all if isinstance(op, ast.And) else any
                return lambda row: together(part(row) for part in parts)
            case ast.UnaryOp(op=ast.Not(), operand=inner):
                part = self._condition(inner)
                return lambda row: not part(row)
            case ast.Compare(left=left, ops=ops, comparators=others):
                pairs = list(map(self._comparison, [left, *others[:-1]], others, ops))
                return lambda row: all(pair(row) for pair in pairs)
            case ast.Name() | ast.Attribute():
                name = self._name(node)
                if self._kind(node, name) != "truth":
                    words = f"{name} is {_WORDS[self._kinds[name]]}: compare it with something"
                    raise self._wrong(node, words)
                return lambda row: bool(row.get(name))
        raise self._wrong(node, "expected a comparison such as energy < 5, joined by and, or, not")

    def _comparison(self, left: ast.expr, right: ast.expr, op: ast.cmpop) -> Condition:
        (first, kind), (second, other) = self._side(left), self._side(right)
        if kind != other:
            words = f"{_WORDS[kind]} is compared with {_WORDS[other]}"
            raise self._wrong(right, words)
        if type(op) in _EQUALS:
            wanted = _EQUALS[type(op)]
            return lambda row: _both(first(row), second(row), lambda a, b: _equal(a, b) is wanted)
        order = _ORDERS.get(type(op))
        if order is None:
            raise self._wrong(right, "compare by <, <=, >, >=, == or !=")
        if kind == "truth":
            raise self._wrong(right, "true and false are compared by == or !=")
        return lambda row: _both(first(row), second(row), order)

    def _side(self, node: ast.expr) -> tuple[Callable[[Mapping[str, Any]], Any], str]:
        """A side of a comparison and its kind."""
        match node:
            case ast.Constant(value=value) if isinstance(value, bool):
                return (lambda row: value), "truth"
            case ast.Constant(value=value) if isinstance(value, int | float) and math.isfinite(value):
                return (lambda row: value), "number"
            case ast.Constant(value=value) if isinstance(value, str):
                return (lambda row: value), "text"
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return (lambda row: -value), "number"
            case ast.Name(id="true" | "false" as word):
                return (lambda row: word == "true"), "truth"
            case ast.Name() | ast.Attribute():
                name = self._name(node)
                return (lambda row: row.get(name)), self._kind(node, name)
        raise self._wrong(node, "expected a column, a number or a text in quotes")

    def _name(self, node: ast.expr) -> str:
        """A column's name, which may have dots."""
        if isinstance(node, ast.Attribute):
            return f"{self._name(node.value)}.{node.attr}"
        if not isinstance(node, ast.Name):
            raise self._wrong(node, "expected a column, a number or a text in quotes")
        return node.id

    def _kind(self, node: ast.expr, name: str) -> str:
        if name not in self._kinds:
            near = suggest(name, self._kinds) or "; without --where the columns are in --json"
            raise self._wrong(node, f"no column {name!r}{near}")
        return self._kinds[name]

    def _wrong(self, node: ast.expr, words: str) -> UsageError:
        return UsageError(self._message(node.col_offset + 1, words))

    def _message(self, column: int, words: str) -> str:
        return f"--where: column {column}: {words}"


def _both(first: Any, second: Any, holds: Callable[[Any, Any], bool]) -> bool:
    """Whether a comparison of two values holds; with a missing value it does not."""
    return not (_missing(first) or _missing(second)) and holds(first, second)


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _equal(first: Any, second: Any) -> bool:
    if isinstance(first, float) or isinstance(second, float):
        return math.isclose(first, second, rel_tol=EQUAL)
    return bool(first == second)
