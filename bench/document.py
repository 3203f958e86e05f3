"""The sections of docs/benchmarks.md, part by part, from what was measured."""

from __future__ import annotations

import re
from dataclasses import dataclass

from .command import BEFORE, Command
from .compare import Comparison, Row
from .machine import machine, versions
from .refinements import Refinement, Way
from .single import Single
from .strip_run import HALF_WIDTH, PEERS, SPAN, ShearPath, Strips
from .tables import Rule, milliseconds, required, table


@dataclass(frozen=True)
class Whole:
    """What is measured on the whole table: both contestants, single solves, and refinements."""

    comparison: Comparison
    singles: list[Single]
    half_width: float
    refinements: list[Refinement]


@dataclass(frozen=True)
class Part:
    """A part of the page, which can be measured and written alone: its rules and its text."""

    name: str
    rules: list[Rule]
    text: str


WALL, CPU = 0.45, 0.68
"""What the whole command may take of its time, and of its processor time, at `command.BEFORE`."""

HEAD = """# Benchmarks

Written by `make bench`, each part also by `python -m bench.run --only PART`; edits are lost.

The problem is the discrete one of Koldaev (2022), (2.19), for the pi-band with the thesis's rule. The peer
is CasADi with IPOPT and MUMPS, helped in every way that was found (`bench/peer.py`). It certifies nothing.
Our seconds hold all that makes a certified state: start, detours by the other grid phase, residuals, inertia,
linking number, facets. Files and spectra are left out.
"""
_PART = re.compile(r"^<!-- part: (\w+) -->$", re.MULTILINE)


def page(parts: list[Part], before: str = "") -> str:
    """The whole document, Markdown: the parts, and of the page before those that were not measured."""
    found = _PART.split(before)[1:]
    texts = {name: text.strip("\n") for name, text in zip(found[::2], found[1::2], strict=True)}
    texts |= {part.name: _measured(part) for part in parts}
    named = [name for name in NAMES if name in texts]
    return HEAD + "".join(f"\n<!-- part: {name} -->\n\n{texts[name]}\n" for name in named)


def _measured(part: Part) -> str:
    """A part with where it was measured, and its rules, under its first heading."""
    heading, _, rest = part.text.partition("\n\n")
    where = f"Measured on a {machine()}, with {versions()}."
    return f"{heading}\n\n{where}\n\n{required(part.rules)}\n\n{rest}"


NAMES = ("command", "table", "scaling", "strips", "contact")
"""The parts in their order."""


def command_part(command: Command) -> Part:
    """The whole command beside the program before."""
    rules = []
    for name, words, most in (("wall", "time", WALL), ("cpu", "processor time", CPU)):
        left = command.ratio(name)
        rules.append(
            (f"the whole command in {most:.2f} of its {words} at {BEFORE}: {left:.2f}", left <= most)
        )
    return Part("command", rules, _command(command))


def table_part(measured: Whole) -> Part:
    """The whole table by both contestants."""
    c = measured.comparison
    texts = _whole(c), _states(c.rows), _singles(measured), _refinements(measured.refinements)
    return Part("table", _table_rules(c), "\n\n".join(texts))


def strips_part(strips: Strips) -> Part:
    """Strips between clamps."""
    return Part("strips", _strip_rules(strips), _strips(strips))


def _table_rules(c: Comparison) -> list[Rule]:
    """What is required of speed, with the figures found."""
    useful = c.peer_seconds(c.own_way) / c.ours_seconds
    everything = c.peer_seconds(c.own_way, failed=True) / c.ours_seconds
    guessed = c.peer_seconds(c.guessed, failed=True) / c.ours_seconds
    slower = [_name(r) for r in c.rows if r.segments >= 100 and _slower(r)]
    return [
        (f"3 times faster than the peer's useful solves, building left out: {useful:.1f}", useful >= 3),
        (f"5 times faster with its failed solves: {everything:.1f}", everything >= 5),
        (f"faster than the peer from our guesses: {guessed:.2f} times", guessed > 1),
        (
            "no slower on any state of 100 segments or more, from the same start and each in its own way: "
            + (", ".join(slower) or "none is"),
            not slower,
        ),
    ]


def _strip_rules(strips: Strips) -> list[Rule]:
    cost = max(strips.cost.ratio(rule) for rule in strips.cost.strips)
    path = strips.paths[0]
    return [
        (
            f"a strip's Newton step at most 1.1 times a band's at N = {strips.cost.segments}: {cost:.2f}",
            cost <= 1.1,
        ),
        (
            f"1.5 times faster than the peer along {len(path.steps)} steps of a strip's shear, by the "
            f"{path.rule} rule: {path.least:.2f}",
            path.least >= 1.5,
        ),
    ]


