"""What a survey has found, read from its run: the equilibria, what became of each, and how complete it is.

The run's log has a line for each start and for each equilibrium looked for on a finer mesh; what follows from
them is decided here, anew whenever it is asked for.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from ..errors import RibbonError
from ..export.words import linking_name
from ..store import Run, Summary
from ..store.events import SurveyFollowed, SurveyStart
from ..store.record import StateRecord
from ..study.records import state_of
from ..study.run_config import resolved_config
from .census import Estimate, accumulation, estimate
from .follow import LOST, MET
from .shapes import Shape

DOUBLINGS = 3
"""An equilibrium is followed to 2N, 4N and 8N."""
CONTINUUM, MESH, OPEN = "continuum", "mesh", "open"
"""Met again on every mesh, with energies that converge; lost on one of them; neither."""
SETTLED = 1e-9
"""Relative change of energy from mesh to mesh that is none."""


@dataclass(frozen=True)
class Standing:
    """How far an equilibrium was followed: the labels of its states, the coarsest first, and what is known of
    it, None as long as it is to be followed further.
    """

    labels: tuple[int, ...]
    verdict: str | None
    why: str


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium that a survey found.

    `found` is the label of the state found first, `label` that of its state on the survey's mesh, `labels`
    those on the finer ones, with `energies`; `hits` counts the ways that led to it. `index` and `indices`
    count negative eigenvalues, rotations left out. Contact is that on the finest mesh: `contacts` is how many
    gaps push there, None without contact forces.
    """

    number: int
    found: int
    label: int
    energy: float
    index: int
    linking_number: float | None
    inflections: int
    symmetry: str
    self_contact: bool
    hits: int
    verdict: str
    why: str
    labels: tuple[int, ...]
    segments: tuple[int, ...]
    energies: tuple[float, ...]
    indices: tuple[int, ...]
    contacts: int | None = None


@dataclass(frozen=True)
class Findings:
    """A survey's result: its equilibria by energy, the ends of its ways by status, and estimates of how many
    there are: minima, saddles, what is called continuum, and all; `curve` is the expected number of
    equilibria against that of hits.
    """

    run: str
    linking_name: str
    half_width: float
    segments: int
    starts: int
    equilibria: tuple[Equilibrium, ...]
    ends: Mapping[str, int]
    estimates: Mapping[str, Estimate | None]
    curve: tuple[tuple[int, float], ...]


def starts_of(run: Run) -> dict[int, SurveyStart]:
    """What came of each start that was explored. Raises StoreError."""
    return {event.start: event for event in run.events() if isinstance(event, SurveyStart)}


def is_survey(run: Run) -> bool:
    """Whether a run holds a survey. Raises StoreError."""
    return bool(starts_of(run))


def found_in(run: Run) -> dict[int, int]:
    """Of each equilibrium, by the label of the state found first, that of its state of the lowest index."""
    best: dict[int, Summary] = {}
    entries = run.entries()
    for _, event in sorted(starts_of(run).items()):
        for end in event.ends:
            if end.found is None or end.stored is None or end.stored not in entries:
                continue
            state = entries[end.stored].state
            before = best.get(end.found)
            if before is None or index_of(state) < index_of(before):
                best[end.found] = state
    return {found: state.label for found, state in best.items()}


def index_of(state: Summary) -> int:
    """Negative eigenvalues of a state whose index is known."""
    return state.negative_eigenvalues or 0


def levels_of(segments: int) -> tuple[int, ...]:
    """Meshes to which equilibria are followed."""
    return tuple(segments * 2**k for k in range(1, DOUBLINGS + 1))


def standings(run: Run, segments: int) -> dict[int, Standing]:
    """How far each equilibrium was followed, by the label of the state found first."""
    followed = {(e.found, e.segments): e for e in run.events() if isinstance(e, SurveyFollowed)}
    paths = {found: [label] for found, label in found_in(run).items()}
    out: dict[int, Standing] = {}
    entries = run.entries()
    for level in levels_of(segments):
        here = {found: followed.get((found, level)) for found in paths if found not in out}
        owners = _owners(event for event in here.values() if event is not None)
        for found, event in here.items():
            path = paths[found]
            if event is None:
                out[found] = Standing(tuple(path), None, "")
            elif event.word != MET or event.label is None or event.label not in entries:
                word = MESH if event.word == LOST else OPEN
                out[found] = Standing(tuple(path), word, f"at N = {level}: {event.why}")
            elif owners[event.label] != found:
                why = f"at N = {level} it is the equilibrium that state {owners[event.label]} becomes"
                out[found] = Standing(tuple(path), MESH, why)
            else:
                path.append(event.label)
    for found, path in paths.items():
        if found not in out:
            energies = [entries[label].state.energy or 0.0 for label in path]
            out[found] = _converged(tuple(path), energies)
    return out


