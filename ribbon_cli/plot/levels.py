"""Spectra, energies under refinement, and branches in the width."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ribbon_cli.digits import powers, significant
from ribbon_cli.errors import UsageError
from ribbon_cli.export.words import meets_unheld
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.plot.branches import AT_REST, HELD_SHARE, MARKS, ROW_SHARE, contact_forces
from ribbon_cli.plot.canvas import Figure
from ribbon_cli.plot.labels import (
    LEGEND_LINE,
    band_text,
    curve_labels,
    legend_above,
    parameter_column,
    parameter_text,
    place_texts,
)
from ribbon_cli.plot.panels import branch_panels, energies, energy_unit, panels
from ribbon_cli.plot.style import GREY, LIGHT_GREY, NEGATIVE, PALETTE, Style, line_look, marked_look
from ribbon_cli.report.convergence import Others, Row, Table
from ribbon_cli.store import SpectrumRecord, StateRecord, Summary

FEW_MODES = 40
"""Most values that are marked one by one."""
SPECTRUM = 18.0
"""Least width of a spectrum's panel, in sizes of its letters."""
BESIDE = 34.0
"""Least width of a picture with its legend beside the panel, in sizes of its letters."""
METRIC_TITLES = {"euclidean": "Euclidean metric", "physical": "metric $h\\,(|du|^2 + |dg|^2)$"}


def spectrum_of(record: StateRecord, metric: str) -> SpectrumRecord | None:
    """A state's spectrum in one metric, None where there is none."""
    return next((spectrum for spectrum in record.spectra if spectrum.metric == metric), None)


def spectrum_figure(
    groups: Sequence[Sequence[StateRecord]],
    style: Style,
    names: Sequence[str] = (),
    runs: Sequence[str] = (),
) -> Figure:
    """Sorted eigenvalues of the projected Hessian in each metric, rotations left out, on a logarithmic scale.

    Each group of states has a row, named after `names` and what differs if there are several, and rows
    share their scales; in a narrow picture the metrics stand below each other. Whole spectra are spread
    over [0, 1], as in Figure 3.14; where all that is stored are the lowest, they are numbered. `runs` name
    the runs of a single group's states where they are of several. Raises UsageError where a group has no
    spectrum.
    """
    for records in groups:
        if not any(spectrum_of(record, m) for m in METRIC_TITLES for record in records):
            raise UsageError(
                f"state {records[0].label} has no spectrum: spectra are stored with equilibria, "
                "where the config's `spectrum` asks for modes"
            )
    every = [record for records in groups for record in records]
    metrics = [m for m in METRIC_TITLES if any(spectrum_of(record, m) for record in every)]
    rows, columns = len(groups), style.fitting(len(metrics), SPECTRUM)
    # Rows share their scales, so that one way to place modes has to serve all of them.
    spread = all(_spreads(records, "euclidean") for records in groups)
    heading = style.font / 72 * (2 if rows > 1 else 1)
    height = 0.05 * style.width + rows * len(metrics) // columns * (style.row(0.36) + heading)
    figure = Figure(figsize=(style.across(), height), layout="constrained")
    titles = _row_titles(groups, names)
    places: list[list[Axes]] = []
    for k, records in enumerate(groups):
        row: list[Axes] = []
        for j, metric in enumerate(metrics):
            # Side by side, or all rows of one metric before those of the next.
            place = k * columns + j if columns == len(metrics) else j * rows + k
            first = places[0][j] if places else None
            axes = figure.add_subplot(
                rows * len(metrics) // columns, columns, place + 1, sharex=first, sharey=first
            )
            draw_spectra(axes, records, metric, spread and metric == "euclidean", runs)
            axes.set_title(METRIC_TITLES[metric] + titles[k])
            if k < rows - 1:
                axes.set_xlabel("")
                axes.tick_params(labelbottom=False)
            row.append(axes)
        places.append(row)
    entries = [_entries(row) for row in places]
    if all(found.keys() == entries[0].keys() for found in entries):
        legend_above(figure, list(entries[0].values()))
    else:  # one line may stand for different meshes in different rows
        for row, found in zip(places, entries, strict=True):
            row[0].legend(found.values(), found.keys(), loc="best", handlelength=2.6)
    return figure


