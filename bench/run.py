"""`python -m bench.run`: measures the solver against the peer and writes docs/benchmarks.md.

`--only PART` measures a part of it alone, and the rest of the page stays.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ribbon_cli.model.band import State

from . import peer
from .command import CONFIG, whole_command
from .compare import compare
from .contact import measure_contact
from .contact_page import contact_part
from .document import NAMES, Part, Whole, command_part, page, strips_part, table_part
from .ours import Table, table, twisted_guess
from .refinements import refinements
from .scaling import scaling
from .scaling_page import scaling_part
from .single import chain, prolonged, single
from .strip_run import STEPS, measure_strips

DOCUMENT = Path(__file__).parents[1] / "docs" / "benchmarks.md"


@dataclass(frozen=True)
class Size:
    """How much is measured: the table, its runs, repeats of solves at `half_width` by N, the finest grids of
    ours and of the peer, strips (segments and steps of the path), runs of the whole command, and grids of
    bands at rest on themselves."""

    widths: tuple[float, ...]
    levels: tuple[int, ...]
    runs: int
    half_width: float
    singles: dict[int, int]
    finest: tuple[int, int]
    strips: tuple[int, int]
    commands: int
    contact: tuple[int, ...]


FULL = Size(
    peer.WIDTHS,
    peer.LEVELS,
    3,
    0.5,
    {50: 15, 200: 15, 800: 7, 3200: 3},
    (102400, 102400),
    (200, STEPS),
    5,
    (100, 200, 400),
)
QUICK = Size((0.1, 0.2), (50, 100), 1, 0.2, {50: 1, 100: 1}, (400, 100), (50, 3), 1, (50,))


class Bench:
    """The parts at one size; states that several parts begin with are made once."""

    def __init__(self, size: Size, document: Path) -> None:
        self.size = size
        self.document = document

    @cached_property
    def guess(self) -> State:
        """The twisted guess."""
        _say("the twisted guess")
        return twisted_guess(self.size.levels[0], self.size.widths[0])

    @cached_property
    def reached(self) -> Table:
        """The states of the table up to the half-width at which single solves are made."""
        widths = tuple(b for b in self.size.widths if b <= self.size.half_width)
        return table(self.guess, widths, self.size.levels)

    def command(self) -> Part:
        """The whole command, before and now."""
        _say("the whole command, before and now")
        return command_part(whole_command(CONFIG, self.size.commands))

    def table(self) -> Part:
        """The whole table, single solves, and refinements."""
        size = self.size
        comparison = compare(self.guess, size.widths, size.levels, size.runs, _say)
        reached = comparison.ours[-1]
        fine = chain(reached[size.half_width, size.levels[-1]].state, max(size.singles) // 2, _say)
        states = {n: r.state for (b, n), r in reached.items() if b == size.half_width}
        states |= {n: r.state for n, r in fine.items()}
        singles = []
        for n, repeats in size.singles.items():
            _say(f"single solves at N = {n}")
            start = _before(reached, size) if n == size.levels[0] else prolonged(states[n // 2], n)
            singles.append(single(start, repeats))
        both = refinements(reached, size.levels, _say)
        return table_part(Whole(comparison, singles, size.half_width, both))

    def scaling(self) -> Part:
        """Time and memory over the number of segments."""
        coarse = self.reached[self.size.half_width, self.size.levels[0]].state
        return scaling_part(scaling(coarse, *self.size.finest, _say), self.document.parent)

    def strips(self) -> Part:
        """Strips between clamps."""
        band = self.reached[self.size.half_width, self.size.levels[-1]].state
        return strips_part(measure_strips(band, *self.size.strips, self.size.runs, _say))

    def contact(self) -> Part:
        """Bands at rest on themselves; of a quick run the way along the width is left out."""
        full = self.size is FULL
        return contact_part(measure_contact(self.guess, self.size.contact, full, _say))


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
    parser.add_argument("--only", action="append", choices=NAMES, help="a part alone; may be repeated")
    parser.add_argument("-o", "--output", type=Path, default=DOCUMENT, help="the document to write")
    asked = parser.parse_args(argv)
    bench = Bench(QUICK if asked.quick else FULL, asked.output)
    measures: dict[str, Callable[[], Part]] = {
        "command": bench.command,
        "table": bench.table,
        "scaling": bench.scaling,
        "strips": bench.strips,
        "contact": bench.contact,
    }
    parts = [measure() for name, measure in measures.items() if name in (asked.only or NAMES)]
    before = asked.output.read_text(encoding="utf-8") if asked.output.exists() else ""
    asked.output.write_text(page(parts, before), encoding="utf-8")
    found = [rule for part in parts for rule in part.rules]
    for text, met in found:
        print(f"{'met    ' if met else 'NOT MET'}  {text}")
    return 0 if asked.quick or all(met for _, met in found) else 1


if __name__ == "__main__":
    sys.exit(main())
