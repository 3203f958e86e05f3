"""Random and hostile YAML: `ribbon check` ends soon, within bounds, with the right code and no traceback."""

from __future__ import annotations

import random
import string
from collections.abc import Callable
from pathlib import Path

import pytest
from fault_support import limited

from ribbon_cli.cli.main import cli
from ribbon_cli.config import templates

GOOD = [text for _, text in sorted(templates().items())]
SIGNS = " \n\t-:[]{},?*&!|>'\"%@`#~<=.0123456789eEpi\\\u00e9\u2028\x00\ufeff"
KEYS = [
    "name",
    "topology",
    "half_twists",
    "length",
    "widths",
    "refinement",
    "levels",
    "at",
    "initial_guess",
    "recipe",
]
KEYS += [
    "segments",
    "half_width",
    "steps",
    "state",
    "spectrum",
    "modes",
    "full_up_to",
    "contact",
    "from",
    "to",
    "x",
]
VALUES = [
    "1",
    "-1",
    "0",
    "2*pi",
    "1e400",
    "1e-400",
    "yes",
    "~",
    "''",
    "../../etc/passwd",
    "/dev/zero",
    ".nan",
    ".inf",
]
VALUES += [
    "twist",
    "cylinder",
    "record",
    "9" * 400,
    "2**99999",
    "((((1))))",
    "\u202e",
    "!!python/object:os.system x",
]


def damaged(chance: random.Random) -> bytes:
    """A good config with characters removed, doubled, exchanged or put in."""
    text = list(chance.choice(GOOD))
    for _ in range(chance.randint(1, 30)):
        at = chance.randrange(len(text))
        match chance.randrange(4):
            case 0:
                del text[at]
            case 1:
                text.insert(at, chance.choice(SIGNS))
            case 2:
                text[at] = chance.choice(SIGNS)
            case _:
                text[at:at] = text[at : at + chance.randint(1, 80)]
    return "".join(text).encode()


def invented(chance: random.Random) -> bytes:
    """Settings of right and wrong names with values of any shape."""

    def value(depth: int) -> str:
        match chance.randrange(5 if depth < 14 else 1):
            case 1:
                return "[" + ", ".join(value(depth + 1) for _ in range(chance.randrange(4))) + "]"
            case 2:
                pairs = (f"{chance.choice(KEYS)}: {value(depth + 1)}" for _ in range(chance.randrange(4)))
                return "{" + ", ".join(pairs) + "}"
            case _:
                return chance.choice(VALUES)

    lines = [f"{chance.choice(KEYS)}: {value(0)}\n" for _ in range(chance.randint(1, 8))]
    if chance.random() < 0.5:
        lines += [line + "\n" for line in chance.choice(GOOD).splitlines() if chance.random() < 0.8]
    chance.shuffle(lines)
    return "".join(lines).encode()


def noise(chance: random.Random) -> bytes:
    """Any bytes, or any signs that YAML knows."""
    size = chance.choice((10, 100, 10_000))
    return (
        chance.randbytes(size) if chance.random() < 0.5 else "".join(chance.choices(SIGNS, k=size)).encode()
    )


def adversarial(chance: random.Random) -> bytes:
    """Deep, wide, long, or referring to itself."""
    many = chance.choice((1000, 30_000, 250_000))
    letter = chance.choice(string.ascii_letters)
    return chance.choice(
        [
            "[" * many,
            "{a: " * (many // 4),
            "- " * many,
            "a: [" + "1, " * many + "]",
            "\n".join(f"key{i}: 1" for i in range(many // 10)),
            "a: &a [x, x]\nb: &b [*a, *a]\nc: [" + "*b, " * many + "]",
            "&a [*a]",
            f"name: {letter * many}",
            "length: " + "9" * many,
            "length: " + "(" * many,
            "length: " + "1+" * many + "1",
            "length: " + "2*" * many + "pi",
            "widths: [" + "0.1, " * many + "0.2]",
            "widths: {from: 0.1, to: 0.2, steps: " + "9" * chance.randint(1, 30) + "}",
            "topology: {half_twists: " + "9" * many + "}",
            "initial_guess: {recipe: twist, segments: 99999999, half_width: 0.1}\ntopology: {half_twists: 1}",
            "<<: {length: 1}\n" * 100,
            "a: 1\n---\n" * 1000,
            '"' + "\\" * many,
            letter * many,
        ]
    ).encode()


def check(path: Path) -> Callable[[], int]:
    def action() -> int:
        try:
            cli.main(["check", str(path), "-q"])
        except SystemExit as left:
            return int(left.code or 0)
        return 0

    return action


def documents(folder: Path, count: int, seed: int) -> dict[int, int]:
    """Check so many documents; how often each exit code came out."""
    chance = random.Random(seed)
    path = folder / "m.yaml"
    codes: dict[int, int] = {}
    for k in range(count):
        path.write_bytes((damaged, invented, noise, adversarial)[k % 4](chance))
        ended = limited(check(path), folder)
        where = f"document {k} of seed {seed}: {ended.code}, {ended.seconds} s, {ended.output[-300:]}"
        assert ended.code in (0, 2), where
        assert "Traceback" not in ended.output, where
        assert ended.seconds < 2.0, where
        assert ended.memory < 2**30, where
        if ended.code == 2:
            errors = [line for line in ended.output.splitlines() if line.startswith(str(path))]
            assert errors, where
        codes[ended.code] = codes.get(ended.code, 0) + 1
    return codes


def test_some_documents(tmp_path):
    assert documents(tmp_path, 20, seed=1)[2] > 10


@pytest.mark.faults
def test_five_thousand_documents(tmp_path, figure):
    codes = documents(tmp_path, 5000, seed=2)
    figure(f"exit codes {codes}")
    assert codes[2] > 3000
