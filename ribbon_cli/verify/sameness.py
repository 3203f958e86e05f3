"""Whether two records are one state: to the last bit, up to rounding, or not.

Another version of a library adds in another order, and everything computed differs in its last digits. How
much that may be is not the same for all that a state holds, so that it is derived and not one tolerance:

- What a state is (kind, N, topology, status, index, ...) is equal.
- Shape and multipliers of each record solve the equations as well as the record says, to the rounding of
  evaluating them, and the two shapes are within `NEAR` of each other. A shape that is moved along a soft mode
  by a residual of rounding is the same; one that is moved otherwise has a residual that tells. Two
  solutions of the same index at a distance d leave a mode with an eigenvalue of order d^2, which is below
  rounding for d < 1e-8: no arithmetic of 16 digits tells nearer ones apart.
- The equations do not know where the numbering begins, which way it runs, which side is the front, nor how
  the band lies in space. Rounding decides on which side a saddle is left, and so which of the images of a
  minimum is met: an image is the same state, and is said to be one.
- Numbers that follow from a shape differ by no more than the shape's difference (turned back in space)
  amplified by second differences on the grid, N^2. Energies are stationary and agree to its square.
- Eigenvalues agree to their bounds; modes as the spaces that belong to eigenvalues which the bounds keep
  apart, so up to sign, and up to rotation where an eigenvalue is multiple.
- Residuals are rounding themselves and are held against the equations, not against each other. How a state
  was reached (stage, method, parent, steps, events, message) is no part of what it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..facts import TOLERANCE
from ..model.band import Array
from ..model.contact import GRAZING_TOLERANCE
from ..model.entries import PER_NODE
from ..model.metrics import metric_named
from ..model.strip_symmetry import strip_images
from ..model.symmetry import Symmetry, find_image, nearest_image
from ..parts import HALF_WIDTH, PARAMETERS
from ..report.comparison import (
    DIFFERENT,
    IDENTICAL,
    SAME,
    Judgement,
    StatePair,
    compare_runs,
    compare_states,
    same_science,
)
from ..solver.newton import Options
from ..solver.status import STATIONARY, Status
from ..store import BranchRecord, Contacts, Run, SpectrumRecord, StateRecord
from ..store.layout import REACTIONS
from ..study.records import all_multipliers_of, multipliers_of, state_of
from .branches import OVERLAP, TANGENT, VALUE
from .recompute import DERIVED, ENERGY, energy_size, problem_of, residual_slack, residuals
from .spectra import NOISE, RELATIVE

NEAR = 1e-7
"""Largest difference of two shapes that rounding may account for, with unit tangents; the root of rounding,
1.5e-8, with room for drift of a band as a whole (8e-10 seen)."""
APART = 1e3
"""Eigenvalues are apart where their gap is so many times their bounds: spaces of modes then turn by less than
1/APART, Davis and Kahan (1970)."""
FACTS = (
    *("kind", "segments", "length", "discretisation", "half_twists", "sigma", "status", "certified"),
    *("negative_eigenvalues", "inverted_facets", "cut_node", "seam_open"),
)
"""What is equal in two records of one state; `prescribed` as well."""
_PATHS = {"cut_node": "state", "seam_open": "state", "segments": "state", "length": "state"}
_ORIGINS = {"kind": "origin", "discretisation": "state", "half_twists": "topology", "sigma": "topology"}


LEFT = 1e-4
"""Difference of modes' residuals, which are rounding, in parts of the eigenvalue or of the metric's unit."""
_SPACES = ("vectors", "soft_mode", "sliding_overlap", "residuals")
"""What gaps of eigenvalues amplify, and what is rounding itself: held against limits, and no measure of how
near two states are."""


@dataclass(frozen=True)
class _Check:
    """One quantity of two records: its relative difference, and how large that may be."""

    path: str
    relative: float
    limit: float

    @property
    def holds(self) -> bool:
        return self.relative <= self.limit


def judge(first: StateRecord, second: StateRecord) -> Judgement:
    """Whether two records are one state: to the last bit, their places in a run apart, or up to rounding."""
    if same_science(compare_states(first, second)):
        return Judgement(IDENTICAL)
    for path, equal in _facts(first, second):
        if not equal:
            return Judgement(DIFFERENT, None, path)
    with np.errstate(all="ignore"):
        image, checks = _checks(first, second)
    failed = [check for check in checks if not check.holds]
    numbers = [check for check in checks if check.path.rpartition("/")[2] not in _SPACES]
    shown = max(failed or numbers, key=lambda check: np.nan_to_num(check.relative, nan=math.inf))
    relative = shown.relative if math.isfinite(shown.relative) else None
    return Judgement(DIFFERENT if failed else SAME, relative, shown.path, None if failed else image)


def _facts(first: StateRecord, second: StateRecord) -> Iterator[tuple[str, bool]]:
    """Paths of what is exact, and whether it is equal."""
    for name in FACTS:
        group = (_PATHS | _ORIGINS).get(name, "certificate")
        yield f"/{group}/{name}", getattr(first, name) == getattr(second, name)
    yield "/ends", _kinds(first) == _kinds(second)
    held = [() if r.prescribed is None else tuple(np.flatnonzero(r.prescribed)) for r in (first, second)]
    yield "/state/prescribed", held[0] == held[1]
    yield "/certificate/kkt_residual", _solves(first) == _solves(second)
    grazing = max(first.clearance, second.clearance) <= 4.0 * GRAZING_TOLERANCE * first.length
    yield "/topology/self_contact", first.self_contact == second.self_contact or grazing
    metrics = [[s.metric for s in r.spectra] for r in (first, second)]
    yield "/spectra", metrics[0] == metrics[1]
    for one, two in zip(first.spectra, second.spectra, strict=False):
        yield f"/spectra/{one.metric}/complete", one.complete == two.complete
        yield f"/spectra/{one.metric}/values", len(one.values) == len(two.values)
        turns = [[label == "rotation" for label in s.labels].count(True) for s in (one, two)]
        yield f"/spectra/{one.metric}/labels", turns[0] == turns[1]
        kept = [-1 if s.vectors is None else len(s.vectors) for s in (one, two)]
        yield f"/spectra/{one.metric}/vectors", kept[0] == kept[1]
    points = [
        None if r.branch is None else (r.branch.type, r.branch.index_before, r.branch.index_after)
        for r in (first, second)
    ]
    yield "/branch/type", points[0] == points[1]
    resting = [None if r.contacts is None else (len(r.contacts), r.contacts.gap) for r in (first, second)]
    yield "/contacts", resting[0] == resting[1]
    ways = [None if r.branch is None else r.branch.parameter or HALF_WIDTH for r in (first, second)]
    yield "/branch/parameter", ways[0] == ways[1]
    loaded = [r.bending_energy is None for r in (first, second)]
    yield "/state/bending_energy", loaded[0] == loaded[1]
    soft = [r.branch is not None and r.branch.soft_mode is not None for r in (first, second)]
    yield "/branch/soft_mode", soft[0] == soft[1]


def _kinds(record: StateRecord) -> str:
    """What ends, material and loads are besides their parameters; a place that a free end has not is nan."""
    parts = record.parts
    for name in record.parameters:
        parts = parts if name == HALF_WIDTH else parts.with_value(name, 0.0)
    return repr(parts)


def _checks(first: StateRecord, second: StateRecord) -> tuple[str | None, list[_Check]]:
    """How the second record is an image of the first, None for itself, and every number held against the
    other's.
    """
    one, two = _unknowns(first), _unknowns(second)
    image = None
    drift = _apart(one, two)
    if first.parts.ends is not None:
        if not drift <= NEAR:
            found = nearest_image(strip_images(state_of(second), state_of(first)))
            image = None if found.is_identity else found
            two = found.apply(two, first.sigma)
            drift = _apart(one, two)
    elif first.kind != "auxiliary":
        turned = find_image(state_of(second), state_of(first), renumbered=False)
        drift = _apart(one, turned.apply(two, first.sigma))
        if not _apart(one, two) <= NEAR:
            image = turned if drift <= NEAR else find_image(state_of(second), state_of(first))
            two = image.apply(two, first.sigma)
            drift = _apart(one, two)
    limit = NEAR if _solves(first) and _solves(second) else DERIVED
    checks = [_Check("/state/half_width", _relative(first.half_width, second.half_width), TOLERANCE)]
    for name, value in first.parameters.items() if first.parts.ends is not None else ():
        apart = abs(value - second.parameters[name]) / max(1.0, abs(value))
        checks.append(_Check(f"/{PARAMETERS[name].part or 'state'}/{name}", apart, TOLERANCE))
    for name, part in (("u", slice(0, 3)), ("g", slice(3, 6)), ("xi", slice(6, 7))):
        checks.append(_Check(f"/state/{name}", _apart(one[:, part], two[:, part]), limit))
    for record in (first, second) if Status(first.status) in STATIONARY else ():
        checks += _equations(record)
    checks += _energies(first, second, drift)
    amplified = first.segments**2 * drift
    checks += _derived(first, second, amplified)
    if image is None:
        checks += _derived_arrays(first, second, amplified)
    if first.contacts is not None and second.contacts is not None:
        checks += _contacts(first.contacts, second.contacts, image, amplified)
    for here, there in zip(first.spectra, second.spectra, strict=True):
        checks += _spectrum(first, here, there, image)
    if first.branch is not None and second.branch is not None:
        checks += _branch(first.branch, second.branch, first.sigma, image, amplified)
    return None if image is None else image.in_words(), checks


def _unknowns(record: StateRecord) -> Array:
    """u, g and xi (N, 7); of a strip what its ends leave to move, with g_{N+1} in the place of g_1."""
    if record.parts.ends is None:
        return np.hstack((record.u, record.g, record.xi[:, None]))
    x: Array = np.where(problem_of(record).fixed, 0.0, state_of(record).vector())
    return x.reshape(-1, 7)


def _solves(record: StateRecord) -> bool:
    """Whether a record says that it solves the equations to the solver's tolerance."""
    worst = max(record.kkt_residual, record.constraint_residual)
    return Status(record.status) in STATIONARY and worst <= Options().tolerance


