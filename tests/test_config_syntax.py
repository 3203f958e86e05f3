"""YAML's own errors in plain words, the same from both of PyYAML's parsers."""

from __future__ import annotations

import pytest
import yaml
from config_samples import GOOD

from ribbon_cli.config import (
    templates,
)
from ribbon_cli.config.document import read_document
from ribbon_cli.config.mistakes import Mistake, Mistakes

LOADERS = [yaml.SafeLoader, *([yaml.CSafeLoader] if yaml.__with_libyaml__ else [])]


@pytest.mark.parametrize("loader", LOADERS)
@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("length: 1\nname\n", 2, 1, "a key needs a colon and a space after it"),
        ("length: 1\nname:x\nfoo: 1\n", 2, 1, "a key needs a colon and a space after it"),
        ("widths: [1, 2\nlength: 3\n", 2, 7, "expected , or ] in the list opened at 1:9"),
        ("topology: {a: 1\nlength: 3\n", 2, 7, "expected , or } in the braces opened at 1:11"),
        ("a: b: c\n", 1, 5, "a colon out of place: check the line above and the indentation"),
        ("widths: [", 1, 10, "a value is missing here"),
        ("widths: [1,\n# end\n\n", 2, 6, "a value is missing here"),
        ("topology: {a: 1\n\n", 1, 16, "expected , or } in the braces opened at 1:11"),
        ("name: 'x\nlength: 2\n", 1, 7, "the quoted text that starts here is not closed"),
        ("name: @x\n", 1, 7, "a value cannot start with this character: quote the text"),
        ("a:\n  b: 1\n c: 2\n", 3, 2, "the indentation does not fit the lines above"),
        ("- a\nb: 1\n", 2, 1, "expected another '- ' of the list begun at 1:1"),
        ("widths: [1,,2]\n", 1, 12, "a value is missing here"),
        ("widths: - 1\n", 1, 9, "a list's '- ' must be the first on its line"),
        ("a: 1\n...\nb: 2\n", 3, 1, "nothing may follow the end of the document"),
        ("a: !foo!bar 1\n", 1, 4, "tags (!) are not accepted: remove it"),
    ],
)
def test_syntax_errors_in_plain_words(text: str, line: int, column: int, message: str, loader: type) -> None:
    problems = Mistakes("m.yaml")
    assert read_document(text, problems, loader) is None
    assert problems.found == [Mistake(line, column, "", f"not valid YAML: {message}")]


@pytest.mark.parametrize("loader", LOADERS)
@pytest.mark.parametrize("escape", ["\\UFFFFFFFF", "\\U00110000", "\\q"])
def test_bad_escapes_are_problems_with_either_parser(escape: str, loader: type) -> None:
    problems = Mistakes("m.yaml")
    assert read_document(f'name: "{escape}"\n', problems, loader) is None
    assert [problem.line for problem in problems.found] == [1]


@pytest.mark.skipif(len(LOADERS) < 2, reason="PyYAML without libyaml")
@pytest.mark.parametrize(
    "text",
    [
        *templates().values(),
        GOOD,
        "é😀: [é, 5,\n  'ü']\nb:\n- 1\n-\n- {c: |\n    x\n   }\n",
        "a:\n  - b: 1\n    c: [x,\n        y]\n  - ? d\n    : e\n",
        'a: >\n  folded\n\nb: plain\n  goes on\nc: "x\\\n  y"\n',
    ],
)
def test_both_parsers_give_the_same_tree_and_positions(text: str) -> None:
    trees = []
    for loader in LOADERS:
        problems = Mistakes("m.yaml")
        trees.append((read_document(text, problems, loader), problems.found))
    assert trees[0] == trees[1]
