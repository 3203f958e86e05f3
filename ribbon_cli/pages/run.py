"""A run on one page: what was asked for, what came of it, and what a referee would want to see of it."""

from __future__ import annotations

from ribbon_cli.analysis import multiplier_curves, run_table
from ribbon_cli.errors import UsageError
from ribbon_cli.export.series import branch, courses, finest, latest
from ribbon_cli.export.words import MEETS_ITSELF, meets_unheld
from ribbon_cli.pages.columns import OF_STATES, listing, named_for, number
from ribbon_cli.pages.html import Cell, heading, page, paragraph, picture, preformatted, table
from ribbon_cli.plot.figure import image
from ribbon_cli.plot.kinds import Source, draw
from ribbon_cli.plot.style import Style
from ribbon_cli.report.tables import RENDERERS
from ribbon_cli.store import Run, StateRecord
from ribbon_cli.store.summaries import varying
from ribbon_cli.study import standing

SCREEN = Style("screen", 6.3, 8.0, 1.0, 0.35, 3.0, 130)
"""The look of `paper` with dots enough for a screen."""
MOST_SHAPES = 3
_PROVENANCE = ("argv", "started", "hostname", "platform", "git_revision", "git_dirty", "blas", "blas_threads")


def run_page(run: Run) -> bytes:
    """The page of a run, from what is stored. Raises UsageError for a run without equilibria, StoreError."""
    shown = finest(run)
    records = [run.load(state.label) for state in shown]
    states = latest(run.states())
    body = [heading(1, f"Run {run.short_name}"), *_summary(run, records)]
    body += [heading(2, "Equilibria"), listing(named_for(STATES, states), states)]
    body += [heading(2, "Shapes"), *_shapes(run, records)]
    body += [heading(2, "Fields and branch"), *_pictures(run)]
    body += [heading(2, "Convergence"), *_convergence(run)]
    body += [heading(2, "How it was reached"), *_stages(run)]
    body += [heading(2, "Config as written"), preformatted((run.path / "config.yaml").read_text("utf-8"))]
    body += [heading(2, "Config as resolved"), preformatted((run.path / "resolved.yaml").read_text("utf-8"))]
    body += [heading(2, "Provenance"), _provenance(records)]
    return page(f"Run {run.short_name}", body)


def _summary(run: Run, records: list[StateRecord]) -> list[str]:
    """What the run is and whether it can be relied on, in a few sentences."""
    states, every = run.states(), run.states(all=True)
    certified = sum(state.certified for state in states)
    kinds: dict[str, int] = {}
    for state in every:
        kinds[state.kind] = kinds.get(state.kind, 0) + 1
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    touching = [state.half_width for state in states if meets_unheld(state)]
    contact = "No self-contact without forces."
    if not any(state.self_contact for state in states):
        contact = "No self-contact."
    if touching:
        contact = (
            f"Self-contact at {len(touching)} of the equilibria, the narrowest b = {min(touching):.10g}: "
            f"there the band {MEETS_ITSELF}, whatever its certificate."
        )
    worst = max((r for state in states if (r := state.kkt_residual) is not None), default=float("nan"))
    linking = sorted(
        {round(state.linking_number, 6) + 0.0 for state in states if state.linking_number is not None}
    )
    name = "Linking numbers" if states[0].sigma else "Tw + Wr"
    again = len(states) - len(latest(states))
    rest = f" (of {again} another at the same half-width and N is listed)" if again else ""
    where = "places" if varying(states) else "half-widths"
    return [
        *(paragraph(f"{line}.", "no") for line in standing(run).failures),
        paragraph(
            f"{run.name}: {len(states)} equilibria{rest} at {len(records)} {where}, {certified} "
            f"certified minima of their discrete problem: stationary, no facet inverted, positive definite "
            f"on the constraints by exact count. Stored states: {counts}."
        ),
        paragraph(
            f"{name} found: {', '.join(f'{lk:g}' for lk in linking)}. Largest gradient residual of "
            f"an equilibrium: {worst:.1e}. {contact}"
        ),
    ]


