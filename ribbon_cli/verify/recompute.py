"""Whether stored numbers follow from the stored shape: everything derived is computed again and compared.

A file can be whole, and hashed, and still say something wrong. What a record claims is recomputed from u, g,
xi and the multipliers: energy, residuals, linking number, contact, geometry, modes, and the inertia that a
certificate rests on.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UsageError
from ..model.band import Array, State
from ..model.constraints import row_weights
from ..model.contact import GRAZING_TOLERANCE
from ..model.geometry import geometry
from ..model.problem import LocalDerivatives, Prescription, Problem
from ..model.topology import EXACT_TOLERANCE
from ..recipes.eversion import Pieces, half_turn, in_two_pieces
from ..solver.inertia import inertia
from ..solver.kkt import FactorisationError
from ..solver.linear import Factor
from ..solver.newton import Options
from ..solver.resting import RestingProblem
from ..solver.resting_kkt import kkt_matrix
from ..solver.status import STATIONARY, Result, Status
from ..store import Run, StateRecord, find_run, list_runs, names_state, resolve_state
from ..store.verification import Checked, Finding, check_file, check_folder, check_states
from ..study.records import Reached, all_multipliers_of, constructed, derive, problem_with, state_of
from ..text import in_a_line
from .branches import check_branch
from .contacts import check_contacts
from .spectra import check_spectra, check_values

EPS = float(np.finfo(float).eps)
ROUNDING = 256.0 * EPS
"""Roundings that may differ between machines, relative to the largest term of a sum."""
DERIVED = 1e-9
"""Relative difference up to which recomputed quantities agree; the stored ones have rounding errors alone."""
ENERGY = 1e-12
"""The same of energies, which are sums of positive terms."""
_ARITHMETIC = (ValueError, ArithmeticError, np.linalg.LinAlgError, FactorisationError)


@dataclass(frozen=True)
class Verification:
    """What was looked at, and what was found."""

    runs: int
    states: int
    findings: tuple[Finding, ...]

    @property
    def problems(self) -> tuple[Finding, ...]:
        """Findings that are no mere notes."""
        return tuple(finding for finding in self.findings if not finding.note)


def verify(root: Path, ref: str = "all", tell: Callable[[str], object] | None = None) -> Verification:
    """Verify a state, a run, or `all` runs, those set aside too: files against hashes, numbers against
    shapes.

    `tell` is called with a sentence on which state was taken, where the reference leaves a choice. Damage is
    in the findings. Raises UsageError for a reference to nothing.
    """
    if ref == "all":
        runs = list_runs(root, aside=True)
        return _joined([_verify_run(run) for run in runs], len(runs))
    if not names_state(ref):
        return _joined([_verify_run(find_run(root, ref))], 1)
    run, label, path = resolve_state(root, ref, tell)
    if path.suffix == ".npz":
        raise UsageError(f"{path}: an npz file carries no hash and no certificate to verify")
    if run is None or label is None:
        return _joined([[check_file(path)]], 0)
    return _joined([list(check_states(run, [label]))], 0)


def _verify_run(run: Run) -> list[Checked]:
    return [Checked(None, run.path, None, tuple(check_folder(run))), *check_states(run)]


def _joined(groups: list[list[Checked]], runs: int) -> Verification:
    """Add the physics to the files, and count."""
    findings: list[Finding] = []
    states = 0
    for checked in (item for group in groups for item in group):
        findings += checked.findings
        states += not (checked.label is None and os.path.isdir(checked.path))
        if checked.record is not None:
            findings += (Finding(str(checked.path), what) for what in verify_record(checked.record))
    return Verification(runs, states, tuple(findings))


def verify_record(record: StateRecord) -> list[str]:
    """Say, in a line each, what in a record does not follow from its u, g, xi and multipliers; nothing if
    all does.
    """
    try:
        with np.errstate(all="ignore"):
            return list(_findings(record))
    except _ARITHMETIC as error:
        return [f"cannot be recomputed: {in_a_line(error)}"]


def _findings(record: StateRecord) -> Iterator[str]:
    if record.sigma == 0 and record.half_twists:
        yield f"a strip with ends has half_twists = {record.half_twists}"
    elif record.sigma and record.sigma != (-1 if record.half_twists % 2 else 1):
        yield f"sigma is {record.sigma}, but {record.half_twists} half-twists make it {-record.sigma}"
    if record.cut_node is not None:
        yield from _two_pieces(record)  # no state of the model, but made of one
        return
    status = Status(record.status)
    problem = problem_of(record)
    x, multipliers = state_of(record).vector(), all_multipliers_of(record)
    local = problem.local_derivatives(x, multipliers)
    left = residuals(problem, local, multipliers)
    result = Result(
        status,
        x,
        multipliers,
        problem.state(x),
        problem.energy(x),
        left.kkt_residual,
        left.constraint_residual,
        record.negative_eigenvalues,
        record.newton_steps,
    )
    reached = Reached(problem, result, record.kind, record.stage, record.method, record.half_twists)
    again = dict(vars(derive(reached)))
    contacts = again.pop("contacts")
    slack = vars(residual_slack(problem, local, x, multipliers))
    for name, value in (again | _closed_up(record, state_of(record), again)).items():
        yield from _compare(record, name, value, slack)
    yield from _kind(record, status, problem)
    yield from _certificate(record, result)
    if isinstance(problem, RestingProblem):
        yield from check_contacts(record, contacts, problem, result, slack["constraint_residual"])
    if status in STATIONARY:
        yield from _inertia(record, problem, local, x)
    yield from check_spectra(record, problem, local, x)
    yield from check_values(record, problem, local, x)
    yield from check_branch(record, problem, x)


def _two_pieces(record: StateRecord) -> Iterator[str]:
    """Turn the second piece on until it fits, and compare with what follows from the band joined there."""
    half = record.segments // 2
    if record.cut_node != half + 1 or record.g_cut is None or record.status != Status.CONSTRUCTED.value:
        yield f"cut at node {record.cut_node} with status {record.status}: no band in two pieces"
        return
    first, cut = record.g[half], record.g_cut
    rest = math.atan2(first[1] * cut[2] - first[2] * cut[1], first[1] * cut[1] + first[2] * cut[2])
    back = half_turn(rest)
    u, g = record.u.copy(), record.g.copy()
    u[half:], g[half:] = u[half:] @ back.T, g[half:] @ back.T
    joined = replace(state_of(record), u=u, g=g)
    if not np.abs(joined.g[half] - cut).max() <= DERIVED:
        yield "its two pieces do not fit together"
        return
    turn = half_turn(math.pi - rest)
    walk = np.vstack((np.zeros(3), np.cumsum(joined.band.h * record.u, axis=0)))
    middle = 0.5 * walk[half]
    walk[half:] += middle - turn @ middle - walk[half]
    pieces = Pieces(record.u, record.g, record.xi, walk, turn @ cut, cut)
    made = constructed(joined)
    whole = derive(Reached(Problem(joined.band), made, record.kind, record.stage, record.method, 0))
    again = vars(whole) | vars(in_two_pieces(joined, pieces))
    del again["contacts"]
    for name, value in (again | _closed_up(record, joined, again)).items():
        yield from _compare(record, name, value, {"g_end": ROUNDING, "constraint_residual": ROUNDING})


def _closed_up(record: StateRecord, state: State, again: Mapping[str, Any]) -> dict[str, Any]:
    """What formats before 1.2 have at nodes without a fold: numbers of the strip closed up there."""
    shape = geometry(state)
    return {
        name: np.where(np.isnan(again[name]) & np.isfinite(getattr(record, name)), closed, again[name])
        for name, closed in (("kappa_s", shape.kappa_s), ("tau", shape.tau), ("eta", shape.eta))
    }


def problem_of(record: StateRecord) -> Problem:
    """The problem that a record solves, with its prescribed rulings or with the gaps that it keeps.

    Raises ValueError for values outside the model.
    """
    band = state_of(record).band
    held, seam = record.prescribed, record.seam_open
    if record.method.startswith("twist") and held is None and seam is None:
        # Format 1.0 does not say; all its auxiliary states are the twist's.
        held, seam = np.arange(record.segments) == 0, True
    rulings = {} if held is None else {int(node): record.g[node] for node in np.flatnonzero(held)}
    if record.contacts is not None and (rulings or seam):
        raise ValueError("contact forces do not go with prescribed rulings")
    return problem_with(record, Problem(band, Prescription(rulings, record.g_end if seam else None)))


@dataclass(frozen=True)
class Residuals:
    """Both residuals of a point, or a number for each, by their names in a record."""

    kkt_residual: float
    constraint_residual: float


def residuals(problem: Problem, local: LocalDerivatives, multipliers: Array) -> Residuals:
    """Both residuals of a point."""
    gradient = problem.lagrangian_gradient(local, multipliers)
    constraints = local.constraints / problem.weights
    return Residuals(float(np.abs(gradient).max()), float(np.abs(constraints).max()))


def residual_slack(problem: Problem, local: LocalDerivatives, x: Array, multipliers: Array) -> Residuals:
    """How far rounding alone may move the residuals, by their largest terms."""
    jacobian = abs(problem.jacobian_matrix(local))
    forces = float((jacobian.T @ np.abs(multipliers)).max()) + float(np.abs(local.gradient).max())
    rulings = float(np.abs(x.reshape(-1, 7)[:, 3:6]).max())
    band = problem.band
    terms = max(1.0, float(row_weights(band).max()), band.half_width / band.h) * max(1.0, rulings) ** 2
    return Residuals(ROUNDING * forces, ROUNDING * terms)


def energy_size(record: StateRecord) -> float:
    """What an energy is measured by: loads may nearly cancel what bending stores."""
    return max(abs(record.energy), abs(record.bending_energy or 0.0))


def _compare(record: StateRecord, name: str, value: object, slack: Mapping[str, float]) -> Iterator[str]:
    """A line if a stored field is not the recomputed one."""
    stored = getattr(record, name)
    if isinstance(value, bool | int):
        if stored != value and not _grazing(record, name):
            yield f"{name} is {stored}, recomputed {value}"
        return
    a, b = np.asarray(stored, dtype=np.float64), np.asarray(value, dtype=np.float64)
    finite = b[np.isfinite(b)]
    scale = max(1.0, float(np.abs(finite).max())) if a.ndim and finite.size else float(np.abs(finite).sum())
    allowed = slack.get(name, 0.0) + (1e-3 if name in slack else DERIVED) * scale
    if name in ("twist", "writhe", "linking_number"):
        allowed = DERIVED  # whole turns are the unit
    elif name == "energy":
        allowed = ENERGY * energy_size(record)
    elif name == "clearance":
        allowed += 4.0 * GRAZING_TOLERANCE * record.length
    elif name == "g_end":
        allowed = slack.get(name, 0.0)
    same = (a == b) | (np.isnan(a) & np.isnan(b)) | (np.abs(a - b) <= allowed)
    if a.shape != b.shape or not np.all(same):
        found = f"{stored:.10g}, recomputed {value:.10g}" if a.ndim == 0 else _worst(a, b)
        yield f"{name} is {found}"


def _worst(a: Array, b: Array) -> str:
    """Where two arrays of one shape are furthest apart."""
    off = np.where(np.isfinite(a) & np.isfinite(b), np.abs(a - b), np.where(a == b, 0.0, np.inf))
    at = np.unravel_index(int(np.argmax(off)), off.shape)
    return f"{a[at]:.10g} at {tuple(map(int, at))}, recomputed {b[at]:.10g}"


def _grazing(record: StateRecord, name: str) -> bool:
    """Whether facets are so near to touching that rounding decides."""
    return name == "self_contact" and record.clearance <= 4.0 * GRAZING_TOLERANCE * record.length


def _kind(record: StateRecord, status: Status, problem: Problem) -> Iterator[str]:
    """A state whose rulings are held is no equilibrium of the band, and a minimum is no saddle."""
    held = bool(problem.prescription.rulings) or problem.prescription.seam is not None
    if (held or status is Status.CONSTRUCTED) != (record.kind == "auxiliary"):
        what = "with prescribed rulings" if held else "with none prescribed"
        yield f"kind is {record.kind}, of a state {what} and status {record.status}"
    if record.kind == "saddle" and status is not Status.SADDLE:
        yield f"kind is saddle with status {record.status}"
    if record.kind in ("equilibrium", "intermediate") and status not in STATIONARY:
        yield f"kind is {record.kind} with status {record.status}"
    if status is Status.SADDLE and not record.negative_eigenvalues:
        yield f"status is saddle with negative_eigenvalues = {record.negative_eigenvalues}"


def _certificate(record: StateRecord, result: Result) -> Iterator[str]:
    """What a certificate promises, held against the recomputed numbers."""
    if record.certified != (record.status == Status.MINIMUM.value):
        yield f"certified is {str(record.certified).lower()} with status {record.status}"
    if not record.certified:
        return
    tolerance = Options().tolerance
    for name in ("kkt_residual", "constraint_residual"):
        if not getattr(result, name) <= tolerance:
            yield f"certified, but its {name} is {getattr(result, name):.2e}, above {tolerance:g}"
    if record.negative_eigenvalues != 0:
        yield f"certified with negative_eigenvalues = {record.negative_eigenvalues}"
    if record.inverted_facets:
        yield f"certified with {record.inverted_facets} inverted facets"
    closed = record.kind != "auxiliary" and record.parts.ends is None
    if closed and not abs(record.linking_number - 0.5 * record.half_twists) <= EXACT_TOLERANCE:
        wanted = record.half_twists / 2
        yield f"certified, but Lk is {record.linking_number:.6g} where {wanted:g} is asked for"


def _inertia(record: StateRecord, problem: Problem, local: LocalDerivatives, x: Array) -> Iterator[str]:
    """Count the negative eigenvalues again."""
    stored = record.negative_eigenvalues
    if stored is None:
        return
    matrix = kkt_matrix(problem, local, problem.rotations(x))
    if stored == 0 and Factor(matrix).proves_minimum():
        return
    count = inertia(matrix)
    if count.trusted and count.negative != stored:
        yield f"negative_eigenvalues is {stored}, recomputed {count.negative}"
    elif not count.trusted and stored == 0:
        measured = f"measured roundoff {count.roundoff:.1e}, pivot gap {count.gap:.1e}"
        yield f"negative_eigenvalues is 0, which cannot be confirmed ({measured})"
