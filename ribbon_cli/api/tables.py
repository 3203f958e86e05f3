"""Rows of `ribbon ls --json` as flat tables: in a run's display, and as pandas data frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ribbon_cli.api.extras import extra
from ribbon_cli.store import Run
from ribbon_cli.store.layout import BRANCH, STATE

if TYPE_CHECKING:
    from pandas import DataFrame


_TYPES = {"float64": "float64", "int64": "int64", "bool": "bool", "utf-8": "object"}
_MAY_LACK = "Int64"
"""pandas' integers with gaps."""


def as_found(run: Run, states: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], dict[int, str]]:
    """Summaries of a run's states, and of those whose files are not what was committed a word on each.

    Their status is that word, and they have no certificate. Raises StoreError for a damaged log.
    """
    lost = run.damage(state["label"] for state in states)
    changed = {label: {"status": word, "certified": False} for label, word in lost.items()}
    return [{**state, **changed.get(state["label"], {})} for state in states], lost


def damage_in_words(run: Run, lost: Mapping[int, str]) -> list[str]:
    """A line on each state whose file is not what was committed."""
    return [
        f"{run.state_path(label)}: {word}: what is listed of it is what was committed"
        for label, word in lost.items()
    ]


def flat(state: Mapping[str, Any]) -> dict[str, Any]:
    """A summary without groups: the topology's keys stand alone, a branch's are `branch_name` and so on."""
    row: dict[str, Any] = {}
    for key, value in state.items():
        if isinstance(value, Mapping):
            row |= {f"branch_{name}" if key == "branch" else name: item for name, item in value.items()}
        else:
            row[key] = tuple(value) if isinstance(value, list) else value
    return row


def column_types(branches: bool) -> dict[str, tuple[str, bool]]:
    """Columns of a flat summary in the order of `ribbon ls --json`, each with its type and whether values may
    be absent; those of branches only if asked.
    """
    marked = [(item.field, item) for item in STATE if item.summary]
    marked += [(f"branch_{item.field}", item) for item in BRANCH if item.summary and branches]
    rows = {name: (item.dtype if not item.dims else "utf-8", item.optional) for name, item in marked}
    return {"run": ("utf-8", False), **rows, "content_sha256": ("utf-8", False)}


def frame(states: Sequence[Mapping[str, Any]], what: str) -> DataFrame:
    """A data frame with a row a summary. Raises ImportError without pandas."""
    pandas = extra("pandas", what)
    rows = [flat(state) for state in states]
    branches = any("branch_name" in row for row in rows)
    known = column_types(branches)
    later = {key: None for row in rows for key in row if key not in known}
    table = pandas.DataFrame(rows, columns=[*known, *later])
    for name, (dtype, optional) in known.items():
        gaps = optional or name.startswith("branch_")
        table[name] = table[name].astype(_MAY_LACK if gaps and dtype == "int64" else _TYPES[dtype])
    return table
