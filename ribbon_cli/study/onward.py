"""`ribbon continue`: from a stored state to other widths; the result joins its run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..config import Arclength, ContactRequest, strips
from ..errors import UsageError
from ..facts import same_value
from ..parts import HALF_WIDTH, PARAMETERS
from ..store import StateRecord, Summary, resolve_state
from .branch import Branches
from .journal import run_or_read
from .natural import Natural
from .outcome import Outcome, Target
from .progress import Progress, silence
from .records import state_of
from .refine import walk_from
from .resting import crosses


def continue_state(
    root: Path,
    ref: str,
    request: Arclength,
    *,
    natural: bool = False,
    contact: ContactRequest | None = None,
    progress: Progress | None = None,
    argv: Sequence[str] = (),
) -> Outcome:
    """Follow the branch of the state that `ref` names, which may be a saddle; the same call again resumes.

    `natural` continuation goes from width to width among minima instead, and ends before the first fold.
    `contact` says whether contact has forces, and their gap, by default as at the start. Raises UsageError
    for a state outside of a run, with an open seam or prescribed rulings, that is not stationary, or at the
    width asked for, and for contacts that cannot be followed.
    """
    taken: list[str] = []
    run, label, path = resolve_state(root, ref, taken.append)
    if run is None or label is None:
        raise UsageError(f"{path}: not in a run: continue adds its results to the state's run")
    record = run.load(label)
    _check(ref, record, request)
    gap = _gap(ref, record, contact)
    undecided = record.status == "undecided" and record.contacts is not None and len(record.contacts) > 0
    if natural and not (record.certified or undecided):
        raise UsageError(f"{ref}: not a certified minimum ({record.status}): give --arclength")

    def study(watcher: Progress) -> Outcome:
        walk = walk_from(run, record, watcher, argv, gap=gap)
        for choice in taken:
            walk.journal.note(choice)
        targets: tuple[Target, ...] = ()
        if natural:
            way = Natural(walk, request, Summary.of(record))
            courses = [way.follow(f"from {record.label}{_with_contact(gap)}")]
            targets = way.uncertified
        else:
            branches = Branches(walk, request, record)
            branches.follow(f"{branch_name(record, request)}{_with_contact(gap)}")
            courses, targets = branches.courses, branches.left
        notes, new = tuple(walk.journal.notes), walk.journal.new_states
        return Outcome(run, targets, notes, new, tuple(courses))

    return run_or_read(run, progress or silence, study)


def _gap(ref: str, record: StateRecord, contact: ContactRequest | None) -> float | None:
    """The gap that contact forces keep, None without them. Raises UsageError where that cannot be done."""
    known = record.contacts
    had = None if known is None else known.gap
    gap = had if contact is None else contact.gap if contact.forces else None
    if known is not None and len(known) and gap != had:
        elsewhere = "leave out --contact, or start from a state that touches nothing"
        there = f"{ref}: rests on itself with {len(known)} contacts"
        if gap is None:
            raise UsageError(f"{there}, and without their forces it is not stationary: {elsewhere}")
        raise UsageError(f"{there} at a gap of {had:g}, which cannot be changed there: {elsewhere}")
    if gap is None:
        return None
    if gap != had and crosses(state_of(record), gap):
        near = f"has facets nearer to each other than {gap:g}" if gap else "crosses or touches itself"
        raise UsageError(f"{ref}: {near}, without forces: start from a state that does not")
    return gap


def _with_contact(gap: float | None) -> str:
    """What a branch's name ends with where contact has forces."""
    if gap is None:
        return ""
    return " with contact forces" + (f" at a gap of {gap:.12g}" if gap else "")


def _check(ref: str, record: StateRecord, request: Arclength) -> None:
    """Raise UsageError for a state that cannot be continued to where the request says."""
    if record.kind == "auxiliary":
        raise UsageError(f"{ref}: an auxiliary state, with prescribed rulings, cannot be continued")
    if max(record.kkt_residual, record.constraint_residual) > 1e-8:
        raise UsageError(f"{ref}: not stationary ({record.status}): there is no branch through it")
    if record.branch is not None and record.branch.type in ("fold", "branch-point"):
        raise UsageError(
            f"{ref}: lies on a {record.branch.type}, where no direction in "
            f"{PARAMETERS[request.parameter].symbol} is given: name a neighbouring state"
        )
    name, length = request.parameter, record.length
    symbol, here = PARAMETERS[name].symbol, record.parameters.get(name)
    if here is None:
        what = {1: "a closed band", -1: "a one-sided band", 0: "a strip with a free end"}[record.sigma]
        raise UsageError(f"{ref}: {what} has no {name}; it has {', '.join(record.parameters)}")
    for option, value in (("--to", request.to), ("--back-to", request.back_to)):
        if value is not None:
            _check_value(record, name, option, value)
    for value in request.at:
        if why := request.outside(value, here, length):
            raise UsageError(f"--at: {symbol} {why}, got {value:g}")
    if same_value(name, request.to, here, length):
        raise UsageError(f"{ref}: has {symbol} = {here:.12g} already")


def _check_value(record: StateRecord, name: str, option: str, value: float) -> None:
    """Raise UsageError for a value that a parameter cannot have."""
    if name == HALF_WIDTH:
        if not 0.0 < value < record.length:
            raise UsageError(
                f"{option}: must be a half-width between 0 and the length {record.length:g}, got {value:g}"
            )
    elif why := strips.flat(record.parts.with_value(name, value), record.length):
        raise UsageError(f"{option} {value:g}: {why}")


def branch_name(record: StateRecord, request: Arclength) -> str:
    """The branch's name in its run: other steps or widths make another branch of it."""
    plain = Arclength(request.to)
    marks = [] if request.parameter == HALF_WIDTH else [f"in {request.parameter}"]
    if request.max_step != plain.max_step:
        marks.append(f"steps up to {request.max_step:.12g}")
    if request.at:
        marks.append(
            f"at {PARAMETERS[request.parameter].symbol} = " + ", ".join(f"{b:.12g}" for b in request.at)
        )
    return f"branch from {record.label}" + (f" ({'; '.join(marks)})" if marks else "")