STATES = {name: OF_STATES[name] for name in ("b", "N", "label", "E", "status")} | {
    "certificate": lambda state: ("yes", "yes") if state.certified else ("no", "no"),
    "contact": lambda state: (
        ("yes", "no") if meets_unheld(state) else "at rest" if state.self_contact else "no"
    ),
    "neg.": lambda state: ("?" if (k := state.negative_eigenvalues) is None else str(k), "n"),
    "gradient": lambda state: number(state.kkt_residual, ".1e"),
    "constraints": lambda state: number(state.constraint_residual, ".1e"),
    "Lk": lambda state: number(None if (lk := state.linking_number) is None else round(lk, 6), "g"),
    "clearance": lambda state: number(state.clearance, ".3g"),
}
"""Columns of the table of equilibria, with their certificates."""


def _shapes(run: Run, records: list[StateRecord]) -> list[str]:
    """The shapes in a row, and a few alone."""
    out = []
    if len(records) > 1:
        out.append(_picture(run, "family", ()))
    step = max(1, -(-len(records) // MOST_SHAPES))
    out += [_picture(run, "shape", (record,)) for record in records[::step]]
    return out


def _pictures(run: Run) -> list[str]:
    """What else can be drawn of the run."""
    kinds = ["geometry", "multipliers"]
    if len(branch(run)) > 1 or courses(run):
        kinds.append("branch")
    out = [_picture(run, kind, ()) for kind in kinds]
    try:
        out.append(_picture(run, "spectrum", ()))
    except UsageError as error:
        out.append(paragraph(f"No spectra: {error}"))
    return out


def _convergence(run: Run) -> list[str]:
    """The table, and its picture where there are two levels."""
    out = [preformatted(RENDERERS["text"](run_table(run)))]
    try:
        out.append(_picture(run, "convergence", ()))
    except UsageError:
        out.append(paragraph("One level of refinement only: nothing can be said of N to infinity."))
    return out


def _picture(run: Run, kind: str, states: tuple[StateRecord, ...]) -> str:
    """A picture with its caption. Raises UsageError where the data lack for it."""
    drawn = draw(kind, Source(run, states, run_table, multiplier_curves), SCREEN)
    return picture(image(drawn.figure, "png", SCREEN, drawn.title, drawn.words), drawn.words)


STAGES = {
    "label": OF_STATES["label"],
    "kind": lambda record: record.kind,
    "stage": lambda record: record.stage,
    "from": lambda record: record.parent_ref or ("" if record.parent is None else str(record.parent)),
    "method": lambda record: record.method,
    "steps": lambda record: (str(record.newton_steps), "n"),
    "E": OF_STATES["E"],
    "status": OF_STATES["status"],
}
"""Columns of the table of every stored state: its stage, and where it came from."""


def _stages(run: Run) -> list[str]:
    """Every stored state, and what went on at it."""
    records = [run.load(label) for label in run.entries()]
    out = [listing(STAGES, records)]
    if events := [f"{record.label}: {event}" for record in records for event in record.events]:
        out += [heading(3, "Events, by label"), preformatted("\n".join(events))]
    return out


def _provenance(records: list[StateRecord]) -> str:
    """Which program made the shown states, where and when; what they all have in common is said once."""
    rows: list[list[Cell]] = []
    names = [name for name in records[0].provenance if name.startswith("version_") or name in _PROVENANCE]
    for name in names:
        values = list(dict.fromkeys(str(record.provenance.get(name, "")) for record in records))
        rows.append([name, values[0] if len(values) == 1 else f"{values[0]} ... {values[-1]}"])
    seconds = sum(float(record.provenance.get("cpu_seconds", 0.0)) for record in records)
    rows.append(["cpu_seconds of the states shown", f"{seconds:.2f}"])
    return table(("", ""), rows)
