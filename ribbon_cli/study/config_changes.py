"""What a changed config has changed: its difference from the nearest run that has the same name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..config import Config
from ..errors import RibbonError
from ..store import Run, list_runs
from .run_config import resolved_config

_MOST = 200
"""Most runs of one name that are looked at."""
_LONGEST = 60


def what_changed(config: Config, root: Path) -> str | None:
    """A line on how a config without a run differs from the nearest run of its name; None if there is no
    such run.
    """
    name = f"{config.name}-{config.hash8()}"
    if (root / name).exists():
        return None
    new = _flat(config.scientific())
    found = []
    for run in [run for run in list_runs(root) if run.short_name == config.name][:_MOST]:
        old = _settings(run)
        if old is not None:
            found.append((_differences(old, new), run.name))
    if not found:
        return None
    differences, nearest = min(found, key=lambda item: (len(item[0]), item[1]))
    return f"a new run, {name}: its config differs from that of {nearest} in {', '.join(differences)}"


def _settings(run: Run) -> dict[str, Any] | None:
    """A run's settings by path, None where they cannot be read."""
    try:
        return _flat(resolved_config(run).scientific())
    except RibbonError:
        return None


def _flat(value: Any, path: str = "") -> dict[str, Any]:
    """Nested settings as `path.to.key`: value; lists stay whole."""
    if not isinstance(value, dict):
        return {path: value}
    flat: dict[str, Any] = {}
    for key, item in value.items():
        flat |= _flat(item, f"{path}.{key}" if path else str(key))
    return flat


def _differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """The keys that differ, each with both values."""
    return [
        f"{key} ({_shown(old.get(key))} -> {_shown(new.get(key))})"
        for key in dict.fromkeys([*new, *old])
        if old.get(key) != new.get(key)
    ]


def _shown(value: Any) -> str:
    """A value on a few characters."""
    text = "none" if value is None else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
