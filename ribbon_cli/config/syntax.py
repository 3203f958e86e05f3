"""YAML's syntax errors in the words of someone who writes a config."""

from __future__ import annotations

import yaml

_EXPLANATIONS = (
    ("simple key", "", "a key needs a colon and a space after it"),
    ("flow sequence", "", "expected , or ] in the list opened at {opened}"),
    ("flow mapping", "", "expected , or }} in the braces opened at {opened}"),
    ("quoted", "end of stream", "the quoted text that starts here is not closed"),
    ("quoted", "escape", "unknown escape (\\) in a text in double quotes"),
    ("", "mapping values are not allowed", "a colon out of place: check the line above and the indentation"),
    ("", "cannot start any token", "a value cannot start with this character: quote the text"),
    ("block mapping", "", "the indentation does not fit the lines above"),
    ("block collection", "", "expected another '- ' of the list begun at {opened}"),
    ("", "node content", "a value is missing here"),
    ("", "entries are not allowed", "a list's '- ' must be the first on its line"),
    ("", "document start", "nothing may follow the end of the document"),
    ("", "undefined tag handle", "tags (!) are not accepted: remove it"),
)
"""Words of an error's context and of its problem, and a sentence for errors that hold both.

The words are common to PyYAML's own parser and to libyaml's, so that both give the same text.
"""
_AT_CONTEXT = (_EXPLANATIONS[0], _EXPLANATIONS[3])
"""Those that point to where something began, not to where it went wrong."""


def explain(error: yaml.MarkedYAMLError) -> tuple[int, int, str]:
    """Line, column (both from 1) and message for a syntax error."""
    context, problem = error.context or "", error.problem or ""
    opened = _place(error.context_mark)
    for known in _EXPLANATIONS:
        in_context, in_problem, sentence = known
        if in_context in context and in_problem in problem:
            mark = error.context_mark if known in _AT_CONTEXT else error.problem_mark
            said = sentence.format(opened="{}:{}".format(*opened))
            return *_place(mark), f"not valid YAML: {said}"
    return *_place(error.problem_mark or error.context_mark), f"not valid YAML: {problem or context}"


def _place(mark: yaml.Mark | None) -> tuple[int, int]:
    return (mark.line + 1, mark.column + 1) if mark else (1, 1)
