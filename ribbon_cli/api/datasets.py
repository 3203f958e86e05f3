"""A run's equilibria as an xarray dataset.

Every fact of a state is a variable over the states' axes and not an attribute: attributes that differ
between runs do not survive `xarray.concat`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbon_cli import api
from ribbon_cli.api.extras import extra
from ribbon_cli.api.tables import column_types, damage_in_words, flat
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import Run, Summary
from ribbon_cli.store.record import METRICS
from ribbon_cli.store.refs import by_place, meant, no_equilibria
from ribbon_cli.store.summaries import varying

if TYPE_CHECKING:
    from xarray import Dataset


_AXES = ("half_width", "segments")
_LEFT_OUT = ("run", "kind", "events", "event_kinds", *_AXES)
"""Fields that are not variables: the run is an attribute, and all states are equilibria."""

Cell = tuple[int, ...]


def dataset(run: api.OpenRun, grid: bool | None, modes: int) -> Dataset:
    """The dataset that `OpenRun.to_xarray` describes."""
    xarray = extra("xarray", "run.to_xarray()")

    if modes < 0:
        raise UsageError(f"modes: must be 0 or more, got {modes}")
    states, lost = run.found()
    if lost:
        raise StoreError("; ".join(damage_in_words(run, lost)))
    if not states:
        raise UsageError(no_equilibria(run))
    places = by_place(states)
    widths, meshes = list(dict.fromkeys(b for b, *_ in places)), sorted({n for _, n, _ in places})
    if grid is None:
        grid = len(places) == len(states) and not varying(states)
    if grid and (others := varying(states)):
        raise UsageError(f"grid: the states differ in {', '.join(others)} as well: pass grid=False")
    chosen: dict[Cell, Summary]
    if grid:
        dims: tuple[str, ...] = _AXES
        shape: Cell = (len(widths), len(meshes))
        chosen = {(widths.index(b), meshes.index(n)): meant(group) for (b, n, _), group in places.items()}
        coordinates: dict[str, Any] = {
            "half_width": np.array(widths, dtype=np.float64),
            "segments": np.array(meshes, dtype=np.int64),
        }
    else:
        dims, shape = ("label",), (len(states),)
        chosen = {(k,): state for k, state in enumerate(states)}
        coordinates = {
            "label": np.array([state.label for state in states], dtype=np.int64),
            "half_width": ("label", np.array([state.half_width for state in states], dtype=np.float64)),
            "segments": ("label", np.array([state.segments for state in states], dtype=np.int64)),
        }
    variables = {name: (dims, values) for name, values in _facts(run, chosen, shape, grid).items()}
    if modes:
        values, names = _spectra(run, chosen, shape, modes)
        if values.shape[-1]:
            inner = (*dims, "metric", "mode")
            variables |= {"eigenvalue": (inner, values), "mode_label": (inner, names)}
            coordinates |= {"metric": list(METRICS), "mode": np.arange(1, values.shape[-1] + 1)}
    made: Dataset = xarray.Dataset(variables, coordinates, {"run": run.name})
    return made


def _facts(run: Run, chosen: Mapping[Cell, Summary], shape: Cell, grid: bool) -> dict[str, NDArray[Any]]:
    """An array for each fact; where there is no state numbers are not-a-number and texts empty.

    Only `certified` is true or false: a missing state has no certificate. Other truth values are 1 and 0.
    """
    rows = {place: flat(state, run.name) for place, state in chosen.items()}
    arrays: dict[str, NDArray[Any]] = {}
    for name, (dtype, _) in column_types(list(chosen.values())).items():
        if name in _LEFT_OUT or (name == "label" and not grid):
            continue
        if name == "certified":
            array: NDArray[Any] = np.zeros(shape, dtype=bool)
        elif dtype == "utf-8":
            array = np.full(shape, "", dtype=object)
        else:
            array = np.full(shape, np.nan)
        for place, row in rows.items():
            if row.get(name) is not None:
                array[place] = row[name]
        arrays[name] = array.astype(str) if dtype == "utf-8" else array
    return arrays


def _spectra(
    run: Run, chosen: Mapping[Cell, Summary], shape: Cell, modes: int
) -> tuple[NDArray[np.float64], NDArray[np.str_]]:
    """The lowest stored eigenvalues, rotations among them, and the names of their modes, by metric."""
    stored = {place: run.load(state.label).spectra for place, state in chosen.items()}
    longest = max((len(s.values) for spectra in stored.values() for s in spectra), default=0)
    inner = (*shape, len(METRICS), min(modes, longest))
    values, names = np.full(inner, np.nan), np.full(inner, "", dtype=object)
    for place, spectra in stored.items():
        for spectrum in spectra:
            k, row = min(inner[-1], len(spectrum.values)), (*place, METRICS.index(spectrum.metric))
            values[row][:k] = spectrum.values[:k]
            names[row][:k] = spectrum.labels[:k]
    return values, names.astype(str)
