"""Rows of `ribbon ls --json` as flat tables: in a run's display, and as pandas data frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ribbon_cli import report
from ribbon_cli.api.extras import extra
from ribbon_cli.store import Run, Summary
from ribbon_cli.store.layout import BRANCH, REACTIONS, STATE
from ribbon_cli.store.summaries import OF_CONTACTS, varying

if TYPE_CHECKING:
    from pandas import DataFrame


_TYPES = {"float64": "float64", "int64": "int64", "bool": "bool", "utf-8": "object"}
_MAY_LACK = "Int64"
"""pandas' integers with gaps."""


def as_found(run: Run, states: Sequence[Summary]) -> tuple[list[Summary], dict[int, str]]:
    """Summaries of a run's states, and of those whose files are not what was committed a word on each.

    Their status is that word, and they have no certificate. Raises StoreError for a damaged log.
    """
    lost = run.damage(state.label for state in states)
    return [
        replace(state, status=lost[state.label], certified=False) if state.label in lost else state
        for state in states
    ], lost


def damage_in_words(run: Run, lost: Mapping[int, str]) -> list[str]:
    """A line on each state whose file is not what was committed."""
    return [
        f"{run.state_path(label)}: {word}: the listing shows what was committed"
        for label, word in lost.items()
    ]


def flat(state: Summary, run: str) -> dict[str, Any]:
    """A summary of a run's state without groups: a branch's fields are `branch_name` and so on, parameters
    besides the half-width `parameter_twist` and so on, a reaction's components `start_force_x` and so on.
    """
    row = {"run": run, **vars(state)}
    branch = row.pop("branch")
    row |= {f"parameter_{name}": value for name, value in row.pop("others").items()}
    for name in REACTIONS:
        row |= zip((f"{name}_{axis}" for axis in "xyz"), row.pop(name) or (), strict=False)
    return row | {f"branch_{name}": value for name, value in (vars(branch) if branch else {}).items()}


def column_types(states: Sequence[Summary]) -> dict[str, tuple[str, bool]]:
    """Columns of flat summaries in the order of `ribbon ls --json`, each with its type and whether values may
    be absent; those of branches where a state is on one, of contact forces where one has some, and of
    parameters that vary.
    """
    branches = any(state.branch for state in states)
    own = {item.field: item for item in STATE if item.summary}
    marked = [*own.items(), ("event_kinds", own["events"])]
    marked += [(f"branch_{item.field}", item) for item in BRANCH if item.summary and branches]
    rows = {name: (item.dtype if not item.dims else "utf-8", item.optional) for name, item in marked}
    rows["bending_energy"] = ("float64", True)
    rows |= {f"parameter_{name}": ("float64", True) for name in varying(states)}
    if any(state.reaction_force for state in states):
        rows |= {f"{name}_{axis}": ("float64", True) for name in REACTIONS for axis in "xyz"}
    if any(state.with_forces for state in states):
        rows |= {name: (dtype, True) for name, dtype in OF_CONTACTS.items()}
    return {"run": ("utf-8", False), **rows, "content_sha256": ("utf-8", False)}


def frame(run: Run, states: Sequence[Summary], what: str) -> DataFrame:
    """A data frame with a row for each of a run's states. Raises ImportError without pandas."""
    known = [report.rows.Column(name, *rest) for name, rest in column_types(states).items()]
    rows = tuple(flat(state, run.name) for state in states)
    return data_frame(extra("pandas", what), report.rows.Rows(tuple(known), rows))


def data_frame(pandas: ModuleType, rows: report.rows.Rows) -> DataFrame:
    """A table as pandas has it: texts are objects, whole numbers that may be missing have gaps."""
    table = pandas.DataFrame(list(rows.rows), columns=[column.name for column in rows.columns])
    for column in rows.columns:
        gaps = column.optional or column.name.startswith("branch_")
        dtype = _MAY_LACK if gaps and column.dtype == "int64" else _TYPES[column.dtype]
        table[column.name] = table[column.name].astype(dtype)
    return table
