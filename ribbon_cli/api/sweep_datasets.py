"""A sweep's equilibria as an xarray dataset whose dimensions are the keys that vary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli import api
from ribbon_cli.api.aims import Aims
from ribbon_cli.api.datasets import Cell, variables_of
from ribbon_cli.api.extras import extra
from ribbon_cli.api.gathering import key_column, spelled
from ribbon_cli.api.tables import damage_in_words
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import Run, Summary
from ribbon_cli.store.refs import by_place, meant

if TYPE_CHECKING:
    from xarray import Dataset

_LEFT_OUT = ("kind", "events", "event_kinds")
_NUMBERS = {"float64": np.float64, "int64": np.int64, "bool": np.bool_}


@dataclass(frozen=True)
class _Axis:
    """A dimension: its name, how many values it has, and coordinates along it by name."""

    name: str
    size: int
    coordinates: dict[str, NDArray[Any]]

    def position(self, value: float) -> int:
        """Where a value stands along it, of those that it has, ascending."""
        return int(np.searchsorted(self.coordinates[self.name], value))


def dataset(sweep: api.OpenSweep, modes: int) -> Dataset:
    """The dataset that `OpenSweep.to_xarray` describes."""
    xarray = extra("xarray", "sweep.to_xarray()")
    if modes < 0:
        raise UsageError(f"modes: must be 0 or more, got {modes}")
    members = [_members(sweep, group) for group in sweep.groups]
    axes = [_axis(group, found) for group, found in zip(sweep.groups, members, strict=True)]
    runs = [(_place(sweep, members, point), point.run) for point in sweep.points if point.run is not None]
    states = [(place, run, state) for place, run in runs for state in _states(run, sweep.keys)]
    if not states:
        raise UsageError(
            f"the sweep {sweep.name} has no state at its targets yet: `ribbon sweep` runs its points"
        )
    inner = _inner(states)
    placed: dict[Cell, tuple[Run, Summary]] = {}
    for place, run, state in states:
        here = [axis.position(getattr(state, axis.name)) for axis in inner]
        placed[*place, *here] = (run, state)
    every = [*axes, *inner]
    shape = tuple(axis.size for axis in every)
    dims = tuple(axis.name for axis in every)
    without = (*_LEFT_OUT, *(axis.name for axis in inner))
    variables, spectral = variables_of(placed, dims, shape, modes, without)
    coordinates: dict[str, Any] = {
        name: (axis.name, values) for axis in every for name, values in axis.coordinates.items()
    }
    variables = {name: value for name, value in variables.items() if name not in coordinates}
    made: Dataset = xarray.Dataset(variables, coordinates | spectral, {"sweep": sweep.name})
    return made


def _members(sweep: api.OpenSweep, group: Sequence[str]) -> list[tuple[Any, ...]]:
    """The values of keys that go together, in the order in which the sweep has them."""
    return list(dict.fromkeys(_values(point, group) for point in sweep.points))


def _values(point: api.OpenPoint, group: Sequence[str]) -> tuple[Any, ...]:
    return tuple(spelled(point.values[key]) for key in group)


def _axis(group: Sequence[str], members: list[tuple[Any, ...]]) -> _Axis:
    """The dimension of keys that go together: the first that tells its members apart names it."""
    rows = [dict(zip(group, member, strict=True)) for member in members]
    coordinates: dict[str, NDArray[Any]] = {}
    for key in group:
        dtype = key_column(key, rows).dtype
        coordinates[key] = np.array([row[key] for row in rows], dtype=_NUMBERS.get(dtype, np.str_))
    named = [key for key in group if len({row[key] for row in rows}) == len(rows)]
    if named:
        return _Axis(named[0], len(rows), coordinates)
    name = " and ".join(group)
    return _Axis(name, len(rows), {name: np.arange(len(rows), dtype=np.int64), **coordinates})


def _place(sweep: api.OpenSweep, members: list[list[tuple[Any, ...]]], point: api.OpenPoint) -> Cell:
    """Where a point stands along the dimensions of the sweep."""
    pairs = zip(members, sweep.groups, strict=True)
    return tuple(found.index(_values(point, group)) for found, group in pairs)


def _states(run: api.OpenRun, keys: Sequence[str]) -> list[Summary]:
    """A run's equilibria where its config leads, for each half-width and N the one that is meant.

    Those on the way belong to none of the sweep's values, nor do others that were added by hand. Raises
    StoreError, ConfigError.
    """
    found, lost = run.found()
    if lost:
        raise StoreError("; ".join(damage_in_words(run, lost)))
    aims = Aims.of(run)
    return [meant(group) for group in by_place(s for s in found if aims.is_end(s, keys)).values()]


def _inner(states: Sequence[tuple[Cell, Run, Summary]]) -> list[_Axis]:
    """Half-width and number of segments as dimensions, where a run has several of them."""
    axes = []
    for name, dtype in (("half_width", np.float64), ("segments", np.int64)):
        several: dict[Cell, set[float]] = {}
        for place, _, state in states:
            several.setdefault(place, set()).add(getattr(state, name))
        if max(map(len, several.values())) > 1:
            values = np.array(sorted(set().union(*several.values())), dtype=dtype)
            axes.append(_Axis(name, values.size, {name: values}))
    return axes
