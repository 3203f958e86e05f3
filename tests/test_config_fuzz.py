"""Hostile and accidental documents: whatever comes, a Config or a ConfigError, and soon."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ribbon_cli.config import ConfigError, dump_resolved, parse_config, templates
from ribbon_cli.config.mistakes import MOST_MISTAKES
from ribbon_cli.expression import ExpressionError, evaluate

BASE = templates()["mobius-pi"]
PLAIN = "".join(line for line in BASE.splitlines(keepends=True) if line[0] not in "#\n")
BIG = 1_000_000
SETTINGS = settings(derandomize=True, deadline=None, max_examples=150, database=None)


def outcome(text: str) -> str:
    """Parse `text`, and hold the promises made for any text; "" for a good config."""
    try:
        config = parse_config(text, "m.yaml")
    except ConfigError as error:
        return checked(error, text)
    again = parse_config(dump_resolved(config), "m.yaml")
    assert again.resolved() == config.resolved()
    if config.guess.state == config.guess.state_as_written:
        assert again.hash8() == config.hash8()
    return ""


def checked(error: ConfigError, text: str) -> str:
    message = str(error)
    lines = message.splitlines()
    assert 1 <= len(lines) == len(error.mistakes) <= MOST_MISTAKES + 1
    count = text.count("\n") + text.count("\r") + 1
    for line, problem in zip(lines, error.mistakes, strict=True):
        assert line.startswith("m.yaml:")
        assert line.isprintable()
        assert len(line) < 400
        assert 0 <= problem.line <= count
    return message


@pytest.mark.parametrize(
    "text",
    [
        "[" * BIG,
        "{" * BIG,
        "{a: " * (BIG // 4),
        "- " * (BIG // 2),
        "? " * (BIG // 2),
        "a: " * (BIG // 3),
        "\n".join(" " * i + "a:" for i in range(1300)),
        "a: [" + "1, " * (BIG // 3) + "]",
        "a: {" + ", ".join(f"k{i}: 1" for i in range(60_000)) + "}",
        "\n".join(f"key{i}: 1" for i in range(60_000)),
        "a: 1\n" * (BIG // 5),
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [" + "*c, " * 200_000 + "]",
        "&a [*a]",
        "%TAG !a! x\n" * (BIG // 11),
        "".join(f"%TAG !a{i}! x\n" for i in range(60_000)),
        "---\n" * (BIG // 4),
        "#" * BIG,
        "\n" * BIG,
        "\t" * BIG,
        "\t\n" * (BIG // 2),
        "\x00" * BIG,
        "\r" * BIG,
        "'" * BIG,
        '"' * BIG,
        '"' + "\\" * BIG,
        "a" * BIG,
        "a: " + "9" * BIG,
        "length: " + "9" * BIG,
        "length: " + "(" * BIG,
        "length: " + "-" * BIG + "1",
        "length: " + "1+" * (BIG // 2) + "1",
        "topology: {half_twists: " + "9" * BIG + "}",
        "name: " + "n" * BIG,
        "name: |\n" + " x\n" * (BIG // 3),
        "lengt" + "h" * BIG + ": 1",
        "? " + "k" * BIG + "\n: 1",
        "!" * BIG,
        "a: !<" + "x" * BIG + "> 1",
        "&" + "a" * BIG + " b: 1",
        "*" + "a" * BIG,
        "<<: {length: 1}\n" + PLAIN,
        "widths: [" + "-1, " * 10_000 + "]",
        "widths: [" + "1, 2, " * 5_000 + "]",
        "widths: {from: 1e-320, to: 1e-319, steps: 9999}",
        "widths: {from: 1, to: 2, steps: 9999}\nrefinement: {levels: [50], at: [" + "1.5, " * 10_000 + "]}",
        "\ufeff\ufeff" + PLAIN,
        "\U0010ffff: 1",
        "\u202ename: x",
    ],
    ids=lambda text: ascii(text[:24]),
)
def test_documents_made_to_hurt(text: str) -> None:
    assert outcome(text)


def test_as_many_widths_as_there_may_be() -> None:
    widths = ", ".join(f"{0.1 + i * 1e-4:.4f}" for i in range(10_000))
    text = PLAIN.replace("[0.1, 0.2, 0.5, 0.8, 1.0, 1.5]", f"[{widths}]")
    text = text.replace("[50, 100, 200, 400]", f"{{levels: [50], at: [{widths}]}}")
    assert len(parse_config(text, "m.yaml").widths) == 10_000


@SETTINGS
@given(st.text(max_size=60))
def test_any_text(text: str) -> None:
    outcome(text)


@SETTINGS
@given(st.text(alphabet=" \n-:[]{},?*&!|>'\"%@`#~<=.01eapi\\", max_size=40))
def test_any_text_of_yaml_signs(text: str) -> None:
    outcome(text)


@SETTINGS
@given(st.text(alphabet="0123456789.eEpi+-*/() ", max_size=30))
def test_any_expression_agrees_with_python(text: str) -> None:
    try:
        value = evaluate(text)
    except ExpressionError:
        return
    names = {"__builtins__": {}, "pi": 3.141592653589793}
    assert value == pytest.approx(eval(text.strip(), names), rel=1e-12)


@SETTINGS
@given(st.integers(0, 2**32), st.integers(1, 6))
def test_damaged_configs(seed: int, edits: int) -> None:
    """Characters of a good config removed, doubled, exchanged, or replaced by others."""
    dice = random.Random(seed)
    text = list(PLAIN)
    for _ in range(edits):
        at = dice.randrange(len(text))
        match dice.randrange(4):
            case 0:
                del text[at]
            case 1:
                text.insert(at, text[dice.randrange(len(text))])
            case 2:
                text[at] = dice.choice(" \n\t-:[]{},?*&!|'\"#0x\u00e9\x01")
            case _:
                text[at : at + 8] = text[at : at + 8][::-1]
    outcome("".join(text))


VALUES = st.recursive(
    st.sampled_from(
        ["1", "-1", "0", "2*pi", "yes", "~", "''", "x", "50", "100", ".inf", "1e-3", "thesis", "twist"]
    ),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: "[" + ", ".join(items) + "]")
        | st.dictionaries(
            st.sampled_from(
                ["half_twists", "recipe", "state", "segments", "from", "to", "steps", "levels", "at"]
            ),
            inner,
            max_size=3,
        ).map(lambda d: "{" + ", ".join(f"{k}: {v}" for k, v in d.items()) + "}")
    ),
    max_leaves=6,
)
KEYS = st.sampled_from([line.split(":")[0] for line in PLAIN.splitlines()] + ["lenght", "x"])


@SETTINGS
@given(st.lists(st.tuples(KEYS, VALUES), max_size=4))
def test_wrong_values_in_right_places(entries: list[tuple[str, str]]) -> None:
    """A good config whose settings are replaced, or followed, by others of any shape."""
    lines = dict(line.split(": ", 1) for line in PLAIN.splitlines()) | dict(entries)
    outcome("".join(f"{key}: {value}\n" for key, value in lines.items()))
