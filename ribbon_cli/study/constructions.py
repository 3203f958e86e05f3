"""Guesses that are made, at least in part, without solving: eversion and n-inflection construction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..model.band import Band, State
from ..model.folding import ClosureError
from ..model.geometry import geometry
from ..model.problem import Problem
from ..model.topology import linking_number
from ..recipes.eversion import Pieces, eversion_stage, eversion_stages, rejoined, turned
from ..recipes.schoenke import schoenke
from ..solver.status import Result, Status
from ..store import Summary
from .auxiliary import Turning
from .clock import Clock
from .plan import CONSTRUCTION, QUARTERS, turn_names
from .records import Reached, state_of
from .steps import Steps


def evert(steps: Steps, ring: State, count: int) -> Summary | str:
    """Run or load the auxiliary stages; the rejoined band, or a sentence why it was not reached."""
    segments = ring.band.segments
    turning = Turning(steps, ring, "eversion", lambda index: eversion_stage(segments, index, count))
    last = turning.run(eversion_stages(segments, count))
    return last if isinstance(last, str) else _join(steps, last)


def _join(steps: Steps, last: Summary) -> Summary:
    """The band cut, half of it turned step by step, and joined again: constructions, nothing is solved."""
    state, record = state_of(steps.journal.load(last)), last
    joined = rejoined(state)
    for k, stage in enumerate(turn_names()):
        steps.begin(stage, last.half_width, last.segments)
        parent, known = record.label, steps.journal.finished(stage)
        if known is None:
            clock, whole = steps.journal.clock(), k == QUARTERS
            method = "halves joined again" if whole else f"second half turned by {k}/{QUARTERS} of pi"
            changes = {} if whole else in_two_pieces(joined, turned(state, math.pi * k / QUARTERS))
            known = _store(steps, joined, clock, stage, method, parent, changes)
        record = known
    return record


def in_two_pieces(joined: State, pieces: Pieces) -> dict[str, Any]:
    """What the record of a band in two pieces has in place of the joined one's.

    Folds at the cuts do not exist: their curvature is not a number and their energy is left out. Neither
    linking number nor clearance is defined.
    """
    half, nan = joined.band.segments // 2, float("nan")
    problem = Problem(joined.band)
    shape = geometry(joined)
    kappa, tau = shape.kappa_s.copy(), shape.tau.copy()
    kappa[[0, half]] = tau[[0, half]] = nan
    terms = problem.energy_terms(joined.vector())
    return {
        "u": pieces.u,
        "g": pieces.g,
        "g_end": pieces.end,
        "cut_node": half + 1,
        "g_cut": pieces.cut,
        "midline": pieces.midline,
        "kappa_s": kappa,
        "tau": tau,
        "energy": float(terms.sum() - terms[0] - terms[half]),
        "linking_number": nan,
        "twist": nan,
        "writhe": nan,
        "self_contact": False,
        "clearance": nan,
    }


def construct(steps: Steps, band: Band, half_twists: int) -> Summary | str:
    """Make or load the n-inflection construction; a sentence where the mesh is too coarse for it."""
    steps.begin(CONSTRUCTION, band.half_width, band.segments)
    known = steps.journal.finished(CONSTRUCTION)
    if known is not None:
        return known
    clock = steps.journal.clock()
    coarse = "its arcs are too short for these facets: take more segments, or a narrower band"
    try:
        state = schoenke(band, half_twists)
    except ClosureError as error:
        return f"{CONSTRUCTION}: {error}; {coarse}"
    method = f"n-inflection construction, n = {abs(half_twists)}"
    found = linking_number(state.u, state.g, band.sigma, band.h).linking_number
    if abs(found - 0.5 * half_twists) > 1e-6:
        return f"{CONSTRUCTION}: closing it on this mesh makes Lk = {found:g}; {coarse}"
    return _store(steps, state, clock, CONSTRUCTION, method, None)


def _store(
    steps: Steps,
    state: State,
    clock: Clock,
    stage: str,
    method: str,
    parent: int | None,
    changes: Mapping[str, Any] | None = None,
) -> Summary:
    """Store a state that was made and not solved for; its multipliers are not numbers."""
    problem, made = Problem(state.band), constructed(state)
    reached = Reached(problem, made, "auxiliary", stage, method, steps.half_twists, parent)
    return steps.journal.store_made(reached, clock, changes or {})


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
