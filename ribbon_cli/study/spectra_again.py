"""Whether a stored spectrum has the eigenvalues of its shape, and all that it claims to have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.band import Array
from ..model.metrics import metric_named
from ..model.problem import LocalDerivatives, Problem
from ..solver.pencil import Pencil
from ..solver.spectra import full_spectra
from ..store import SpectrumRecord, StateRecord

DENSE_UP_TO = 200
"""Segments up to which a complete spectrum is computed again; of others the lowest `COUNTED` are counted."""
COUNTED = 12
RELATIVE = 1e-6
"""Relative difference of eigenvalues that are not told apart."""
NOISE = 1e-10
"""Rounding of eigenvalues relative to the largest one."""


def check_values(record: StateRecord, problem: Problem, local: LocalDerivatives, x: Array) -> Iterator[str]:
    """Compare the eigenvalues of each spectrum with those of the shape, whether or not modes are stored."""
    free = 2 * record.segments
    dense = [s.metric for s in record.spectra if s.complete and record.segments <= DENSE_UP_TO]
    again = {s.metric: s for s in full_spectra(problem, x, local, tuple(dense), 0)} if dense else {}
    for spectrum in record.spectra:
        name = f"/spectra/{spectrum.metric}"
        if spectrum.metric in again:
            found = again[spectrum.metric]
            if len(found.values) != len(spectrum.values):
                yield f"{name}/values has {len(spectrum.values)}, complete are {len(found.values)}"
                continue
            off = np.abs(spectrum.values - found.values)
            size = float(np.abs(found.values).max(initial=0.0))
            allowed = RELATIVE * np.abs(found.values) + NOISE * size + 10.0 * found.bounds
            for k in np.flatnonzero(~(off <= allowed))[:1]:
                yield f"{name}/values[{k}] is {spectrum.values[k]:.10g}, recomputed {found.values[k]:.10g}"
            continue
        if spectrum.complete and len(spectrum.values) > free:
            yield f"{name}/values has {len(spectrum.values)}, more than there are"
        yield from _counted(name, spectrum, Pencil(problem, x, local, metric_named(spectrum.metric)))


def _counted(name: str, spectrum: SpectrumRecord, pencil: Pencil) -> Iterator[str]:
    """Count the eigenvalues on either side of each of the lowest ones."""
    others = np.array([label != "rotation" for label in spectrum.labels], dtype=bool)
    values = spectrum.values[others]
    slack = RELATIVE * np.abs(values) + NOISE * pencil.metric.unit(pencil.problem.band)
    for value, off in list(zip(values, slack, strict=True))[:COUNTED]:
        lower = pencil.count_below(float(value - off))
        stored = int((values < value - off).sum())
        if lower.trusted and lower.negative > stored:
            yield f"{name}/values has {stored} below {value:.10g}, the shape {lower.negative}"
            return
        upper = pencil.count_below(float(value + off))
        stored = int((values < value + off).sum())
        # Where the list ends, others that are nearly equal may follow.
        listed = upper.negative == stored or (stored == len(values) and not spectrum.complete)
        if upper.trusted and (upper.negative < stored or not listed):
            yield f"{name}/values has {stored} up to {value:.10g}, the shape {upper.negative}"
            return
