"""From what a user types to a run or a state: `mobius-pi:12`, `mobius-pi@b=0.5,N=400`, a path."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ribbon_cli.errors import UsageError
from ribbon_cli.expression import evaluate
from ribbon_cli.facts import same_width
from ribbon_cli.store.folder import is_run
from ribbon_cli.store.root import named
from ribbon_cli.store.run import Run
from ribbon_cli.store.summaries import Summary

_FILES = (".h5", ".hdf5", ".npz")
_SHOWN = 12
"""Most names or values that a message lists."""


def list_runs(root: str | Path, aside: bool = False) -> list[Run]:
    """Runs in a folder by name, those set aside only if asked; none if there is no such folder."""
    try:
        runs = [Run(path) for path in sorted(Path(root).iterdir()) if is_run(path)]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UsageError(f"{root}: cannot be read: {error.strerror}") from error
    return [run for run in runs if aside or not run.is_aside]


def suggest(word: str, known: Iterable[str]) -> str:
    """Return "; did you mean ...?" for the nearest known words, or nothing."""
    near = difflib.get_close_matches(word, list(dict.fromkeys(known)), n=3, cutoff=0.6)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def find_run(root: str | Path, text: str) -> Run:
    """Return the run that `text` names: by its folder's name, its own name, a unique prefix, or a path.

    Raises UsageError when no run or more than one fits.
    """
    if os.sep in text:
        return Run.open(text)
    if text and is_run(Path(root) / text):
        return Run(Path(root) / text)
    runs = list_runs(root)
    fitting = [run for run in runs if run.short_name == text] or [
        run for run in runs if text and run.name.startswith(text)
    ]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise UsageError(
            f"{text!r} names more than one run: {_join(run.name for run in fitting)}; "
            "`ribbon check CONFIG` tells which is a config's"
        )
    if not runs:
        raise UsageError(f"no run {text!r}: there are no runs in {root} (see --runs)")
    near = suggest(text, [run.short_name for run in runs])
    raise UsageError(f"no run {text!r} in {root}{near or ': it has ' + _join(run.name for run in runs)}")


def typed(run: Run) -> str:
    """What names a run in a command: its own name where no other has it, else its folder's, or its path."""
    name, short = named(run.path), run.short_name
    if name != run.name:
        return name
    try:
        fitting = [other.name for other in list_runs(run.path.parent) if other.short_name == short]
    except UsageError:  # a folder that may be entered and not be listed
        return name
    return short if fitting == [name] else name


def names_state(ref: str) -> bool:
    """Whether a reference is to a state rather than a run."""
    if os.path.isdir(ref):
        return False
    return ":" in ref or "@" in ref or ref.endswith(_FILES) or os.path.isfile(ref)


def resolve_state(
    root: str | Path, ref: str, tell: Callable[[str], object] | None = None
) -> tuple[Run | None, int | None, Path]:
    """Return run, label and file of the state that a reference names.

    `RUN:LABEL`; `RUN@b=0.5,N=400` (equilibria only, either part may be left out, of several the one that is
    `meant`); or a path to a state's HDF5 or npz file, whose run and label are None outside a run. `tell` is
    called with a sentence on the choice where the reference leaves one. Raises UsageError, saying what there
    is instead, when it names none.
    """
    if ref.endswith(_FILES) or os.path.isfile(ref):
        return _from_path(Path(ref))
    name, at, query = ref.partition("@")
    if at:
        run = find_run(root, name)
        state, choice = select(run, *_parse_query(ref, query))
        if tell is not None and choice:
            tell(f"{ref}: {choice}")
        return run, state.label, run.state_path(state.label)
    name, colon, text = ref.rpartition(":")
    if not colon:
        run = find_run(root, ref)
        last = max(run.entries(), default=1)
        raise UsageError(f"{ref!r} is a run: name one of its states, for instance {ref}:{last}")
    run = find_run(root, name)
    label = _parse_label(ref, text)
    labels = run.entries().keys()
    if label not in labels:
        has = f"{min(labels)} to {max(labels)}" if labels else "none yet"
        raise UsageError(f"{run.name} has no state {label}: its labels are {has}")
    return run, label, run.state_path(label)


def find_states(root: str | Path, ref: str, all: bool = False) -> tuple[Run, list[Summary]]:
    """Return a run and the summaries of its equilibria, or of `all` its states: those that `ref` names.

    `ref` is a run, or RUN@b=0.5,N=400 with either part left out. Raises UsageError.
    """
    name, at, query = ref.partition("@")
    b, segments = _parse_query(ref, query) if at else (None, None)
    run = find_run(root, name)
    return run, [state for state in run.states(all=all) if _is_at(state, b, segments)]


def _from_path(path: Path) -> tuple[Run | None, int | None, Path]:
    """A file, with its run and label where it lies in a run."""
    if not os.path.isfile(path):
        raise UsageError(f"{path}: no such file")
    folder = path.resolve().parent.parent
    if is_run(folder):
        run = Run(folder)
        label = run.label_of(path)
        if label is not None:
            return run, label, path
    return None, None, path


