"""What a stored state's spectrum says: modes with names, and a verdict in a sentence.

Signs decide stability, and a sign is believed only where the value stands clear of its error bound and the
block reduction's inertia counts the same. Everything is computed from the stored state; nothing is written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..errors import TargetError, UsageError
from ..model.band import Array, State
from ..model.metrics import METRICS, lengths, metric_named
from ..model.problem import Problem
from ..model.strip_symmetry import strip_symmetries
from ..model.symmetry import Symmetry, SymmetryGroup, find_symmetries
from ..parts import HALF_WIDTH
from ..report.spectra import Counts, Element, Group, Mode, StateSpectrum
from ..solver.inertia import Inertia, inertia
from ..solver.kkt import FactorisationError
from ..solver.newton import Options
from ..solver.resting_kkt import kkt_matrix
from ..solver.spectra import Spectrum, full_spectra, lowest_spectrum
from ..solver.status import Status
from ..solver.steps import inverted_facets
from ..store import StateRecord, content_sha256
from ..store.npz import UNKNOWN
from ..study.records import all_multipliers_of, problem_with, state_of
from .verdict import Verdict, judge

DEFAULT_METRIC = "physical"
DEFAULT_MODES = 12
LARGEST_FULL = 1600
"""Most segments of a full spectrum: dense algebra takes minutes and gigabytes beyond."""
SAME_VALUE = 1e-6
"""Relative difference up to which eigenvalues count as one multiple eigenvalue."""
LISTED = 64
"""Most exact symmetries listed one by one; a ring has 4N."""


@dataclass(frozen=True, eq=False)
class Stability:
    """The spectrum of a state in one metric, with modes named and the verdict.

    `vectors` (m, N, 7) are the lowest m modes, (u, g, xi) per node, of unit length in the metric, in the
    order of `modes`; `state` is what they move.
    """

    state: State
    metric: str
    formula: str
    complete: bool
    modes: tuple[Mode, ...]
    vectors: Array
    symmetries: SymmetryGroup
    symmetry_names: tuple[str, ...]
    inertia: Inertia
    verdict: Verdict


def stability_of(
    record: StateRecord, metric: str = DEFAULT_METRIC, modes: int = DEFAULT_MODES, full: bool = False
) -> Stability:
    """The lowest `modes` besides rotations of a stored state, or all of them if `full`, and the verdict.

    Modes of a band that rests on itself keep its contacts, with what their forces add to the Hessian.
    Raises UsageError for an unknown metric, for auxiliary states and for a full spectrum of too many
    segments; TargetError where the eigenvalues do not converge.
    """
    _check(record, metric, modes, full)
    state = state_of(record)
    problem, x = problem_with(record, Problem(state.band)), state.vector()
    local = problem.local_derivatives(x, all_multipliers_of(record))
    try:
        counted = inertia(kkt_matrix(problem, local, problem.rotations(x)))
        if full:
            (spectrum,) = full_spectra(problem, x, local, (metric,), 2 * problem.band.segments)
        else:
            spectrum = lowest_spectrum(problem, x, local, metric, modes)
    except (FactorisationError, np.linalg.LinAlgError) as error:
        raise TargetError(f"no spectrum in the {metric} metric: {error}") from error
    group = find_symmetries(state) if state.band.closed else strip_symmetries(state)
    vectors = _adapted(state, spectrum, group)
    named = dict(zip(_primed([s.name for s in group.generators()]), group.generators(), strict=True))
    characters = _characters(state, metric, vectors, named)
    found = tuple(
        Mode(
            float(spectrum.values[k]),
            float(spectrum.residuals[k]),
            float(spectrum.bounds[k]),
            label,
            float(spectrum.sliding_overlap[k]),
            float(spectrum.hidden[k]),
            {name: float(c[k]) for name, c in characters.items() if k < vectors.shape[0]},
        )
        for k, label in enumerate(spectrum.labels)
    )
    verdict = _with_contacts(record, judge(found, counted, _doubts(record, problem, x), spectrum.complete))
    return Stability(
        state=state,
        metric=metric,
        formula=metric_named(metric).formula,
        complete=spectrum.complete,
        modes=found,
        vectors=vectors,
        symmetries=group,
        symmetry_names=tuple(named),
        inertia=counted,
        verdict=verdict,
    )


def _check(record: StateRecord, metric: str, modes: int, full: bool) -> None:
    if metric not in METRICS:
        raise UsageError(f"no metric {metric!r}: there are {', '.join(METRICS)}")
    if modes < 1:
        raise UsageError(f"the number of modes must be at least 1, got {modes}")
    given = (record.u, record.g, record.xi, all_multipliers_of(record))
    if record.kind != "auxiliary" and not all(np.isfinite(values).all() for values in given):
        raise UsageError(
            f"state {record.label} holds values that are not finite ({record.status}): it has no spectrum"
        )
    if record.kind == "auxiliary":
        raise UsageError("an auxiliary state, with prescribed rulings, has no spectrum of its own")
    if full and record.segments > LARGEST_FULL:
        raise UsageError(
            f"a full spectrum takes at most {LARGEST_FULL} segments, this state has {record.segments}: "
            "ask for --modes"
        )


def _primed(names: list[str]) -> list[str]:
    """Names made distinct by primes: C2, C2', C2''."""
    return [name + "'" * names[:k].count(name) for k, name in enumerate(names)]


