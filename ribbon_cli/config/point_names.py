"""Names of a sweep's points: what varies, short, fit for a folder, and the same whenever they are made.

`fam-n1-twist-b0.2`: each key that varies, in the order of the file, numbers with a label, words alone.
A point's name does not depend on the other points, so that a sweep that grows finds its runs again.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ribbon_cli.config.table import NAME

_SHORT = {"half_width": "b", "segments": "N", "half_twists": "n", "widths": "b"}
_UNFIT = re.compile(r"[^A-Za-z0-9._-]+")
_POOR = re.compile(r"to|from|[0-9]+")
"""Last words of a key that say little by themselves."""
_LONGEST_LIST = 20
_DIGITS = 8


def labels(keys: Sequence[str]) -> dict[str, str]:
    """A short word for each dotted key; the whole of it where two would have the same."""
    words = {key: _label(key.split(".")) for key in keys}
    count = Counter(words.values())
    return {key: word if count[word] == 1 else _fit(key) for key, word in words.items()}


def _label(parts: list[str]) -> str:
    keep = 1
    while keep < len(parts) and _POOR.fullmatch(parts[-keep]):
        keep += 1
    return _fit(".".join(_SHORT.get(part, part) for part in parts[-keep:]))


def point_name(sweep: str, values: Mapping[str, Any], words: Mapping[str, str]) -> str:
    """The name of the point with these values; `words` are the keys' labels."""
    name = "-".join([sweep, *(_part(words[key], value) for key, value in values.items())])
    if len(name) <= NAME.longest:
        return name
    return f"{name[: NAME.longest - _DIGITS - 1].rstrip('-._')}-{_digest(values)}"


def _part(word: str, value: Any) -> str:
    if isinstance(value, bool):
        return f"{word}-{str(value).lower()}"
    if isinstance(value, int | float):
        return f"{word}{_number(value)}"
    if isinstance(value, str):
        return _fit(value) or f"{word}-{_digest(value)}"
    if isinstance(value, tuple) and all(isinstance(item, int | float) for item in value):
        together = "_".join(map(_number, value))
        if len(together) <= _LONGEST_LIST:
            return f"{word}{together}"
    return f"{word}-{_digest(value)}"


def _number(value: float) -> str:
    """A number to 12 digits, as file names take it."""
    return f"{value + 0.0:.12g}".replace("+", "")


def _fit(text: str) -> str:
    return _UNFIT.sub("_", text).strip("._-")


def _digest(value: Any) -> str:
    canonical = json.dumps(value, sort_keys=True, separators=(",", ":"), default=dict)
    return hashlib.sha256(canonical.encode()).hexdigest()[:_DIGITS]
