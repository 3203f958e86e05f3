"""The table of a config's keys, and what follows from it: schema, reference, defaults, bounds."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import test_config_messages as messages
import yaml
from cli_support import QUICK_BRANCH, QUICK_MOBIUS, QUICK_RING, QUICK_SCHOENKE, ribbon, ribbon_json
from config_samples import GOOD, MINIMAL, STRIP
from config_table import keys, rows
from jsonschema import Draft7Validator
from test_faults_configs import damaged, invented

from ribbon_cli.config import (
    RECIPES,
    SCHEMA_FILE,
    STOPS,
    Arclength,
    ConfigError,
    dump_resolved,
    load_config,
    parse_config,
    templates,
)
from ribbon_cli.config.document import Node
from ribbon_cli.config.json_schema import schema
from ribbon_cli.config.mistakes import Mistakes
from ribbon_cli.config.reader import Reader
from ribbon_cli.expression import PATTERN, ExpressionError, evaluate
from ribbon_cli.keys import Integer, Text

ROOT = Path(__file__).parent.parent
SCHEMA = Draft7Validator(schema())


class Yaml11(yaml.SafeLoader):
    """YAML as PyYAML has it, without dates, which JSON does not know."""


class Yaml12(yaml.SafeLoader):
    """The core schema of YAML 1.2, as the language server has it."""


def resolvers(kept: dict[str, str], starts: str) -> dict[str, list[tuple[str, re.Pattern[str]]]]:
    every = [(f"tag:yaml.org,2002:{tag}", re.compile(f"^(?:{pattern})$")) for tag, pattern in kept.items()]
    return dict.fromkeys([*starts, ""], every)


Yaml11.yaml_implicit_resolvers = {
    first: [entry for entry in entries if not entry[0].endswith((":timestamp", ":value", ":merge"))]
    for first, entries in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Yaml12.yaml_implicit_resolvers = resolvers(
    {
        "null": "~|null|Null|NULL|",
        "bool": "true|True|TRUE|false|False|FALSE",
        "int": "[-+]?[0-9]+",
        "float": r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)",
    },
    "~nNtTfF0123456789+-.",
)
# PyYAML's own reads a leading zero as octal.
Yaml12.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(node.value))
Yaml12.add_constructor(
    "tag:yaml.org,2002:float", lambda loader, node: float(node.value.replace(".i", "i").replace(".I", "i"))
)
LOADERS = (Yaml11, Yaml12)


def accepted(text: str) -> bool:
    """Whether a config is a good one to the schema, by either reading of YAML; both must agree to that."""
    return all(SCHEMA.is_valid(yaml.load(text, loader)) for loader in LOADERS)


def valid(text: str) -> bool:
    try:
        parse_config(text, "m.yaml")
    except ConfigError:
        return False
    return True


# ---- the schema


def test_the_schema_is_one() -> None:
    Draft7Validator.check_schema(schema())


@pytest.mark.parametrize("path", sorted(ROOT.glob("configs/**/*.yaml")), ids=lambda path: path.name)
def test_every_config_is_accepted(path: Path) -> None:
    assert accepted(path.read_text(encoding="utf-8"))
    assert accepted(dump_resolved(load_config(path)))


@pytest.mark.parametrize(
    "text", [*templates().values(), GOOD, MINIMAL, QUICK_RING, QUICK_MOBIUS, QUICK_SCHOENKE, QUICK_BRANCH]
)
def test_every_sample_is_accepted(text: str) -> None:
    assert accepted(text)


BEYOND = re.compile(
    "duplicate key|must differ|does not fit the topology|must keep the widths distinct|the guess's segments"
    "|twice the level before|must be one of the widths|half-twists, got|half-twists meet"
    "|the band's length|'6.28' .in quotes|got 50.0$"
)
"""What ties values to each other, or is lost when YAML is read, is not for a schema to see."""


def mistakes() -> Iterator[tuple[str, str]]:
    """Every config with one mistake of test_config_messages, and the message."""
    for test, before in (
        (messages.test_one_mistake_gives_one_message, ""),
        (messages.test_mistakes_about_the_guess, messages.STATE),
    ):
        for text, line in test.pytestmark[0].args[1]:
            yield before + text, line


def readable(text: str) -> bool:
    try:
        return all(yaml.load(text, loader) is not None for loader in LOADERS)
    except (yaml.YAMLError, ValueError, TypeError):
        return False


def test_mistakes_are_refused_where_a_schema_can_see_them() -> None:
    seen = {True: 0, False: 0}
    for text, line in mistakes():
        refused_by_yaml = re.search(r"anchors|tags|directives|control character|tab character", line)
        if readable(text) and not refused_by_yaml:
            beyond = BEYOND.search(line) is not None
            assert accepted(text) == beyond, line
            seen[beyond] += 1
    assert seen[False] > 40
    assert seen[True] > 15


def test_an_editor_is_told_what_is_expected() -> None:
    """Descriptions, defaults and words for patterns are where the language server looks for them."""
    properties = schema()["properties"]
    assert all(entry["description"] for entry in properties.values())
    assert properties["length"]["default"] == "2*pi"
    assert properties["length"]["patternErrorMessage"] == "must be a number such as 0.5, 1e-3, 2*pi or pi/30"
    recipes = properties["initial_guess"]["oneOf"]
    assert [kind["title"] for kind in recipes] == [
        "cylinder",
        "twist",
        "eversion",
        "schoenke",
        "figure-eight",
        "strip",
        "a state",
    ]
    assert "steps" not in recipes[0]["properties"]
    assert recipes[1]["properties"]["steps"]["default"] == 50


# ---- never stricter than the reader

NUMBERS = [
    *("0.2", ".2", "2e-1", "2E-1", "0.2e0", "+0.2", "+.2", "+ .2", "0.20000", "2e-01", "pi/16", "(1/5)"),
    *("1/5", "1 / 5", "( 1 / 5 )", "1/(2+3)", "0.02*1e1", "-1*-0.2", "0.1 + 0.1", "-(0.1 - 0.3)"),
]
NAMES = [
    *("a", "2024", "no", "1e3", "007", "0x1F", "1.5", "true", "off", "2024-01-01", "1_000", "y", "1."),
    *("'null'", "'5'", '"a.b-c_d"'),
]
STATES = ["x:1", "12", "'m@b=0.5,N=40'", "a/b.NPZ", "~/c.h5", "1:30", "2024-01-01", "no", "'a b'", "5.h5"]


def written(chance: random.Random) -> str:
    """A config of any kind, its values spelled in many ways, few of them wrong."""

    def one(values: list[str]) -> str:
        wrong = ["0", "-1", "x", "'0.2'", "1e99", "[]", "true", "050", "{to: 0.3}", "40.0", "1:30", "~"]
        return chance.choice(wrong if chance.random() < 0.02 else values)

    def some(parts: list[str]) -> str:
        return ", ".join(part for part in parts if chance.random() < 0.6)

    twists, guess = chance.choice(
        [
            ("0", "recipe: cylinder, segments: S, half_width: W"),
            ("1", "recipe: twist, segments: S, half_width: W, steps: 12"),
            ("+1", "'recipe': 'twist', segments: S, half_width: W"),
            ("0", "recipe: eversion, segments: S, half_width: W, steps: 3"),
            ("-3", "recipe: schoenke, segments: S, half_width: W"),
            ("2", "state: STATE"),
            ("-1", "state: STATE, saddle: leave"),
        ]
    )
    branch = some(["back_to: 0.1", "at: [0.25, 0.3]", "max_step: 1e-1", "steps: 9", "stop_at: [fold, fold]"])
    branch += some([", switch: 2", ", both: 'false'"])
    widths = chance.choice(
        ["[W, 0.3, W]", "[W]", "{from: W, to: 0.5, steps: 3}", f"{{arclength: {{to: 0.4, {branch}}}}}"]
    )
    guess = guess.replace("S", one(["40", "+40"]), 1) if "segments: S" in guess else guess
    lines = [
        f"topology: {{half_twists: {one([twists])}}}",
        f"initial_guess: {{{guess.replace('W', one(NUMBERS)).replace('STATE', one(STATES))}}}",
    ]
    for line in (
        f"name: {one(NAMES)}",
        f"length: {chance.choice(['2*pi', '6', '(2)*pi', '+2e+1'])}",
        f"widths: {widths.replace('W', one(NUMBERS))}",
        f"refinement: {chance.choice(['[40, 80]', '[+40]', '{levels: [40]}', '{levels: [40], at: [0.3]}'])}",
        f"spectrum: {{{some(['modes: 0', 'full_up_to: 20', 'metrics: [physical]'])}}}",
        f"contact: {one(['stop', 'record'])}",
    ):
        lines += [line] if chance.random() < 0.5 else []
    chance.shuffle(lines)
    return "\n".join(lines) + "\n"


def test_whatever_the_reader_takes_the_schema_takes() -> None:
    chance = random.Random(20)
    taken = 0
    for k in range(500):
        text = written(chance) if k % 3 else (damaged, invented)[k % 2](chance).decode()
        if valid(text):
            taken += 1
            assert accepted(text), text
    assert taken > 150


SIGNS = [
    *("0", "1", "12", "0.5", "5.", ".5", "1e-3", "2E+1", "pi", "05", "x", "1e"),
    *("+", "-", "*", "/", "(", ")", " "),
]


def fault_of(expression: str) -> str | None:
    try:
        evaluate(expression)
    except ExpressionError as error:
        return str(error)
    return None


def test_the_pattern_of_numbers_is_that_of_expressions() -> None:
    """It takes what `evaluate` takes, and besides only what a pattern cannot see."""
    chance = random.Random(21)
    unseen = re.compile("parenthes|out of place|not finite|division by zero")
    values, both = 0, 0
    for _ in range(30_000):
        text = "".join(chance.choices(SIGNS, k=chance.randint(1, 7)))
        matched = re.search(PATTERN, text) is not None
        fault = fault_of(text)
        assert matched if fault is None else not matched or unseen.search(fault), (text, fault)
        values += fault is None
        both += fault is not None and not matched
    assert min(values, both) > 1000
    assert re.search(PATTERN, "1*" * 49 + "x") is None  # soon


@pytest.mark.parametrize("path", [path for path, _, _ in keys()])
def test_bounds_are_the_same_to_both(path: str) -> None:
    """Single values at the ends of a key's bounds and beyond, each read by the reader and by the schema."""
    texts = ["thesis", "true", "x:1", "1e9", "1e-9", "0.999", "1.0", "5e-324", "0", "-0.1"]
    for _, key, part in (entry for entry in keys() if entry[0] == path):
        takes = key.takes
        if isinstance(takes, Integer):
            texts += [str(n) for n in (takes.low - 1, takes.low, takes.high, takes.high + 1)]
        for text in texts:
            try:
                value = Reader(Mistakes("")).read(Node(1, 1, "scalar", text), path, takes)
            except TypeError:
                return
            loaded: Any = yaml.load(text, Yaml12)
            whole = isinstance(takes, Integer) and isinstance(loaded, float)
            even = isinstance(takes, Integer) and takes.even and value is not None and value % 2
            if not whole and not even and not (isinstance(takes, Text) and value is None):
                assert Draft7Validator(part).is_valid(loaded) == (value is not None), (path, text)