def _row_titles(groups: Sequence[Sequence[StateRecord]], names: Sequence[str]) -> list[str]:
    """Second lines of titles where there are several rows: the run; band, b and rule where rows differ."""
    if len(groups) < 2:
        return [""] * len(groups)
    columns = [
        list(names),
        [band_text(records[0].half_twists, records[0].sigma) for records in groups],
        place_texts([records[0] for records in groups]),
        [f"rule {_rule(records)}" for records in groups],
    ]
    shown = [column for column in columns if column is columns[0] or len(set(column)) > 1]
    return ["\n" + ", ".join(parts) for parts in zip(*shown, strict=True)]


def _entries(row: Iterable[Axes]) -> dict[str, Any]:
    """What the panels of a row have to say in a legend, once each: lines by label."""
    found: dict[str, Any] = {}
    for axes in row:
        found |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    return found


def _rule(records: Sequence[StateRecord]) -> str:
    """The rules by which states average xi, mostly one."""
    return " and ".join(dict.fromkeys(record.discretisation for record in records))


def _spreads(records: Sequence[StateRecord], metric: str) -> bool:
    """Whether spectra are spread over [0, 1]: whole ones in the Euclidean metric.

    There it is the whole spectrum that shrinks with N; in the physical metric each mode's value converges,
    which is seen where modes are counted.
    """
    found = [s for r in records if (s := spectrum_of(r, metric)) is not None]
    return metric == "euclidean" and all(spectrum.complete for spectrum in found)


def draw_spectra(
    axes: Axes,
    records: Sequence[StateRecord],
    metric: str,
    spread: bool | None = None,
    runs: Sequence[str] = (),
) -> None:
    """Draw the eigenvalues of several states in one metric into `axes`, spread over [0, 1] or numbered.

    Of negative values the moduli are drawn, with crosses on the curve that they belong to.
    """
    found = [(k, r, s) for k, r in enumerate(records) if (s := spectrum_of(r, metric)) is not None]
    names = curve_labels([record for _, record, _ in found], [runs[k] for k, _, _ in found] if runs else ())
    spread = _spreads(records, metric) if spread is None else spread
    few = not spread and all(spectrum.values.size <= FEW_MODES for _, _, spectrum in found)
    crosses = "negative, modulus"
    for k, (_, _, spectrum) in enumerate(found):
        values = np.array(
            [v for v, name in zip(spectrum.values, spectrum.labels, strict=True) if name != "rotation"]
        )
        places = np.linspace(0.0, 1.0, values.size) if spread else np.arange(1.0, values.size + 1)
        look = marked_look(k) if few else line_look(k, values.size)
        axes.plot(places, np.where(values == 0, np.nan, np.abs(values)), label=names[k], **look)
        negative = values < 0
        if negative.any():
            axes.plot(places[negative], -values[negative], "x", color=NEGATIVE, label=crosses, zorder=3)
            crosses = "_" + crosses
    axes.set_yscale("log")
    if spread:
        axes.set_xlabel("place in the sorted spectrum")
    else:
        if not few:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter("{x:g}")
        elif axes.get_xscale() == "linear":  # a row above may share the axis, and have more modes
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("number of the mode, rotations left out")
    axes.set_ylabel("eigenvalue")
    axes.grid(axis="y", color=LIGHT_GREY, linewidth=0.3)


