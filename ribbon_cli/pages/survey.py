"""A survey on one page: its equilibria, a picture of each, and how complete it is."""

from __future__ import annotations

from ribbon_cli import digits
from ribbon_cli.analysis import multiplier_curves, run_table
from ribbon_cli.pages.html import Cell, heading, page, paragraph, picture, preformatted, table
from ribbon_cli.pages.run import SCREEN
from ribbon_cli.plot.counts import accumulation_figure
from ribbon_cli.plot.figure import image
from ribbon_cli.plot.kinds import Source, draw
from ribbon_cli.plot.style import styled
from ribbon_cli.store import Run
from ribbon_cli.surveys import Equilibrium, Findings, findings
from ribbon_cli.surveys.text import CENSUS, cells, census_rows, contact, heads, in_vain, ways

WORDS = {"continuum": "yes", "mesh": "no", "open": "open"}
"""Classes of cells for what an equilibrium is called."""


def survey_page(run: Run) -> bytes:
    """The page of a survey's run, from what is stored. Raises UsageError, StoreError."""
    found = findings(run)
    body = [heading(1, f"Survey {run.short_name}"), *_summary(found)]
    body += [heading(2, "Equilibria"), _table(found), *_reasons(found)]
    body += [heading(2, "How complete"), *_census(found)]
    body += [heading(2, "Shapes"), *(_shape(run, row) for row in found.equilibria)]
    body += [heading(2, "Config as written"), preformatted((run.path / "config.yaml").read_text("utf-8"))]
    return page(f"Survey {run.short_name}", body)


def _summary(found: Findings) -> list[str]:
    counts = {word: sum(row.verdict == word for row in found.equilibria) for word in WORDS}
    return [
        paragraph(
            f"{len(found.equilibria)} equilibria at b = {found.half_width:.10g}, N = {found.segments}, told "
            "apart up to rotation, sliding and mirror image. Followed to 2N, 4N and 8N, "
            f"{counts['continuum']} were met again on each mesh, with energies that converge (continuum), "
            f"{counts['mesh']} were lost (mesh), and of {counts['open']} neither is known (open)."
        ),
        paragraph(f"{ways(found)}.", "note"),
        *(paragraph(f"{line}.", "no") for line in filter(None, [in_vain(found)])),
    ]


def _table(found: Findings) -> str:
    names = heads(found)
    rows = []
    for row in found.equilibria:
        marked: list[Cell] = []
        for name, text in zip(names, cells(row, found), strict=True):
            if name == "is":
                marked.append((text, WORDS[text]))
            elif name == "contact":
                marked.append((text, "no") if row.self_contact and not row.contacts else text)
            else:
                marked.append(text if name == "symmetry" else (text, "n"))
        rows.append(marked)
    return table(names, rows)


def _reasons(found: Findings) -> list[str]:
    told = [f"{row.number}: {row.verdict}, {row.why}" for row in found.equilibria if row.why]
    return [preformatted("\n".join(told))] if told else []


def _census(found: Findings) -> list[str]:
    """The curve and its estimates."""
    text = (
        "Hits are ways that led to an equilibrium. Coverage is the chance that the next hit is on a known "
        "one; Chao1 and ACE estimate how many there are in all, from how many were met once and twice. They "
        "are lower bounds: of what such starts hardly ever lead to they know nothing."
    )
    out = [
        paragraph(text),
        table(CENSUS, [[name, *((cell, "n") for cell in rest)] for name, *rest in census_rows(found)]),
    ]
    if len(found.curve) > 1:
        whole = list(found.estimates.values())[-1]
        words = "Expected number of equilibria against the number of hits, with the estimate of all of them"
        with styled(SCREEN):
            figure = accumulation_figure(found.curve, None if whole is None else whole.chao1, SCREEN)
        out.append(picture(image(figure, "png", SCREEN, "Survey", words), f"{words}."))
    return out


def _shape(run: Run, row: Equilibrium) -> str:
    """A picture of an equilibrium on its finest mesh."""
    record = run.load(row.labels[-1] if row.labels else row.label)
    drawn = draw("shape", Source(run, (record,), run_table, multiplier_curves), SCREEN)
    meets = contact(row)
    told = f", {meets}" if meets else ""
    words = (
        f"{row.number}: {row.verdict}. E = {digits.energy(record.energy)}, N = {record.segments}, "
        f"index {row.index}, {row.inflections} inflections, symmetry {row.symmetry}{told}"
    )
    return picture(image(drawn.figure, "png", SCREEN, drawn.title, words), words)
