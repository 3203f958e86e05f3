"""From a solve's result to the record that the store keeps."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import SpectrumRequest
from ..errors import UsageError
from ..facts import Event, event
from ..model.band import Array, Band, Discretisation, Multipliers, State
from ..model.contact import self_contact
from ..model.geometry import geometry
from ..model.problem import Problem
from ..model.reactions import Reactions, reactions
from ..model.topology import linking_number, open_turn, turn_of, writhe
from ..model.touching import Shape, excluded_distance
from ..model.touching_audit import audit
from ..model.touching_gaps import Pairs
from ..parts import FREE
from ..solver.kkt import FactorisationError
from ..solver.resting import RestingProblem, resting_reactions
from ..solver.resting_set import Rest, rest_at
from ..solver.spectra import Spectrum, full_spectra, lowest_spectra
from ..solver.status import Result, SaddleMet, Status
from ..solver.steps import inverted_facets
from ..solver.threads import cpu_seconds
from ..store import BranchRecord, Contacts, SpectrumRecord, StateRecord, Summary, encoded
from .clock import Clock


@dataclass(frozen=True)
class Reached:
    """A solve's end with what a record needs to say how it was reached.

    Of a `Rest` they are its `problem`, a `RestingProblem`, and its `result`, whose multipliers end with the
    forces.
    """

    problem: Problem
    result: Result
    kind: str
    stage: str
    method: str
    half_twists: int
    parent: int | None = None
    parent_ref: str | None = None
    events: tuple[Event, ...] = ()
    steps: int = 0
    branch: BranchRecord | None = None


def saddle_result(problem: Problem, met: SaddleMet) -> Result:
    """A saddle met on the way, as a result of its own."""
    return Result(
        Status.SADDLE,
        met.x,
        met.multipliers,
        problem.state(met.x),
        met.energy,
        met.kkt_residual,
        met.constraint_residual,
        met.index,
        0,
    )


def constructed(state: State) -> Result:
    """A state that was made and not solved for, as a result; its multipliers are not numbers."""
    problem, x = Problem(state.band), state.vector()
    return Result(
        Status.CONSTRUCTED,
        x,
        np.full(problem.rows, np.nan),
        state,
        problem.energy(x),
        float("nan"),
        float(np.abs(problem.constraints(x)).max()),
        None,
        0,
    )


def build_record(
    label: int, reached: Reached, clock: Clock, spectrum: SpectrumRequest | None = None
) -> StateRecord:
    """The record of a reached state; `spectrum` says which modes to compute, None none."""
    problem, result = reached.problem, reached.result
    band, state = problem.band, result.state
    named = Multipliers.from_vector(band, split(problem, result.multipliers)[0])
    record = StateRecord(
        **vars(derive(reached)),
        label=label,
        kind=reached.kind,
        status=result.status.value,
        message=_sentence(result, reached.kind),
        certified=result.certified,
        half_width=band.half_width,
        length=band.length,
        sigma=band.sigma,
        segments=band.segments,
        half_twists=reached.half_twists,
        discretisation=band.discretisation.value,
        stage=reached.stage,
        u=state.u,
        g=state.g,
        xi=state.xi,
        lambda_1=named.lambda_1,
        lambda_2=named.lambda_2,
        lambda_3=named.lambda_3,
        lambda_4=named.lambda_4,
        lambda_5=named.lambda_5,
        gamma=named.gamma,
        lambda_end=named.end,
        parts=band.parts,
        negative_eigenvalues=result.negative,
        branch=reached.branch,
        parent=reached.parent,
        parent_ref=reached.parent_ref,
        method=reached.method,
        newton_steps=reached.steps,
        events=tuple(map(str, reached.events)),
        event_kinds=tuple(event.kind for event in reached.events),
        prescribed=_prescribed(problem),
        seam_open=True if problem.prescription.seam is not None else None,
        provenance=clock.facts(),
    )
    return record if spectrum is None else with_spectra(record, spectrum)


def _sentence(result: Result, kind: str) -> str:
    """The result in words; of an auxiliary problem with whose minimum it is."""
    if kind == "auxiliary" and result.status is Status.MINIMUM:
        return "Converged to a minimum of the auxiliary problem, with its prescribed rulings held."
    return result.message


@dataclass(frozen=True, eq=False)
class Derived:
    """Fields of a record that follow from u, g, xi and the multipliers, by their names in a `StateRecord`."""

    energy: float
    kkt_residual: float
    constraint_residual: float
    smallest_facet: float
    inverted_facets: int
    linking_number: float
    twist: float
    writhe: float
    self_contact: bool
    clearance: float
    g_end: Array
    midline: Array
    kappa_s: Array
    tau: Array
    eta: Array
    eta_prime: Array
    bending_energy: float | None
    reaction_force: Array | None
    reaction_moment: Array | None
    start_force: Array | None
    start_moment: Array | None
    contacts: Contacts | None


def derive(reached: Reached) -> Derived:
    """Fields of a record that follow from u, g, xi and the multipliers: what `ribbon verify` computes again.

    Raises ValueError where they are not defined, as for values that are not finite.
    """
    problem, result = reached.problem, reached.result
    band, state = problem.band, result.state
    end = problem.end_ruling(result.x)
    shape = geometry(state, end if problem.prescription.seam is not None else None)
    turn = _topology(problem, state)
    contacts = contacts_of(problem, result)
    touching, clearance = _meeting(state, end, contacts)
    facets = inverted_facets(problem, result.x)
    held = None if band.closed else _reactions(problem, result)
    return Derived(
        energy=result.energy,
        kkt_residual=result.kkt_residual,
        constraint_residual=result.constraint_residual,
        smallest_facet=float(facets.min()),
        inverted_facets=int((facets <= 0).sum()),
        linking_number=turn[0],
        twist=turn[1],
        writhe=turn[2],
        self_contact=touching,
        clearance=clearance,
        g_end=end,
        midline=shape.midline,
        kappa_s=shape.kappa_s,
        tau=shape.tau,
        eta=shape.eta,
        eta_prime=shape.eta_prime,
        bending_energy=problem.bending_energy(result.x) if problem.terms else None,
        reaction_force=None if held is None else held.force,
        reaction_moment=None if held is None else held.moment,
        start_force=None if held is None else held.start_force,
        start_moment=None if held is None else held.start_moment,
        contacts=contacts,
    )


def split(problem: Problem, multipliers: Array) -> tuple[Array, Array]:
    """Multipliers of constraints (5N+3,), and forces of contacts (k,), of which most problems have none."""
    if isinstance(problem, RestingProblem):
        return problem.split(multipliers)
    return multipliers, np.empty(0)


def _reactions(problem: Problem, result: Result) -> Reactions:
    """What holds a strip's ends."""
    if isinstance(problem, RestingProblem):
        return resting_reactions(problem, result.x, result.multipliers)
    return reactions(problem, result.x, result.multipliers)