def _equations(record: StateRecord) -> Iterator[_Check]:
    """Residuals computed again, by how much they exceed what the record says, up to the rounding of their
    terms.
    """
    problem = problem_of(record)
    x, multipliers = state_of(record).vector(), all_multipliers_of(record)
    local = problem.local_derivatives(x, multipliers)
    slack = vars(residual_slack(problem, local, x, multipliers))
    for name, found in vars(residuals(problem, local, multipliers)).items():
        excess = found - (1.0 + 1e-3) * getattr(record, name)
        yield _Check(f"/certificate/{name}", 0.0 if excess <= slack[name] else excess, slack[name])


def _energies(first: StateRecord, second: StateRecord, drift: float) -> Iterator[_Check]:
    """Energies, which are stationary: a drift counts by its square, and constraints by their multipliers.

    What bends alone is not stationary.
    """
    size = max(map(energy_size, (first, second)))
    relative = abs(first.energy - second.energy) / size if first.energy != second.energy else 0.0
    left = sum(record.constraint_residual * _largest_multiplier(record) for record in (first, second))
    off = PER_NODE * first.length * left / size if size > 0.0 else 0.0
    yield _Check("/state/energy", relative, ENERGY + off + (first.segments * drift) ** 2)
    if first.bending_energy is not None and second.bending_energy is not None:
        apart = abs(first.bending_energy - second.bending_energy) / size if size > 0.0 else 0.0
        yield _Check("/state/bending_energy", apart, DERIVED + first.segments**2 * drift)