def convergence_figure(table: Table, style: Style) -> Figure:
    """Differences |E_N - E_2N| over N for each half-width, with the slope of second order.

    Rings are about differences of an energy without certificate, or of another minimum. Differences of 0,
    which a logarithmic scale has no place for, are told in the legend. Raises UsageError where no half-width
    has two levels.
    """
    groups = differences(table)
    if not groups:
        raise UsageError(
            "no half-width of this run has two levels of refinement: see `refinement` in the config, "
            "or `ribbon refine STATE --levels 2`"
        )
    width = style.across(0.72)
    height = max(style.row(0.5), (len(groups) + 5) * LEGEND_LINE * 0.9 * style.font / 72)
    beside = width * 72 >= BESIDE * style.font
    figure = Figure(figsize=(width, height if beside else style.row(0.6)), layout="constrained")
    axes = figure.subplots()
    situated = [{HALF_WIDTH: b, **dict(others)} for b, others in groups]
    names = [name for name in PARAMETERS if any(name in place for place in situated)]
    columns = [parameter_column(situated, name) for name in names]
    texts = [", ".join(filter(None, parts)) for parts in zip(*columns, strict=True)]
    for k, (rows, text) in enumerate(zip(groups.values(), texts, strict=True)):
        zeros = [str(row.segments) for row in rows if not row.delta]
        label = text + (f"\n0 at $N$ = {', '.join(zeros)}" if zeros else "")
        places = [row.segments for row in rows], [row.delta or math.nan for row in rows]
        axes.loglog(*places, label=label, **marked_look(k))
    doubtful = [row for rows in groups.values() for row in rows if row.delta and row.doubtful]
    if doubtful:
        places = [row.segments for row in doubtful], [row.delta or math.nan for row in doubtful]
        label = "no certificate, or\nanother minimum"
        axes.plot(*places, "o", color=NEGATIVE, fillstyle="none", markersize=2.6 * style.marker, label=label)
    every = sorted({row.segments for rows in groups.values() for row in rows})
    known = [row.delta for rows in groups.values() for row in rows if row.delta]
    if known:
        _slope(axes, every, min(known))
    _decades(axes)
    shown = _apart(every, 0.6 * width * 72 / style.font)
    axes.set_xticks(shown, [str(n) for n in shown])
    axes.minorticks_off()
    axes.set_xlabel("$N$")
    axes.set_ylabel(r"$\Delta_N = |E_N - E_{2N}|$")
    axes.grid(axis="y", color=LIGHT_GREY, linewidth=0.3)
    handles, labels = axes.get_legend_handles_labels()
    if beside:
        axes.legend(handles, labels, loc="center left", bbox_to_anchor=(1.02, 0.5), handlelength=2.6)
    else:
        legend_above(figure, handles, rows=0)
    return figure


@dataclass(frozen=True)
class PlacedAt:
    """A half-width and all parameters, without a state."""

    half_width: float
    parameters: Mapping[str, float | None]


def differences(table: Table) -> dict[tuple[float, Others], list[Row]]:
    """The rows of a table that have a difference, by half-width and other parameters."""
    groups: dict[tuple[float, Others], list[Row]] = {}
    for row in table.rows:
        if row.delta is not None:
            groups.setdefault((row.half_width, row.others), []).append(row)
    return groups


def _apart(segments: Sequence[int], letters: float) -> list[int]:
    """Those N, the first among them, whose numbers have room on a logarithmic axis so many letters long."""
    whole = math.log(segments[-1] / segments[0]) or 1.0
    shown = [segments[0]]
    for n in segments[1:]:
        room = letters * math.log(n / shown[-1]) / whole
        if room >= 0.32 * (len(str(n)) + len(str(shown[-1]))) + 0.6:
            shown.append(n)
    return shown


def _decades(axes: Axes) -> None:
    """Widen a logarithmic scale until it shows two powers of ten: none would leave it without numbers."""
    low, high = axes.get_ylim()
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    if last <= first:
        axes.set_ylim(min(low, 0.8 * 10.0 ** (last - (last >= first))), max(high, 1.25 * 10.0**first))


def _slope(axes: Axes, segments: Sequence[int], least: float) -> None:
    """A line of slope -2 below the data, named."""
    if len(segments) < 2:
        return
    first, last = segments[0], segments[-1]
    low = 0.35 * least
    axes.loglog([first, last], [low * (last / first) ** 2, low], color=GREY, linewidth=0.8)
    middle = math.sqrt(first * last)
    axes.annotate(
        "slope −2",
        (middle, low * (last / middle) ** 2),
        xytext=(-4, -4),
        textcoords="offset points",
        ha="right",
        va="top",
        color=GREY,
    )


