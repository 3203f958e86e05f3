"""How states and runs are displayed: in a line, and as HTML in notebooks.

Every display of a state says whether it has a certificate and whether the band meets itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ribbon_cli import api, digits, export, plot
from ribbon_cli.errors import RibbonError
from ribbon_cli.pages import html
from ribbon_cli.pages.columns import OF_STATES, contact, listing, named_for
from ribbon_cli.store import Summary, content_sha256
from ribbon_cli.text import visible

SHOWN = 12
"""Most states that a run's display lists."""


def state_text(state: api.OpenState) -> str:
    """A state in a line."""
    taken = f"; {state.choice}" if state.choice else ""
    return visible(f"<state {plot.figure.state_caption((state,), state.run_name)}{taken}>")


def state_html(state: api.OpenState) -> str:
    """A state as a small table."""
    linking = "Tw + Wr" if state.seam_open else export.words.linking_name((state,))
    others = export.words.others_in_words(state)
    rows: list[tuple[str, html.Cell]] = [
        ("certificate", (export.words.verdict(state), _mark(state.certified and state.kind != "auxiliary"))),
        ("self-contact", contact(state)),
        ("b", f"{state.half_width:.10g}"),
        *([("parameters", others)] if others else []),
        ("N", str(state.segments)),
        ("E", digits.energy(state.energy)),
        (linking, _number(state.linking_number)),
        ("clearance", f"{state.clearance:.4g}"),
        ("residuals", f"gradient {state.kkt_residual:.1e}, constraints {state.constraint_residual:.1e}"),
        ("stage", state.stage),
        ("sha256", content_sha256(state)[:12]),
    ]
    if state.choice:
        rows.append(("taken", state.choice))
    head = (f"state {plot.figure.reference(state, state.run_name)}", state.kind)
    return html.table(head, rows)


def run_text(run: api.OpenRun) -> str:
    """A run in a line."""
    try:
        states, lost = run.found()
    except RibbonError as error:
        return visible(f"<run {run.name}: {error}>")
    return visible(f"<run {run.name}: {_counts(states, len(run.entries()), len(lost))}; {run.path}>")


def run_html(run: api.OpenRun) -> str:
    """A run as a table of its equilibria, the last ones of many."""
    try:
        states, lost = run.found()
    except RibbonError as error:
        return html.paragraph(f"run {run.name}: {error}")
    title = html.paragraph(f"run {run.name}: {_counts(states, len(run.entries()), len(lost))}")
    left = len(states) - SHOWN
    more = html.paragraph(f"the last {SHOWN}; `run.table()` has {left} before them") if left > 0 else ""
    return title + listing(named_for(_STATES, states), states[-SHOWN:]) + more


_STATES = dict(OF_STATES) | {
    "Lk": lambda state: "–" if state.linking_number is None else _number(state.linking_number),
    "self-contact": contact,
    "certificate": lambda state: ("certified", "yes") if state.certified else ("no certificate", "no"),
}


def _counts(states: Sequence[Summary], stored: int, lost: int) -> str:
    """How many states there are, of which kinds, and where."""
    if not states:
        return f"no equilibria, {stored} other states"
    certified = sum(state.certified for state in states)
    meeting = sum(map(export.words.meets_unheld, states))
    resting = sum(state.self_contact for state in states) - meeting
    widths = sorted({state.half_width for state in states})
    meshes = sorted({state.segments for state in states})
    words = [
        f"{certified} of {len(states)} equilibria certified",
        f"{meeting} in self-contact without forces" if meeting else "" if resting else "none in self-contact",
        f"{resting} at rest on themselves" if resting else "",
        f"{lost} with files lost or damaged" if lost else "",
        f"b = {_span(widths)}",
        f"N = {_span(meshes)}",
        f"{stored - len(states)} other states",
    ]
    return ", ".join(filter(None, words))


def _span(values: Sequence[float]) -> str:
    """Ascending values, or their ends where they are many."""
    texts = [f"{value:.10g}" for value in values]
    return ", ".join(texts) if len(texts) <= 4 else f"{texts[0]} to {texts[-1]} ({len(texts)})"


def _number(value: float) -> str:
    """A linking number; rounding errors of zero are zero."""
    return f"{round(value, 4) + 0.0:g}" if math.isfinite(value) else "-"


def _mark(good: bool) -> str:
    return "yes" if good else "no"