def _largest_multiplier(record: StateRecord) -> float:
    """The largest multiplier, zero of a state that is constructed and has none."""
    multipliers = multipliers_of(record)
    return float(np.abs(multipliers[np.isfinite(multipliers)]).max(initial=0.0))


def _derived(first: StateRecord, second: StateRecord, amplified: float) -> Iterator[_Check]:
    """Scalars that follow from the shape, whatever its numbering."""
    mirrored = first.parts.ends is not None or abs(first.linking_number) <= DERIVED
    for name in ("linking_number", "twist", "writhe"):  # whole turns are the unit
        one, two = getattr(first, name), getattr(second, name)
        apart = min(abs(one - two), abs(one + two) if mirrored else math.inf)
        both = math.isnan(one) and math.isnan(two)
        yield _Check(f"/topology/{name}", 0.0 if both else apart, DERIVED + amplified)
    apart = abs(first.clearance - second.clearance) if first.clearance != second.clearance else 0.0
    allowed = DERIVED + 4.0 * GRAZING_TOLERANCE + amplified
    yield _Check("/topology/clearance", apart / first.length, allowed)
    facets = abs(first.smallest_facet - second.smallest_facet)
    yield _Check("/certificate/smallest_facet", facets, DERIVED + amplified)


def _derived_arrays(first: StateRecord, second: StateRecord, amplified: float) -> Iterator[_Check]:
    """Arrays that follow from the shape, of states numbered alike."""
    limit = DERIVED + amplified
    yield _Check("/state/g_end", _apart(first.g_end, second.g_end), NEAR)
    if first.g_cut is not None and second.g_cut is not None:
        yield _Check("/state/g_cut", _apart(first.g_cut, second.g_cut), DERIVED)
    largest = max(_largest_multiplier(record) for record in (first, second))
    for name in ("lambda_1", "lambda_2", "lambda_3", "lambda_4", "lambda_5", "gamma"):
        yield _Check(
            f"/multipliers/{name}", _apart(getattr(first, name), getattr(second, name), largest), limit
        )
    if first.lambda_end is not None and second.lambda_end is not None:
        ends = np.array([first.lambda_end]), np.array([second.lambda_end])
        yield _Check("/multipliers/lambda_end", _apart(*ends, max(1.0, largest)), limit)
    for name in REACTIONS if first.reaction_force is not None else ():
        pair = getattr(first, name), getattr(second, name)
        yield _Check(f"/reactions/{name}", _apart(*pair, max(1.0, largest)), limit)
    for name in ("midline", "eta_prime"):
        yield _Check(f"/geometry/{name}", _apart(getattr(first, name), getattr(second, name)), limit)
    for name in ("kappa_s", "tau", "eta"):
        yield _Check(f"/geometry/{name}", _apart(_at_folds(first, name), _at_folds(second, name)), limit)


