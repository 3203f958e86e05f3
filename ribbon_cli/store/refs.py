"""From what a user types to a run or a state: `mobius-pi:12`, `mobius-pi@b=0.5,N=400`, a path."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ribbon_cli import config as configs
from ribbon_cli.errors import RibbonError, UsageError
from ribbon_cli.expression import evaluate
from ribbon_cli.facts import same_value, same_width
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.store.folder import RESOLVED, is_run
from ribbon_cli.store.root import named
from ribbon_cli.store.run import Run
from ribbon_cli.store.summaries import Summary, varying
from ribbon_cli.text import listed

_FILES = (".h5", ".hdf5", ".npz")
_SYMBOLS = {row.symbol: name for name, row in PARAMETERS.items()}


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
    """Return "; did you mean ...?" for the nearest known words, else for those that hold it, or nothing."""
    words = list(dict.fromkeys(known))
    near = difflib.get_close_matches(word, words, n=3, cutoff=0.6)
    near = near or [name for name in words if len(word) > 2 and word in name][:3]
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
            f"{text!r} names more than one run: {listed(run.name for run in fitting)}; "
            "write more of its name; `ribbon check CONFIG` tells which is a config's"
        )
    if not runs:
        raise UsageError(f"no run {text!r}: there are no runs in {root} (see --runs)")
    near = suggest(text, [run.short_name for run in runs])
    raise UsageError(f"no run {text!r} in {root}{near or ': it has ' + listed(run.name for run in runs)}")


def typed(run: Run) -> str:
    """The name of a run in a command: its own if no other has it, else its folder's, or its path."""
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

    `RUN:LABEL`; `RUN@b=0.5,shear=0.3,N=400` (equilibria only, by `select`); or a path to a state's HDF5 or
    npz file, whose run and label are None outside a run. `tell` is called with a sentence on the choice where
    the reference leaves one. Raises UsageError, saying what there is instead, when it names none.
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

    `ref` is a run, or RUN@b=0.5,shear=0.3,N=400 with any part left out, whatever it is. Raises UsageError.
    """
    name, at, query = ref.partition("@")
    values, segments = _parse_query(ref, query) if at else ({}, None)
    run = find_run(root, name)
    return run, [state for state in run.states(all=all) if _is_at(state, values, segments)]


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


def _parse_query(ref: str, query: str) -> tuple[dict[str, float], int | None]:
    """Parameters by name and N of `b=0.5,shear=0.3,N=400`; values may be spelled as in a config, `b=pi/6`.

    Raises UsageError.
    """
    wanted: dict[str, float] = {}
    segments: int | None = None
    for part in query.split(","):
        key, _, text = (piece.strip() for piece in part.partition("="))
        expected = f"{ref!r}: expected RUN@b=...,N=..., got {part!r}"
        name = _SYMBOLS.get(key, key)
        if key != "N" and name not in PARAMETERS:
            near = suggest(key, (*_SYMBOLS, *PARAMETERS)) if key else ""
            raise UsageError(f"{expected}: no parameter {key!r}{near}")
        if name in wanted or (key == "N" and segments is not None):
            raise UsageError(f"{expected}: {name} is given twice")
        try:
            if key == "N":
                segments = int(text)
            else:
                wanted[name] = evaluate(text)
        except ValueError as error:
            why = "" if key == "N" else f" ({error})"
            raise UsageError(f"{ref!r}: {key} must be a number, got {text!r}{why}") from None
    return wanted, segments


def select(
    run: Run, values: Mapping[str, float] | None = None, segments: int | None = None
) -> tuple[Summary, str]:
    """The equilibrium that parameters, N or both mean: the one rule for what is typed and for what programs
    ask for.

    A parameter that is left out, and that the states differ in, has the last value in the run's config; the
    half-width of closed bands may be any. With it comes a sentence on which was taken, and why that one;
    empty where there was no choice, and the state is certified. Raises UsageError, saying what there is
    instead, when there is none.
    """
    fitting, assumed = _fitting(run, values or {}, segments)
    state = meant(fitting)
    told = segments is None or len(fitting) > 1 or not state.certified or bool(assumed)
    shown = (HALF_WIDTH, *varying(run.states())) if told else ()
    words = (f"{_said({name: state.parameters[name]})}, the last value in the config" for name in assumed)
    return state, "; ".join([_choice(state, fitting, shown), *words]) if told else ""


def no_equilibria(run: Run) -> str:
    """The message for a run without equilibria, with the command that lists its other states."""
    return f"{run.name} has no equilibria yet; `ribbon ls {typed(run)} --all` lists its states"


def meant(states: Sequence[Summary]) -> Summary:
    """The state that represents several, given in the order stored: the latest of the finest certified ones,
    or if none is certified the latest of the finest.
    """
    certified = [state for state in states if state.certified]
    return max(reversed(certified or states), key=lambda state: state.segments)


def regridded(before: Summary, after: Summary) -> bool:
    """Whether a step led to another N at the same width."""
    return same_width(before.half_width, after.half_width) and before.segments != after.segments


class Place(NamedTuple):
    """Where a state is: its half-width, N, and its other parameters by name."""

    half_width: float
    segments: int
    others: tuple[tuple[str, float | None], ...] = ()


def by_place(states: Iterable[Summary]) -> dict[Place, list[Summary]]:
    """States by place, in the order of half-widths, then of other parameters, then of N.

    Those of one place are in the order stored.
    """
    states = list(states)
    one = {name: _representatives(states, name) for name in PARAMETERS}
    places: dict[Place, list[Summary]] = {}
    for state in states:
        known = {name: one[name][value] for name, value in state.parameters.items()}
        b = known.pop(HALF_WIDTH)
        assert b is not None
        places.setdefault(Place(b, state.segments, tuple(known.items())), []).append(state)

    def order(place: Place) -> tuple[object, ...]:
        return place.half_width, [value or 0.0 for _, value in place.others], place.segments

    return {place: sorted(places[place], key=lambda s: s.label) for place in sorted(places, key=order)}


def _representatives(states: Sequence[Summary], name: str) -> dict[float | None, float | None]:
    """For each value that states have of a parameter the smallest that is the same."""
    found: dict[float | None, float | None] = {None: None}
    last: float | None = None
    lengths = {state.parameters.get(name): state.length for state in states}
    for value in sorted(value for value in lengths if value is not None):
        last = last if last is not None and same_value(name, last, value, lengths[value]) else value
        found[value] = last
    return found


def _choice(taken: Summary, fitting: Sequence[Summary], shown: Iterable[str]) -> str:
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
    place = f"{_said({name: taken.parameters[name] for name in shown})}, N = {taken.segments}"
    return f"state {taken.label} is taken ({place}), {why}"


def _fitting(
    run: Run, values: Mapping[str, float], segments: int | None
) -> tuple[list[Summary], tuple[str, ...]]:
    """The equilibria with these parameters, of one N or both, at least one; and the parameters that were left
    out and taken from the config. Raises UsageError.
    """
    states = run.states()
    if not states:
        raise UsageError(no_equilibria(run))
    words: list[str] = []
    for name, value in values.items():
        if not any(name in state.parameters for state in states):
            known = ", ".join(PARAMETERS[name].symbol for name in states[-1].parameters)
            raise UsageError(f"{run.name} has no parameter {name}: it has {known}")
        words.append(_said({name: value}))
        states = _narrowed(run, states, name, value, " and ".join(words))
    assumed = []
    free = varying(states)
    if not states[-1].sigma and len({state.half_width for state in states}) > 1:
        free = (HALF_WIDTH, *free)
    last = _last_values(run) if free else {}
    for name in free:
        if name in last and len(by_place(states)) > 1:
            words.append(_said({name: last[name]}))
            states = _narrowed(run, states, name, last[name], " and ".join(words))
            assumed.append(name)
    if segments is None:
        return states, tuple(assumed)
    fitting = [state for state in states if state.segments == segments]
    if not fitting:
        meshes = listed(map(str, sorted({state.segments for state in states})))
        where = "".join(f"{word} and " for word in words)
        raise UsageError(f"{run.name} has no equilibrium with {where}N = {segments}: it has N = {meshes}")
    return fitting, tuple(assumed)


def _narrowed(run: Run, states: Sequence[Summary], name: str, value: float, words: str) -> list[Summary]:
    """Those of the states that have a value of a parameter. Raises UsageError; `words` say what was asked."""
    fitting = [state for state in states if _is_at(state, {name: value})]
    if not fitting:
        there = {state.parameters.get(name) for state in states}
        has = listed(f"{value:.10g}" for value in sorted(value for value in there if value is not None))
        symbol = PARAMETERS[name].symbol
        raise UsageError(f"{run.name} has no equilibrium with {words}: it has {symbol} = {has}")
    return fitting


def _last_values(run: Run) -> dict[str, float]:
    """The parameters after the last leg of the run's config, nothing where it cannot be read."""
    try:
        return configs.load_config(run.path / RESOLVED).last()
    except RibbonError:
        return {}


def _is_at(state: Summary, values: Mapping[str, float], segments: int | None = None) -> bool:
    """Whether a state has the parameters and the N asked for."""
    return segments in (None, state.segments) and all(
        (found := state.parameters.get(name)) is not None and same_value(name, found, value, state.length)
        for name, value in values.items()
    )


def _said(values: Mapping[str, float | None]) -> str:
    """Parameters with their values: `b = 0.5, shear = 0.3`."""
    return ", ".join(f"{PARAMETERS[name].symbol} = {value:.10g}" for name, value in values.items())
