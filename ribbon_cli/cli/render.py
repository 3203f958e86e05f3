"""Text for people: tables and listings of runs, states, plans and outcomes.

Everything here turns plain values into text and computes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ribbon_cli import digits, store, study, sweeps
from ribbon_cli.export.words import linking_name, meeting
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.text import aligned, ranges, visible

if TYPE_CHECKING:
    from ribbon_cli.store import StateRecord, Summary
    from ribbon_cli.store.events import Event

MISSING = "-"

_LEFT = frozenset(
    {
        "type",
        "status",
        "place",
        "kind",
        "stage",
        "run",
        "last change",
        "name",
        "template",
        "field",
        "first",
        "second",
        "point",
        "why",
    }
)
"""Columns of words; the others hold numbers and are aligned on the right."""


def columns(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Aligned columns under `heads`, two spaces apart."""
    left = {k for k, head in enumerate(heads) if head in _LEFT}
    return aligned([heads, *map(_visible_row, rows)], left)


def _visible_row(row: Sequence[str]) -> Sequence[str]:
    """A row's texts, made visible where one of them needs it; hardly any row does."""
    return row if "".join(row).isprintable() else tuple(map(visible, row))


def number(value: float | int | None, spec: str = "") -> str:
    """A number by a format specification; a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return MISSING
    return format(value, spec)


def energy(value: float | None) -> str:
    """An energy; a dash where there is none."""
    return MISSING if value is None or math.isnan(value) else digits.energy(value)


def _figures(state: Summary, heads: Sequence[str]) -> list[str]:
    """Energy, status, linking number, contact, residuals and certificate of a state, as `heads` name them."""
    return [
        energy(state.energy),
        status_in_words(state),
        _linking_number(state.linking_number),
        _contact(state.self_contact, state.contacts),
        *([number(state.contact_force, ".6g")] if _FORCE in heads else []),
        number(state.kkt_residual, ".1e"),
        number(state.constraint_residual, ".1e"),
        "yes" if state.certified else "no",
    ]


def status_in_words(state: Summary | StateRecord) -> str:
    """A state's status; for an auxiliary state, which problem's minimum it is."""
    if (state.kind, state.status) == ("auxiliary", "minimum"):
        return "minimum of the auxiliary problem"
    return state.status


def certificate_in_words(state: Summary | StateRecord) -> str:
    """Whether a state is certified, and how its band meets itself, which a certificate allows."""
    return ", ".join(filter(None, [_plain(state.certified), meeting(state)]))


def _contact(meets: bool, contacts: int | None) -> str:
    """Whether a band meets itself; with contact forces, on how many contacts it rests."""
    if not meets or not contacts:
        return "yes" if meets else "no"
    return f"at {contacts}"


def _linking_number(value: float | None) -> str:
    """Lk or, of open seams, Tw + Wr to four decimals; rounding errors of zero are zero."""
    return MISSING if value is None else f"{round(value, 4) + 0.0:g}"


_FORCE = "force"
_FIGURES = ("E", "status", "Lk", "contact", _FORCE, "gradient", "constraint", "certificate")


def _heads(states: Collection[Summary]) -> list[str]:
    """Names of the figures of states; forces where some were computed with contact forces."""
    name, forced = linking_name(states), any(state.with_forces for state in states)
    return [name if head == "Lk" else head for head in _FIGURES if head != _FORCE or forced]


def states_table(states: Sequence[Summary], kinds: bool) -> str:
    """The states of a run, with the parameters that they differ in, and with kind and stage if `kinds`."""
    moved = store.varying(states)
    figures = _heads(states)
    heads = ["label", "b", *moved, "N", *figures, *(("kind", "stage") if kinds else ())]
    rows = (
        [
            str(state.label),
            number(state.half_width, ".10g"),
            *(number(state.parameters.get(name), ".10g") for name in moved),
            str(state.segments),
            *_figures(state, figures),
            *((state.kind, state.stage) if kinds else ()),
        ]
        for state in states
    )
    return columns(heads, rows)


def targets_table(targets: Iterable[study.Target], states: Mapping[int, Summary]) -> str:
    """The result for each target; `states` holds the summaries by label. Other parameters stand beside b."""
    rows, targets, heads = [], list(targets), _heads(states.values())
    named = any(target.place for target in targets)
    for target in targets:
        state = None if target.label is None else states.get(target.label)
        word = "beyond contact" if target.beyond else "not reached"
        word = "not met" if target.of_branch else word
        empty = [MISSING, word, *[MISSING] * (len(heads) - 2)]
        figures = empty if state is None else _figures(state, heads)
        label = MISSING if target.label is None else str(target.label)
        place = target.where if named else number(target.half_width, ".10g")
        rows.append([place, str(target.segments), label, *figures])
    return columns(["place" if named else "b", "N", "label", *heads], rows)


def branch_text(course: study.Course) -> str:
    """A branch: its points in a table, then why it ends."""
    title = visible(f"{course.name}, from state {course.start}")
    why = visible(f"({course.reason}): {course.message}")
    end = f"ends at {course.place} {why}"
    return f"{title}\n{branch_table(course)}\n{end}" if course.points else f"{title}: {end}"


def branch_table(course: study.Course) -> str:
    """The points of a branch: label, type, its parameter, E, index, lowest eigenvalue, Lk and contact.

    For a strip, Tw + Wr takes the place of Lk, and there is no sliding. Contact forces have a column where
    there are some.
    """
    name = course.parameter
    strips = any("gravity" in point.parameters for point in course.points)
    forced = any(point.contacts is not None for point in course.points)
    rows = (
        [
            str(point.label),
            point.type,
            number(point.half_width if name == HALF_WIDTH else point.parameters.get(name), ".12g"),
            energy(point.energy),
            _branch_index(point.negative_eigenvalues, point.index_before, point.index_after),
            number(point.lowest_eigenvalue, ".3e"),
            *([] if strips else [number(point.sliding_overlap, ".2f")]),
            _linking_number(point.linking_number),
            _contact(point.self_contact, point.contacts),
            *([number(point.contact_force, ".6g")] if forced else []),
            point.status,
        ]
        for point in course.points
    )
    turns = ["Tw+Wr"] if strips else ["sliding", "Lk"]
    contact = ("contact", _FORCE) if forced else ("contact",)
    heads = ["label", "type", PARAMETERS[name].symbol, "E", "index", "lowest", *turns, *contact, "status"]
    return columns(heads, rows)


def _branch_index(negative: int | None, before: int | None, after: int | None) -> str:
    """The number of negative eigenvalues; at a singular point those on either side."""
    if before is None and after is None:
        return number(negative)
    return f"{number(before)} to {number(after)}"


def runs_table(runs: Iterable[study.Standing]) -> str:
    """The runs in a folder."""
    rows = []
    for found in runs:
        counts = found.counts
        numbers = (counts.done, counts.running, counts.waiting, counts.failed, found.states)
        rows.append([found.run.name, found.status, *map(number, numbers), found.last_change or MISSING])
    heads = ["run", "status", "done", "running", "waiting", "failed", "states", "last change"]
    return columns(heads, rows)


def listing(values: Mapping[str, Any]) -> str:
    """Names and values, a line each; a mapping's own names are indented, a list stays on its line."""
    return "\n".join(_listing_lines(values, ""))


