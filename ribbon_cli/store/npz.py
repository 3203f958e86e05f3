"""States as npz files, for programs that read NumPy's formats and not HDF5."""

from __future__ import annotations

import dataclasses
import io
import math
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ribbon_cli.errors import StoreError
from ribbon_cli.parts import FINISHES, FREE, STARTS, Ends, Loads, Material, Parts
from ribbon_cli.store.atomic import write_atomic
from ribbon_cli.store.contacts import Contacts
from ribbon_cli.store.content import content_sha256
from ribbon_cli.store.hdf5 import MAX_BYTES
from ribbon_cli.store.layout import REACTIONS
from ribbon_cli.store.record import StateRecord
from ribbon_cli.text import in_a_line

UNKNOWN = -1
"""Stands for an undetermined `negative_eigenvalues`: npz has no None."""

ARRAYS = ("u", "g", "xi", "g_end", "lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma")
SCALARS = (
    "half_width",
    "length",
    "sigma",
    "segments",
    "half_twists",
    "discretisation",
    "energy",
    "linking_number",
    "self_contact",
    "label",
    "kind",
    "status",
    "certified",
    "kkt_residual",
    "constraint_residual",
    "negative_eigenvalues",
)

_PARTS: dict[str, type[Ends | Material | Loads]] = {"ends": Ends, "material": Material, "loads": Loads}
_PART_FIELDS = tuple(f"{part}_{name}" for part, kind in _PARTS.items() for name in vars(kind()))
_CONTACTS = tuple(f"contact_{field.name}" for field in dataclasses.fields(Contacts))
_SHAPES: dict[str, tuple[str | int, ...]] = {
    **dict.fromkeys(("u", "g"), ("N", 3)),
    **dict.fromkeys(("xi", "lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5"), ("N",)),
    **dict.fromkeys(("g_end", "gamma"), (3,)),
}
_DEFAULTS = {"length": 2.0 * math.pi, "discretisation": "thesis"}
_UNREADABLE = (ValueError, TypeError, EOFError, RuntimeError, struct.error, zlib.error, zipfile.BadZipFile)
"""What zipfile and NumPy raise on damaged files."""
_DISCRETISATIONS = ("thesis", "value-average")


def export_npz(record: StateRecord, path: str | Path, overwrite: bool = False) -> None:
    """Write a state's arrays (`ARRAYS`), scalars (`SCALARS`) and content_sha256, of a strip its parts, and of
    a state with contact forces `contact_first` and so on.

    The same record gives the same bytes. Raises StoreError when the file exists and is not to be overwritten,
    or cannot be written.
    """
    fields: dict[str, Any] = {name: getattr(record, name) for name in ARRAYS}
    for name in SCALARS:
        value = getattr(record, name)
        fields[name] = np.asarray(UNKNOWN if value is None else value)
    if record.parts.ends is not None:
        fields |= _of_strip(record)
    if record.contacts is not None:
        fields |= {f"contact_{name}": np.asarray(value) for name, value in vars(record.contacts).items()}
    fields["content_sha256"] = np.asarray(content_sha256(record))
    write_arrays(path, fields, overwrite)


def _of_strip(record: StateRecord) -> dict[str, Any]:
    """What an open strip has besides: `ends_span` and so on, its bending energy and reactions."""
    fields = {
        f"{part}_{name}": np.asarray(value)
        for part, kind in _PARTS.items()
        for name, value in vars(getattr(record.parts, part) or kind()).items()
    }
    more = ("bending_energy", "lambda_end", *REACTIONS)
    known = {name: getattr(record, name) for name in more}
    return fields | {name: np.asarray(value) for name, value in known.items() if value is not None}


def write_arrays(path: str | Path, fields: Mapping[str, Any], overwrite: bool = False) -> None:
    """Write arrays and scalars as an npz file; the same ones give the same bytes.

    Raises StoreError when the file exists and is not to be overwritten, or cannot be written.
    """
    buffer = io.BytesIO()
    np.savez(buffer, **fields)
    write_atomic(path, buffer.getvalue(), overwrite=overwrite)


