"""The whole table by both contestants, several times in turn, and what the peer's solutions are."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ribbon_cli.model.band import State

from . import peer
from .ours import SIGMA, Reached, Table, solved, start_of, table, verdict

Key = tuple[float, int]
"""A state of the table: half-width and number of segments."""


@dataclass(frozen=True)
class Row:
    """One state: median seconds of ours and of the peer, both ways, and what the peer found.

    `ours` holds start, detours and certificate; `same` is solve and certificate from the start that the peer
    has when it is `guessed`. Seconds of the peer are those of the solve that ended there, None without one.
    """

    half_width: float
    segments: int
    steps: int
    ours: float
    same: float
    same_steps: int
    own_way: float | None
    own_iterations: int
    own_verdict: str
    guessed: float | None
    guessed_iterations: int
    guessed_verdict: str


@dataclass(frozen=True)
class Comparison:
    """All runs of the table, in the order ours, peer in its own way, and from our guesses peer and ours."""

    ours: list[Table]
    own_way: list[peer.Tally]
    guessed: list[peer.Tally]
    same: list[Table]

    @property
    def rows(self) -> list[Row]:
        """State by state, medians over the runs."""
        return [self._row(key) for key in self.ours[0]]

    def _row(self, key: Key) -> Row:
        mine = [run[key] for run in self.ours]
        own, own_verdict = _median(self.own_way, key), _verdict(self.own_way[-1], key, mine[-1])
        guessed, guessed_verdict = _median(self.guessed, key), _verdict(self.guessed[-1], key, mine[-1])
        seconds = statistics.median(m.seconds for m in mine)
        same, steps = statistics.median(run[key].seconds for run in self.same), self.same[-1][key].steps
        return Row(*key, mine[-1].steps, seconds, same, steps, *own, own_verdict, *guessed, guessed_verdict)

    @property
    def ours_seconds(self) -> float:
        """Median of our whole job."""
        return statistics.median(self.totals)

    @property
    def totals(self) -> list[float]:
        """Seconds of our whole job, run by run."""
        return [sum(r.seconds for r in run.values()) for run in self.ours]

    def peer_seconds(self, runs: list[peer.Tally], *, failed: bool = False, build: bool = False) -> float:
        """Median of the peer's whole job: useful solves alone, or with what is named as well."""
        return statistics.median(
            t.useful_seconds + failed * t.failed_seconds + build * t.build_seconds for t in runs
        )


def _median(runs: list[peer.Tally], key: Key) -> tuple[float | None, int]:
    found = [run.results[key] for run in runs if key in run.results]
    if not found:
        return None, 0
    return statistics.median(f.seconds for f in found), found[-1].iterations


def _verdict(run: peer.Tally, key: Key, ours: Reached) -> str:
    return verdict(run.results[key], ours) if key in run.results else "missing"


def compare(
    guess: State,
    widths: tuple[float, ...],
    levels: tuple[int, ...],
    repeats: int,
    say: Callable[[str], None],
) -> Comparison:
    """Run ours, the peer in its own way, and both from our guesses in turn, `repeats` times."""
    out = Comparison([], [], [], [])
    for k in range(repeats):
        say(f"table, run {k + 1} of {repeats}")
        out.ours.append(table(guess, widths, levels))
        out.own_way.append(peer.table_own_way(start_of(guess), SIGMA, widths=widths, levels=levels))
        guesses = [(start_of(r.start), *key) for key, r in out.ours[0].items()]
        out.guessed.append(peer.from_guesses(guesses, SIGMA))
        out.same.append({key: solved(r.start) for key, r in out.ours[0].items()})
    return out


def alternate(
    contestants: dict[str, Callable[[], object]], repeats: int
) -> Iterator[tuple[str, float, object]]:
    """Call each in turn, `repeats` times: who, how long, what came of it."""
    for _ in range(repeats):
        for name, run in contestants.items():
            began = time.perf_counter()
            found = run()
            yield name, time.perf_counter() - began, found
