"""A survey in text: its table of equilibria, and what it says of its completeness."""

from __future__ import annotations

from collections.abc import Sequence

from .. import digits
from ..export.words import MEETS_ITSELF
from ..text import aligned
from .census import Estimate
from .reading import Equilibrium, Findings

_WORDS = {"found", "symmetry", "is", "equilibria", "contact"}


def heads(found: Findings) -> list[str]:
    """Names of the columns of the table of equilibria."""
    finer = [f"E, N = {n}" for n in meshes(found)]
    named = [f"E, N = {found.segments}", "index", found.linking_name, "inflections"]
    return ["no.", "label", *named, "symmetry", "contact", "hits", "is", *finer]


def meshes(found: Findings) -> list[int]:
    """The finer meshes that something was met on."""
    return sorted({n for row in found.equilibria for n in row.segments})


def contact(row: Equilibrium) -> str:
    """How an equilibrium meets itself, on how many contacts it rests; empty where it does not."""
    if row.contacts:
        return f"rests on itself at {row.contacts} contact{'s' * (row.contacts > 1)}"
    return MEETS_ITSELF if row.self_contact else ""


def cells(row: Equilibrium, found: Findings) -> list[str]:
    """A row of the table of equilibria."""
    finer = dict(zip(row.segments, row.energies, strict=True))
    last = row.indices[-1] if row.indices else row.index
    linking = "-" if row.linking_number is None else f"{round(row.linking_number, 4) + 0.0:g}"
    return [
        str(row.number),
        str(row.label),
        digits.energy(row.energy),
        str(row.index) if last == row.index else f"{row.index}, then {last}",
        linking,
        str(row.inflections),
        row.symmetry,
        contact(row) or "no",
        str(row.hits),
        row.verdict,
        *(digits.energy(finer[n]) if n in finer else "-" for n in meshes(found)),
    ]


def survey_text(found: Findings) -> str:
    """The whole survey."""
    if not found.equilibria:
        return f"{ways(found)}\n{in_vain(found)}"
    names = heads(found)
    left = {k for k, name in enumerate(names) if name in _WORDS}
    table = aligned([names, *(cells(row, found) for row in found.equilibria)], left)
    reasons = [f"{row.number}: {row.verdict}, {row.why}" for row in found.equilibria if row.why]
    return "\n".join([table, *reasons, "", ways(found), "", census_text(found)])


def in_vain(found: Findings) -> str:
    """That a survey has found nothing, and what may help; empty where it has."""
    if found.equilibria or not found.ends:
        return ""
    where = f"b = {found.half_width:.10g}, N = {found.segments}"
    advice = "take more starts"
    if through := found.ends.get("left-topology"):
        where += f": {through} of {sum(found.ends.values())} ways led through the band itself"
        advice += ", or `contact: forces`, with which a band rests on itself"
    return f"no equilibrium was found at {where}; {advice}"


def ways(found: Findings) -> str:
    """How the ways from the starts ended, in a sentence."""
    ends = "; ".join(f"{word} {count}" for word, count in found.ends.items())
    return f"{found.starts} starts, {sum(found.ends.values())} ways from them: {ends or 'none'}"


CENSUS = ("equilibria", "hits", "found", "once", "twice", "coverage", "Chao1", "ACE")
"""Columns of the table of estimates."""


def census_rows(found: Findings) -> list[list[str]]:
    """Rows of the table of estimates."""
    return [[name, *_census(one)] for name, one in found.estimates.items()]


def _census(one: Estimate | None) -> Sequence[str]:
    if one is None:
        return ("0", "0", "0", "0", "-", "-", "-")
    ace = "-" if one.ace is None else f"{one.ace:.1f}"
    numbers = (one.hits, one.found, one.once, one.twice)
    return (*map(str, numbers), f"{one.coverage:.3f}", f"{one.chao1:.1f}", ace)


def census_text(found: Findings) -> str:
    """The table of estimates."""
    return aligned([CENSUS, *census_rows(found)], {0})
