"""A comparison as a short table, then what differs: like differences together, each group with its first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from .differences import KINDS, Compared, Difference
from .expect import Expected
from .speed import Pace

_SHOWN = 12
_STATE_KINDS = ("state", "hash", "dataset")


def counts(compared: Sequence[Compared], left: Iterable[Difference]) -> Iterator[str]:
    """What was compared, and how much of it differs unexpectedly."""
    left = list(left)
    differing = {
        "states": len({(d.case, d.where) for d in left if d.kind in _STATE_KINDS}),
        "exit codes": len([d for d in left if d.kind == "exit"]),
        "JSON documents": len({(d.case, d.where) for d in left if d.kind in ("json", "json-added")}),
        "files": len({(d.case, d.where) for d in left if d.kind == "file"}),
    }
    totals = {
        "states": sum(c.states for c in compared),
        "exit codes": sum(c.steps for c in compared),
        "JSON documents": sum(c.documents for c in compared),
        "files": sum(c.files for c in compared),
    }
    yield f"{'':<20} {'compared':>9} {'differ':>7}"
    yield f"{'cases':<20} {len(compared):>9} {len({d.case for d in left}):>7}"
    for what, total in totals.items():
        yield f"{what:<20} {total:>9} {differing[what]:>7}"
    lines = sum(d.kind in ("text", "message") for d in left)
    yield f"{'lines printed':<20} {'':>9} {lines:>7}"


def details(left: Iterable[Difference], whole: bool) -> Iterator[str]:
    """The differences kind by kind; like ones as one, unless all are wanted."""
    left = list(left)
    for kind, title in KINDS.items():
        mine = [d for d in left if d.kind == kind]
        if not mine:
            continue
        yield ""
        yield f"{title}: {len(mine)}"
        groups: dict[tuple[str, ...], list[Difference]] = {}
        for difference in mine:
            groups.setdefault(_likeness(difference), []).append(difference)
        ordered = sorted(groups.values(), key=len, reverse=True)
        for group in ordered if whole else ordered[:_SHOWN]:
            yield from (_line(d) for d in group) if whole else (_group(group),)
        if not whole and len(ordered) > _SHOWN:
            yield f"  and {len(ordered) - _SHOWN} more kinds of these: --all lists them"


def _likeness(difference: Difference) -> tuple[str, ...]:
    """What like differences have in common: the path but for numbers; of lines, the command."""
    if difference.kind in ("text", "message", "file", "exit"):
        return difference.where, difference.case
    return (re.sub(r"(?<![^.])\d+(?![^.])", "*", difference.path),)


def _group(group: list[Difference]) -> str:
    """A group of like differences by its first."""
    if len(group) == 1:
        return _line(group[0])
    cases = len({d.case for d in group})
    several = f"{len(group)} times" + (f" in {cases} cases" if cases > 1 else "")
    return f"  {several}, first {_line(group[0]).strip()}"


def _line(d: Difference) -> str:
    """One difference."""
    return f"  {d.case}: {d.where}: {d.path + ': ' if d.path else ''}{d.detail}"


def expectations(expected: Sequence[Expected], covered: Sequence[int]) -> Iterator[str]:
    """How many differences each expectation covers."""
    if expected:
        yield ""
        yield "expected differences:"
    for item, number in zip(expected, covered, strict=True):
        patterns = ", ".join(f"{key} {value}" for key, value in item.patterns.items())
        yield f"  {number or 'no':>5} of {patterns}: {item.reason}"


def paces(measured: Sequence[Pace]) -> Iterator[str]:
    """Seconds side by side."""
    if not measured:
        return
    yield ""
    yield f"{'seconds (of processor)':<58} {'before':>13} {'now':>13} {'ratios':>13}"
    for pace in measured:
        pairs = (f"{wall:.3f} ({busy:.3f})" for wall, busy in (pace.before, pace.after))
        wall = pace.after[0] / pace.before[0]
        yield (
            f"{pace.what:<58} "
            + " ".join(f"{p:>13}" for p in pairs)
            + f" {f'{wall:.2f} ({pace.ratio:.2f})':>13}"
        )
