"""An equilibrium on a mesh with twice as many facets: met again there, lost, or neither."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..model.band import State
from ..model.folding import ClosureError
from ..model.problem import Problem
from ..model.touching_gaps import Pairs
from ..solver.arclength import nearest
from ..solver.climbing import climb
from ..solver.continuation import TRACKING_STEPS, to_segments
from ..solver.kinship import another_minimum
from ..solver.newton import Options, solve
from ..solver.prolongation import phase_of, smooth
from ..solver.resting_exchange import NoRestError
from ..solver.status import STATIONARY, Result
from ..study.acceptance import checked
from .explore import options_from
from .resting import Kept, refined
from .shapes import Shape, distance

MOST_APART = 0.3
"""Distance from mesh to mesh up to which a state may be the same equilibrium. The everted pi bands at
b = 0.15, N = 48 and 96 are 0.1 to 0.15 apart."""
NEAR_ENERGY = 0.1
"""Relative change of energy up to which it may: pi bands at b = 0.1 change by 0.02 from N = 48 to 96."""
CLIMBED = 200
"""Most segments at which a saddle is climbed to, by dense algebra, where Newton's method fails."""
MET, LOST, FAILED = "met", "lost", "failed"
"""Met again; led to something else; led to nothing that converged."""


@dataclass(frozen=True)
class Task:
    """An equilibrium to follow to a mesh; with contact forces on, and with what it keeps."""

    state: State
    energy: float
    index: int
    segments: int
    half_twists: int
    kept: Kept | None = None


@dataclass(frozen=True)
class Followed:
    """What came of it: the state where it was met, how far that is from the coarser one, and in words what
    was found instead where it was not. With contact forces on, `pairs` are the gaps that it keeps.
    """

    word: str
    result: Result | None = None
    distance: float | None = None
    why: str = ""
    pairs: Pairs | None = None


def follow(task: Task) -> Followed:
    """An equilibrium on a finer mesh; of several places there that of the lowest index."""
    if task.kept is not None:
        return _at_rest(task, task.kept)
    coarse = Shape(task.state, task.energy, task.index)
    options = options_from(task.state, task.half_twists)
    others: list[str] = []
    met: list[tuple[int, float, Result]] = []
    tried: list[str] = []
    for result, fled in _ways(task, options):
        fine = Shape.of(checked(result, task.half_twists))
        if fine is None or (fled and fine.index < task.index):
            tried.append(result.status.value)
            continue
        apart = distance(task.state, fine.state)
        why = _other(coarse, fine, apart, options)
        if why:
            others.append(why)
            continue
        met.append((fine.index, apart, result))
        if fine.index <= task.index:
            break
    if met:
        _, apart, result = min(met, key=lambda one: one[:2])
        return Followed(MET, result, apart)
    if others:
        return Followed(LOST, why=others[0])
    return Followed(FAILED, why=", ".join(dict.fromkeys(tried)))


def _at_rest(task: Task, kept: Kept) -> Followed:
    """A shape with contact forces on a finer mesh: what it touches is told by the way there."""
    try:
        rest, result = refined(task.state, kept, task.segments, task.half_twists)
    except NoRestError as error:
        return Followed(FAILED, why=str(error))
    fine = Shape.of(result, kept.gap)
    if fine is None:
        return Followed(FAILED, why=result.status.value)
    apart = distance(task.state, fine.state)
    why = _unlike(Shape(task.state, task.energy, task.index, kept.gap), fine, apart)
    if why or fine.index > task.index:
        return Followed(LOST, why=why or f"index {fine.index}")
    return Followed(MET, result, apart, pairs=rest.pairs)


def _ways(task: Task, options: Options) -> Iterator[tuple[Result, bool]]:
    """Where an equilibrium may be on a finer mesh, the likeliest first; and whether the way there flees from
    saddles, so that it proves nothing of one to have led elsewhere.
    """
    if task.index == 0:
        with suppress(ClosureError):
            yield to_segments(task.state, task.segments, options).result, False
    starts = list(_starts(task.state, task.segments))
    for start in starts:
        yield nearest(start, options.guard), False
    between = task.state.band.segments * 5 // 4
    for start in _starts(task.state, between):
        middle = nearest(start, options.guard)
        for second in _starts(middle.state, task.segments) if middle.status in STATIONARY else ():
            yield nearest(second, options.guard), False
    if task.index == 0:
        return
    staying = replace(options, leave_saddles=0, max_steps=TRACKING_STEPS)
    for start in starts:
        yield solve(Problem(start.band), start.vector(), None, staying), True
    if task.segments <= CLIMBED:
        for start in starts[:1]:
            yield climb(Problem(start.band), start.vector(), task.index, options.guard), False


def _starts(state: State, segments: int) -> Iterator[State]:
    """A shape on a finer mesh, with its inflections where they lie on the coarser and then elsewhere."""
    here = phase_of(state)
    phases = (here, *(phase for phase in type(here) if phase is not here)) if state.band.closed else (here,)
    for phase in phases:
        try:
            yield smooth(state, segments, phase).state
        except (ClosureError, np.linalg.LinAlgError):
            continue


def _other(coarse: Shape, fine: Shape, apart: float, options: Options) -> str:
    """Why a state on a finer mesh is another equilibrium; empty where it may be the same."""
    why = _unlike(coarse, fine, apart)
    if why:
        return why
    if coarse.index == 0 and fine.index == 0:
        kin = another_minimum(coarse.state, fine.state, options)
        return "" if kin is None else str(kin)
    return f"index {fine.index}" if abs(fine.index - coarse.index) > 1 else ""


def _unlike(coarse: Shape, fine: Shape, apart: float) -> str:
    """In what a state on a finer mesh is too far from a coarser one; empty where it is not."""
    if fine.inflections != coarse.inflections:
        return f"{fine.inflections} inflections"
    if abs(fine.energy - coarse.energy) > NEAR_ENERGY * abs(coarse.energy):
        return f"E = {fine.energy:.9g}"
    if apart > MOST_APART:
        return f"another shape, {apart:.2g} away"
    return ""
