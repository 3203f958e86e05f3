"""Guesses that are made, at least in part, without solving: eversion and n-inflection construction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
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
from .failure import Failure
from .plan import CONSTRUCTION, QUARTERS, turn_names
from .records import state_of
from .walk import Ended, Stage, Walk


def evert(walk: Walk, ring: State, count: int) -> Summary | Failure:
    """Run or load the auxiliary stages; the rejoined band."""
    segments = ring.band.segments
    turning = Turning(walk, ring, "eversion", lambda index: eversion_stage(segments, index, count))
    last = turning.run(eversion_stages(segments, count))
    return last if isinstance(last, Failure) else _join(walk, last)


def _join(walk: Walk, last: Summary) -> Summary | Failure:
    """The band cut, half of it turned step by step, and joined again: constructions, nothing is solved."""
    state, record = state_of(walk.journal.load(last)), last
    joined = rejoined(state)
    for k, name in enumerate(turn_names()):
        stage = Stage(name, last.half_width, last.segments, "auxiliary", record.label)
        known = walk.reach(stage, partial(_turned, state, joined, k))
        if isinstance(known, Failure):
            return known
        record = known
    return record


def _turned(state: State, joined: State, k: int) -> Ended:
    """The band cut, its second half turned by k quarters of a half-turn; after the last it is joined."""
    if k == QUARTERS:
        return _made(joined, "halves joined again")
    pieces = turned(state, math.pi * k / QUARTERS)
    return _made(joined, f"second half turned by {k}/{QUARTERS} of pi", in_two_pieces(joined, pieces))


def in_two_pieces(joined: State, pieces: Pieces) -> dict[str, Any]:
    """What the record of a band in two pieces has in place of the joined one's.

    Folds at the cuts do not exist: kappa_s, tau and eta are no numbers there, and their energy is left out.
    Neither linking number nor clearance is defined.
    """
    half, nan = joined.band.segments // 2, float("nan")
    problem = Problem(joined.band)
    shape = geometry(joined)
    kappa, tau, eta = shape.kappa_s.copy(), shape.tau.copy(), shape.eta.copy()
    kappa[[0, half]] = tau[[0, half]] = eta[[0, half]] = nan
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
        "eta": eta,
        "energy": float(terms.sum() - terms[0] - terms[half]),
        "linking_number": nan,
        "twist": nan,
        "writhe": nan,
        "self_contact": False,
        "clearance": nan,
    }


def construct(walk: Walk, band: Band, half_twists: int) -> Summary | Failure:
    """Make or load the n-inflection construction; it fails where the mesh is too coarse for it."""

    def made() -> Ended | Failure:
        try:
            state = schoenke(band, half_twists)
        except ClosureError as error:
            return Failure("construction", None, str(error), {"stage": CONSTRUCTION})
        found = linking_number(state.u, state.g, band.sigma, band.h).linking_number
        if abs(found - 0.5 * half_twists) > 1e-6:
            detail = f"closing it on this mesh makes Lk = {found:g}"
            return Failure("construction", None, detail, {"stage": CONSTRUCTION})
        return _made(state, f"n-inflection construction, n = {abs(half_twists)}")

    return walk.reach(Stage(CONSTRUCTION, band.half_width, band.segments, "auxiliary"), made)


def _made(state: State, method: str, changes: Mapping[str, Any] | None = None) -> Ended:
    """A state that was made and not solved for, as a stage's end; its multipliers are not numbers."""
    return Ended(Problem(state.band), constructed(state), method, changes=changes or {})


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
