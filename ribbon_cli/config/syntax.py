"""YAML's syntax errors in the words of someone who writes a config."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import yaml


@dataclass(frozen=True)
class _Explanation:
    """A sentence for an error whose context and problem hold the given words, and where it points to.

    The words are common to PyYAML's own parser and to libyaml's, so that both give the same text.
    """

    context: str
    problem: str
    at: Literal["problem", "context"]
    sentence: str


_EXPLANATIONS = (
    _Explanation("simple key", "", "context", "a key needs a colon and a space after it"),
    _Explanation("flow sequence", "", "problem", "expected , or ] in the list opened at {opened}"),
    _Explanation("flow mapping", "", "problem", "expected , or }} in the braces opened at {opened}"),
    _Explanation("quoted", "end of stream", "context", "the quoted text that starts here is not closed"),
    _Explanation("quoted", "escape", "problem", "unknown escape (\\) in a text in double quotes"),
    _Explanation(
        "",
        "mapping values are not allowed",
        "problem",
        "a colon out of place: check the line above and the indentation",
    ),
    _Explanation(
        "", "cannot start any token", "problem", "a value cannot start with this character: quote the text"
    ),
    _Explanation("block mapping", "", "problem", "the indentation does not fit the lines above"),
    _Explanation("block collection", "", "problem", "expected another '- ' of the list begun at {opened}"),
    _Explanation("", "node content", "problem", "a value is missing here"),
    _Explanation("", "entries are not allowed", "problem", "a list's '- ' must be the first on its line"),
    _Explanation("", "document start", "problem", "nothing may follow the end of the document"),
    _Explanation("", "undefined tag handle", "problem", "tags (!) are not accepted: remove it"),
)


def explain(error: yaml.MarkedYAMLError) -> tuple[int, int, str]:
    """Line, column (both from 1) and message for a syntax error."""
    context, problem = error.context or "", error.problem or ""
    opened = _place(error.context_mark)
    for known in _EXPLANATIONS:
        if known.context in context and known.problem in problem:
            mark = error.context_mark if known.at == "context" else error.problem_mark
            sentence = known.sentence.format(opened="{}:{}".format(*opened))
            return *_place(mark), f"not valid YAML: {sentence}"
    return *_place(error.problem_mark or error.context_mark), f"not valid YAML: {problem or context}"


def _place(mark: yaml.Mark | None) -> tuple[int, int]:
    return (mark.line + 1, mark.column + 1) if mark else (1, 1)