def _owners(events: Iterable[SurveyFollowed]) -> dict[int, int]:
    """Of the equilibria that become one state on a finer mesh, the one that is nearest to it."""
    nearest: dict[int, SurveyFollowed] = {}
    for event in events:
        if event.label is None or event.word != MET:
            continue
        before = nearest.get(event.label)
        if before is None or (event.distance or 0.0, event.found) < (before.distance or 0.0, before.found):
            nearest[event.label] = event
    return {label: event.found for label, event in nearest.items()}


def _converged(path: tuple[int, ...], energies: Sequence[float]) -> Standing:
    before, last = abs(energies[-2] - energies[-3]), abs(energies[-1] - energies[-2])
    if last < before or last <= SETTLED * abs(energies[-1]):
        return Standing(path, CONTINUUM, "")
    return Standing(path, OPEN, f"energies do not converge: the last changes are {before:.2g} and {last:.2g}")


def findings(run: Run) -> Findings:
    """The survey that a run holds. Raises StoreError, UsageError where a state is missing."""
    explored = starts_of(run)
    ends = [end for _, event in sorted(explored.items()) for end in event.ends]
    hits = Counter(end.found for end in ends if end.found is not None)
    best, entries = found_in(run), run.entries()
    first = entries[next(iter(best.values()))].state if best else None
    known = standings(run, first.segments) if first else {}
    half_width, segments = (first.half_width, first.segments) if first else _place(run)
    rows = sorted(best, key=lambda found: (entries[best[found]].state.energy or 0.0, found))
    table = tuple(
        _equilibrium(run, number, found, known[found], hits[found])
        for number, found in enumerate(rows, start=1)
    )
    return Findings(
        run.name,
        linking_name([first] if first else []),
        half_width,
        segments,
        len(explored),
        table,
        dict(sorted(Counter(end.status for end in ends).items())),
        {name: estimate(counts) for name, counts in _groups(table)},
        tuple(accumulation([row.hits for row in table])),
    )


def _place(run: Run) -> tuple[float, int]:
    """Half-width and N of a survey that has found nothing, as far as its config tells."""
    with suppress(RibbonError):
        config = resolved_config(run)
        half_width = config.widths[0] if config.widths else config.guess.half_width
        return math.nan if half_width is None else half_width, config.guess.segments or 0
    return math.nan, 0


def _groups(table: Sequence[Equilibrium]) -> list[tuple[str, list[int]]]:
    """Hits of equilibria by what these are; all of them come last."""
    groups = [
        ("minima", [row.hits for row in table if row.index == 0]),
        ("saddles", [row.hits for row in table if row.index > 0]),
        (CONTINUUM, [row.hits for row in table if row.verdict == CONTINUUM]),
    ]
    return [*((name, counts) for name, counts in groups if counts), ("all", [row.hits for row in table])]


def _equilibrium(run: Run, number: int, found: int, standing: Standing, hits: int) -> Equilibrium:
    states = [run.look_up(label) for label in standing.labels]
    coarse, finer = states[0], states[1:]
    shape = shape_of(run.load(coarse.label))
    return Equilibrium(
        number,
        found,
        coarse.label,
        coarse.energy or 0.0,
        shape.index,
        coarse.linking_number,
        shape.inflections,
        shape.symmetry,
        states[-1].self_contact,
        hits,
        standing.verdict or OPEN,
        standing.why if standing.verdict else "not followed to the end",
        tuple(state.label for state in finer),
        tuple(state.segments for state in finer),
        tuple(state.energy or 0.0 for state in finer),
        tuple(index_of(state) for state in finer),
        states[-1].contacts,
    )


def shape_of(record: StateRecord) -> Shape:
    """What a stored state is told from others by."""
    gap = None if record.contacts is None else record.contacts.gap
    return Shape(state_of(record), record.energy, record.negative_eigenvalues or 0, gap)
