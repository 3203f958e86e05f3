"""Whether stored spectra are those of the stored shape: values, residuals, overlaps, labels and modes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.band import Array
from ..model.metrics import lengths, metric_named
from ..model.problem import LocalDerivatives, Problem
from ..solver.pencil import Pencil
from ..solver.spectra import (
    CHECKERBOARD_FACETS,
    CHECKERBOARD_SHARE,
    LABELS,
    SLIDING_OVERLAP,
    full_spectra,
    hidden_share,
    mode_label,
    sliding_covector,
)
from ..store import SpectrumRecord, StateRecord

NOISE = 1e-10
"""Rounding of eigenvalues and of modes' residuals, relative to the Hessian's largest entry or eigenvalue."""
UNIT = 1e-6
"""How far stored modes may be from unit length, and figures of theirs from a bound that decides a label."""

DENSE_UP_TO = 200
"""Segments up to which a complete spectrum is computed again; of others the lowest `COUNTED` are counted."""
COUNTED = 12
RELATIVE = 1e-6
"""Relative difference of eigenvalues that are not told apart."""


def check_spectra(record: StateRecord, problem: Problem, local: LocalDerivatives, x: Array) -> Iterator[str]:
    """Check each spectrum: order, signs, labels, and what follows from the modes that are stored."""
    for spectrum in record.spectra:
        name, values = f"/spectra/{spectrum.metric}", spectrum.values
        others = np.array([label != "rotation" for label in spectrum.labels], dtype=bool)
        if not np.all(np.diff(values) >= 0):
            yield f"{name}/values do not ascend"
        below = values[others] < -np.maximum(1e-9, 10.0 * spectrum.residuals[others])
        if record.certified and below.any():
            yield f"{name}/values has {int(below.sum())} negative ones, but the state is certified"
        if not np.all(spectrum.residuals >= 0):
            yield f"{name}/residuals are not norms"
        overlap = spectrum.sliding_overlap
        if not np.all((overlap >= 0) & (overlap <= 1)):
            yield f"{name}/sliding_overlap is not between 0 and 1"
        sliding = np.array([label == "sliding" for label in spectrum.labels], dtype=bool)
        if np.any(sliding != (others & (overlap > SLIDING_OVERLAP))):
            yield f"{name}/labels do not agree with sliding_overlap"
        unknown = sorted(set(spectrum.labels) - set(LABELS))
        if unknown:
            yield f"{name}/labels has {unknown[0]!r}, which is none of {', '.join(LABELS)}"
        turns = problem.rotations(x).shape[1]
        if int((~others).sum()) != turns:
            yield f"{name}/labels has {int((~others).sum())} rotations, the shape {turns}"
        rotations = (values, spectrum.residuals, overlap)
        if np.any(np.stack(rotations)[:, ~others] != 0.0):
            yield f"{name} has rotations with other numbers than zero"
        if spectrum.vectors is not None:
            yield from _modes(name, spectrum, problem, local, x)


def _turns(name: str, turns: list[int], vectors: Array, pencil: Pencil) -> Iterator[str]:
    """Modes (7N, r) called rotations must be some, of unit length where the metric sees them."""
    basis = pencil.rotations
    off = np.linalg.norm(vectors - basis @ (basis.T @ vectors), axis=0)
    sizes, seen = np.linalg.norm(vectors, axis=0), lengths(pencil.mass, vectors)
    blind = seen <= UNIT * np.sqrt(pencil.mass.diagonal().max()) * sizes
    for k, miss, size, length in zip(turns, off, sizes, np.where(blind, sizes, seen), strict=True):
        if not (miss <= UNIT * size and abs(length - 1.0) <= UNIT):
            yield f"{name}/vectors[{k}] is no rotation of unit length"


def _labels(
    name: str, kept: list[int], spectrum: SpectrumRecord, overlaps: Array, hidden: Array, spread: Array
) -> Iterator[str]:
    """Labels of the stored modes, but where a figure is so near to its bound that rounding decides."""
    for k, overlap, share, facets in zip(kept, overlaps, hidden, spread, strict=True):
        close = (
            abs(overlap - SLIDING_OVERLAP) <= UNIT
            or abs(share - CHECKERBOARD_SHARE) <= UNIT
            or abs(facets - CHECKERBOARD_FACETS) <= UNIT * CHECKERBOARD_FACETS
        )
        found = mode_label(overlap, share, facets)
        if spectrum.labels[k] != found and not close:
            yield f"{name}/labels[{k}] is {spectrum.labels[k]}, its mode is {found}"


def _modes(
    name: str, spectrum: SpectrumRecord, problem: Problem, local: LocalDerivatives, x: Array
) -> Iterator[str]:
    """Modes must be tangent to the constraints, with their eigenvalues as Rayleigh quotients and their
    residuals."""
    assert spectrum.vectors is not None
    pencil = Pencil(problem, x, local, metric_named(spectrum.metric))
    hessian, mass, jacobian = pencil.hessian, pencil.mass, problem.jacobian_matrix(local)
    size, steepest = float(abs(hessian).max()), max(1.0, float(abs(jacobian).max()))
    turns = [k for k in range(len(spectrum.vectors)) if spectrum.labels[k] == "rotation"]
    kept = [k for k in range(len(spectrum.vectors)) if spectrum.labels[k] != "rotation"]
    rotations = spectrum.vectors[turns].reshape(len(turns), problem.size).T
    yield from _turns(name, turns, rotations, pencil)
    vectors = spectrum.vectors[kept].reshape(len(kept), problem.size).T
    norms = np.einsum("ij,ij->j", vectors, mass @ vectors)
    squares = np.einsum("ij,ij->j", vectors, vectors) / norms
    values = spectrum.values[kept]
    quotients = np.einsum("ij,ij->j", vectors, hessian @ vectors) / norms
    found = pencil.residuals(values, vectors / np.sqrt(norms))
    overlaps = np.abs(sliding_covector(problem, x, mass, pencil.rotations) @ vectors) / np.sqrt(norms)
    for k, value, quotient, square, residual, overlap in zip(
        kept, values, quotients, squares, found, overlaps, strict=True
    ):
        # A mode that is off by e has a quotient off by e^2 |W|.
        if not abs(quotient - value) <= 1e-6 * abs(value) + NOISE * size * square:
            yield f"{name}/values[{k}] is {value:.10g}, its mode gives {quotient:.10g}"
        stored = spectrum.residuals[k]
        if not abs(stored - residual) <= 0.5 * max(stored, residual) + NOISE * size * np.sqrt(square):
            yield f"{name}/residuals[{k}] is {stored:.3g}, recomputed {residual:.3g}"
        kept_overlap = spectrum.sliding_overlap[k]
        if not abs(min(overlap, 1.0) - kept_overlap) <= 1e-6:
            yield f"{name}/sliding_overlap[{k}] is {kept_overlap:.6g}, recomputed {overlap:.6g}"
    yield from _labels(name, kept, spectrum, overlaps, *hidden_share(problem, vectors))
    gram = vectors.T @ (mass @ vectors)
    for k, off in zip(kept, np.abs(gram - np.eye(len(kept))).max(axis=0, initial=0.0), strict=True):
        if not off <= UNIT:
            yield f"{name}/vectors[{k}] is not of unit length and orthogonal to the others, by {off:.1e}"
    sizes = np.linalg.norm(vectors, axis=0)
    leaving = np.abs(jacobian @ vectors).max(axis=0, initial=0.0) > 1e-6 * sizes * steepest
    for k in np.flatnonzero(leaving):
        yield f"{name}/vectors[{kept[k]}] leaves the constraints"


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