# ---- defaults, and what they must not change


def test_a_default_is_what_stands_for_its_key() -> None:
    """A config that spells out every default of the table is the same as one without."""
    plain = {
        "topology": {"half_twists": 1},
        "initial_guess": {"state": "x:1"},
        "widths": {"arclength": {"to": 0.3, "back_to": 0.1}},
    }
    spelled: dict[str, Any] = json.loads(json.dumps(plain))
    defaults = {path: key.default for path, key, _ in keys() if key.default is not None}
    del defaults["initial_guess.steps"]  # those of the recipes: each in a line of its own below
    strips: dict[str, dict[str, Any]] = {"ends": {}, "loads": {}}
    for path in [path for path in defaults if path.startswith(("ends.", "loads."))]:
        section, _, name = path.partition(".")
        value = defaults.pop(path)
        strips[section][name] = list(value) if isinstance(value, tuple) else value
    for path, value in defaults.items():
        *sections, name = path.split(".")
        place = spelled
        for section in sections:
            place = place.setdefault(section, {})
        place[name] = list(value) if isinstance(value, tuple) else value
    assert len(defaults) == 13
    of_strips = yaml.safe_load(STRIP)
    for section, values in strips.items():
        of_strips[section] = of_strips.get(section, {}) | values
    as_yaml = yaml.safe_dump(of_strips)
    assert parse_config(as_yaml, "m.yaml").hash8() == parse_config(STRIP, "m.yaml").hash8()
    as_yaml = yaml.safe_dump(spelled)
    assert parse_config(as_yaml, "m.yaml").hash8() == parse_config(yaml.safe_dump(plain), "m.yaml").hash8()
    for name, steps in (("twist", 50), ("eversion", 25)):
        assert [key.default for key in RECIPES[name].keys if key.name == "steps"] == [steps]