def branch_figure(
    states: Sequence[Summary],
    lowest: Sequence[float | None],
    style: Style,
    contact: float | None = None,
    parameter: str = HALF_WIDTH,
    changes: Sequence[Summary] = (),
) -> Figure:
    """Energy, lowest eigenvalue and clearance over a parameter, and the contact force of bands that have one;
    where these touch all along, in place of the clearance.

    `states` are summaries along the branch in its order; `lowest` the lowest eigenvalue of
    each in the physical metric, rotations and sliding left out, None where no spectrum is stored. Filled
    marks are certified minima, open ones are not; crosses have self-contact. A line is
    drawn at `contact`, the value at which that was found to begin. `changes` are states at which a contact
    begins or ends: in the panels of energy and force, a caret from above is a touch, one from below a lift.
    """
    b, energy, clearance = energies(states, parameter)
    title, ring = energy_unit(states)
    eigenvalues = np.array([np.nan if v is None else v for v in lowest])
    lowest_title = "lowest eigenvalue but sliding" if states[0].sigma else "lowest eigenvalue"
    drawn = {title: energy / ring, lowest_title: eigenvalues, "clearance": clearance}
    resting = any(state.with_forces for state in states)
    if resting:
        drawn[AT_REST] = contact_forces(states)
        if all(state.contacts for state in states):
            del drawn["clearance"]
    figure, places = panels(style, 4, 2, HELD_SHARE) if len(drawn) == 4 else panels(style, 3, 3, ROW_SHARE)
    branch_panels(places, tuple(drawn), parameter)
    for axes, values in zip(places, drawn.values(), strict=True):
        axes.plot(b, values, color=PALETTE[0], zorder=1)
        _mark(axes, states, b, values, style)
        if contact is not None:
            label = f"first contact, {parameter_text(parameter)} = {powers(significant(contact, 5))}"
            axes.axvline(contact, color=PALETTE[1], linestyle=(0, (1.2, 1.6)), zorder=0, label=label)
        if np.isnan(values).all():
            axes.text(0.5, 0.5, "not stored", transform=axes.transAxes, ha="center", color=GREY)
            axes.set_yticks([])
    if resting and changes:
        _changes(places[0], places[-1], changes, style, parameter)
    for axes, (name, values) in list(zip(places, drawn.items(), strict=True))[1:]:
        if np.nanmin(values, initial=np.inf) > 0 or name == AT_REST:
            axes.set_ylim(bottom=0.0)
    legend_above(figure, places[0].get_legend_handles_labels()[0])
    return figure


def _changes(energy: Axes, force: Axes, changes: Sequence[Summary], style: Style, parameter: str) -> None:
    """Marks of what begins to touch, and of what lifts."""
    for kind in ("touch", "lift"):
        found = [state for state in changes if kind in state.event_kinds]
        if not found:
            continue
        name, marker = MARKS[kind]
        b, e, _ = energies(found, parameter)
        for axes, values in ((energy, e / energy_unit(found)[1]), (force, contact_forces(found))):
            axes.plot(
                b,
                values,
                marker=marker,
                linestyle="",
                markersize=1.5 * style.marker,
                markerfacecolor="white",
                markeredgecolor=PALETTE[1],
                label=name,
                zorder=4,
            )


def _mark(axes: Axes, states: Sequence[Summary], b: np.ndarray, values: np.ndarray, style: Style) -> None:
    """Marks that say what each state is."""

    def mark(label: str, chosen: list[bool], **look: Any) -> None:
        mask = np.array(chosen)
        if mask.any():
            axes.plot(b[mask], values[mask], linestyle="", label=label, **look)

    mark("certified minimum", [s.certified for s in states], marker="o", color=PALETTE[0])
    uncertified, touching = [not s.certified for s in states], list(map(meets_unheld, states))
    open_look: dict[str, Any] = {"markerfacecolor": "white", "markeredgecolor": PALETTE[1]}
    mark("no certificate", uncertified, marker="o", zorder=3, **open_look)
    mark("self-contact", touching, marker="x", color=PALETTE[1], markersize=1.6 * style.marker, zorder=4)


def lowest_value(record: StateRecord, *left_out: str) -> float | None:
    """Lowest eigenvalue in the physical metric of a mode with no label of `left_out`; None where none is
    stored.
    """
    spectrum = spectrum_of(record, "physical")
    if spectrum is None:
        return None
    pairs = zip(spectrum.values, spectrum.labels, strict=True)
    return min((float(v) for v, label in pairs if label not in left_out), default=None)
