"""What `ribbon plot` can draw: each kind of picture, the states it needs, and what to say where they lack."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from ribbon_cli.errors import UsageError
from ribbon_cli.export.mesh import check_shape
from ribbon_cli.export.series import along, branch, courses, finest, followed_in, left_out, levels, value_at
from ribbon_cli.export.words import meets_unheld
from ribbon_cli.parts import HALF_WIDTH
from ribbon_cli.plot.branches import arclength_figure
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.contacts import contacts_figure
from ribbon_cli.plot.curves import Curve, geometry_figure, multipliers_figure
from ribbon_cli.plot.fields import Choice, chosen, curves, fields_figure
from ribbon_cli.plot.figure import dressed, state_caption
from ribbon_cli.plot.flat import pattern_figure
from ribbon_cli.plot.labels import (
    LISTED,
    Placed,
    band_text,
    lines,
    panel_titles,
    parameter_text,
    place_texts,
    run_texts,
    width_texts,
)
from ribbon_cli.plot.levels import (
    PlacedAt,
    branch_figure,
    convergence_figure,
    differences,
    lowest_value,
    spectrum_figure,
)
from ribbon_cli.plot.modes import ModeShape, mode_animation, mode_figure
from ribbon_cli.plot.pictures import Panel, family_figure, letters_across, shape_figure, shapes_figure
from ribbon_cli.plot.runs import MOST_RUNS, runs_figure
from ribbon_cli.plot.style import MOST_LOOKS, Style, styled
from ribbon_cli.report.convergence import Table
from ribbon_cli.report.rows import Rows
from ribbon_cli.store import Run, StateRecord, Summary
from ribbon_cli.store.refs import typed
from ribbon_cli.text import listed

T = TypeVar("T")

MOST_CURVES = 7
"""Most half-widths of a run in one panel; of states that someone names there may be `MOST_LOOKS`."""
MOST_SHAPES = 12
MOST_PANELS = 20
"""Most shapes of a sweep beside each other."""


@dataclass(frozen=True)
class Source:
    """What a reference names: states, and the run they belong to (None outside of one).

    `whole_run` says that the reference was to the run; then `states` is empty. `table` gives the run's
    convergence table, `curves` a state's multipliers beside their formulas (UsageError where it has none),
    `mode` the mode to show of a state. `angles` is a chosen view, `segments` the N to show of a run, `beside`
    are further runs. `names` are the states' references where they are of several runs, and `run_names` names
    their runs. `rows` is a table over runs and sweeps, of which `choice` says what to draw.
    """

    run: Run | None
    states: tuple[StateRecord, ...]
    table: Callable[[Run], Table]
    curves: Callable[[StateRecord], Sequence[Curve]]
    mode: Callable[[StateRecord], ModeShape] | None = None
    angles: tuple[float, float] | None = None
    segments: int | None = None
    beside: tuple[Run, ...] = ()
    names: tuple[str, ...] = ()
    run_names: tuple[str, ...] = ()
    rows: Rows | None = None
    choice: Choice = field(default_factory=Choice)

    @property
    def whole_run(self) -> bool:
        """Whether the reference names a run and no state."""
        return not self.states


@dataclass(frozen=True)
class Picture:
    """A figure with its title, the states that it shows, the mode if it shows one, and a caption, which says
    what it shows.
    """

    figure: Figure
    title: str
    states: tuple[StateRecord, ...]
    mode: ModeShape | None = None
    caption: str = ""

    @property
    def words(self) -> str:
        """Title and caption, as they stand below the picture."""
        return f"{self.title}. {self.caption}."

    def dressed(self, style: Style, caption: bool = True, title: str | None = None) -> Figure:
        """The figure in full dress; it is drawn upon, so ask for it once."""
        return dressed(self.figure, style, self.words if caption else None, title)


def draw(kind: str, source: Source, style: Style) -> Picture:
    """Draw a kind of picture. Raises UsageError, which says what to run, where the data lack for it."""
    with styled(style):
        picture = KINDS[kind](source, style)
    run = source.run.name if source.run else None
    shown = state_caption(picture.states, run, source.names) if picture.states else str(run)
    return replace(picture, caption=picture.caption or shown)


def animate(
    picture: Picture, source: Source, style: Style, caption: str | None, title: str | None = None
) -> bytes:
    """The picture of a mode as an animated GIF."""
    assert picture.mode is not None
    with styled(style):
        return mode_animation(picture.states[0], picture.mode, style, caption, source.angles, title)


def _one(source: Source, kind: str) -> StateRecord:
    """The state that a picture of one state shows."""
    if source.run is not None and source.whole_run:
        example = finest(source.run)[-1].label
        raise UsageError(
            f"{kind} shows one state: name one of {source.run.name}, "
            f"for instance {typed(source.run)}:{example}"
        )
    if len(source.states) > 1:
        raise UsageError(f"{kind} shows one state: leave --with out")
    return source.states[0]


def _run(source: Source, kind: str) -> Run:
    """The run that a picture of a run shows."""
    if source.run is None:
        raise UsageError(f"{kind} shows a run: name the run, this is a file outside of one")
    return source.run


def _several(source: Source, kind: str) -> tuple[tuple[StateRecord, ...], str]:
    """The states named, or of a run the finest of each half-width, or all widths of the N asked for.

    What of these is left out, because no more can be told apart, is said in words for the title. Raises
    UsageError where too many are named.
    """
    if source.whole_run:
        assert source.run is not None
        return _spread_out(source.run, source.segments, MOST_CURVES)
    if len(source.states) > MOST_LOOKS:
        raise UsageError(
            f"{kind} tells {MOST_LOOKS} states apart, and {len(source.states)} are named: leave some out"
        )
    return source.states, ""


def _spread_out(run: Run, segments: int | None, most: int) -> tuple[tuple[StateRecord, ...], str]:
    """At most so many widths of a run, and words for the title where that are not all of them."""
    found = branch(run, segments) if segments else finest(run)
    if found[0].sigma == 0:  # a schedule leads where it wants: as it was walked
        found = sorted(found, key=lambda state: state.label)
    chosen = _thinned(found, most)
    note = _without(found, chosen)
    return tuple(run.load(state.label) for state in chosen), note + left_out(run, chosen)


def _thinned(items: Sequence[T], most: int) -> list[T]:
    """At most so many of the items, the first and the last among them, evenly spread."""
    if len(items) <= most:
        return list(items)
    return [items[round(k * (len(items) - 1) / (most - 1))] for k in range(most)]


def _without(found: Sequence[Placed], chosen: Sequence[Placed]) -> str:
    """Words for the title where of some places not all were chosen: how many, and which are left out."""
    if len(chosen) == len(found):
        return ""
    kept = {id(place) for place in chosen}
    if len({place.half_width for place in found}) == len(found):
        texts = width_texts([place.half_width for place in found])
        what, start = "half-widths", "b = "
    else:
        texts, what, start = [text.replace("$", "") for text in place_texts(found)], "places", ""
    without = listed(
        (text for place, text in zip(found, texts, strict=True) if id(place) not in kept), LISTED
    )
    return f", {len(chosen)} of {len(found)} {what}, without {start}{without}"


def _shape(source: Source, style: Style) -> Picture:
    states = source.states
    if len(states) < 2:
        record = _one(source, "shape")
        return Picture(shape_figure(record, style, source.angles), "Shape", (record,))
    titles = panel_titles(states, source.run_names, letters_across(len(states), style))
    panels = [Panel(record, title) for record, title in zip(states, titles, strict=True)]
    return Picture(shapes_figure(panels, style, aligned=True, angles=source.angles), "Shapes", states)


def _geometry(source: Source, style: Style) -> Picture:
    states, note = _several(source, "geometry")
    figure = geometry_figure(states, style, source.run_names)
    return Picture(figure, f"Signed curvature, torsion, eta and eta'{note}", states)


def _multipliers(source: Source, style: Style) -> Picture:
    states, note = _several(source, "multipliers")
    for record in states:
        if not math.isfinite(record.gamma.sum()):
            raise UsageError(
                f"state {record.label} has no multipliers: it was {record.status}, not solved for"
            )
    curves = [_curves(source, record) for record in states]
    title = "Lagrange multipliers"
    if any(curves):
        title += " and, dashed, their explicit formulas on the same shapes"
    return Picture(multipliers_figure(states, style, curves, source.run_names), title + note, states)


def _curves(source: Source, record: StateRecord) -> Sequence[Curve] | None:
    """A state's multipliers beside their formulas, None for auxiliary states, which have none."""
    try:
        return source.curves(record)
    except UsageError:
        return None


