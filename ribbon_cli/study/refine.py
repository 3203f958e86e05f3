"""`ribbon refine`: a stored state on finer grids; the result joins its run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from ..config import SpectrumRequest
from ..errors import RibbonError, UsageError
from ..facts import OTHER_MINIMA
from ..keys import SEGMENTS
from ..recipes.eversion import not_everted
from ..store import Run, StateRecord, Summary, resolve_state
from ..store.refs import meant, regridded
from .failure import Failure
from .journal import run_or_read
from .outcome import Outcome, Target
from .progress import Progress, silence
from .records import state_of
from .run_config import resolved_config
from .walk import Walk

_CONFIG_FACTS = ("git_revision", "git_dirty")
"""Facts on the config's repository."""


def refine_state(
    root: Path,
    ref: str,
    *,
    to: int | None = None,
    levels: int | None = None,
    method: Literal["smooth", "split"] = "smooth",
    progress: Progress | None = None,
    argv: Sequence[str] = (),
) -> Outcome:
    """Refine the state that `ref` names, to N = `to` or by doubling `levels` times.

    On the way to a distant N the grid is doubled, and those states are kept as intermediate. Where the run
    holds a refinement of the same band with such an N already, that one is taken and nothing is stored.
    `split` halves facets as in Koldaev (2022), 3.1, only doubles, and takes nothing that was made otherwise.
    Raises UsageError for a state outside of a run, with an open seam or prescribed rulings, or for an N that
    the method cannot reach.
    """
    if (to is None) == (levels is None):
        raise UsageError("refine: give either the number of segments to refine to, or the number of levels")
    taken: list[str] = []
    run, label, path = resolve_state(root, ref, taken.append)
    if run is None or label is None:
        raise UsageError(f"{path}: not in a run: refine adds its results to the state's run")
    record = run.load(label)
    if record.kind == "auxiliary":
        raise UsageError(f"{ref}: an auxiliary state, with prescribed rulings, cannot be refined")
    there = to == record.segments and record.kind == "equilibrium" and record.certified
    grids = [record.segments] if there else _grids(ref, record.segments, to, levels, method)

    def study(watcher: Progress) -> Outcome:
        gap = None if record.contacts is None else record.contacts.gap
        walk = walk_from(run, record, watcher, argv, len(grids), gap)
        for choice in taken:
            walk.journal.note(choice)
        targets = _refine_all(walk, Summary.of(record), grids, method, every=levels is not None)
        return Outcome(run, targets, tuple(walk.journal.notes), walk.journal.new_states)

    return run_or_read(run, progress or silence, study)


def _refine_all(
    walk: Walk, start: Summary, grids: list[int], method: str, *, every: bool
) -> tuple[Target, ...]:
    """Refine through the grids; all of them are targets if `every`, else the last."""
    record, targets = start, []
    for k, n in enumerate(grids):
        named = every or n == grids[-1]
        how = ", facets split" if method == "split" else ""
        stage = f"state {start.label} refined to N = {n}{how}" + ("" if named else ", on the way")
        kind = "equilibrium" if named else "intermediate"
        following = _stored(walk, start, n, stage, named, method) or walk.refine(
            record, n, stage, kind, splitting=method == "split"
        )
        if isinstance(following, Failure):
            failed: str | None = following.sentence
        else:
            record = following
            if named:
                message = record.message
                targets.append(Target(record.half_width, n, record.label, True, record.certified, message))
            failed = None if record.certified else f"{stage}: not certified: {record.message}"
        if failed is not None:
            walk.journal.note(failed)
            rest = [m for m in grids[k:] if every or m == grids[-1]]
            known = {t.segments for t in targets}
            targets += [
                Target(start.half_width, m, None, False, False, f"not reached: {failed}")
                for m in rest
                if m not in known
            ]
            break
    return tuple(targets)


def _stored(
    walk: Walk, start: Summary, segments: int, stage: str, named: bool, method: str
) -> Summary | None:
    """The certified state with so many segments that is the start's own refinement, or is related to it by
    refinements; None where none is stored but, perhaps, by the stage's name.
    """
    if segments == start.segments:
        label = start.label
    elif method == "split" or walk.journal.has(stage):
        return None
    else:
        kinds = ("equilibrium",) if named else ("equilibrium", "intermediate")
        known = [
            state
            for state in _relatives(walk.journal.run, start.label)
            if state.segments == segments and state.kind in kinds
        ]
        if not known:
            return None
        label = meant(known).label
    if named:
        place = f"b = {start.half_width:.10g} and N = {segments}"
        walk.journal.note(f"state {label} has {place} already: nothing new is stored")
    return walk.journal.run.look_up(label)


def _relatives(run: Run, label: int) -> list[Summary]:
    """The certified states that are one band on several grids with the state of a label, in the order stored.

    A refinement keeps the width and changes N. What is refined from the state is its own even where another
    minimum came of it, as it would again; elsewhere such a step leads to another band.
    """
    every = run.states(all=True)
    states = {state.label: state for state in every if state.certified or state.label == label}
    found, own = {label}, {label}
    links = [
        (state.label, state.parent, not OTHER_MINIMA.isdisjoint(state.event_kinds))
        for state in states.values()
        if state.parent in states and regridded(states[state.parent], state)
    ]
    for child, parent, _ in links:  # parents come before their children
        own |= {child} if parent in own else set()
    size = 0
    while size != len(found):
        size = len(found)
        for child, parent, other in links:
            if not other and states[label].certified and (child in found) != (parent in found):
                found |= {child, parent}
    return [state for key, state in states.items() if key in found | own and state.certified]


def _grids(ref: str, segments: int, to: int | None, levels: int | None, method: str) -> list[int]:
    """Numbers of segments to pass through. Raises UsageError."""
    if levels is not None:
        if levels < 1:
            raise UsageError("refine: the number of levels must be at least 1")
        # Bounded before it is made, whatever number of levels was typed.
        if levels > 32 or segments * 2**levels > SEGMENTS.high:
            times = f"{segments} doubled {levels} times is more"
            raise UsageError(f"refine: a band has at most {SEGMENTS.high} segments: {times}")
        return [segments * 2**k for k in range(1, levels + 1)]
    assert to is not None
    if to < 8:
        raise UsageError(f"refine: a band needs at least 8 segments, got {to}")
    if to > SEGMENTS.high:
        raise UsageError(f"refine: a band has at most {SEGMENTS.high} segments, got {to}")
    if to == segments:
        raise UsageError(f"{ref}: has {segments} segments already")
    grids = []
    n = segments
    while 2 * n <= to:
        n *= 2
        grids.append(n)
    if n != to:
        if method == "split":
            raise UsageError(
                f"refine: splitting facets doubles their number; {to} is not {segments} times a power of 2"
            )
        grids = [*grids, to] if to < segments or to >= 1.2 * n else [*grids[:-1], to]
    return grids


def walk_from(
    run: Run,
    record: StateRecord,
    progress: Progress,
    argv: Sequence[str],
    total: int = 0,
    gap: float | None = None,
) -> Walk:
    """The walk of a pass that begins at a stored state; the config's repository is the one that it names.

    `gap` is what contact forces keep, None without them.
    """
    origin = {key: value for key, value in record.provenance.items() if key in _CONFIG_FACTS}
    everted = record.half_twists == 0 and not_everted(state_of(record)) is None
    return Walk(run, record.half_twists, _spectrum(run), progress, argv, origin, total, everted, gap)


def _spectrum(run: Run) -> SpectrumRequest:
    """What the run's config asks for."""
    try:
        return resolved_config(run).spectrum
    except RibbonError:
        return SpectrumRequest()