def _contacts(one: Contacts, two: Contacts, image: Symmetry | None, amplified: float) -> Iterator[_Check]:
    """Which features touch, and forces; of an image, which numbers them anew, forces by size."""
    pairs = one.keys() == two.keys() and np.array_equal(one.sign, two.sign)
    if image is None:
        yield _Check("/contacts/first", 0.0 if pairs else math.inf, 0.0)
    forces = (one.force, two.force) if image is None else (np.sort(one.force), np.sort(two.force))
    largest = max(1.0, float(np.abs(one.force).max(initial=0.0)))
    yield _Check("/contacts/force", _apart(*forces, largest), DERIVED + amplified)
    deepest = abs(one.penetration - two.penetration)
    yield _Check("/contacts/penetration", deepest, DERIVED + amplified)


def _at_folds(record: StateRecord, name: str) -> Array:
    """A field at nodes, without what formats before 1.2 have at those that have no fold."""
    values: Array = getattr(record, name).copy()
    if record.seam_open or record.cut_node is not None:
        values[0] = np.nan
    if record.cut_node is not None:
        values[record.cut_node - 1] = np.nan
    return values


def _spectrum(
    record: StateRecord, one: SpectrumRecord, two: SpectrumRecord, image: Symmetry | None
) -> Iterator[_Check]:
    """Eigenvalues to their bounds; of modes that these keep apart, spaces, sliding and names."""
    name = f"/spectra/{one.metric}"
    unit = metric_named(one.metric).unit(state_of(record).band)
    noise = NOISE * max(unit, float(np.abs(one.values).max(initial=0.0)) if one.complete else 0.0)
    bounds = noise + 10.0 * np.minimum(one.residuals, two.residuals)
    left = np.abs(one.residuals - two.residuals) / np.maximum(np.abs(one.values), unit)
    yield _Check(f"{name}/residuals", float(left.max(initial=0.0)), LEFT)
    sizes = np.maximum(np.abs(one.values), bounds / RELATIVE)
    yield _Check(
        f"{name}/values", float((np.abs(one.values - two.values) / sizes).max(initial=0.0)), RELATIVE
    )
    for group in _groups(one, bounds):
        overlaps = [float(np.linalg.norm(s.sliding_overlap[group])) for s in (one, two)]
        yield _Check(f"{name}/sliding_overlap", abs(overlaps[0] - overlaps[1]), OVERLAP)
        if len(group) == 1 and one.labels[group[0]] != two.labels[group[0]]:
            yield _Check(f"{name}/labels", math.inf, 0.0)
        if one.vectors is None or two.vectors is None or group[-1] >= len(one.vectors):
            continue
        vectors = two.vectors[group]
        if image is not None:
            vectors = np.stack([image.apply(mode, record.sigma) for mode in vectors])
        yield _Check(f"{name}/vectors", _turn(one.vectors[group], vectors), 1.0 / APART)