def _spectrum(source: Source, style: Style) -> Picture:
    title = "Eigenvalues of the projected Hessian"
    if not source.whole_run:
        states, _ = _several(source, "spectrum")
        return Picture(spectrum_figure([states], style, (), source.run_names), title, states)
    runs = (_run(source, "spectrum"), *source.beside)
    groups = [_refined(run) for run in runs]
    if source.beside:
        below = [state_caption(g, run.name) for g, run in zip(groups[1:], source.beside, strict=True)]
        title += f", row by row; below, {' and '.join(below)}"
    return Picture(spectrum_figure(groups, style, run_texts(runs)), title, groups[0])


def _refined(run: Run) -> tuple[StateRecord, ...]:
    """The levels of the half-width that has most of them with whole spectra, else with any."""
    branch(run)
    best: list[StateRecord] = []
    for group in levels(run):
        records = [run.load(state.label) for state in group]
        whole = [r for r in records if r.spectra and all(s.complete for s in r.spectra)]
        chosen = whole or [r for r in records if r.spectra]
        if len(chosen) > len(best):
            best = chosen
    if not best:
        raise UsageError(f"{run.name} stores no spectra: its config's `spectrum` asks for none")
    return tuple(best)


def _convergence(source: Source, style: Style) -> Picture:
    table = source.table(_run(source, "convergence"))
    found = list(differences(table))
    chosen = _thinned(found, MOST_LOOKS)
    shown = replace(table, rows=tuple(row for row in table.rows if (row.half_width, row.others) in chosen))
    everywhere = [PlacedAt(b, {HALF_WIDTH: b, **dict(others)}) for b, others in found]
    title = "Energy differences under refinement"
    title += _without(everywhere, [everywhere[found.index(place)] for place in chosen])
    return Picture(convergence_figure(shown, style), title, ())