def _listing_lines(values: Mapping[str, Any], indent: str) -> list[str]:
    plain = [name for name, value in values.items() if not isinstance(value, Mapping)]
    width = max((len(visible(name)) for name in plain), default=0)
    lines = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{visible(name)}:", *_listing_lines(value, f"{indent}  ")]
        else:
            lines.append(f"{indent}{visible(name):{width}}  {_plain(value)}".rstrip())
    return lines


def _plain(value: Any) -> str:
    """One value as text."""
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return MISSING if math.isnan(value) else f"{value:.10g}"
    if isinstance(value, list | tuple):
        return "; ".join(map(_plain, value)) or "none"
    return visible(str(value)) or MISSING


def history_lines(events: Iterable[Event]) -> dict[str, str]:
    """The log's events other than states, by time: the event and its text."""
    lines: dict[str, str] = {}
    for event in events:
        document = event.document
        notes = document.get("notes")
        more = ": " + "; ".join(map(str, notes)) if isinstance(notes, list) and notes else ""
        label = f" {document['label']}" if "label" in document else ""
        label += f" {ranges(event.labels)}" if isinstance(event, store.events.Removed) else ""
        lines[event.time] = "; ".join(filter(None, [lines.get(event.time), f"{event.kind}{label}{more}"]))
    return lines


def gathered(causes: Iterable[tuple[str, str]]) -> list[str]:
    """Failures, one line for each cause: `b = 0.5, N = 50; b = 0.5, N = 100: not reached: ...`."""
    places: dict[str, list[str]] = {}
    for place, cause in causes:
        places.setdefault(cause, []).append(place)
    return [f"{'; '.join(group)}: {cause}" for cause, group in places.items()]


def counts_text(counts: Mapping[str, int]) -> str:
    """How many points of a sweep stand where: `57 done, 3 failed`."""
    return ", ".join(f"{count} {status}" for status, count in counts.items() if count) or "no points"


def points_table(points: Iterable[sweeps.PointStanding]) -> str:
    """Where the points of a sweep stand, and why."""
    rows = [[p.point.name, p.status, "; ".join(p.failures) or p.words] for p in points]
    return columns(["point", "status", "why"], rows)


def plan_table(stages: Sequence[study.PlannedStage], whole: bool) -> str:
    """The stages of a plan; long series of one kind shortened to their ends unless `whole`."""
    rows: list[list[str]] = []
    for index, stage in enumerate(stages):
        if whole or not _inside(stages, index):
            place = [number(stage.half_width, ".10g"), number(stage.segments)]
            rows.append([str(index + 1), stage.name, stage.kind, *place])
        elif rows[-1][0] != "...":
            rows.append(["...", "...", "", "", ""])
    return columns(["", "stage", "kind", "b", "N"], rows)


def _inside(stages: Sequence[study.PlannedStage], index: int) -> bool:
    """Whether a stage and two neighbours on either side are of one kind, other than equilibrium."""
    if not 2 <= index < len(stages) - 2 or stages[index].kind == "equilibrium":
        return False
    return len({stage.kind for stage in stages[index - 2 : index + 3]}) == 1
