"""Conditions on rows of a table: columns compared with values, `and`, `or`, `not`; nothing else.

Python's own parser reads the text. Only the nodes that are listed here are accepted, and nothing is
evaluated. A comparison with a missing value does not hold. Numbers are equal if they agree to 1e-9, as widths
in references are.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, Protocol

from ribbon_cli.errors import UsageError
from ribbon_cli.parts import PARAMETERS
from ribbon_cli.store import suggest

LONGEST = 2000
"""Most characters of a condition."""
EQUAL = 1e-9
_SYNONYMS = {"b": "half_width", "N": "segments", "E": "energy", "twist_plus_writhe": "linking_number"}
"""Columns by names that other places give them."""
_QUOTED = re.compile(r"""('[^']*'|"[^"]*")""")
_NUMBERED = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.\w+)*\.\d+(?:\.\w+)*")


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


def near(name: str, columns: Collection[str]) -> str:
    """Return "; did you mean ...?" for a column that is not there, or nothing."""
    meant = _SYNONYMS.get(name) or (f"parameter_{name}" if name in PARAMETERS else "")
    return f"; did you mean {meant}?" if meant in columns else suggest(name, columns)


def hints(text: str | None, columns: Collection[str]) -> list[str]:
    """What is worth telling of a condition that is understood: two quantities are called twist."""
    both = {"twist", "parameter_twist"} <= set(columns)
    if both and re.search(r"(?<![\w.])twist\b", text or ""):
        return ["--where: twist is Tw, in turns; the angle of a strip's end is parameter_twist"]
    return []


class _Reader:
    def __init__(self, text: str, kinds: Mapping[str, str]) -> None:
        self._text = text
        self._kinds = kinds
        self._spelled: dict[str, str] = {}
        """Columns with numbers in their names, as `widths.0`, by names that Python can read."""

    def read(self) -> Condition:
        if len(self._text) > LONGEST:
            raise UsageError(f"--where: at most {LONGEST} characters, got {len(self._text)}")
        try:
            parts = _QUOTED.split(self._text.strip())
            parts[::2] = [_NUMBERED.sub(self._readable, part) for part in parts[::2]]
            tree = ast.parse("".join(parts), mode="eval")
        except SyntaxError as error:
            raise UsageError(self._message(error.offset or 1, f"not a condition: {error.msg}")) from None
        except (ValueError, RecursionError, MemoryError) as error:
            raise UsageError(self._message(1, f"not a condition: {error}")) from None
        try:
            return self._condition(tree.body)
        except RecursionError:
            raise UsageError(self._message(1, "not a condition: nested too deeply")) from None

    def _readable(self, found: re.Match[str]) -> str:
        """A name as long as the one found, so that places in the text stay."""
        name = re.sub(r"\.(?=\d)", "_", found[0])
        self._spelled[name] = found[0]
        return name

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
        for word, beside in ((left, right), (right, left)):
            if isinstance(word, ast.Name) and self._is_unknown(word.id) and self._is_text(beside):
                raise self._wrong(word, f"no column {word.id!r}; a text stands in quotes: '{word.id}'")
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
        first = node
        while isinstance(first, ast.Attribute):
            first = first.value
        if not isinstance(first, ast.Name):
            raise self._wrong(node, "expected a column, a number or a text in quotes")
        name = ast.unparse(node)
        return self._spelled.get(name, name)

    def _kind(self, node: ast.expr, name: str) -> str:
        if name not in self._kinds:
            hint = near(name, self._kinds) or "; without --where the columns are in --json"
            raise self._wrong(node, f"no column {name!r}{hint}")
        return self._kinds[name]

    def _is_unknown(self, name: str) -> bool:
        return name not in self._kinds and name not in ("true", "false", "True", "False")

    def _is_text(self, node: ast.expr) -> bool:
        """Whether a side is a column of texts."""
        return isinstance(node, ast.Name | ast.Attribute) and self._kinds.get(ast.unparse(node)) == "text"

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