def contacts_of(problem: Problem, result: Result) -> Contacts | None:
    """The gaps that a state keeps, with the audit over all pairs; None without contact forces."""
    if not isinstance(problem, RestingProblem):
        return None
    found = audit(Shape.of(result.state, problem.gap))
    return Contacts(
        first=problem.pairs.first,
        second=problem.pairs.second,
        sign=problem.pairs.sign.astype(np.int64),
        force=split(problem, result.multipliers)[1],
        value=problem.gaps(result.x).value,
        gap=problem.gap,
        excluded=excluded_distance(problem.band.length, problem.gap),
        clearance=found.clearance,
        penetration=found.penetration,
    )


def _meeting(state: State, end: Array, contacts: Contacts | None) -> tuple[bool, float]:
    """Whether a band touches or crosses itself, and the least distance of its facets."""
    if contacts is not None:
        return contacts.touching, contacts.clearance
    band = state.band
    found = self_contact(state.u, state.g, end, band.half_width, band.h, closed=band.closed)
    return found.contact, found.clearance


def _prescribed(problem: Problem) -> NDArray[np.bool_] | None:
    """Marks (N,) of the rulings that are held, None if none is."""
    held = np.zeros(problem.band.segments, dtype=np.bool_)
    held[list(problem.prescription.rulings)] = True
    return held if held.any() else None


def _topology(problem: Problem, state: State) -> tuple[float, float, float]:
    """Lk, Tw, Wr; with an open seam Tw + Wr of the open frame stands for Lk, of strips Tw + Wr.

    Not-a-number if undefined.
    """
    band = problem.band
    try:
        if not band.closed:
            found_open = turn_of(state)
            return sum(found_open), *found_open
        if problem.prescription.seam is None:
            found = linking_number(state.u, state.g, band.sigma, band.h)
            return found.linking_number, found.twist, found.writhe
        turn, wr = open_turn(state.u, state.g, band.h), writhe(state.u, band.h)
        return turn, turn - wr, wr
    except ValueError:
        return float("nan"), float("nan"), float("nan")


