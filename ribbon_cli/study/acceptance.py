"""Which results a study takes: stationary, and bands of the topology and shape that it is about."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..model.band import State
from ..model.topology import Linking, linking_number, turn_of
from ..parts import FREE
from ..recipes.eversion import not_everted
from ..solver.newton import Guard, Options
from ..solver.status import STATIONARY, Result, Status
from .progress import Progress, Step, silence

MOST_TURN = 1.0
"""Change of Tw + Wr of a strip, in turns, over one step, but for that of its twist: passing through makes
2."""


def strip_guard(start: State) -> Guard | None:
    """What refuses a strip that passed through itself on the way from another one.

    None at a free end, which may go round anything.
    """
    ends = start.band.parts.ends
    assert ends is not None
    if ends.end == FREE:
        return None
    try:
        before = sum(turn_of(start))
    except ValueError:
        return None

    def check(state: State) -> str | None:
        twisted = state.band.parts.value("twist") - ends.twist
        try:
            change = sum(turn_of(state)) - before - twisted / math.tau
        except ValueError:
            return None
        return f"(Tw + Wr changed by {change:.3g}.)" if abs(change) > MOST_TURN else None

    return check


def options_for(half_twists: int, progress: Progress = silence) -> Options:
    """Options of a solve with a closed seam: it must keep its linking number."""

    def watch(iteration: int, energy: float, residual: float) -> None:
        progress(Step(iteration, energy, residual))

    return Options(guard=_linking_guard(half_twists), watch=watch)


def _linking_guard(half_twists: int) -> Callable[[State], str | None]:
    def check(state: State) -> str | None:
        try:
            found = _linking_of(state).linking_number
        except ValueError:
            return None  # sum u is not zero between iterates; the state that ends a stage is checked again
        if abs(found - 0.5 * half_twists) > 0.25:
            return f"(Lk = {found:.6g} in place of {half_twists / 2:g}.)"
        return None

    return check


def _linking_of(state: State) -> Linking:
    return _linking(state.u.tobytes(), state.g.tobytes(), state.band.sigma, state.band.h)


@lru_cache(maxsize=1)
def _linking(u: bytes, g: bytes, sigma: int, h: float) -> Linking:
    """The linking number; the state that the guard saw last is the one that is checked next."""
    return linking_number(np.frombuffer(u).reshape(-1, 3), np.frombuffer(g).reshape(-1, 3), sigma, h)


def checked(result: Result, half_twists: int, *, everted: bool = False) -> Result:
    """A converged result, or the same with its status changed if it is not the band asked for.

    Of an `everted` cylinder, which the linking number does not tell from a ring, the inflections count too.
    """
    if not converged(result):
        return result
    state = result.state
    if not state.band.closed:  # each step was guarded from where it began
        return result
    try:
        found = _linking_of(state)
    except ValueError as error:
        return replace(result, status=Status.LEFT_TOPOLOGY, detail=f"(No linking number: {error}.)")
    if not found.exact or abs(found.linking_number - 0.5 * half_twists) > 1e-6:
        detail = f"(Lk = {found.linking_number:.9g} in place of {half_twists / 2:g}.)"
        return replace(result, status=Status.LEFT_TOPOLOGY, detail=detail)
    misfit = not_everted(state) if everted else None
    return replace(result, status=Status.OTHER_SHAPE, detail=misfit) if misfit else result


def converged(result: Result) -> bool:
    """Whether a result is a stationary band of the right topology, certified or not."""
    return result.status in STATIONARY