def _adapted(state: State, spectrum: Spectrum, group: SymmetryGroup) -> Array:
    """Modes (m, N, 7), turned inside multiple eigenvalues so that each has a parity under one symmetry.

    The first symmetry of order two is taken; on the pairs of a band with an n-fold axis that is a twofold
    axis or a mirror.
    """
    vectors = spectrum.vectors.copy()
    twofold = next((s for s in group.generators() if s.name in ("C2", "sigma", "i")), None)
    if twofold is None:
        return vectors
    mass = metric_named(spectrum.metric).matrix(state)
    clusters = _clusters(spectrum.values[: vectors.shape[0]], spectrum.labels)
    for first, last in clusters:
        block = vectors[first:last].reshape(last - first, -1).T
        image = _image(twofold, state, block)
        form = block.T @ (mass @ image)
        _, y = scipy.linalg.eigh(0.5 * (form + form.T))
        vectors[first:last] = (block @ y[:, ::-1]).T.reshape(last - first, *vectors.shape[1:])
    for k in range(*clusters[-1]):  # of which the list may have a part only
        vectors[k] = _one_parity(vectors[k], twofold, state, mass)
    return vectors


def _one_parity(mode: Array, twofold: Symmetry, state: State, mass: scipy.sparse.csr_matrix) -> Array:
    """The larger of the symmetric and the antisymmetric part of a mode (N, 7), at unit length.

    Of a multiple eigenvalue that the list cuts, both parts are modes; any other mode has one part only.
    """
    v = mode.reshape(-1, 1)
    image = _image(twofold, state, v)
    part = v + image if float(np.sum(v * (mass @ image))) >= 0.0 else v - image
    size = float(lengths(mass, part)[0])
    return (part / size).reshape(mode.shape) if size > 0.0 else mode


def _clusters(values: Array, labels: tuple[str, ...]) -> list[tuple[int, int]]:
    """Ranges of equal eigenvalues of modes of one label, those of one mode too."""
    found, first = [], 0
    for k in range(1, values.size + 1):
        if (
            k == values.size
            or labels[k] != labels[first]
            or values[k] - values[first] > SAME_VALUE * abs(values[k])
        ):
            found.append((first, k))
            first = k
    return found


def _image(symmetry: Symmetry, state: State, block: Array) -> Array:
    """T v of moves (7N, k)."""
    n = state.band.segments
    moved = symmetry.apply(block.reshape(n, 7, -1), state.band.sigma)
    return moved.reshape(block.shape)