def test_continue_tells_the_same_defaults_and_events() -> None:
    """Its options are a branch's keys by another door; the command's module loads no config to say so."""
    text = " ".join(ribbon("continue", "--help").stdout.split())
    assert f"Longest step along the branch ({Arclength.max_step})." in text
    assert f"Largest number of steps ({Arclength.steps})." in text
    assert f"[{'|'.join(STOPS)}]" in text


STATE = "topology: {half_twists: 0}\ninitial_guess: {state: a.npz, saddle: keep}\nwidths: "
HASHES = {
    GOOD: "713b55d7",
    MINIMAL: "e768b4ce",
    QUICK_RING: "eba61e57",
    QUICK_MOBIUS: "34f1edb2",
    QUICK_SCHOENKE: "899db31b",
    QUICK_BRANCH: "c5be9eb8",
    GOOD.replace("recipe: twist", "recipe: eversion").replace("twists: 1", "twists: 0"): "b282512f",
    MINIMAL.replace("0.1", "pi/30") + "length: (1 + 1/3)*pi\n": "2738c269",
    MINIMAL + "widths: {from: 0.1, to: 1.5, steps: 28}\nspectrum: {metrics: [physical]}\n": "5a00ff3f",
    MINIMAL + "widths: [0.1, 5e-1]\nrefinement: {levels: [50, 100], at: [.5]}\ncontact: stop\n": "964a844c",
    STATE + "{arclength: {to: 0.2}}\n": "95b02f4f",
    STATE + "{arclength: {to: 2e-1, back_to: 0.1, both: true, at: [0.15]}}\n": "524da034",
    STATE
    + "{arclength: {to: 0.2, stop_at: [contact, fold], steps: 9,max_step: .05,switch: 2}}\n": "b7984cc7",
}


