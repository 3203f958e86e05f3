"""Branches as VTKHDF files, which ParaView and VTK open as a series in the half-width.

The layout is that of VTKHDF 2.0, type UnstructuredGrid: one part a step, and under `Steps` where each step
begins in every dataset.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ribbon_cli.export.contacts import touching
from ribbon_cli.export.mesh import Array, facet_fields, facet_normals, node_fields, strip
from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.store import StateRecord

VERTEX, QUAD = 1, 9
"""VTK's numbers for a point and a quadrilateral."""
SCALARS = ("half_width", "length", "energy", "linking_number", "twist", "writhe", "clearance")


def vtkhdf_bytes(records: Sequence[StateRecord], title: str) -> bytes:
    """States in the order given, one time step each; a step's time is its half-width, or the one other
    parameter in which the states differ. Where they differ in several it is the step's number.

    Points have the fields at nodes and `across` (-1 and +1 at the two edges), cells those at facets, the unit
    normal and the facet's number. Where states were computed with contact forces, each contact adds a point
    on either of its sheets, and a cell of that point: `contact` is its number, 0 elsewhere, and
    `contact_force` the force on that sheet. The same states give the same bytes.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("earliest", "v110")) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        root.attrs["Type"] = np.bytes_(b"UnstructuredGrid")
        root.attrs["Description"] = np.bytes_(title.encode())
        resting = any(record.contacts is not None for record in records)
        _write(root, [_step(record, resting) for record in records], _times(records))
    return buffer.getvalue()


def _times(records: Sequence[StateRecord]) -> list[float]:
    """What tells the states from each other, as a number."""
    rows = [record.parameters for record in records]
    differing = [name for name in rows[0] if len({row.get(name) for row in rows}) > 1]
    if len(differing) > 1:
        return [float(k) for k in range(len(rows))]
    return [row[differing[0] if differing else HALF_WIDTH] for row in rows]


@dataclass(frozen=True, eq=False)
class _Step:
    """One state's arrays: its mesh, and its fields by name under `PointData`, `CellData` and `FieldData`.

    Of the points (P, 3) the last `touching` are those of contacts, each a cell after the quadrilaterals."""

    points: Array
    quads: NDArray[Any]
    touching: int
    fields: dict[str, dict[str, NDArray[Any]]]

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.quads) + self.touching

    @property
    def connectivity(self) -> NDArray[Any]:
        """The points of all cells, one after another."""
        last = len(self.points)
        return np.concatenate((self.quads.ravel(), np.arange(last - self.touching, last)))

    @property
    def sizes(self) -> NDArray[Any]:
        """How many points each cell has."""
        return np.concatenate((np.full(len(self.quads), 4), np.ones(self.touching, dtype=np.int64)))


def _step(record: StateRecord, resting: bool) -> _Step:
    mesh = strip(record)
    points = {name: np.repeat(values, 2) for name, values in node_fields(record, mesh).items()}
    points["across"] = np.tile([-1.0, 1.0], len(mesh.low))
    cells: dict[str, NDArray[Any]] = dict(facet_fields(record))
    cells |= {"normal": facet_normals(record), "facet": np.arange(1, record.segments + 1)}
    facts = {name: np.array([getattr(record, name)], dtype=np.float64) for name in SCALARS}
    # As in tables: `twist` is Tw in turns, `parameter_twist` the angle of the end.
    others = ((name, value) for name, value in record.parameters.items() if name != HALF_WIDTH)
    facts |= {f"parameter_{name}": np.array([value]) for name, value in others}
    facts |= {name: np.array([int(getattr(record, name))]) for name in ("label", "certified", "self_contact")}
    found = {"PointData": points, "CellData": cells, "FieldData": facts}
    if not resting:
        return _Step(mesh.points, mesh.quads, 0, found)
    contacts = touching(record)
    places, forces = contacts.arrows
    count = len(places)
    own = {"contact": np.repeat(np.arange(1, len(contacts) + 1), 2), "contact_force": forces}
    for fields, owned in ((points, len(mesh.points)), (cells, len(mesh.quads))):
        fields |= {name: _longer(values, count) for name, values in fields.items()}
        fields |= {
            name: np.concatenate((np.zeros((owned, *values.shape[1:]), dtype=values.dtype), values))
            for name, values in own.items()
        }
    facts |= {"contacts": np.array([len(contacts)]), "contact_force": np.array([contacts.forces.sum()])}
    return _Step(np.concatenate((mesh.points, places)), mesh.quads, count, found)


def _longer(values: NDArray[Any], count: int) -> NDArray[Any]:
    """A field with so many more rows, of what a point of contact does not have: 0 of whole numbers."""
    none = 0 if values.dtype.kind == "i" else np.nan
    return np.concatenate((values, np.full((count, *values.shape[1:]), none, dtype=values.dtype)))


def _write(root: h5py.Group, steps: Sequence[_Step], times: Sequence[float]) -> None:
    """Write the steps one after another, and where each begins."""
    points = [len(step.points) for step in steps]
    cells = [step.cells for step in steps]
    connectivity = [step.connectivity for step in steps]
    ids = [len(points) for points in connectivity]
    _array(root, "NumberOfPoints", np.array(points, dtype=np.int64))
    _array(root, "NumberOfCells", np.array(cells, dtype=np.int64))
    _array(root, "NumberOfConnectivityIds", np.array(ids, dtype=np.int64))
    _array(root, "Points", np.concatenate([step.points for step in steps]))
    _array(root, "Connectivity", np.concatenate(connectivity))
    _array(root, "Offsets", np.concatenate([np.append(0, np.cumsum(step.sizes)) for step in steps]))
    types = [np.where(step.sizes == 1, VERTEX, QUAD) for step in steps]
    _array(root, "Types", np.concatenate(types).astype(np.uint8))
    series = root.create_group("Steps")
    series.attrs["NSteps"] = np.int64(len(steps))
    _array(series, "Values", np.array(times, dtype=np.float64))
    count = np.arange(len(steps), dtype=np.int64)
    _array(series, "PartOffsets", count)
    _array(series, "NumberOfParts", np.ones(len(steps), dtype=np.int64))
    starts = {"PointData": _starts(points), "CellData": _starts(cells), "FieldData": count}
    _array(series, "PointOffsets", starts["PointData"])
    _array(series, "CellOffsets", starts["CellData"][:, None])
    _array(series, "ConnectivityIdOffsets", _starts(ids)[:, None])
    for kind, start in starts.items():
        group, offsets = root.create_group(kind), series.create_group(f"{kind}Offsets")
        for name in steps[0].fields[kind]:
            _array(group, name, np.concatenate([step.fields[kind][name] for step in steps]))
            _array(offsets, name, start)
    sizes = series.create_group("FieldDataSizes")
    for name in steps[0].fields["FieldData"]:
        _array(sizes, name, np.tile(np.array([1, 1], dtype=np.int64), (len(steps), 1)))


def _starts(sizes: Sequence[int]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Where each block of so many rows begins."""
    return np.concatenate(([0], np.cumsum(sizes)[:-1])).astype(np.int64)


def _array(group: h5py.Group, name: str, data: np.ndarray[Any, Any]) -> None:
    """One dataset, without times."""
    group.create_dataset(name, data=data, track_times=False)