def with_spectra(record: StateRecord, request: SpectrumRequest) -> StateRecord:
    """The record with its spectra, which follow from it alone; `request` says which modes to compute."""
    wall, cpu = time.perf_counter(), cpu_seconds()
    spectra, remarks = _spectra(record, request)
    facts = dict(record.provenance)
    costs = {"wall_seconds": time.perf_counter() - wall, "cpu_seconds": cpu_seconds() - cpu}
    for name, cost in costs.items():
        facts[name] = float(facts[name]) + cost
    return replace(
        record,
        spectra=spectra,
        events=(*record.events, *map(str, remarks)),
        event_kinds=(*(record.event_kinds or ()), *(remark.kind for remark in remarks)),
        provenance=facts,
    )


def completed(record: StateRecord, request: SpectrumRequest | None) -> tuple[bytes, Summary]:
    """The file of a record with its spectra, and its summary, as `Run.commit_soon` asks for them."""
    return encoded(record if request is None else with_spectra(record, request))


def _spectra(
    record: StateRecord, request: SpectrumRequest
) -> tuple[tuple[SpectrumRecord, ...], tuple[Event, ...]]:
    """Stored spectra: all values up to `full_up_to` segments, the lowest modes beyond; and remarks."""
    if record.segments > request.full_up_to and not request.modes:
        return (), ()
    state = state_of(record)
    problem, x = problem_with(record, Problem(state.band)), state.vector()
    local = problem.local_derivatives(x, all_multipliers_of(record))
    try:
        if record.segments <= request.full_up_to:
            found = full_spectra(problem, x, local, request.metrics, request.modes)
        else:
            found = lowest_spectra(problem, x, local, request.metrics, request.modes)
    except (FactorisationError, np.linalg.LinAlgError) as error:
        return (), (event("no-spectrum", why=error),)
    return tuple(_spectrum_record(s) for s in found), ()


def _spectrum_record(spectrum: Spectrum) -> SpectrumRecord:
    return SpectrumRecord(
        metric=spectrum.metric,
        complete=spectrum.complete,
        values=spectrum.values,
        residuals=spectrum.residuals,
        labels=spectrum.labels,
        sliding_overlap=spectrum.sliding_overlap,
        vectors=spectrum.vectors,
    )


def state_of(record: StateRecord) -> State:
    """The discrete state of a record. Raises UsageError for a discretisation of a newer version."""
    try:
        rule = Discretisation(record.discretisation)
    except ValueError:
        unknown = f"no discretisation {record.discretisation!r} is known here"
        raise UsageError(f"state {record.label}: {unknown}: update ribbon") from None
    band = Band(record.segments, record.half_width, record.length, record.sigma, rule, record.parts)
    return State(band, record.u, record.g, record.xi, None if band.closed else record.g_end)


def multipliers_of(record: StateRecord) -> Array:
    """The multipliers (5N+3,) of a record."""
    fields = (record.lambda_1, record.lambda_2, record.lambda_3, record.lambda_4, record.lambda_5)
    ends = record.parts.ends
    closing = 0 if ends is not None and ends.end == FREE else 3
    return Multipliers(*fields, record.gamma, record.lambda_end).vector(closing)


def pairs_of(contacts: Contacts) -> Pairs:
    """The pairs of features whose gaps are kept."""
    return Pairs(contacts.first, contacts.second, contacts.sign.astype(np.float64))


def problem_with(record: StateRecord, problem: Problem) -> Problem:
    """A record's problem with the gaps that it keeps; without contact forces the problem itself."""
    if record.contacts is None:
        return problem
    return RestingProblem(problem.band, pairs_of(record.contacts), record.contacts.gap)


def all_multipliers_of(record: StateRecord) -> Array:
    """The multipliers of constraints and then the forces of contacts, (5N+3+k,)."""
    own = multipliers_of(record)
    return own if record.contacts is None else np.concatenate((own, record.contacts.force))


def rest_of(record: StateRecord, gap: float = 0.0) -> Rest:
    """A stored state as a shape that may rest on itself, with its contacts.

    One without contact forces has none, and is to be continued at a `gap`. The index is counted anew.
    """
    state, own, contacts = state_of(record), multipliers_of(record), record.contacts
    if contacts is None:
        return rest_at(state, own, gap=gap)
    return rest_at(state, own, pairs_of(contacts), contacts.force, contacts.gap)