@pytest.mark.parametrize("text", HASHES)
def test_runs_keep_their_names(text: str) -> None:
    """The hash in a run's name is that of the first version that had the config."""
    assert parse_config(text, "m.yaml").hash8() == HASHES[text]


# ---- where the table is shown


def test_the_readme_has_the_table() -> None:
    section = (ROOT / "docs/reference/config.md").read_text(encoding="utf-8").partition("## The keys\n")[2]
    table = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("| ")]
    assert table[1:] == rows()


# ---- the command


def test_schema_prints_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed = ribbon("schema")
    assert printed.exit_code == 0
    assert json.loads(printed.stdout) == schema()
    assert ribbon("schema", "-o", SCHEMA_FILE).stdout == f"{SCHEMA_FILE}\n"
    assert (tmp_path / SCHEMA_FILE).read_text() == printed.stdout
    again = ribbon("schema", "-o", SCHEMA_FILE)
    assert (again.exit_code, again.stdout) == (2, "")
    assert "exists already and is not replaced: add --overwrite" in again.stderr
    assert ribbon_json("schema", "-o", SCHEMA_FILE, "--overwrite") == {"path": SCHEMA_FILE}


def test_templates_name_the_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for text in templates().values():
        assert text.splitlines()[0] == f"# yaml-language-server: $schema={SCHEMA_FILE}"
        assert f"`ribbon schema -o {SCHEMA_FILE}`" in text
    (tmp_path / "sub").mkdir()
    assert f"`ribbon schema -o sub/{SCHEMA_FILE}`" in ribbon("init", "-o", "sub/a.yaml").stderr
    ribbon("schema", "-o", f"sub/{SCHEMA_FILE}")
    assert SCHEMA_FILE not in ribbon("init", "-o", "sub/b.yaml").stderr
