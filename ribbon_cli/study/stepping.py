"""A step from width to width, halved where it fails."""

from __future__ import annotations

import math

from ..solver.continuation import Move, to_width
from ..solver.status import Result, Status
from ..solver.tracking import PARTS
from ..store import Summary
from .acceptance import converged
from .clock import Clock
from .plan import MOST_HALVINGS, width_name, width_steps
from .records import multipliers_of, state_of
from .remedies import remedied
from .steps import Steps


def longest_step(
    steps: Steps, before: Summary | None, current: Summary, b: float, visit: int
) -> tuple[Summary | None, str | None]:
    """Compute and store the longest step towards width b that works; also why none does, if none does.

    `before` is the state from which a halved step towards b led to the current one, None if none did. A state
    at b that is reached without a certificate is stored, and returned with that sentence.
    """
    record = steps.journal.load(current)
    state, multipliers = state_of(record), multipliers_of(record)
    failures: list[str] = []
    whole: tuple[Move, Result, Clock] | None = None
    beyond: list[float] = []
    candidates = list(enumerate(width_steps(current.half_width, b, visit)))
    for halvings, (stage, width) in candidates[_first_candidate(before, current, b) :]:
        steps.begin(stage, width, current.segments)
        clock = steps.journal.clock()
        # Doubts are resolved down to one length, however often the step itself was halved.
        parts = max(0, PARTS - halvings)
        move = to_width(state, multipliers, width, steps.options, parts)
        result = steps.checked(move.result)
        if result.status is Status.MINIMUM:
            kind = "equilibrium" if width == b else "intermediate"
            reached = steps.store_move(
                move, result, clock, kind=kind, stage=stage, parent=current.label, failures=failures
            )
            return reached, None
        whole = whole or (move, result, clock)
        beyond += [width] if result.status is Status.LEFT_BRANCH else []
        failures.append(
            f"a step from b = {current.half_width:.12g} to {width:.12g} failed, halved: {result.message}"
        )
        steps.journal.note(failures[-1])
    assert whole is not None
    move, result, clock = whole
    if beyond:
        near = 0.5 * (current.half_width + beyond[-1])
        return None, (
            f"the branch seems to turn back (fold) near b = {near:.6g}: natural continuation towards "
            f"b = {b:.12g} ends, its last state is {current.label} at b = {current.half_width:.12g}; "
            f"`ribbon continue {steps.journal.run.short_name}:{current.label} --to {b:.12g} --arclength`, or "
            f"`widths: {{arclength: {{to: {b:.12g}}}}}` in a config, goes on around it"
        )
    why = f"no step from b = {current.half_width:.12g} towards {b:.12g} succeeds. {result.message}"
    why = remedied(why, result.status, "a schedule with more widths")
    if not (converged(result) and move.band.half_width == b):
        return None, why
    stage = width_name(b, visit)
    uncertified = steps.store_move(move, result, clock, kind="equilibrium", stage=stage, parent=current.label)
    return uncertified, why


def _first_candidate(before: Summary | None, current: Summary, b: float) -> int:
    """Where to begin halving: at twice the step that led here, if that was a halved one.

    Read off the stored states, so that a resumed run takes the same steps.
    """
    if before is None:
        return 0
    last, left = abs(current.half_width - before.half_width), abs(b - current.half_width)
    if last == 0.0 or left <= 2.0 * last * (1.0 + 1e-9):
        return 0
    return min(MOST_HALVINGS, math.ceil(math.log2(left / (2.0 * last)) - 1e-9))