def load_npz(path: str | Path) -> dict[str, Any]:
    """Read a state's npz file: what `export_npz` writes, or less.

    Needed are u (N,3), g (N,3), xi (N,), half_width and sigma. Returns those, `length` (2 pi unless given),
    `discretisation` (thesis unless given), and those of `ARRAYS` that are there; arrays are float64, sigma
    is +1 or -1, or 0 of a strip, of which g_end and `ends_...` are needed, and `parts` are returned;
    `contacts` where all of `contact_...` are there. Raises StoreError, one line, for a file that is missing,
    damaged or does not hold a state. Nothing is ever unpickled.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            wanted = (*ARRAYS, "half_width", "sigma", *_DEFAULTS, *_PART_FIELDS, *_CONTACTS)
            found = {name: _read_member(archive, names[name]) for name in wanted if name in names}
        return _check(found)
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _UNREADABLE as error:
        raise StoreError(f"{path}: not a state: {in_a_line(error)}") from error


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray[Any, Any]:
    """Read one array, whose size is checked before anything is allocated. Raises ValueError."""
    if info.file_size > MAX_BYTES or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{info.filename} is too large, or packed in a way that NumPy does not use")
    stream = io.BytesIO(archive.read(info))
    version = np.lib.format.read_magic(stream)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"{info.filename} has npy version {version}")
    shape, fortran, dtype = read[version](stream)
    data = stream.read()
    if dtype.hasobject or dtype.kind not in "fiubU" or math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError(f"{info.filename} is not an array of numbers or text")
    return np.frombuffer(data, dtype=dtype).reshape(shape, order="F" if fortran else "C")


def _check(found: dict[str, np.ndarray[Any, Any]]) -> dict[str, Any]:
    """Check shapes, ranges and that all is finite; return plain values. Raises ValueError."""
    missing = [name for name in ("u", "g", "xi", "half_width", "sigma") if name not in found]
    if missing:
        raise ValueError(f"it has no {', '.join(missing)}")
    n = found["xi"].shape[0] if found["xi"].ndim else 0
    if n < 3:
        raise ValueError(f"xi has shape {found['xi'].shape}, expected (N,) with N at least 3")
    state: dict[str, Any] = {}
    for name in ARRAYS:
        if name in found:
            shape = tuple(n if dim == "N" else dim for dim in _SHAPES[name])
            if found[name].shape != shape or found[name].dtype.kind not in "fiu":
                raise ValueError(
                    f"{name} is {found[name].dtype} {found[name].shape}, expected numbers {shape}"
                )
            state[name] = np.ascontiguousarray(found[name], dtype=np.float64)
            if name in ("u", "g", "xi") and not np.isfinite(state[name]).all():
                raise ValueError(f"{name} is not finite")
    for name in ("half_width", "sigma", *_DEFAULTS):
        state[name] = _scalar(name, found[name]) if name in found else _DEFAULTS[name]
    if state["sigma"] not in (1, -1, 0):
        raise ValueError(f"sigma must be +1 or -1, or 0 of an open strip, got {state['sigma']}")
    if state["sigma"] == 0:
        state["parts"] = _read_parts(found)
    if state["discretisation"] not in _DISCRETISATIONS:
        raise ValueError(
            f"discretisation must be {' or '.join(_DISCRETISATIONS)}, got {state['discretisation']}"
        )
    sigma = int(state["sigma"])
    if any(name in found for name in _CONTACTS):
        state["contacts"] = _read_contacts(found)
        state["contacts"].check(n, sigma != 0)
    return state | {"sigma": sigma}


def _read_contacts(found: Mapping[str, np.ndarray[Any, Any]]) -> Contacts:
    """The contacts of a band that rests on itself. Raises ValueError where some of it is missing or odd."""
    missing = [name for name in _CONTACTS if name not in found]
    if missing:
        raise ValueError(f"it has contacts, and no {', '.join(missing)}")
    if any(found[name].dtype.kind not in "fiu" for name in _CONTACTS):
        raise ValueError("its contacts are not numbers")
    scalars = ("gap", "excluded", "clearance", "penetration")
    if any(found[f"contact_{name}"].shape for name in scalars):
        raise ValueError(f"its contact_{', contact_'.join(scalars)} are not a number each")
    values: dict[str, Any] = {name.removeprefix("contact_"): found[name] for name in _CONTACTS}
    numbers = {name: float(values[name]) for name in scalars}
    contacts = Contacts(**(values | numbers))
    every = (*numbers.values(), *contacts.force, *contacts.value)
    if not all(map(math.isfinite, every)) or not contacts.gap >= 0.0:
        raise ValueError("its contacts are not finite, or their gap is negative")
    return contacts


def _read_parts(found: Mapping[str, np.ndarray[Any, Any]]) -> Parts:
    """Ends, material and loads of a strip. Raises ValueError for anything else."""
    missing = [name for name in ("g_end", "ends_start", "ends_end", "ends_span") if name not in found]
    if missing:
        raise ValueError(f"sigma is 0, an open strip's, and it has no {', '.join(missing)}")
    read: dict[str, Any] = {}
    for part, kind in _PARTS.items():
        given: dict[str, Any] = {}
        for name, default in vars(kind()).items():
            value = found.get(f"{part}_{name}", np.asarray(default))
            wanted = np.asarray(default)
            if value.shape != wanted.shape or (value.dtype.kind == "U") != (wanted.dtype.kind == "U"):
                raise ValueError(
                    f"{part}_{name} is {value.dtype} {value.shape}, expected as {wanted.tolist()}"
                )
            given[name] = tuple(value.tolist()) if value.shape else value.item()
            free = name == "span" and given.get("end") == FREE
            if value.dtype.kind != "U" and not (free or np.isfinite(value).all()):
                raise ValueError(f"{part}_{name} is not finite")
        read[part] = kind(**given)
    ends = read["ends"]
    if ends.start not in STARTS or ends.end not in FINISHES:
        raise ValueError(f"ends are {ends.start!r} and {ends.end!r}, which no strip has")
    return Parts(**read)


def _scalar(name: str, value: np.ndarray[Any, Any]) -> float | str:
    """A scalar, positive and finite but for sigma and text. Raises ValueError."""
    text = name == "discretisation"
    if value.shape != () or (value.dtype.kind == "U") != text:
        raise ValueError(
            f"{name} is {value.dtype} {value.shape}, expected one {'text' if text else 'number'}"
        )
    if text:
        return str(value.item())
    number = float(value.item())
    if name != "sigma" and not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be positive and finite, got {number}")
    return number
