"""The table of keys as a JSON Schema, for editors and for programs that write configs.

It is of draft-07: yaml-language-server, which most editors use, knows later drafts only since version 1.20,
and nothing that they add is needed here. Of a spelled number (`2*pi`) or a name that looks like a number a
schema sees what YAML makes of it, the reader what is written. So the schema takes whatever the reader takes,
and more: what ties one key to another (widths that are refined, recipes that fit the topology) is the
reader's to see.
"""

from __future__ import annotations

from typing import Any

from ribbon_cli.config.reader import NUMBER
from ribbon_cli.config.table import CONFIG
from ribbon_cli.expression import MAX_CHARACTERS, PATTERN
from ribbon_cli.keys import (
    Either,
    Flag,
    Integer,
    Items,
    Key,
    Number,
    Section,
    Takes,
    Text,
    Vector,
    Word,
)

SCHEMA_FILE = "ribbon.schema.json"
"""What templates call the schema's file, which lies beside the config."""


def schema() -> dict[str, Any]:
    """The JSON Schema of configs."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "config of ribbon",
        "description": "`ribbon check` finds what this schema cannot express.",
        **_of(CONFIG),
    }


def _of(takes: Takes) -> dict[str, Any]:
    """The schema of one kind of values."""
    match takes:
        case Integer():
            even = {"multipleOf": 2} if takes.even else {}
            return {"type": "integer", "minimum": takes.low, "maximum": takes.high, **even}
        case Number():
            return _number(takes)
        case Vector():
            return {"type": "array", "items": _of(takes.of), "minItems": 3, "maxItems": 3}
        case Word():
            return {"enum": list(takes.choices)}
        case Flag():
            return {"type": ["boolean", "string"], "pattern": "^(?:true|false)$"}
        case Text():
            pattern = f"^(?:{takes.pattern})$"
            return {
                "type": ["string", "number", "boolean"],
                "pattern": pattern,
                "patternErrorMessage": f"must be {takes.expected}",
                "minLength": 1,
                "maxLength": takes.longest,
            }
        case Items():
            once = {"uniqueItems": True} if takes.once else {}
            return {"type": "array", "items": _of(takes.of), "minItems": 1, "maxItems": takes.at_most, **once}
        case Section():
            return _section(takes)
        case Either():
            return {"oneOf": [_of(kind) for kind in takes.kinds]}


def _number(takes: Number) -> dict[str, Any]:
    """A number, or a text that spells one; only the size of numbers can be told by a schema."""
    inclusive = takes.above is None or takes.low > takes.above
    low = {"minimum": takes.low} if inclusive else {"exclusiveMinimum": takes.above}
    high = {} if takes.below is None else {"exclusiveMaximum": takes.below}
    high |= {} if takes.high is None else {"maximum": takes.high}
    return {
        "type": ["number", "string"],
        **low,
        **high,
        "pattern": PATTERN,
        "patternErrorMessage": f"must be {NUMBER}",
        "maxLength": MAX_CHARACTERS,
    }


def _section(section: Section) -> dict[str, Any]:
    told = {"title": section.name, "description": section.about}
    required = [key.name for key in section.keys if key.required]
    return {
        **{name: text for name, text in told.items() if text},
        "type": "object",
        "properties": {key.name: _key(key) for key in section.keys},
        "additionalProperties": False,
        **({"required": required} if required else {}),
    }


def _key(key: Key) -> dict[str, Any]:
    unit = f", in the unit of `{key.takes.unit}`" if isinstance(key.takes, Number) and key.takes.unit else ""
    default = list(key.default) if isinstance(key.default, tuple) else key.default
    return {
        "description": key.meaning + unit,
        **({} if default is None else {"default": default}),
        **({"examples": list(key.examples)} if key.examples else {}),
        **_of(key.takes),
    }
