"""Numbers as people write them in a config: `0.5`, `1e-3`, `2*pi`, `pi/30`, `(1 + 1/3)*pi`."""

from __future__ import annotations

import math
import re

MAX_CHARACTERS = 100
"""Characters of the longest text that is read."""
_MAX_PARENTHESES = 10  # open at once: bounds the recursion
_DECIMAL = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_NUMBER = rf"(?:{_DECIMAL}|pi)"
_ALONE = re.compile(rf"(?!0[0-9]){_DECIMAL}")
_TOKEN = re.compile(rf"{_NUMBER}(?![.\w])|[-+*/()]")
_OPERAND = rf" *(?:(?:[+-] *)?\( *)*(?:[+-] *)?(?!0[0-9]){_NUMBER} *(?:\) *)*"
PATTERN = rf"^{_OPERAND}(?:[-+*/]{_OPERAND})*$"
"""What `evaluate` takes, but for parentheses that do not pair, for programs that know patterns alone."""


class ExpressionError(ValueError):
    """The text is no number; the message says why, in a few words."""


def evaluate(text: str) -> float:
    """The value of `text`: decimal numbers and pi with + - * / and parentheses.

    The result is finite. Raises ExpressionError for anything else, among them the spellings that YAML
    1.1 reads in its own way (`010` octal, `1_000`, `1:30`).
    """
    if len(text) > MAX_CHARACTERS:
        raise ExpressionError(f"longer than {MAX_CHARACTERS} characters")
    value = float(text) if _ALONE.fullmatch(text) else _Parser(_tokens(text)).whole()
    if not math.isfinite(value):
        raise ExpressionError("not finite")
    return value


def _tokens(text: str) -> list[str]:
    tokens: list[str] = []
    at = 0
    while at < len(text):
        if text[at] == " ":
            at += 1
            continue
        match = _TOKEN.match(text, at)
        if match is None:
            raise ExpressionError("not made of numbers, pi, + - * / and parentheses")
        token = match.group()
        if re.match("0[0-9]", token):
            raise ExpressionError("leading zero")
        tokens.append(token)
        at = match.end()
    return tokens


class _Parser:
    """Recursive descent over a token list; as deep as there are open parentheses."""

    def __init__(self, tokens: list[str]) -> None:
        self._tokens = tokens
        self._at = 0

    @property
    def next(self) -> str:
        """The token to be read next, empty at the end."""
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def take(self) -> str:
        """Read the next token, empty at the end."""
        token = self.next
        self._at += 1
        return token

    def whole(self) -> float:
        """The value of all tokens."""
        value = self.sum(0)
        if self.next:
            raise ExpressionError(f"{self.next} out of place")
        return value

    def sum(self, depth: int) -> float:
        """Products with + and - between them; `depth` counts the open parentheses."""
        value = self.product(depth)
        while self.next in ("+", "-"):
            sign = 1.0 if self.take() == "+" else -1.0
            value += sign * self.product(depth)
        return value

    def product(self, depth: int) -> float:
        """Factors with * and / between them."""
        value = self.factor(depth)
        while self.next in ("*", "/"):
            if self.take() == "*":
                value *= self.factor(depth)
                continue
            divisor = self.factor(depth)
            if divisor == 0.0:
                raise ExpressionError("division by zero")
            value /= divisor
        return value

    def factor(self, depth: int) -> float:
        """A number, pi or a parenthesis, with at most one sign before it."""
        sign = 1.0
        if self.next in ("+", "-"):
            sign = -1.0 if self.take() == "-" else 1.0
        token = self.take()
        if token == "pi":
            return sign * math.pi
        if token == "(":
            return sign * self.parenthesis(depth + 1)
        if token[:1] in "+-*/)":  # an empty token too
            raise ExpressionError(f"a number is missing {f'before {token}' if token else 'at the end'}")
        return sign * float(token)

    def parenthesis(self, depth: int) -> float:
        """What stands up to the closing parenthesis."""
        if depth > _MAX_PARENTHESES:
            raise ExpressionError(f"more than {_MAX_PARENTHESES} parentheses inside each other")
        value = self.sum(depth)
        if self.take() != ")":
            raise ExpressionError("a parenthesis is not closed")
        return value