def _slower(row: Row) -> bool:
    """Whether the peer was faster from the same start, or in its own way than we with everything."""
    pairs = ((row.same, row.guessed), (row.ours, row.own_way))
    return any(theirs is not None and ours > theirs for ours, theirs in pairs)


def _name(row: Row) -> str:
    return f"b = {row.half_width:g}, N = {row.segments}"


def _command(command: Command) -> str:
    lines = []
    for name, words in (("wall", "by the clock"), ("cpu", "of all processes")):
        before, now = command.medians(name)
        lines.append((words, f"{before:.2f}", f"{now:.2f}", f"{now / before:.2f}"))
    return f"""## The whole command

`ribbon solve configs/mobius-pi.yaml` into an empty folder: imports, solves, spectra, files. Seconds of the
program at {BEFORE} and of today's, in turn, on {command.cores} cores; medians of {len(command.now)} runs.
Both have their byte code, as an installed package has.

{table(("seconds", "before", "now", "ratio"), lines)}"""


def _whole(c: Comparison) -> str:
    ours, found = c.ours_seconds, [(c.own_way, "in its own way"), (c.guessed, "from our guesses")]
    lines = [("ours, certified", f"{ours:.2f}", "", f"{c.totals[0]:.2f} the first time")]
    for runs, how in found:
        for words, failed, build in (
            ("useful solves", False, False),
            ("with failed ones", True, False),
            ("and with building", True, True),
        ):
            seconds = c.peer_seconds(runs, failed=failed, build=build)
            note = "; ".join(runs[-1].failures) if words == "with failed ones" else ""
            lines.append((f"peer {how}, {words}", f"{seconds:.2f}", f"{seconds / ours:.2f}", note))
    own, guessed = ([getattr(r, f"{n}_verdict") for r in c.rows] for n in ("own", "guessed"))
    return f"""## The whole table

{len(c.rows)} states from the ring twisted in 50 steps, not yet freed. One thread for each contestant, both
in one process, in turn; medians of {len(c.ours)} runs. *In its own way*: continuation in width
on the coarsest grid with multipliers, a failed step halved; facets split from level to level, tried with
multipliers, then without, then from the width before. *From our guesses*: every state from the start that
led us there, without multipliers; finding and making it counts for us and not for the peer.

{table(("", "seconds", "ratio to ours", ""), lines)}

{_found("In its own way", own)} {_found("From our guesses", guessed)}"""


def _found(way: str, verdicts: list[str]) -> str:
    wrong = [v for v in verdicts if v != "minimum"]
    kinds = ", ".join(f"{wrong.count(kind)} {kind}" for kind in sorted(set(wrong)))
    rest = f"the others by our certificate: {kinds}" if wrong else "by our certificate as well"
    return f"{way}, {len(verdicts) - len(wrong)} of its {len(verdicts)} states are the minimum, {rest}."


def _states(rows: list[Row]) -> str:
    def peer(seconds: float | None, iterations: int, verdict: str) -> str:
        if seconds is None:
            return "missing"
        return f"{milliseconds(seconds)} / {iterations}" + ("" if verdict == "minimum" else f" ({verdict})")

    lines = [
        (
            f"{r.half_width:g}",
            str(r.segments),
            f"{milliseconds(r.ours)} / {r.steps}",
            f"{milliseconds(r.same)} / {r.same_steps}",
            peer(r.guessed, r.guessed_iterations, r.guessed_verdict),
            peer(r.own_way, r.own_iterations, r.own_verdict),
        )
        for r in rows
    ]
    head = ("b", "N", "ours", "ours, given the start", "peer, the same start", "peer in its own way")
    return f"""## State by state

Milliseconds and Newton steps or iterations. *Ours* is all of it, *given the start* what is left where the
peer begins from our guesses: solve and certificate, without multipliers. The peer's is its last solve alone.

{table(head, lines)}"""


def _singles(measured: Whole) -> str:
    lines = [
        (
            str(s.segments),
            f"{milliseconds(s.ours)} ({milliseconds(s.ours_first)})",
            str(s.steps),
            _pair(s.ours_residuals),
            f"{milliseconds(s.peer)}",
            str(s.iterations),
            _pair(s.peer_residuals),
            f"{s.build:.2f}",
            f"{s.ratio:.1f}",
            s.peer_verdict,
        )
        for s in measured.singles
    ]
    head = (
        "N",
        "ours, ms (first)",
        "steps",
        "residuals",
        "peer, ms",
        "iterations",
        "residuals",
        "building, s",
    )
    return f"""## Single solves at b = {measured.half_width:g}

Both from the same start without multipliers: for the coarsest grid the state of the width before, for the
others the prolongation of the state with half as many segments. Ours holds the certificate; in brackets its
first solve at this N here. Residuals are those of the Lagrangian's gradient and of constraints as written.

{table((*head, "ratio", "the peer's is a"), lines)}"""


