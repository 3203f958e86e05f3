"""Two states or two runs, field by field."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ribbon_cli.store import Run, StateRecord, Summary
from ribbon_cli.store.fields import flatten, is_provenance, value_shape

if TYPE_CHECKING:
    from ribbon_cli.store.fields import Value

_ORDER = ("/origin/label", "/origin/parent")
"""Datasets that say where a state stands in its run, not what it is."""
IDENTICAL, SAME, DIFFERENT = "identical", "same to rounding", "different"
"""The three answers of a comparison."""


@dataclass(frozen=True)
class Judgement:
    """One of the three answers, the largest relative difference and the path of the dataset that has it.

    Both are None if nothing differs; the difference alone is None if the dataset holds no numbers. `image`
    says how the second shape is an image of the first (renumbered, turned), None if it is not.
    """

    answer: str
    largest_relative_difference: float | None = None
    largest_in: str | None = None
    image: str | None = None


Judge = Callable[["StateRecord", "StateRecord"], Judgement]
"""A function that judges how far two states agree."""


@dataclass(frozen=True)
class FieldPair:
    """One dataset of two states: scalars, or the shapes of arrays; None where a state does not have it.

    `difference` is the largest absolute difference of numbers of one shape, else None.
    """

    path: str
    equal: bool
    first: Any
    second: Any
    difference: float | None = None


@dataclass(frozen=True)
class StatePair:
    """The labels of two runs' states that ended the same stage; None where a run has no such state."""

    stage: str
    kind: str
    first: int | None
    second: int | None
    equal: bool
    energies: tuple[float | None, float | None]
    judgement: Judgement


def compare_states(first: StateRecord, second: StateRecord) -> list[FieldPair]:
    """Every dataset of two states, in the order of the format's table; equal means equal to the last bit."""
    one = {field.item.path: field.value for field in flatten(first)}
    two = {field.item.path: field.value for field in flatten(second)}
    return [_pair(path, one.get(path), two.get(path)) for path in dict.fromkeys([*one, *two])]


def same_science(pairs: list[FieldPair]) -> bool:
    """Whether all that was computed is equal: everything but provenance and the states' places in a run."""
    return all(pair.equal for pair in pairs if not is_provenance(pair.path) and pair.path not in _ORDER)


def _pair(path: str, one: Value | None, two: Value | None) -> FieldPair:
    if one is None or two is None:
        return FieldPair(path, False, _shown(one), _shown(two))
    if isinstance(one, str | tuple) or isinstance(two, str | tuple):
        return FieldPair(path, one == two, _shown(one), _shown(two))
    same = one.dtype == two.dtype and one.shape == two.shape and one.tobytes() == two.tobytes()
    difference = 0.0 if same else _difference(one, two)
    return FieldPair(path, same, _shown(one), _shown(two), difference)


def _difference(one: Any, two: Any) -> float | None:
    """Largest absolute difference of two arrays of numbers; infinite where only one is finite, None if
    shapes differ.
    """
    if one.shape != two.shape:
        return None
    a, b = one.astype(np.float64), two.astype(np.float64)
    both = np.isnan(a) & np.isnan(b)
    with np.errstate(invalid="ignore"):
        apart = np.where(both | (a == b), 0.0, np.abs(a - b))
    return float(np.where(np.isnan(apart), np.inf, apart).max()) if apart.size else 0.0


def _shown(value: Value | None) -> Any:
    """A scalar or list of texts as it is; of an array its shape."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return list(value)
    return value.item() if value.shape == () else list(value_shape(value))


def compare_runs(first: Run, second: Run, judge: Judge) -> list[StatePair]:
    """The states of two runs by the stages that they ended, in the order of the first run.

    `judge` is asked about states of different hashes. Raises StoreError for a file that is not what was
    committed.
    """
    for run in (first, second):
        for entry in run.entries().values():
            run.committed_bytes(entry)
    ours, theirs = _by_stage(first), _by_stage(second)
    pairs = []
    for key in dict.fromkeys([*ours, *theirs]):
        one, two = ours.get(key), theirs.get(key)
        if one is None or two is None:
            judgement = Judgement(DIFFERENT)
        elif one.content_sha256 == two.content_sha256:
            judgement = Judgement(IDENTICAL)
        else:
            judgement = judge(first.load(one.label), second.load(two.label))
        labels = [None if state is None else state.label for state in (one, two)]
        energies = (None if one is None else one.energy, None if two is None else two.energy)
        equal = judgement.answer == IDENTICAL
        pairs.append(StatePair(key[1], key[0], labels[0], labels[1], equal, energies, judgement))
    return pairs


def decided(pairs: Sequence[StatePair]) -> tuple[Judgement, StatePair | None]:
    """How far two runs agree, and the pair of states that decides it: the one that differs most."""
    for answer in (DIFFERENT, SAME):
        these = [pair for pair in pairs if pair.judgement.answer == answer]
        if these:
            pair = max(these, key=lambda pair: pair.judgement.largest_relative_difference or 0.0)
            return pair.judgement, pair
    return Judgement(IDENTICAL), None


def _by_stage(run: Run) -> dict[tuple[str, str, int], Summary]:
    """States by kind, stage and the number of earlier states of the same kind and stage."""
    seen: defaultdict[tuple[str, str], int] = defaultdict(int)
    found = {}
    for state in run.states(all=True):
        key = (state.kind, state.stage)
        found[(*key, seen[key])] = state
        seen[key] += 1
    return found