def _parse_label(ref: str, text: str) -> int:
    """A label as typed. Raises UsageError."""
    if not (text.isascii() and text.isdigit()):
        raise UsageError(f"{ref!r}: a label is a whole number, as in RUN:12, got {text!r}")
    return int(text)


def _parse_query(ref: str, query: str) -> tuple[float | None, int | None]:
    """b and N of `b=0.5,N=400`; b may be spelled as in a config, `b=pi/6`. Raises UsageError."""
    wanted: dict[str, Any] = {}
    for part in query.split(","):
        key, _, text = (piece.strip() for piece in part.partition("="))
        if key not in ("b", "N") or key in wanted:
            raise UsageError(f"{ref!r}: expected RUN@b=...,N=..., got {part!r}")
        try:
            wanted[key] = evaluate(text) if key == "b" else int(text)
        except ValueError as error:
            why = f" ({error})" if key == "b" else ""
            raise UsageError(f"{ref!r}: {key} must be a number, got {text!r}{why}") from None
    return wanted.get("b"), wanted.get("N")


def select(run: Run, b: float | None = None, segments: int | None = None) -> tuple[Summary, str]:
    """The equilibrium that a half-width, N or both mean: the one rule for what is typed and for what programs
    ask for.

    With it comes a sentence on which was taken, and why that one; empty where there was no choice, and the
    state is certified. Raises UsageError, saying what there is instead, when there is none.
    """
    fitting = _fitting(run, b, segments)
    state = meant(fitting)
    told = segments is None or len(fitting) > 1 or not state.certified
    return state, _choice(state, fitting) if told else ""


def no_equilibria(run: Run) -> str:
    """Why there is nothing to say of a run's equilibria, and where its other states are listed."""
    return f"{run.name} has no equilibria yet; `ribbon ls {typed(run)} --all` lists its states"


def meant(states: Sequence[Summary]) -> Summary:
    """Of states in the order stored the one that stands for them: the latest of the finest certified ones,
    where none is certified the latest of the finest.
    """
    certified = [state for state in states if state.certified]
    return max(reversed(certified or states), key=lambda state: state.segments)


def by_place(states: Iterable[Summary]) -> dict[tuple[float, int], list[Summary]]:
    """States by half-width and N, in this order; those of one place in the order stored."""
    places: dict[tuple[float, int], list[Summary]] = {}
    width = -math.inf
    for state in sorted(states, key=lambda state: state.half_width):
        if not same_width(width, state.half_width):
            width = state.half_width
        places.setdefault((width, state.segments), []).append(state)
    return {place: sorted(places[place], key=lambda state: state.label) for place in sorted(places)}


def _choice(taken: Summary, fitting: Sequence[Summary]) -> str:
    """Which of the equilibria that fit a reference was taken, and why that one."""
    rivals = [state for state in fitting if state.certified == taken.certified]
    alike = [state for state in rivals if state.segments == taken.segments]
    words = ["finest"] * (len(alike) < len(rivals)) + ["latest"] * (len(alike) > 1)
    which = f"the {' and '.join(words) or 'only'}"
    among = "that fits" if len(fitting) == 1 else f"of {len(fitting)} that fit"
    if taken.certified:
        why = f"{which} one {among}" if len(fitting) == 1 else f"{which} certified one {among}"
    else:
        why = f"{which} one {among}, without certificate" + ("" if len(fitting) == 1 else " like the others")
    place = f"b = {taken.half_width:.10g}, N = {taken.segments}"
    return f"state {taken.label} is taken ({place}), {why}"


def _fitting(run: Run, b: float | None, segments: int | None) -> list[Summary]:
    """The equilibria at a half-width, of one N or both, at least one. Raises UsageError."""
    states = run.states()
    if not states:
        raise UsageError(no_equilibria(run))
    at_width = [state for state in states if _is_at(state, b)]
    if not at_width:
        widths = _join(f"{b:.10g}" for b in sorted({state.half_width for state in states}))
        raise UsageError(f"{run.name} has no equilibrium with b = {b:.10g}: it has b = {widths}")
    fitting = [state for state in at_width if _is_at(state, None, segments)]
    if not fitting:
        meshes = _join(map(str, sorted({state.segments for state in at_width})))
        where = "" if b is None else f"b = {b:.10g} and "
        raise UsageError(f"{run.name} has no equilibrium with {where}N = {segments}: it has N = {meshes}")
    return fitting


def _is_at(state: Summary, b: float | None = None, segments: int | None = None) -> bool:
    """Whether a state has the half-width and the N asked for."""
    return (b is None or same_width(state.half_width, b)) and segments in (None, state.segments)


def _join(words: Iterable[str]) -> str:
    """List words, the first few of many."""
    words = list(words)
    more = f" and {len(words) - _SHOWN} more" if len(words) > _SHOWN else ""
    return ", ".join(words[:_SHOWN]) + more
