"""Bands at rest on themselves towards the widest that there can be: E (b* - b) over b."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import ribbon_cli as ribbon
from ribbon_cli import digits
from ribbon_cli.report.tables import MISSING
from ribbon_cli.store import Summary
from ribbon_cli.text import aligned

HEADS = ("band", "b", "N", "E", "E (b* - b)", "contacts", "force", "certificate")


@dataclass(frozen=True)
class Limit:
    """The band of a config: its name, and b* at the length 2 pi with what it is; None where none is known."""

    config: str
    band: str
    widest: float | None
    known: str = ""


LIMITS = (
    Limit("pi-400", "π", math.pi / math.sqrt(3.0), "theorem, Schwartz (2023)"),
    Limit("figure-eight", "2π", 0.5 * math.pi, "theorem"),
    Limit("3pi", "3π", math.pi / 3.0, "conjecture, Brown and Schwartz (2023)"),
    Limit("5pi", "5π", None),
    Limit("7pi", "7π", None),
)


def limits_text(configs: Path, runs: Path, progress: bool) -> str:
    """Solve configs/contact, and the table of the states that rest on themselves, by band and width."""
    rows: list[tuple[str, ...]] = [HEADS]
    for limit in LIMITS:
        run = ribbon.solve(configs / "contact" / f"{limit.config}.yaml", runs=runs, progress=progress).run
        rows += [_row(limit, state) for state in run.states() if state.contacts]
    known = [
        f"{limit.band}: b* = "
        + ("not known" if limit.widest is None else f"{limit.widest:.6g}, {limit.known}")
        for limit in LIMITS
    ]
    return "\n".join([aligned(rows, left={0, len(HEADS) - 1}), "", *known]) + "\n"


def _row(limit: Limit, state: Summary) -> tuple[str, ...]:
    energy = math.nan if state.energy is None else state.energy
    far = None if limit.widest is None else energy * (limit.widest - state.half_width)
    return (
        limit.band,
        f"{state.half_width:.6g}",
        str(state.segments),
        digits.energy(energy),
        MISSING if far is None else digits.significant(far, 4),
        str(state.contacts),
        digits.significant(state.contact_force or 0.0, 5),
        "yes" if state.certified else state.status,
    )