def _branch(source: Source, style: Style) -> Picture:
    run = _run(source, "branch")
    if source.beside:
        return _runs(source, style)
    if followed := courses(run, source.segments):
        return _followed(run, followed, style)
    every = branch(run, source.segments)
    parameter, states = along(every)
    name = _called(parameter)
    if len(states) < 2:
        raise UsageError(f"{run.name} has one {name} only at N = {states[0].segments}: a branch needs two")
    records = tuple(run.load(state.label) for state in states)
    # Where the run located the first contact, its states are not among the equilibria that someone named. It
    # lies elsewhere on every mesh.
    located = [
        value_at(state, parameter)
        for state in run.states(all=True)
        if state.segments == states[0].segments and "first-contact" in state.event_kinds
    ]
    contact = min(located, default=None)
    lowest = [lowest_value(r, "rotation", "sliding") for r in records]
    changes = [
        state
        for state in run.states(all=True)
        if state.segments == states[0].segments and {"touch", "lift"} & set(state.event_kinds)
    ]
    figure = branch_figure(states, lowest, style, contact, parameter, changes)
    title = f"Branch in the {'width' if parameter == HALF_WIDTH else name}{left_out(run, states)}"
    return Picture(figure, title + _elsewhere(len(every) - len(states)), records)


def _called(parameter: str) -> str:
    """A parameter in sentences."""
    return "half-width" if parameter == HALF_WIDTH else parameter_text(parameter)


def _elsewhere(count: int) -> str:
    """Words on states that lie elsewhere in other parameters, and are not of the branch."""
    return f"; without {count} at other values of other parameters" if count else ""


def _one_parameter(followed: dict[str, list[Summary]]) -> tuple[str, dict[str, list[Summary]]]:
    """The parameter in which a run's first branch was followed, and its branches in that."""
    parameter = followed_in(next(iter(followed.values())))
    return parameter, {name: points for name, points in followed.items() if followed_in(points) == parameter}


def _followed(run: Run, followed: dict[str, list[Summary]], style: Style) -> Picture:
    """Branches that arclength continuation followed, around folds and over saddles."""
    count = len(followed)
    parameter, followed = _one_parameter(followed)
    first = {points[0].label for points in followed.values() if points[0].branch is None}
    starts = {label: lowest_value(run.load(label), "rotation") for label in first}
    every = {p.label: p.branch.type for points in followed.values() for p in points if p.branch}
    types = list(every.values())
    shown = dict(list(followed.items())[:MOST_LOOKS])
    title = f"Branches in the {'width' if parameter == HALF_WIDTH else _called(parameter)}: {len(followed)}"
    if len(followed) < count:
        title += f", without {count - len(followed)} in other parameters"
    if len(shown) < len(followed):
        title += f", {len(shown)} of them shown, without {listed(list(followed)[MOST_LOOKS:], LISTED)}"
    for kind, name in (("fold", "folds"), ("branch-point", "branch points")):
        if kind in types:
            title += f", {name}: {types.count(kind)}"
    return Picture(arclength_figure(shown, starts, style, parameter), title, ())


