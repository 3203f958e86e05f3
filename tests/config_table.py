"""The table of a config's keys, listed by path and rendered as docs/reference/config.md shows it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ribbon_cli.config.json_schema import schema
from ribbon_cli.config.table import CONFIG
from ribbon_cli.keys import Either, Flag, Integer, Items, Key, Number, Section, Takes, Vector, Word


def keys() -> Iterator[tuple[str, Key, dict[str, Any]]]:
    """Every key with its path and its part of the schema; several of one path where recipes share a name."""
    return _keys(CONFIG, schema(), "")


def _keys(takes: Takes, part: dict[str, Any], prefix: str) -> Iterator[tuple[str, Key, dict[str, Any]]]:
    if isinstance(takes, Either):
        for kind, inner in zip(takes.kinds, part["oneOf"], strict=True):
            yield from _keys(kind, inner, prefix)
    if isinstance(takes, Section):
        for key in takes.keys:
            inner = part["properties"][key.name]
            yield prefix + key.name, key, inner
            yield from _keys(key.takes, inner, f"{prefix}{key.name}.")


def rows() -> list[str]:
    """The reference's rows, one for each path."""
    merged: dict[str, list[Key]] = {}
    for path, key, _ in keys():
        merged.setdefault(path, []).append(key)
    return [_row(path, found) for path, found in merged.items()]


def _row(path: str, found: list[Key]) -> str:
    takes, defaults = _cell(_takes(key.takes) for key in found), _cell(_default(key) for key in found)
    return f"| `{path}` | {takes} | {defaults} | {found[0].meaning} |"


def _cell(texts: Iterable[str]) -> str:
    """What a key takes, or its default, in each of the recipes that know it."""
    return "; ".join(dict.fromkeys(texts))


def _default(key: Key) -> str:
    if key.required or key.default is None:
        return "required" if key.required else key.otherwise
    value = key.default
    text = f"[{', '.join(_short(part) for part in value)}]" if isinstance(value, tuple) else str(value)
    return f"`{text.lower() if isinstance(value, bool) else text}`"


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _takes(takes: Takes) -> str:
    match takes:
        case Integer():
            return takes.expected.partition(" ")[2]
        case Number():
            if takes.above is None:
                return "number" if takes.low < 0.0 else f"number from {takes.low:g}"
            inclusive = takes.low > takes.above
            low = f"number from {takes.low:g}" if inclusive else f"number > {takes.above:g}"
            high = "" if takes.below is None else f", < {takes.below:g}"
            high += "" if takes.high is None else f", up to {takes.high:g}"
            return f"{low}{high}".replace("e-0", "e-").replace("e+0", "e")
        case Vector():
            return "list of three numbers"
        case Word():
            return ", ".join(f"`{choice}`" for choice in takes.choices)
        case Flag():
            return "`true`, `false`"
        case Items():
            return f"list of at most {takes.at_most}: {_takes(takes.of)}"
        case Section():
            return f"`{{{', '.join(_entry(key) for key in takes.keys)}}}`"
        case Either():
            return "; ".join(_takes(kind) for kind in takes.kinds)
    return "text"


def _entry(key: Key) -> str:
    single = isinstance(key.takes, Word) and len(key.takes.choices) == 1
    return f"{key.name}: {key.takes.choices[0]}" if single else key.name
