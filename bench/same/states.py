"""State files, read by h5py and not by the package, which may be what went wrong."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

DAMAGED = "damaged"


@dataclass(frozen=True)
class StateFile:
    """A state by its place: the run's folder, the stage, and its number among those of one stage."""

    place: str
    path: Path
    content: str


def states_below(work: Path) -> dict[str, StateFile]:
    """Every state below a folder, by its place."""
    found: dict[str, StateFile] = {}
    times: Counter[str] = Counter()
    for path in sorted(work.rglob("states/*.h5")):
        stage, content = _named(path)
        place = f"{path.parents[1].relative_to(work)}: {stage}"
        times[place] += 1
        if times[place] > 1:
            place += f" ({times[place]})"
        found[place] = StateFile(place, path, content)
    return found


def _named(path: Path) -> tuple[str, str]:
    """Stage and content hash of a state; a file that its head does not vouch for is not given to HDF5."""
    head, _, rest = path.read_bytes().partition(b"\n")
    if head.rpartition(b" ")[2].decode(errors="replace") != hashlib.sha256(rest).hexdigest():
        return f"{path.name} ({DAMAGED})", DAMAGED
    with h5py.File(path) as file:
        return _text(file["origin/stage"][()]), _text(file.attrs["content_sha256"])


def datasets(path: Path) -> dict[str, Any]:
    """Every dataset of a file but those of the provenance, by its path."""
    values: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("provenance/"):
            values[f"/{name}"] = np.asarray(item[()])

    with h5py.File(path) as file:
        file.visititems(take)
    return values


def attributes(path: Path) -> dict[str, str]:
    """Every attribute of a file but its content hash and references between datasets, by `PATH@NAME`."""
    values: dict[str, str] = {}

    def take(name: str, item: Any) -> None:
        for key, value in item.attrs.items():
            if key not in ("content_sha256", "DIMENSION_LIST", "REFERENCE_LIST"):
                values[f"/{name}@{key}"] = _text(value)

    with h5py.File(path) as file:
        take("", file)
        file.visititems(lambda name, item: None if name.startswith("provenance") else take(name, item))
    return values


def differing(first: dict[str, Any], second: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Arrays that differ to the bit, by name, and how; those that one side lacks, too."""
    for name in sorted(first.keys() | second.keys()):
        if name not in first:
            yield name, f"added: {_described(second[name])}"
        elif name not in second:
            yield name, f"removed: {_described(first[name])}"
        elif (how := _difference(first[name], second[name])) is not None:
            yield name, how


def _difference(one: np.ndarray, two: np.ndarray) -> str | None:
    """How two arrays differ; None where they are equal to the bit."""
    texts = one.dtype.kind in "SUO"
    if one.shape != two.shape or one.dtype.kind != two.dtype.kind or (one.dtype != two.dtype and not texts):
        return f"{_described(one)} -> {_described(two)}"
    if texts:
        pairs = zip(one.ravel().tolist(), two.ravel().tolist(), strict=True)
        return next((f"{_text(a)!r} -> {_text(b)!r}" for a, b in pairs if a != b), None)
    if one.tobytes() == two.tobytes():
        return None
    size = one.dtype.itemsize
    bytes_of = [np.frombuffer(a.tobytes(), np.uint8).reshape(-1, size) for a in (one, two)]
    where = np.flatnonzero((bytes_of[0] != bytes_of[1]).any(axis=1))
    if one.ndim == 0:
        return f"{one[()]!s} -> {two[()]!s}{_distance(one, two)}"
    places = ", ".join(str(k) for k in where[:3]) + (", ..." if len(where) > 3 else "")
    return f"{len(where)} of {one.size} values differ, at {places}{_distance(one, two)}"


def _distance(one: np.ndarray, two: np.ndarray) -> str:
    """The largest difference of two arrays, and how many values are numbers in one alone."""
    if one.dtype.kind not in "fiu":
        return ""
    a, b = np.asarray(one, float).ravel(), np.asarray(two, float).ravel()
    both = np.isfinite(a) & np.isfinite(b)
    largest = float(np.abs(a[both] - b[both]).max()) if both.any() else 0.0
    lost, gained = int((np.isfinite(a) & ~both).sum()), int((np.isfinite(b) & ~both).sum())
    told = [f"; largest difference {largest:.3g}"]
    told += [f"; {lost} numbers became not finite"] if lost else []
    told += [f"; {gained} became finite"] if gained else []
    return "".join(told)


def _described(array: np.ndarray) -> str:
    """Type and shape, and the value where there is one alone."""
    kind = "text" if array.dtype.kind in "SUO" else str(array.dtype)
    value = f" {_text(array.ravel()[0])!r}" if array.size == 1 else ""
    return f"{kind} {array.shape}{value}"


def _text(value: Any) -> str:
    """A value of HDF5 as text."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
