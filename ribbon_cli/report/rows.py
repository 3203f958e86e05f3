"""A table with a row for each state, of one run or of many: as text, JSON, CSV, Parquet and netCDF."""

from __future__ import annotations

import csv
import importlib
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

from ribbon_cli import digits
from ribbon_cli.errors import UsageError
from ribbon_cli.report.where import condition, near
from ribbon_cli.text import aligned, visible

LEADING = ("schedule", "widths")
"""Sections of a config whose keys say where it leads; those of others hold from the start."""
MISSING = "-"
KINDS = {"float64": "number", "int64": "number", "bool": "truth", "utf-8": "text"}
"""What a column holds, in the words of conditions."""


@dataclass(frozen=True)
class Column:
    """A column: its name, the type of its values as in layout.py, and whether they may be missing."""

    name: str
    dtype: str
    optional: bool = True

    @property
    def kind(self) -> str:
        """What it holds, in a word."""
        return KINDS[self.dtype]


@dataclass(frozen=True)
class Rows:
    """Columns and rows; `shown` are the columns that text shows by default, `keys` those that tell the states
    apart.

    `leading` are keys of sweeps that say where schedules lead, which are None in rows of states that are not
    there. `missed` has a sentence for each sweep some of whose points have no state there.
    """

    columns: tuple[Column, ...]
    rows: tuple[Mapping[str, Any], ...]
    shown: tuple[str, ...] = ()
    keys: tuple[str, ...] = ()
    leading: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()

    def where(self, text: str | None) -> Rows:
        """The rows for which a condition holds. Raises UsageError."""
        if text is None:
            return self
        holds = condition(text, {column.name: column.kind for column in self.columns})
        return replace(self, rows=tuple(row for row in self.rows if holds(row)))

    def only(self, names: Sequence[str]) -> Rows:
        """Some of the columns, in the order given. Raises UsageError for an unknown column."""
        known = {column.name: column for column in self.columns}
        for name in names:
            if name not in known:
                raise UsageError(f"--columns: no column {name!r}{near(name, known)}")
        return replace(self, columns=tuple(known[name] for name in names), shown=tuple(names))

    def values(self, column: Column) -> list[Any]:
        """A column's values, None for those that are missing."""
        return [_plain(row.get(column.name), column) for row in self.rows]


def _plain(value: Any, column: Column) -> Any:
    """A value of a column's type; several texts are joined by `; `."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    if column.dtype == "utf-8":
        return "; ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
    return float(value) if column.dtype == "float64" else value


# --- text and JSON ---


def text(table: Rows) -> str:
    """The `shown` columns, aligned."""
    chosen = table.only(table.shown).columns
    cells = [[_cell(value, column) for value in table.values(column)] for column in chosen]
    left = {k for k, column in enumerate(chosen) if column.dtype == "utf-8"}
    return aligned([[column.name for column in chosen], *zip(*cells, strict=True)], left)


def _cell(value: Any, column: Column) -> str:
    if value is None:
        return MISSING
    if column.dtype == "bool":
        return "yes" if value else "no"
    if "energy" in column.name and column.dtype == "float64":
        return digits.energy(value)
    return f"{value:.10g}" if column.dtype == "float64" else visible(str(value))


def records(table: Rows) -> list[dict[str, Any]]:
    """The rows for JSON."""
    columns = {column.name: table.values(column) for column in table.columns}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


# --- files ---


def csv_bytes(table: Rows) -> bytes:
    """CSV: numbers to full precision, missing values as empty cells, truth values as `true` and `false`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    cells = [[_csv_cell(value) for value in table.values(column)] for column in table.columns]
    writer.writerows(zip(*cells, strict=True))
    return out.getvalue().encode()


def _csv_cell(value: Any) -> Any:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else value


def parquet_bytes(table: Rows) -> bytes:
    """One Parquet file; numbers with a decimal point are float64, hashes are texts.

    Raises UsageError without pyarrow.
    """
    pyarrow, parquet = _needed("pyarrow"), _needed("pyarrow.parquet")
    types = {
        "float64": pyarrow.float64(),
        "int64": pyarrow.int64(),
        "bool": pyarrow.bool_(),
        "utf-8": pyarrow.string(),
    }
    arrays = [pyarrow.array(table.values(column), types[column.dtype]) for column in table.columns]
    out = io.BytesIO()
    named = pyarrow.Table.from_arrays(arrays, names=[column.name for column in table.columns])
    parquet.write_table(named, out)
    return out.getvalue()


def netcdf_bytes(table: Rows) -> bytes:
    """A netCDF-4 file: a variable for each column over the dimension `state`.

    A missing value is not-a-number or an empty text. Whole numbers are float64 if one is missing. Truth
    values are bytes, 1 or 0. Raises UsageError without h5netcdf.
    """
    import numpy as np

    h5netcdf = _needed("h5netcdf")
    out = io.BytesIO()
    with h5netcdf.File(out, "w") as file:
        file.dimensions = {"state": len(table.rows)}
        for column in table.columns:
            values = table.values(column)
            if column.dtype == "utf-8":
                made = file.create_variable(column.name, ("state",), h5netcdf.core.h5py.string_dtype())
                made[...] = np.array(["" if value is None else value for value in values], dtype=object)
                continue
            if column.dtype == "bool":
                array = np.array([bool(value) for value in values], dtype=np.int8)
            elif column.dtype == "int64" and None not in values:
                array = np.array(values, dtype=np.int64)
            else:
                array = np.array([math.nan if value is None else value for value in values], dtype=np.float64)
            file.create_variable(column.name, ("state",), array.dtype, data=array)
    return out.getvalue()


def _needed(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        advice = f"this format needs {package}, which is not installed: pip install {package}"
        raise UsageError(advice) from error


FORMATS: dict[str, Callable[[Rows], bytes]] = {
    "csv": csv_bytes,
    "parquet": parquet_bytes,
    "nc": netcdf_bytes,
}
"""Writers by the suffix of a file."""
