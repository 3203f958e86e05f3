"""Between a record and the flat set of values that its file holds, as layout.py lists them.

A value is a NumPy array (0-d for scalars) of little-endian float64, int64 or bool, a str, or a tuple of str.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ribbon_cli.parts import FINISHES, STARTS, Ends, Loads, Material, Parts
from ribbon_cli.store.contacts import Contacts
from ribbon_cli.store.layout import (
    BRANCH,
    CONTACTS,
    DIMENSIONS,
    ENDS,
    LOADS,
    MATERIAL,
    SPECTRUM,
    STATE,
    Item,
    as_with_forces,
    provenance_item,
)
from ribbon_cli.store.record import METRICS, BranchRecord, SpectrumRecord, StateRecord

if TYPE_CHECKING:
    import numpy as np

    Value = np.ndarray[Any, Any] | str | tuple[str, ...]

NUMPY_DTYPE = {"float64": "<f8", "int64": "<i8", "bool": "?"}
_KEY = r"[a-z][a-z0-9_]{0,63}"


@dataclass(frozen=True)
class Field:
    """One dataset to write: its item, with the path made definite, and its value."""

    item: Item
    value: Value


def is_provenance(path: str) -> bool:
    """Whether a path is in /provenance."""
    return path.startswith("/provenance/")


def is_scientific(path: str) -> bool:
    """Whether the content hash covers a path: everything but /provenance and scales, which follow from the
    rest.
    """
    return not is_provenance(path) and path.rpartition("/")[2] not in DIMENSIONS


def value_shape(value: Value) -> tuple[int, ...]:
    """Shape of a value; a str is a scalar."""
    if isinstance(value, str):
        return ()
    return (len(value),) if isinstance(value, tuple) else value.shape


def value_dtype(value: Value) -> str:
    """Name of a value's dtype in layout.py. Raises ValueError for an array of another dtype."""
    if isinstance(value, str | tuple):
        return "utf-8"
    for name, code in NUMPY_DTYPE.items():
        if value.dtype == code:
            return name
    raise ValueError(f"dtype {value.dtype} is not one of float64, int64, bool, utf-8")


def _check_shape(item: Item, shape: tuple[int, ...], dims: dict[str, int]) -> None:
    """Compare a shape with the item's, binding symbols at their first use. Raises ValueError."""
    wanted = tuple(
        dim if isinstance(dim, int) else dims.setdefault(dim, shape[axis] if axis < len(shape) else -1)
        for axis, dim in enumerate(item.shape)
    )
    if shape != wanted:
        symbols = "(" + ", ".join(map(str, item.shape)) + ")"
        raise ValueError(f"{item.path} has shape {shape}, expected {symbols} = {wanted}")


def _to_value(item: Item, raw: Any) -> Value:
    """Convert a record's attribute to the item's dtype. Raises ValueError where that would change it."""
    import numpy as np

    if item.dtype == "utf-8":
        texts = (raw,) if isinstance(raw, str) else raw
        if any("\0" in text for text in texts):
            raise ValueError(f"{item.path}: text must not contain the null character")
        return raw if isinstance(raw, str) else tuple(raw)
    value = np.asarray(raw, dtype=NUMPY_DTYPE[item.dtype])
    if item.dtype != "float64" and not np.array_equal(value, raw):
        raise ValueError(f"{item.path} must be {item.dtype}, got {raw!r}")
    return value


def _record_fields(record: object, items: tuple[Item, ...], dims: dict[str, int]) -> Iterator[Field]:
    """Fields of the items that the record has; absent optional ones are left out."""
    for item in items:
        raw = getattr(record, item.field)
        if raw is None and item.optional:
            continue
        value = _to_value(item, raw)
        _check_shape(item, value_shape(value), dims)
        yield Field(item, value)


def _kept(parts: Parts) -> Iterator[tuple[tuple[Item, ...], object]]:
    """What a file keeps of ends, material and loads, with its items."""
    if parts.ends is not None:
        yield from ((ENDS, parts.ends), (LOADS, parts.loads))
    if parts.ends is not None or parts.material != Material():
        yield MATERIAL, parts.material


