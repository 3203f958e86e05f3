"""Bands that rest on themselves, found by other means: a log barrier on node positions, then Newton's
method."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from ribbon_cli.model.band import Band, State
from ribbon_cli.model.touching import Shape
from ribbon_cli.model.touching_audit import audit
from ribbon_cli.model.touching_gaps import Pairs
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.resting import RestingProblem
from ribbon_cli.solver.resting_certificate import certified
from ribbon_cli.store import StateRecord
from ribbon_cli.study.clock import Clock
from ribbon_cli.study.records import Reached, build_record

DATA = Path(__file__).parent / "data" / "resting"


@lru_cache
def resting(name: str) -> tuple[State, Pairs, np.ndarray, float]:
    """A state, the gaps that it keeps, their forces and its energy."""
    with np.load(DATA / f"{name}.npz") as kept:
        band = Band(len(kept["u"]), float(kept["half_width"]), sigma=-1)
        state = State(band, kept["u"], kept["g"], kept["xi"])
        return state, Pairs(kept["first"], kept["second"], kept["sign"]), kept["force"], float(kept["energy"])


@lru_cache
def resting_record(name: str, label: int = 1) -> StateRecord:
    """The same state as a run would keep it, solved to its forces."""
    state, pairs, *_ = resting(name)
    problem = RestingProblem(state.band, pairs)
    result = solve(problem, state.vector(), None, Options(leave_saddles=0))
    result = certified(problem, result, audit(Shape.of(result.state), 1e-10 * state.band.length))
    half_twists = 3 if name.startswith("3pi") else 1
    stage = f"b = {state.band.half_width:g}, N = {state.band.segments}"
    return build_record(
        label, Reached(problem, result, "equilibrium", stage, "test", half_twists), Clock((), None)
    )