def _groups(spectrum: SpectrumRecord, bounds: Array) -> Iterator[list[int]]:
    """Numbers of eigenvalues that are not kept apart from each other, rotations by themselves.

    The last group may go on behind an incomplete list, and is left out there.
    """
    turns = [k for k, label in enumerate(spectrum.labels) if label == "rotation"]
    if turns:
        yield turns
    group: list[int] = []
    for k in (k for k, label in enumerate(spectrum.labels) if label != "rotation"):
        if group:
            gap = spectrum.values[k] - spectrum.values[group[-1]]
            close = APART * (bounds[k] + RELATIVE * abs(spectrum.values[k]))
            if gap > close:
                yield group
                group = []
        group.append(k)
    if group and spectrum.complete:
        yield group


def _turn(one: Array, two: Array) -> float:
    """Sine of the largest angle between the spaces of modes (k, N, 7)."""
    first, second = (np.linalg.qr(modes.reshape(len(modes), -1).T)[0] for modes in (one, two))
    return float(np.linalg.norm(second - first @ (first.T @ second), 2))


def _branch(
    one: BranchRecord, two: BranchRecord, sigma: int, image: Symmetry | None, amplified: float
) -> Iterator[_Check]:
    """A point's place on its branch, its tangent and its soft mode, up to the mode's sign."""

    def placed(moves: Array) -> Array:
        return moves if image is None else image.apply(moves, sigma)

    yield _Check("/branch/tangent", _apart(one.tangent, placed(two.tangent)), TANGENT + amplified)
    for name in ("arclength", "next_step", "half_width_rate"):
        a, b = getattr(one, name), getattr(two, name)
        yield _Check(f"/branch/{name}", abs(a - b) / max(abs(a), 1.0), TANGENT + amplified)
    a, b = one.lowest_eigenvalue, two.lowest_eigenvalue
    known = a is not None and b is not None
    apart = abs(a - b) / (abs(a) + 1.0) if a is not None and b is not None else 0.0
    yield _Check("/branch/lowest_eigenvalue", apart if known or a is b else math.inf, VALUE)
    overlap = abs((one.sliding_overlap or 0.0) - (two.sliding_overlap or 0.0))
    yield _Check("/branch/sliding_overlap", overlap, OVERLAP)
    if one.soft_mode is not None and two.soft_mode is not None:
        yield _Check(
            "/branch/soft_mode", _turn(one.soft_mode[None], placed(two.soft_mode)[None]), 1.0 / APART
        )


def _relative(a: float, b: float) -> float:
    """Difference of two numbers in parts of the larger one."""
    return abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0


def _apart(one: Array, two: Array, size: float | None = None) -> float:
    """Largest difference of two arrays in parts of `size`, by default of the largest entry where that exceeds
    1; infinite where one alone is finite.
    """
    same = (one == two) | (np.isnan(one) & np.isnan(two))
    off = np.where(same, 0.0, np.abs(one - two))
    largest = float(np.where(np.isnan(off), np.inf, off).max(initial=0.0))
    if size is None:
        size = max(1.0, float(np.abs(one[np.isfinite(one)]).max(initial=0.0)))
    return largest / size if largest else 0.0


def judge_runs(first: Run, second: Run) -> list[StatePair]:
    """The states of two runs by the stages that they ended, each pair judged. Raises StoreError."""
    return compare_runs(first, second, judge)