def _runs(source: Source, style: Style) -> Picture:
    """Energies of several runs over a parameter, the one in which the first leads on."""
    runs = (_run(source, "branch"), *source.beside)
    if len({run.path.resolve() for run in runs}) < len(runs):
        raise UsageError("--with names a run that is there already")
    if len(runs) > MOST_RUNS:
        raise UsageError(f"branch tells {MOST_RUNS} runs apart, and {len(runs)} are named: leave some out")
    shown: list[list[list[Summary]]] = []
    words = []
    parameter = ""
    for run in runs:
        followed: list[list[Summary]] = []
        states: list[Summary] = []
        if of_run := courses(run, source.segments):
            own, kept = _one_parameter(of_run)
            followed = list(kept.values())
        else:
            own, states = along(branch(run, source.segments))
        parameter = parameter or own
        if own != parameter:
            raise UsageError(
                f"branch has one axis: {runs[0].name} moves in {_called(parameter)}, "
                f"{run.name} in {_called(own)}"
            )
        shown.append(followed or [states])
        every = {state.label: state for points in shown[-1] for state in points}.values()
        certified = sum(state.certified for state in every)
        meshes = ", ".join(str(n) for n in sorted({state.segments for state in every}))
        words.append(
            f"{run.name}, N = {meshes} ({certified} of {len(every)} certified{left_out(run, states)})"
        )
    firsts = [of_run[0][0] for of_run in shown]
    bands = [band_text(point.half_twists, point.sigma) for point in firsts]
    figure = runs_figure(run_texts(runs), bands, shown, style, parameter)
    title = f"Energies of {len(runs)} runs over the {_called(parameter)}"
    return Picture(figure, title, (), caption="; ".join(words))


def _family(source: Source, style: Style) -> Picture:
    run = _run(source, "family")
    records, note = _spread_out(run, source.segments, MOST_SHAPES)
    what = "widths" if records[0].parts.ends is None else "places"
    return Picture(family_figure(records, style, source.angles), f"Shapes at several {what}{note}", records)


def _table(source: Source, style: Style) -> Picture:
    assert source.rows is not None
    columns = chosen(source.rows, source.choice)
    figure = fields_figure(source.rows, columns, style)
    count = len({row["run"] for row in source.rows.rows})
    drawn = sum(len(found) for _, found in curves(source.rows, columns))
    part = f", {drawn} of them drawn" if drawn < len(source.rows.rows) else ""
    caption = f"{count} run{'s' * (count > 1)}, {len(source.rows.rows)} states{part}"
    caption = "; ".join([caption, *source.rows.missed])
    return Picture(figure, columns.title, (), caption=caption)


def _shapes(source: Source, style: Style) -> Picture:
    """Small multiples: the shapes of a sweep, each under what tells it from the others."""
    states, names = _thinned(source.states, MOST_PANELS), _thinned(source.names, MOST_PANELS)
    letters = letters_across(len(states), style)
    titles = [lines(name.split(", "), letters) for name in names]
    panels = [Panel(record, title) for record, title in zip(states, titles, strict=True)]
    left = len(source.states) - len(states)
    title = "Shapes" + (f", {len(states)} of {len(source.states)}" if left else "")
    figure = shapes_figure(panels, style, aligned=False, angles=source.angles)
    told = "; ".join(name.replace("$", "") for name in names)
    certified, meeting = sum(s.certified for s in states), sum(map(meets_unheld, states))
    contact = f", {meeting} in self-contact" if meeting else ""
    caption = f"{told} ({certified} of {len(states)} certified{contact})"
    missed = () if source.rows is None else source.rows.missed
    return Picture(figure, title, tuple(states), caption="; ".join([caption, *missed]))


def _mode(source: Source, style: Style) -> Picture:
    record = _one(source, "mode")
    assert source.mode is not None
    mode = source.mode(record)
    return Picture(mode_figure(record, mode, style, source.angles), mode.title, (record,), mode)


def _pattern(source: Source, style: Style) -> Picture:
    record = _one(source, "pattern")
    return Picture(pattern_figure(record, style), "Fold pattern", (record,))


def _contacts(source: Source, style: Style) -> Picture:
    record = _one(source, "contacts")
    if record.contacts is None:
        raise UsageError(
            f"state {record.label} was computed without contact forces: see `contact: forces` in the config, "
            "or `ribbon continue STATE --contact forces`"
        )
    check_shape(record)
    count = len(record.contacts.force)
    title = f"Contacts of the strip with itself: {count}" if count else "No contact of the strip with itself"
    return Picture(contacts_figure(record, style), title, (record,))


KINDS: dict[str, Callable[[Source, Style], Picture]] = {
    "shape": _shape,
    "geometry": _geometry,
    "multipliers": _multipliers,
    "spectrum": _spectrum,
    "convergence": _convergence,
    "branch": _branch,
    "family": _family,
    "mode": _mode,
    "pattern": _pattern,
    "contacts": _contacts,
    "table": _table,
    "shapes": _shapes,
}
"""Drawing function of each kind. A new kind is a new row."""