def _characters(state: State, metric: str, vectors: Array, named: dict[str, Symmetry]) -> dict[str, Array]:
    """<v, T v>/<v, v> (m,) of modes for each symmetry T; NaN for modes that have no length in the metric, as
    rotations have none in folding coordinates.
    """
    mass = metric_named(metric).matrix(state)
    block = vectors.reshape(vectors.shape[0], -1).T
    size = np.einsum("ij,ij->j", block, mass @ block)
    size[size <= np.finfo(float).eps * abs(mass).max() * np.einsum("ij,ij->j", block, block)] = np.nan
    return {
        name: np.einsum("ij,ij->j", block, mass @ _image(symmetry, state, block)) / size
        for name, symmetry in named.items()
    }


def _doubts(record: StateRecord, problem: Problem, x: Array) -> list[str]:
    """Why the state is no stationary band, whatever its spectrum says."""
    tolerance = Options().tolerance
    doubts = []
    for name, residual in (("gradient", record.kkt_residual), ("constraints", record.constraint_residual)):
        if not residual <= tolerance:
            doubts.append(f"the state is not stationary ({name} {residual:.1e}, tolerance {tolerance:.0e})")
    if (inverted_facets(problem, x) <= 0).any():
        doubts.append("a facet is turned inside out")
    if record.contacts is not None and record.status in (Status.UNDECIDED.value, Status.GAP_LOST.value):
        doubts.append(f"so is the certificate with contact: {record.message.rstrip('.')}")
    return doubts


def _with_contacts(record: StateRecord, verdict: Verdict) -> Verdict:
    """The verdict, which holds for moves that keep all contacts."""
    if record.contacts is None or not len(record.contacts):
        return verdict
    kept = f"modes keep the {len(record.contacts)} contact{'s' * (len(record.contacts) > 1)}"
    return replace(verdict, sentence=f"{verdict.sentence}; {kept}")


def told_of(record: StateRecord, found: Stability, run: str | None) -> StateSpectrum:
    """What `ribbon spectrum STATE` tells: plain values, arrays left out."""
    group = found.symmetries
    return StateSpectrum(
        run=run,
        label=record.label,
        half_width=record.half_width,
        segments=record.segments,
        h=record.length / record.segments,
        discretisation=record.discretisation,
        metric=found.metric,
        formula=found.formula,
        complete=found.complete,
        negative=found.verdict.negative,
        stability=found.verdict.kind,
        gap=found.verdict.gap,
        verdict=found.verdict.sentence,
        inertia=Counts(found.inertia.negative, found.inertia.gap, found.inertia.trusted),
        symmetry=Group(
            group.name,
            group.order,
            group.residual,
            group.near_name,
            group.near_residual,
            tuple(
                Element(s.name, s.matrix.tolist(), s.shift, s.reverse, s.flip, s.residual, s.exact)
                for s in (*group.exact[:LISTED], *group.near)
            ),
        ),
        symmetries=found.symmetry_names,
        modes=found.modes,
        parameters=_others(record) if record.parts.ends else None,
    )


def _others(record: StateRecord) -> dict[str, float]:
    """The parameters besides the half-width."""
    return {name: value for name, value in record.parameters.items() if name != HALF_WIDTH}


def arrays_of(record: StateRecord, found: Stability, run: str) -> dict[str, Array]:
    """Modes as arrays, with the state that they move and its hash: see docs/format.md."""
    modes, verdict = found.modes, found.verdict
    columns = ("value", "residual", "bound", "label", "sliding_overlap", "hidden")
    names = ("values", "residuals", "bounds", "labels", "sliding_overlap", "hidden")
    scalars = {
        "metric": found.metric,
        "complete": found.complete,
        "verdict": verdict.sentence,
        "negative_eigenvalues": UNKNOWN if verdict.negative is None else verdict.negative,
        "half_width": record.half_width,
        "length": record.length,
        "sigma": record.sigma,
        "discretisation": record.discretisation,
        "run": run,
        "label": record.label,
        "content_sha256": content_sha256(record),
    }
    return {
        **{
            name: np.array([getattr(m, key) for m in modes]) for name, key in zip(names, columns, strict=True)
        },
        "vectors": found.vectors,
        "u": found.state.u,
        "g": found.state.g,
        "xi": found.state.xi,
        **{name: np.asarray(value) for name, value in scalars.items()},
    }
