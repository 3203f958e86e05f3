"""`python -m bench.run`: measures the solver against the peer and writes docs/benchmarks.md."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ribbon_cli.model.band import State

from . import peer
from .command import CONFIG, whole_command
from .compare import compare
from .contact import TOUCHES_NOTHING, measure_contact
from .document import Measured, document, rules
from .ours import Table, twisted_guess
from .refinements import refinements
from .single import chain, memory, prolonged, single
from .strip_run import STEPS, measure_strips

DOCUMENT = Path(__file__).parents[1] / "docs" / "benchmarks.md"


@dataclass(frozen=True)
class Size:
    """How much is measured: the table, its runs, repeats of solves at `half_width` by N, memory, strips
    (segments and steps of the path), runs of the whole command, and contact by N."""

    widths: tuple[float, ...]
    levels: tuple[int, ...]
    runs: int
    half_width: float
    singles: dict[int, int]
    memory: tuple[int, ...]
    strips: tuple[int, int]
    commands: int
    contact: tuple[int, ...]


FULL = Size(
    peer.WIDTHS,
    peer.LEVELS,
    3,
    0.5,
    {50: 15, 200: 15, 800: 7, 3200: 3},
    (800, 1600, 3200, 6400),
    (200, STEPS),
    5,
    (100, 200, 400),
)
QUICK = Size((0.1, 0.2), (50, 100), 1, 0.2, {50: 1, 100: 1}, (100,), (50, 3), 1, ())


def measure(size: Size) -> Measured:
    """Run everything; what goes on is told on stderr."""
    _say("the whole command, before and now")
    command = whole_command(CONFIG, size.commands)
    coarsest = size.levels[0]
    _say("the twisted guess")
    guess = twisted_guess(coarsest, size.widths[0])
    comparison = compare(guess, size.widths, size.levels, size.runs, _say)
    reached = comparison.ours[-1]
    finest = max(*size.singles, *size.memory) // 2
    fine = chain(reached[size.half_width, size.levels[-1]].state, finest, _say)
    states = {n: r.state for (b, n), r in reached.items() if b == size.half_width}
    states |= {n: r.state for n, r in fine.items()}
    singles = []
    for n, repeats in size.singles.items():
        _say(f"single solves at N = {n}")
        start = _before(reached, size) if n == coarsest else prolonged(states[n // 2], n)
        singles.append(single(start, repeats))
    grown = []
    for n in size.memory:
        _say(f"memory at N = {n}")
        grown.append(memory(prolonged(states[n // 2], n)))
    both = refinements(reached, size.levels, _say)
    large = {n: r.seconds for n, r in fine.items()}
    strips = measure_strips(states[size.levels[-1]], *size.strips, size.runs, _say)
    touching = {n: reached[TOUCHES_NOTHING, n].state for n in size.contact}
    contact = measure_contact(touching, bool(size.contact), _say)
    return Measured(
        comparison, singles, size.half_width, large, grown, both, strips, size.runs, command, contact
    )


def _before(reached: Table, size: Size) -> State:
    """The coarsest state of the width before, as a start at `half_width`."""
    width = size.widths[size.widths.index(size.half_width) - 1]
    state = reached[width, size.levels[0]].state
    return State(state.band.with_half_width(size.half_width), state.u, state.g, state.xi)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and write; the exit code says whether all that is required of speed is met (0) or not (1)."""
    parser = argparse.ArgumentParser(prog="python -m bench.run", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few small solves, to see that all of it runs")
    parser.add_argument("-o", "--output", type=Path, default=DOCUMENT, help="the document to write")
    asked = parser.parse_args(argv)
    measured = measure(QUICK if asked.quick else FULL)
    asked.output.write_text(document(measured), encoding="utf-8")
    found = rules(measured)
    for text, met in found:
        print(f"{'met    ' if met else 'NOT MET'}  {text}")
    return 0 if asked.quick or all(met for _, met in found) else 1


if __name__ == "__main__":
    sys.exit(main())
