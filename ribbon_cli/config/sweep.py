"""From SWEEP.yaml to its points, or to all the mistakes in it and in them at once.

Each point is the base config with other values at the keys that vary, read as any config is. So every rule of
configs holds for it, and a mistake in a value is told where the sweep's file has it.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ribbon_cli.config.document import Node, read_document
from ribbon_cli.config.mistakes import MOST_MISTAKES, ConfigError, Mistake, Mistakes, shown
from ribbon_cli.config.parse import config_of, read_text
from ribbon_cli.config.point_names import labels, point_name
from ribbon_cli.config.reader import Reader, got, is_null
from ribbon_cli.config.sweep_types import Point, Sweep
from ribbon_cli.config.table import NAME
from ribbon_cli.config.types import Config
from ribbon_cli.expression import ExpressionError, evaluate
from ribbon_cli.keys import Integer, Items, Key, Number, Section, Text

MOST_POINTS = 10_000
_VALUES = "a list of values, or {from: ..., to: ..., steps: ...}"
_ANY = Number(-1e9, above=None, high=1e9)
# fmt: off
SWEEP_NAME = Text(NAME.expected.replace("64", "40"), NAME.pattern, 40)
RANGE = Section((
    Key("from", _ANY, "first value", required="the first value"),
    Key("to", _ANY, "last value", required="the last value"),
    Key("steps", Integer(1, MOST_POINTS - 1), "number of equal steps", required="the number of steps"),
))
GROUPS = Items(Section(()), 20)
SWEEP = Section((
    Key("name", SWEEP_NAME, "name of the sweep, with which those of its runs begin",
        otherwise="the file's stem"),
    Key("config", Text("a config's path", "[^\x00-\x1f]+", 1024), "the config that varies: a path, or whole",
        required="the path of a config, or its settings"),
    Key("vary", GROUPS, "what varies",
        required="groups of keys, as [{initial_guess.half_width: [0.1, 0.2]}]"),
), "a sweep")
# fmt: on


class _Column(NamedTuple):
    """A key that varies: its place in the file, and its values."""

    key: Node
    values: list[Node]

    @property
    def path(self) -> list[str]:
        return self.key.text.split(".")


_Pair = tuple[Node, Node]
"""A key and its value; a point has one for each dotted key."""


def load_sweep(path: str | os.PathLike[str]) -> Sweep:
    """Read and check the sweep at `path`, and every point of it. Raises ConfigError with all mistakes."""
    file = os.fsdecode(path)
    mistakes = Mistakes(file)
    text = read_text(file, mistakes)
    root = read_document(text, mistakes)
    if root is None:
        raise mistakes.error()
    reader = Reader(mistakes)
    found = reader.section(root, "", SWEEP)
    name = found.read("name") if "name" in found.nodes else _stem(reader, root, file)
    groups = _groups(reader, found.nodes.get("vary"))
    base, folder = _base(reader, found.nodes.get("config"), file)
    count = math.prod(len(column.values) for group in groups for column in group[:1])
    if count > MOST_POINTS:
        found.report("vary", f"must give at most {MOST_POINTS} points, got {count}")
    if mistakes.found or base is None or name is None:
        raise mistakes.error()
    points = _Points(mistakes, base, name, groups, (file, folder)).all()
    return Sweep(
        name, tuple(tuple(column.key.text for column in group) for group in groups), points, text, file
    )


def _stem(reader: Reader, root: Node, file: str) -> str:
    stem = os.path.splitext(os.path.basename(file))[0]
    if not SWEEP_NAME.fits(stem):
        mistake = f"is missing, and the file's {stem[:40]!a} cannot stand for it"
        reader.report(root, "name", f"{mistake}: give {SWEEP_NAME.expected}")
    return stem


def _base(reader: Reader, node: Node | None, file: str) -> tuple[Node | None, str]:
    """The tree of the base config, and its file. Raises ConfigError for a file that cannot be read."""
    if node is None or node.kind == "mapping":
        return node if node is None else _from_file(node, file), file
    text = reader.read(node, "config", SWEEP.keys[1].takes)
    if text is None:
        return None, file
    path = os.path.join(os.path.dirname(file), os.path.expanduser(text))
    mistakes = Mistakes(path)
    try:
        root = read_document(read_text(path, mistakes), mistakes)
        if root is None:
            raise mistakes.error()
    except ConfigError as error:
        for mistake in error.mistakes:
            if mistake.line:
                raise
            reader.report(node, "config", f"{shown(path)}: {mistake.message}")
        return None, file
    return _from_file(root, path), path


def _from_file(node: Node, file: str) -> Node:
    return replace(node, file=file, items=[_from_file(item, file) for item in node.items])


def _groups(reader: Reader, node: Node | None) -> list[list[_Column]]:
    """The keys that vary, by group, each with its values."""
    groups: list[list[_Column]] = []
    varied: dict[str, str] = {}
    for group, field, _ in reader.items(node, "vary", GROUPS) if node is not None else ():
        columns: list[_Column] = []
        if group.kind != "mapping" or not group.items:
            expected = f"must be a mapping {{key: {_VALUES}}}"
            reader.report(group, field, f"{expected}, got {'{}' if group.kind == 'mapping' else got(group)}")
            continue
        for key, value in zip(group.items[::2], group.items[1::2], strict=True):
            path = f"{field}.{shown(key.text)}"
            before = _overlap(key.text, varied)
            if key.kind != "scalar" or not all(key.text.split(".")):
                reader.wrong(key, field, "a key must be the path of one in a config, as topology.half_twists")
            elif key.text == "name":
                reader.report(key, path, "cannot vary: points are named by what varies")
            elif before:
                reader.report(key, path, f"{before} varies already, in {varied[before]}")
            else:
                varied[key.text] = field
                columns.append(_Column(key, _values(reader, value, path)))
        for column in columns[1:]:
            first, here = len(columns[0].values), len(column.values)
            if first and here and first != here:
                words = f"must have as many values as {columns[0].key.text}, {first}, got {here}"
                reader.report(column.key, f"{field}.{column.key.text}", words)
        groups.append(columns)
    return groups


def _overlap(key: str, varied: Mapping[str, str]) -> str | None:
    """A key that varies already and is this one, or holds it, or lies in it."""
    return next((k for k in varied if f"{k}.".startswith(f"{key}.") or f"{key}.".startswith(f"{k}.")), None)


def _values(reader: Reader, node: Node, field: str) -> list[Node]:
    if node.kind == "list":
        if not node.items:
            reader.report(node, field, "must have at least one value, got an empty list")
        for item in node.items:
            if is_null(item):
                reader.report(item, field, "has no value")
        return node.items
    if node.kind != "mapping":
        reader.wrong(node, field, f"must be {_VALUES}")
        return []
    found = reader.section(node, field, RANGE)
    first, last, steps = found.values().values()
    if first is None or last is None or steps is None:
        return []
    # To 15 digits, so that rounding does not tell 0.3 from the 0.3 that people ask for.
    between = (float(f"{first + j * (last - first) / steps:.15g}") for j in range(1, steps))
    numbers = (first, *between, last)
    if len(set(numbers)) < len(numbers):
        found.report("to", f"must leave the values apart, got {got(found.nodes['to'])}")
        return []
    return [Node(node.line, node.column, "scalar", _spelled(number)) for number in numbers]


def _spelled(number: float) -> str:
    """A number as a key takes it that may want an integer."""
    return str(int(number)) if number.is_integer() else repr(number)


_WORD = Node(1, 1, "scalar", "name")


def _places(groups: Sequence[Sequence[_Column]]) -> list[dict[str, _Pair]]:
    """Key and value of every point, by dotted key: the members of one group with those of the others."""
    members = [
        [
            {column.key.text: (column.key, value) for column, value in zip(group, row, strict=True)}
            for row in zip(*(column.values for column in group), strict=True)
        ]
        for group in groups
    ]
    return [
        {key: pair for part in chosen for key, pair in part.items()} for chosen in itertools.product(*members)
    ]


class _Points:
    """Makes the points, recording what is wrong with them; `files` are the sweep's and the base config's."""

    def __init__(
        self,
        mistakes: Mistakes,
        base: Node,
        name: str,
        groups: Sequence[Sequence[_Column]],
        files: tuple[str, str],
    ) -> None:
        self._mistakes = mistakes
        self._base = base
        self._name = name
        self._files = files
        self._places = _places(groups)
        self._wrong: dict[Mistake, list[dict[str, _Pair]]] = {}

    def all(self) -> tuple[Point, ...]:
        """Every point. Raises ConfigError with what is wrong with any of them."""
        made = []
        for place in self._places:
            config = self._config(place)
            made += [] if config is None else [(place, config)]
        for mistake, places in self._wrong.items():
            self._tell(mistake, places)
        if self._mistakes.found:
            raise self._mistakes.error()
        values = _same_types([self._read(place, config) for place, config in made])
        words = labels(list(values[0]))
        points: dict[str, Point] = {}
        for (place, config), value in zip(made, values, strict=True):
            name = point_name(self._name, value, words)
            if name in points:
                key, node = list(place.values())[-1]
                told = f"gives a point that there is already, {name}: values must differ, to 12 digits"
                self._mistakes.add(node.line, node.column, key.text, told)
            points[name] = Point(value, replace(config, name=name))
        if self._mistakes.found:
            raise self._mistakes.error()
        return tuple(points.values())

    def _config(self, place: dict[str, _Pair]) -> Config | None:
        """The config of a point, None with what is wrong on record."""
        sweep, base = self._files
        own = Mistakes(sweep)
        tree = self._base
        for key, value in place.values():
            tree = _placed(tree, key.text.split("."), key, value, own)
        tree = _placed(tree, ["name"], _WORD, _WORD, own)
        state = any("initial_guess.state".startswith(key) for key in place)
        try:
            if own.found:
                raise own.error()
            return config_of(tree, own, "", sweep if state else base)
        except ConfigError as error:
            for mistake in error.mistakes:
                if mistake in self._wrong or len(self._wrong) < MOST_MISTAKES:
                    self._wrong.setdefault(mistake, []).append(place)
            return None

    def _tell(self, mistake: Mistake, places: Sequence[dict[str, _Pair]]) -> None:
        """Record a mistake that these points have: where it stands or, if the base config is right by itself,
        at the value that does not go with it.
        """
        line, column, field, message, file = vars(mistake).values()
        if file and len(places) < len(self._places):
            first = places[0]
            shared = [key for key, pair in first.items() if all(place[key] is pair for place in places)]
            at = ", ".join(f"{key} = {got(first[key][1])}" for key in shared or first)
            value = first[(shared or list(first))[0]][1]
            message = f"{message} ({shown(file)}:{line}:{column}, with {at})"
            line, column, file = value.line, value.column, ""
        self._mistakes.add(line, column, field, message, "" if file == self._files[0] else file)

    def _read(self, place: dict[str, _Pair], config: Config) -> dict[str, Any]:
        """What varies, as the config understood it; as it is spelled where that is the default."""
        resolved = config.resolved()
        values = {}
        for key, (_, node) in place.items():
            found = _look_up(resolved, key.split("."))
            values[key] = _frozen(_plain(node) if found is None else found)
        return values


def _placed(tree: Node, path: list[str], key: Node, value: Node, mistakes: Mistakes) -> Node:
    """A copy of a tree with another value at a path; sections that are not there are made."""
    if not path:
        return value
    first, *rest = path
    if tree.kind == "list" and first.isdecimal() and int(first) < len(tree.items):
        items = list(tree.items)
        items[int(first)] = _placed(items[int(first)], rest, key, value, mistakes)
        return replace(tree, items=items)
    if tree.kind != "mapping":
        if tree.kind != "invalid":
            mistakes.add(
                key.line, key.column, key.text, f"no key {shown(first)} in the config: it has {got(tree)}"
            )
        return Node(key.line, key.column, "invalid")
    names, found = tree.items[::2], tree.items[1::2]
    for k, name in enumerate(names):
        if name.text == first:
            inner = Node(key.line, key.column, "mapping") if rest and is_null(found[k]) else found[k]
            items = list(tree.items)
            if not rest:
                items[2 * k] = replace(name, line=key.line, column=key.column, file="")
            items[2 * k + 1] = _placed(inner, rest, key, value, mistakes)
            return replace(tree, items=items)
    made = replace(key, text=first)
    inner = _placed(Node(key.line, key.column, "mapping"), rest, key, value, mistakes)
    return replace(tree, items=[*tree.items, made, inner])


def _look_up(resolved: Any, path: list[str]) -> Any:
    for part in path:
        if isinstance(resolved, list):
            resolved = resolved[int(part)] if part.isdecimal() and int(part) < len(resolved) else None
        else:
            resolved = resolved.get(part) if isinstance(resolved, Mapping) else None
    return resolved


def _plain(node: Node) -> Any:
    """What a node says, as far as it tells by itself."""
    if node.kind == "list":
        return [_plain(item) for item in node.items]
    if node.kind == "mapping":
        return {key.text: _plain(value) for key, value in zip(node.items[::2], node.items[1::2], strict=True)}
    if node.quoted:
        return node.text
    if node.text in ("true", "false"):
        return node.text == "true"
    try:
        number = evaluate(node.text)
    except ExpressionError:
        return node.text
    return int(node.text) if node.text.lstrip("+-").isdecimal() else number


def _frozen(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(map(_frozen, value))
    return {key: _frozen(item) for key, item in value.items()} if isinstance(value, Mapping) else value


def _same_types(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same, a key's numbers all floats where one of them is."""
    mixed = {key for key in rows[0] if {type(row[key]) for row in rows} == {int, float}}
    return [{key: float(value) if key in mixed else value for key, value in row.items()} for row in rows]
