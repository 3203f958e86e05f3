"""The page that sets every figure beside its config, what the thesis says of it, and whether that holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ribbon_cli.pages.html import heading, page, paragraph, picture, preformatted, table

if TYPE_CHECKING:
    from paper.claims import Check
    from paper.figures import Item, Made

TITLE = "Chapter 3 of Koldaev (2022), made anew"


def paper_page(
    items: Mapping[str, Item],
    made: Mapping[str, Made],
    images: Mapping[str, bytes],
    configs: Mapping[str, str],
) -> bytes:
    """The page of what was made; `images` are PNGs by name, `configs` the texts of configs by name."""
    checks = [(name, check) for name in made for check in made[name].checks]
    counts = {value: sum(check.agrees is value for _, check in checks) for value in (True, False, None)}
    body = [
        heading(1, TITLE),
        paragraph(
            "Figures and tables of D. Koldaev, Mathematical Modeling and Numerical Analysis of Unstretchable "
            "Elastic Ribbons (2022), from our own runs. Captions and claims are in our words; of the thesis "
            "there are the numbers of Table 3.1."
        ),
        paragraph(
            f"{len(checks)} claims were checked: {counts[True]} hold, {counts[False]} do not, "
            f"{counts[None]} could not be decided. The thesis names no tolerances; those under “holds if” "
            "are ours, with the number found beside them. A minimum is one of the discrete energy on its "
            "mesh, its negative eigenvalues counted exactly, and says nothing of the continuum."
        ),
        heading(2, "Claims that do not hold", "differ"),
        _checks([(name, check) for name, check in checks if check.agrees is False]),
    ]
    for name, found in made.items():
        item = items[name]
        body.append(heading(2, name.replace("-", " ").capitalize(), name))
        if name in images:
            body.append(picture(images[name], item.caption))
        else:
            body.append(paragraph(item.caption))
        if item.remarks:
            body.append(paragraph(item.remarks, "note"))
        body += [preformatted(found.texts["txt"])] if "txt" in found.texts else []
        body.append(paragraph(f"States: {', '.join(found.sources)}.", "note"))
        if found.checks:
            body.append(_checks([("", check) for check in found.checks]))
        for config in item.configs:
            body += [paragraph(f"configs/{config}.yaml", "note"), preformatted(configs[config])]
    return page(TITLE, body)


def _checks(checks: list[tuple[str, Check]]) -> str:
    """Claims in a table, with the figures' names where there are several."""
    named = any(name for name, _ in checks)
    words = {True: ("holds", "yes"), False: ("does not hold", "no"), None: ("not decided", "open")}
    head = [*(["figure"] if named else []), "claim", "holds if", "found", "", "note"]
    rows: list[list[str | tuple[str, str]]] = [
        [
            *([name] if named else []),
            check.claim,
            check.expected,
            check.found,
            words[check.agrees],
            check.note,
        ]
        for name, check in checks
    ]
    return table(head, rows) if rows else paragraph("None.")