def _parts(values: Mapping[str, Value]) -> Parts:
    """Ends, material and loads as a file has them. Raises ValueError where they do not fit."""
    ends, material, loads = (
        _plain_values(values, items) if any(path.startswith(f"/{group}/") for path in values) else None
        for group, items in (("ends", ENDS), ("material", MATERIAL), ("loads", LOADS))
    )
    found = Parts(None if ends is None else Ends(**ends), Material(**material or {}), Loads(**loads or {}))
    if found.ends is not None and (found.ends.start not in STARTS or found.ends.end not in FINISHES):
        raise ValueError(f"ends are {found.ends.start!r} and {found.ends.end!r}, which no strip has")
    return found


def _plain_values(values: Mapping[str, Value], items: tuple[Item, ...]) -> dict[str, Any]:
    """Values of a group without arrays. Raises ValueError where they do not fit."""
    found = _record_values(values, items, {})
    return {
        name: tuple(value.tolist()) if hasattr(value, "tolist") else value for name, value in found.items()
    }


def _spectrum_items(metric: str) -> tuple[Item, ...]:
    """Items of one spectrum with definite paths."""
    return tuple(replace(item, path=item.path.replace("METRIC", metric)) for item in SPECTRUM)


def _dims(segments: int) -> dict[str, int]:
    """Values of the symbols that N fixes."""
    return {"N": segments, "N+1": segments + 1}


def flatten(record: StateRecord) -> list[Field]:
    """Return every dataset of a record's file, provenance last.

    Raises ValueError where a value does not fit layout.py.
    """
    of_state, of_branch = STATE, BRANCH
    if record.contacts is not None:
        of_state, of_branch = as_with_forces(STATE), as_with_forces(BRANCH)
    fields = list(_record_fields(record, of_state, _dims(record.segments)))
    for items, part in _kept(record.parts):
        fields += _record_fields(part, items, {})
    for spectrum in record.spectra:
        dims = _dims(record.segments)
        fields += _record_fields(spectrum, _spectrum_items(spectrum.metric), dims)
        _check_modes(spectrum.metric, dims)
    if record.branch is not None:
        fields += _record_fields(record.branch, of_branch, _dims(record.segments))
    if record.contacts is not None:
        fields += _record_fields(record.contacts, CONTACTS, {})
    for key in sorted(record.provenance):
        if not re.fullmatch(_KEY, key):
            raise ValueError(f"provenance key {key!r} must be lower-case letters, digits and underscores")
        item = provenance_item(key, record.provenance[key])
        fields.append(Field(item, _to_value(item, record.provenance[key])))
    return fields


def scales(fields: list[Field], length: float, segments: int) -> list[Field]:
    """Return the dimension scales of the arrays in `fields`: one for each dimension in each group."""
    found: dict[str, Field] = {}
    for field in fields:
        for dim, size in zip(field.item.dims, value_shape(field.value), strict=True):
            path = f"{field.item.group}/{dim}"
            if path not in found:
                about = DIMENSIONS[dim]
                item = Item(path, about.dtype, (dim,), about.equation, about.description)
                found[path] = Field(item, scale(dim, size, length / segments))
    return list(found.values())


def scale(dim: str, size: int, h: float) -> Value:
    """Values along a dimension, of facets of length h."""
    import numpy as np

    if dim == "xyz":
        return ("x", "y", "z")
    if dim == "feature":
        return ("kind", "number")
    if dim == "unknown":
        return ("u_x", "u_y", "u_z", "g_x", "g_y", "g_z", "xi")
    if DIMENSIONS[dim].dtype == "int64":
        return np.arange(1, size + 1, dtype=np.int64)
    return (np.arange(size) + (0.5 if dim == "facet" else 0.0)) * h