def _pair(values: tuple[float, float]) -> str:
    return " / ".join(f"{v:.0e}" for v in values)


def _refinements(found: list[Refinement]) -> str:
    lines = []
    for r in found:
        phases = r.phases[0] if len(r.phases) == 1 else f"{r.phases[0]}, then {r.phases[1]}"
        lines.append((f"{r.half_width:g}", str(r.segments), phases, *_way(r.smooth), *_way(r.split)))
    head = (
        "b",
        "to N",
        "phases tried",
        "at start",
        "most",
        "steps",
        "ms",
        "split: at start",
        "most",
        "steps",
        "ms",
    )
    smooth, split = (sum(getattr(r, way).steps for r in found) for way in ("smooth", "split"))
    second = [r for r in found if len(r.phases) > 1]
    where = "; ".join(f"b = {r.half_width:g}, N = {r.segments}" for r in second) or "nowhere"
    return f"""## Newton steps of a refinement

Smooth prolongation beside the splitting of facets in Koldaev (2022), section 3.1, from the same coarse
minima. Negative eigenvalues of the projected Hessian are counted at the start, with multipliers by least
squares, and the most at any step. Steps are those of all grid phases tried; the second was needed: {where}.
In all {smooth} steps, {split} by splitting. Where splitting ends elsewhere than on the minimum, it says so.

{table(head, lines)}"""


def _strips(strips: Strips) -> str:
    cost = strips.cost
    costs = [("closed band", f"{1000 * cost.band:.2f}", "")]
    costs += [(f"strip, {r} rule", f"{1000 * s:.2f}", f"{cost.ratio(r):.2f}") for r, s in cost.strips.items()]
    totals = []
    for path in strips.paths:
        for peer in PEERS:
            ours, theirs = path.seconds(peer)
            found = f"{len(path.common(peer))} of {len(path.steps)}"
            totals.append((path.rule, peer, found, f"{ours:.2f}", f"{theirs:.2f}", f"{path.ratio(peer):.2f}"))
    first, last = strips.paths[0], strips.paths[0].steps[-1]
    return f"""## Strips between clamps

Seconds of the processor; medians in turn. One Newton step at N = {cost.segments}: derivatives, matrix,
factors and solution.

{table(("", "ms", "ratio to the band's"), costs)}

A strip at span {SPAN:g} l, b = {HALF_WIDTH:g} l, is sheared to {last.shear:g} l at N = {first.segments},
in {len(first.steps)} equal steps; `bench/strips.py` is the peer's problem. Each step begins for both at our
certified state of the step before. Ours has its multipliers, and holds the certificate, the guard of Tw + Wr
and the check that the branch was kept. The peer begins without multipliers, which it then estimates, and with
ours. Passes of the path: {strips.repeats}. Sums are over the steps that both end on the same equilibrium. The
path stops short of a shear of 0.2 l, where the branch loses its stability: beyond, the two end on different
states. Required is the ratio under the first rule, the default, with the peer at its best. What the peer
loses, it loses in the first steps; a later one takes it about as long as us with all our checks.

{table(("rule", "peer", "same equilibrium", "ours, s", "peer, s", "ratio"), totals)}

{_shear_steps(strips.paths)}"""


def _shear_steps(paths: list[ShearPath]) -> str:
    head = ["shear"]
    for path in paths:
        head += [f"{path.rule}: ours", *(f"peer {peer}" for peer in PEERS)]
    lines = []
    for steps in zip(*(path.steps for path in paths), strict=True):
        line = [f"{steps[0].shear:g}"]
        for step in steps:
            line.append(f"{milliseconds(step.ours.seconds)} / {step.ours.iterations}")
            for peer in PEERS:
                found = step.peers[peer]
                elsewhere = "" if found.same else " (elsewhere)"
                line.append(f"{milliseconds(found.seconds)} / {found.iterations}{elsewhere}")
        lines.append(tuple(line))
    return f"Milliseconds and Newton steps or iterations:\n\n{table(tuple(head), lines)}"


def _way(way: Way) -> tuple[str, str, str, str]:
    steps = str(way.steps) if way.end == "minimum" else f"{way.steps} ({way.end})"
    return str(way.at_start), str(way.most), steps, milliseconds(way.seconds)
