"""A state that a config or command names, as a start."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..config import Config, ConfigError, Mistake
from ..digits import significant
from ..errors import StoreError, UsageError
from ..facts import Event, event
from ..model.band import Band, Discretisation, State
from ..model.folding import close, facet_frames, from_state, to_state
from ..model.topology import CLOSURE_TOLERANCE, linking_number
from ..parts import CLOSED
from ..store import Contacts, Run, StateRecord, decode, load_npz, resolve_state
from .plan import start_name, start_width
from .records import state_of

OPEN = 1e-2
"""Distance of the ends of a midline, in parts of the length, up to which a given state is closed: what a few
printed digits or another discretisation leave, and little enough for fold angles to make up for."""
SAME = 1e-9
"""Difference, relative or absolute, up to which parameters of a given strip are those of the config."""


class Given(NamedTuple):
    """A state to start from in the config's length and discretisation, its name, that it was closed, and the
    contacts on which it rests."""

    state: State
    name: str
    closing: Event | None = None
    contacts: Contacts | None = None


def given_band(config: Config, root: Path, tell: Callable[[str], object] | None = None) -> Band | None:
    """The band of the state that a config starts from, None for a recipe. Arguments and errors are those of
    `given_state`; `tell` also hears that the state was closed.
    """
    if config.guess.recipe != "state":
        return None
    given = given_state(config, root, tell)
    if given.closing is not None and tell is not None:
        tell(f"{start_name(config)}: {given.closing}")
    return given.state.band


def given_state(config: Config, root: Path, tell: Callable[[str], object] | None = None) -> Given:
    """The state of `initial_guess: {state: ...}`; one of an npz file that is open by up to `OPEN` is closed.

    The name bears a hash of the state's numbers, so that a run can tell whether it started from them. `tell`
    is called with a sentence on which state was taken, where the reference leaves a choice.

    Raises ConfigError, at the reference's place in the config, if it does not exist, is an npz file without
    a state in it, or is not the band that the config describes; StoreError if a run's state is damaged.
    """
    try:
        return _given_state(config, root, tell)
    except UsageError as error:
        raise refused(config, str(error)) from error


def refused(config: Config, message: str) -> ConfigError:
    """The error of a config whose given state cannot be used."""
    guess = config.guess
    return ConfigError(config.path, [Mistake(guess.line, guess.column, "initial_guess.state", message)])


def _given_state(config: Config, root: Path, tell: Callable[[str], object] | None) -> Given:
    ref, closing, contacts = config.guess.state or "", None, None
    run, label, path = resolve_state(root, ref, tell)
    if path.suffix == ".npz":
        try:
            data = load_npz(path)
        except StoreError as error:  # not of the store: a file of the user's own
            raise UsageError(str(error)) from error
        length, sigma, n = float(data["length"]), int(data["sigma"]), int(data["xi"].size)
        _check_topology(config, sigma, ref)
        parts = data.get("parts", CLOSED)
        band = Band(n, float(data["half_width"]), length, sigma, parts=parts)
        g_end = None if band.closed else data["g_end"]
        found = State(band, data["u"], data["g"], data["xi"], g_end)
        contacts = _check_contacts(config, data.get("contacts"), length, ref)
    else:
        record = _record(run, label, path)
        if record.kind == "auxiliary":
            raise UsageError(
                f"{ref}: an auxiliary state ({record.stage}): its rulings are prescribed or its seam is "
                "open; start from an equilibrium"
            )
        _check_topology(config, record.sigma, ref)
        found = state_of(record)
        contacts = _check_contacts(config, record.contacts, record.length, ref)
    mark = _mark(found)
    if config.open:
        _check_parts(config, found.band, ref)
    else:
        if path.suffix == ".npz":
            found, closing = _closed(found, ref)
        _check_closed(config, found, ref)
    _check_level(config, found, ref)
    scale = config.length / found.band.length
    band = Band(
        found.band.segments,
        start_width(config, found.band.half_width * scale),
        config.length,
        found.band.sigma,
        Discretisation(config.discretisation),
        config.parts,
    )
    name = f"{config.guess.state_as_written or ref} ({mark})"
    return Given(State(band, found.u, found.g, found.xi, found.g_end), name, closing, contacts)


def _check_contacts(config: Config, known: Contacts | None, length: float, ref: str) -> Contacts | None:
    """The contacts on which a stored state rests, None where it touches nothing. Raises UsageError where the
    config does not go on with them."""
    if known is None or not len(known):
        return None
    wanted = "contact: forces" if known.gap == 0.0 else f"contact: {{gap: {known.gap:.12g}}}"
    scale = config.length / length
    if not config.contact.forces or not math.isclose(config.contact.gap, known.gap * scale, rel_tol=SAME):
        raise UsageError(f"{ref}: rests on itself with {len(known)} contacts: it takes `{wanted}` to go on")
    return known


def _check_topology(config: Config, sigma: int, ref: str) -> None:
    """Raise UsageError for an open strip where a closed band is wanted, or the other way round."""
    if (sigma == 0) != config.open:
        kinds = ("a closed band", "an open strip")
        raise UsageError(f"{ref}: is {kinds[sigma == 0]}, where the config is about {kinds[config.open]}")


def _closed(state: State, ref: str) -> tuple[State, Event | None]:
    """A state with its midline closed, and the event where that had to be done. Raises UsageError.

    The fold angles are changed least (`model.folding.close`); ends further apart than `OPEN` are refused.
    """
    gap = float(np.linalg.norm(state.u.mean(axis=0)))
    if gap * state.band.segments <= CLOSURE_TOLERANCE:
        return state, None
    apart = f"its ends are {significant(gap, 3)} of its length apart"
    if gap > OPEN:
        raise UsageError(
            f"{ref}: not a closed band: {apart}, and up to {OPEN:g} is closed automatically: close it first"
        )
    try:
        folding = close(from_state(state), state.band.sigma)
        closed = to_state(state.band, folding, facet_frames(state)[0])
    except ValueError as error:  # a ClosureError among them
        raise UsageError(f"{ref}: not a closed band: {apart}, and closing it fails: {error}") from error
    moved = float(np.abs(closed.u - state.u).max())
    return closed, event("closed", state=ref, apart=apart, angle=significant(moved, 2))


def _mark(state: State) -> str:
    """What tells one given state from another of the same name: the start of a hash of its numbers."""
    band = state.band
    digest = hashlib.sha256(np.array([band.half_width, band.length, band.sigma]).tobytes())
    digest.update(np.ascontiguousarray(state.vector()).tobytes())
    return f"sha256 {digest.hexdigest()[:16]}"


def _record(run: Run | None, label: int | None, path: Path) -> StateRecord:
    return decode(path) if run is None or label is None else run.load(label)


def _check_parts(config: Config, band: Band, ref: str) -> None:
    """Raise UsageError unless a strip is held and loaded as the config says, and is as long."""
    told = [("length", band.length, config.length)]
    for part in ("ends", "material", "loads"):
        here, there = vars(getattr(band.parts, part)), vars(getattr(config.parts, part))
        told += [(f"{part}.{name}", here[name], value) for name, value in there.items()]
    for name, has, wanted in told:
        if has != wanted and (isinstance(has, str) or not np.allclose(has, wanted, SAME, SAME, True)):
            raise UsageError(
                f"{ref}: has {name} = {_shown(has)}, where the config says {_shown(wanted)}: begin as "
                "the state is, and let the schedule lead on"
            )


def _shown(value: object) -> str:
    """A number, three of them, or a word, as a config has them."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _check_closed(config: Config, state: State, ref: str) -> None:
    """Raise UsageError unless a band has the config's topology."""
    try:
        lk = linking_number(state.u, state.g, state.band.sigma, state.band.h).linking_number
    except ValueError as error:
        raise UsageError(f"{ref}: not a closed band: {error}") from error
    if abs(lk - 0.5 * config.half_twists) > 0.25:
        raise UsageError(
            f"{ref}: has Lk = {lk:.3g}, which is half_twists: {round(2 * lk)}, where the config says "
            f"topology: {{half_twists: {config.half_twists}}}"
        )


def _check_level(config: Config, state: State, ref: str) -> None:
    """Raise UsageError unless refinement starts with the state's number of segments."""
    levels = config.refinement.levels
    if levels and levels[0] != state.band.segments:
        raise UsageError(
            f"{ref}: has {state.band.segments} segments, but refinement starts at {levels[0]}: "
            f"its first level must be that of the given state"
        )