def _check_modes(metric: str, dims: dict[str, int]) -> None:
    """Refuse more vectors than eigenvalues. Raises ValueError."""
    if dims.get("m", 0) > dims["k"]:
        raise ValueError(f"/spectra/{metric}/vectors holds {dims['m']} modes for {dims['k']} eigenvalues")


def _to_python(value: Value) -> Any:
    """Scalars as Python's own, arrays and texts as they are."""
    return value if isinstance(value, str | tuple) or value.shape else value.item()


def _record_values(
    values: Mapping[str, Value], items: tuple[Item, ...], dims: dict[str, int]
) -> dict[str, Any]:
    """Keyword arguments of a record from its file's values. Raises ValueError where they do not fit."""
    found: dict[str, Any] = {}
    for item in items:
        value = values.get(item.path)
        if value is None:
            if not item.optional:
                raise ValueError(f"{item.path} is missing")
            found[item.field] = None
            continue
        if value_dtype(value) != item.dtype:
            raise ValueError(f"{item.path} is {value_dtype(value)}, expected {item.dtype}")
        _check_shape(item, value_shape(value), dims)
        found[item.field] = _to_python(value)
    return found


def assemble(values: Mapping[str, Value], event_kinds: tuple[str, ...] | None = None) -> StateRecord:
    """Return the record of a file's values, a mapping from path to value; the inverse of `flatten`.

    `event_kinds` are those of the file's events, None where it does not have them.
    Paths that layout.py does not know are skipped: a newer minor version may add them.
    Raises ValueError where a dataset is missing or does not fit.
    """
    segments = values.get("/state/segments")
    if segments is None or value_dtype(segments) != "int64" or value_shape(segments) != ():
        raise ValueError("/state/segments is missing or not an integer")
    n = int(_to_python(segments))
    spectra = []
    for metric in METRICS:
        if not any(path.startswith(f"/spectra/{metric}/") for path in values):
            continue
        dims = _dims(n)
        spectra.append(SpectrumRecord(**_record_values(values, _spectrum_items(metric), dims), metric=metric))
        _check_modes(metric, dims)
    branch = None
    if any(path.startswith("/branch/") for path in values):
        branch = BranchRecord(**_record_values(values, BRANCH, _dims(n)))
    contacts = None
    if any(path.startswith("/contacts/") for path in values):
        contacts = Contacts(**_record_values(values, CONTACTS, {}))
    fields = _record_values(values, STATE, _dims(n))
    fields |= {"spectra": tuple(spectra), "branch": branch, "event_kinds": event_kinds}
    fields["contacts"] = contacts
    fields["parts"] = _parts(values)
    record = StateRecord(**fields, provenance=_provenance(values))
    _check_scales(values, record)
    return record


def _check_scales(values: Mapping[str, Value], record: StateRecord) -> None:
    """Refuse scales that are not those of the arrays. Format 1.0 has none. Raises ValueError."""
    stored = {path for path in values if not is_provenance(path) and not is_scientific(path)}
    if not stored:
        return
    for field in scales(flatten(record), record.length, record.segments):
        path, value = field.item.path, values.get(field.item.path)
        stored.discard(path)
        if value is None:
            raise ValueError(f"{path} is missing")
        if value_dtype(value) != field.item.dtype or not _same(value, field.value):
            raise ValueError(f"{path} is not the scale of its arrays")
    if stored:
        raise ValueError(f"{min(stored)} is a scale of nothing")


def _same(a: Value, b: Value) -> bool:
    """Whether two values of one type are equal to the last bit."""
    if isinstance(a, str | tuple) or isinstance(b, str | tuple):
        return a == b
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def _provenance(values: Mapping[str, Value]) -> dict[str, Any]:
    """Entries of /provenance. Raises ValueError unless each is a scalar."""
    found = {}
    for path, value in values.items():
        if is_provenance(path):
            if value_shape(value) != ():
                raise ValueError(f"{path} must be a scalar")
            found[path.removeprefix("/provenance/")] = _to_python(value)
    return found
