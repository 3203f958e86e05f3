"""Spectra and their convergence as JSON, text, Markdown and CSV."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ribbon_cli.report.convergence import Others
from ribbon_cli.report.tables import csv_text
from ribbon_cli.store.log import to_json
from ribbon_cli.text import aligned, pipes


@dataclass(frozen=True)
class Told:
    """What `--json` prints; the other formats show most of it."""

    def document(self) -> dict[str, Any]:
        """Plain values; not-a-number is None."""
        plain: dict[str, Any] = to_json(asdict(self))
        return plain


CLEAR = 1e-3
"""Distance of a mode's character from +1 or -1 up to which it is called symmetric or antisymmetric."""


@dataclass(frozen=True)
class Mode:
    """One mode. `bound` limits the error of `value`, roundoff included; `residual` leaves roundoff out.

    `hidden` is the share of the mode's xi that the energy does not see (checkerboard modes: above 1/2).
    `symmetry` gives <v, T v> in [-1, 1] for each symmetry of the state by its name: +1 symmetric, -1
    antisymmetric, in between for modes of a multiple eigenvalue that the symmetry mixes.
    """

    value: float
    residual: float
    bound: float
    label: str
    sliding_overlap: float
    hidden: float
    symmetry: Mapping[str, float]

    @property
    def parity(self) -> str:
        """One letter for each symmetry: s symmetric, a antisymmetric, x neither."""
        return "".join(
            "s" if c > 1 - CLEAR else "a" if c < CLEAR - 1 else "x" for c in self.symmetry.values()
        )


@dataclass(frozen=True)
class Counts:
    """Negative eigenvalues by the block reduction's inertia."""

    negative: int
    pivot_gap: float
    trusted: bool


@dataclass(frozen=True)
class Element:
    """One symmetry: an orthogonal map and a shift by facets, with or without reversal and turning over."""

    name: str
    matrix: list[list[float]]
    shift: float
    reverse: bool
    flip: bool
    residual: float
    exact: bool


@dataclass(frozen=True)
class Group:
    """The symmetry of a state: its group, and the group that it nearly has."""

    group: str
    order: int
    residual: float
    nearly: str
    near_residual: float | None
    elements: tuple[Element, ...]


@dataclass(frozen=True)
class StateSpectrum(Told):
    """One state's spectrum; `run` is None for a state of no run, `parameters` is None for a closed band."""

    run: str | None
    label: int
    half_width: float
    segments: int
    h: float
    discretisation: str
    metric: str
    formula: str
    complete: bool
    negative: int | None
    stability: str
    gap: float | None
    verdict: str
    inertia: Counts
    symmetry: Group
    symmetries: tuple[str, ...]
    modes: tuple[Mode, ...]
    parameters: Mapping[str, float] | None = None

    def document(self) -> dict[str, Any]:
        """Plain values; `parameters` are those of strips alone."""
        plain = super().document()
        if self.parameters is None:
            del plain["parameters"]
        return plain


@dataclass(frozen=True)
class RunSpectra(Told):
    """The spectra of all equilibria of a run."""

    run: str
    metric: str
    states: tuple[StateSpectrum, ...]

    def document(self) -> dict[str, Any]:
        """Plain values, state by state."""
        return super().document() | {"states": [state.document() for state in self.states]}


@dataclass(frozen=True)
class ModeSequence:
    """One mode at one half-width over N, ascending.

    `others` are the parameters besides b in which the run's states differ: different values are never mixed.
    `label` is sliding, mode or checkerboard; `number` counts within the label from 1. Each of the `orders`
    belongs to the first of three N that double. The sliding mode falls to zero; its orders are
    log2(value_N / value_2N), and its `limit` is None. Elsewhere `limit` is None where nothing can be said.
    """

    half_width: float
    label: str
    number: int
    parity: str
    segments: tuple[int, ...]
    values: tuple[float, ...]
    bounds: tuple[float, ...]
    overlaps: tuple[float, ...]
    orders: tuple[float | None, ...]
    limit: float | None
    error: float | None
    settled: bool
    reason: str
    others: Others = ()

    @property
    def place(self) -> str:
        """The half-width, and other parameters where the run has several values of them."""
        return _place(self.half_width, self.others)


@dataclass(frozen=True)
class SpectralTable(Told):
    """Sequences of a run by half-width and other parameters."""

    run: str
    metric: str
    formula: str
    sequences: tuple[ModeSequence, ...]
    notes: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Plain values, with `parameters` where others than the half-width vary."""
        plain = super().document()
        for sequence in plain["sequences"]:
            if others := sequence.pop("others"):
                sequence["parameters"] = dict(others)
        return plain


MISSING = "-"
_MODE = ("value", "bound", "label", "sliding_overlap", "hidden")
"""Fields of a mode in CSV, of one state and of a whole run."""


def render(told: Told, style: str) -> str:
    """A state's modes, a run's convergence or all of a run's states, as text, markdown or csv."""
    match told:
        case SpectralTable():
            return _convergence_csv(told) if style == "csv" else _convergence(told, style)
        case RunSpectra():
            return _run_csv(told) if style == "csv" else _run(told, style)
        case StateSpectrum():
            return _spectrum_csv(told) if style == "csv" else _spectrum(told, style)
    raise TypeError(told)


def _spectrum(told: StateSpectrum, style: str) -> str:
    """A state's modes in columns, its symmetry, and the verdict as the last line."""
    heading, rows, verdict = _heading(told), _spectrum_rows(told), told.verdict
    if style == "text":
        return "\n".join([*heading, "", aligned(rows), "", verdict, ""])
    return "\n".join([*(f"{line}  " for line in heading), "", pipes(rows), "", f"**{verdict}**", ""])


def _spectrum_csv(told: StateSpectrum) -> str:
    """One line a mode, numbers to full precision; `position` spreads the modes evenly on [0, 1]."""
    modes, names = told.modes, told.symmetries
    last = max(len(modes) - 1, 1)
    rows = [
        {"number": k + 1, "position": k / last}
        | {key: getattr(mode, key) for key in ("value", "bound", "residual", *_MODE[2:])}
        | {name: mode.symmetry.get(name, "") for name in names}
        for k, mode in enumerate(modes)
    ]
    return csv_text(rows)


def _convergence(told: SpectralTable, style: str) -> str:
    """Sequences of eigenvalues by half-width, a column for each N, with orders and limits.

    Text says why limits are not settled.
    """
    blocks, notes = [], told.notes
    for place, rows in _by_place(told):
        head = f"{place}, {told.metric} metric"
        if style == "text":
            blocks += [f"{head}: {told.formula}\n{aligned(rows)}", _reasons(told, place)]
        else:
            blocks.append(f"{head}\n\n{pipes(rows)}")
    if style == "text":
        blocks += ["\n".join(notes)] if notes else []
    else:
        blocks += [f"- {note}" for note in notes]
    return "\n\n".join(blocks) + "\n"


def _convergence_csv(told: SpectralTable) -> str:
    """One line for each eigenvalue at each N, numbers to full precision, missing ones empty."""
    named, result = ("half_width", "label", "number", "parity"), ("limit", "error", "settled")
    rows = [
        {key: getattr(item, key) for key in named}
        | dict(item.others)
        | {"segments": n, "value": item.values[k], "bound": item.bounds[k]}
        | {"sliding_overlap": item.overlaps[k], "order": item.orders[k]}
        | {key: getattr(item, key) for key in result}
        for item in told.sequences
        for k, n in enumerate(item.segments)
    ]
    return csv_text(rows)


def _run(told: RunSpectra, style: str) -> str:
    """A line for each state: its lowest eigenvalue, and how many modes are checkerboards.

    Markdown has a table for each state, one after the other.
    """
    if style == "markdown":
        return "\n".join(_spectrum(state, style) for state in told.states)
    rows = [["b", "N", "rule", "modes", "lowest", "lowest/h", "hidden modes", "under 1e-2 of the median"]]
    for state in told.states:
        values = sorted(mode.value for mode in state.modes if mode.label != "rotation")
        hidden = sum(mode.label == "checkerboard" for mode in state.modes)
        small = sum(value < 1e-2 * values[len(values) // 2] for value in values)
        figures = [f"{values[0]:.6g}", f"{values[0] / state.h:.6g}", str(hidden), str(small)]
        place = [f"{state.half_width:.10g}", str(state.segments), state.discretisation]
        rows.append([*place, str(len(values)), *figures])
    return f"{told.metric} metric, all eigenvalues besides rotations\n\n{aligned(rows)}\n"


def _run_csv(told: RunSpectra) -> str:
    """One line a mode, with its state in front: the data of Koldaev (2022), Figure 3.14."""
    rows = []
    for state in told.states:
        modes = [mode for mode in state.modes if mode.label != "rotation"]
        place = {key: getattr(state, key) for key in ("half_width", "segments", "discretisation")}
        for k, mode in enumerate(modes):
            figures = {key: getattr(mode, key) for key in _MODE}
            rows.append({**place, "position": k / max(len(modes) - 1, 1), **figures})
    return csv_text(rows)


def _place(half_width: float, others: Iterable[tuple[str, float | None]]) -> str:
    """A half-width and other parameters: `b = 0.05, shear = 0.3`."""
    return f"b = {half_width:.10g}" + "".join(f", {name} = {value:.10g}" for name, value in others)


def _heading(told: StateSpectrum) -> list[str]:
    symmetry = told.symmetry
    others = ((name, value) for name, value in (told.parameters or {}).items() if value)
    place = f"{_place(told.half_width, others)}, N = {told.segments}, {told.discretisation}"
    lines = [
        f"{place}; {told.metric} metric: {told.formula}",
        f"symmetry {symmetry.group}, order {symmetry.order}, residual {symmetry.residual:.0e}",
    ]
    if symmetry.nearly != symmetry.group:
        lines[-1] += f"; {symmetry.nearly} but for {symmetry.near_residual:.1e}"
    return lines


def _spectrum_rows(told: StateSpectrum) -> list[list[str]]:
    """The modes in columns, heads first; a strip with ends cannot slide and has no such column."""
    names, slides = told.symmetries, told.parameters is None
    rows = [["", "value", "+-", "label", *(["sliding"] if slides else []), "hidden", *names]]
    for k, mode in enumerate(told.modes, 1):
        figures = [f"{mode.value:.8g}", f"{mode.bound:.0e}", mode.label]
        shares = [*([f"{mode.sliding_overlap:.4f}"] if slides else []), f"{mode.hidden:.3f}"]
        rows.append([str(k), *figures, *shares, *(_sign(mode.symmetry.get(name)) for name in names)])
    return rows


def _sign(character: float | None) -> str:
    """+ for symmetric, - for antisymmetric, else the number; empty without one."""
    if character is None or math.isnan(character):
        return ""
    return "+" if character > 1 - CLEAR else "-" if character < CLEAR - 1 else f"{character:.3f}"


def _by_place(told: SpectralTable) -> Iterable[tuple[str, list[list[str]]]]:
    """The rows of the table of each half-width and other parameters, heads first."""
    for place in dict.fromkeys(item.place for item in told.sequences):
        items = [item for item in told.sequences if item.place == place]
        grid = sorted({n for item in items for n in item.segments})
        rows = [["mode", "parity", *(f"N = {n}" for n in grid), "orders", "limit"]]
        for item in items:
            known = dict(zip(item.segments, item.values, strict=True))
            orders = [MISSING if o is None else f"{o:.2f}" for o in item.orders]
            name = item.label if item.label == "sliding" else f"{item.label} {item.number}"
            values = [f"{known[n]:.7g}" if n in known else MISSING for n in grid]
            rows.append([name, item.parity or MISSING, *values, " ".join(orders), _limit(item)])
        yield place, rows


def _limit(item: ModeSequence) -> str:
    if item.label == "sliding":
        return "0"
    if item.limit is None:
        return MISSING
    bar = "" if item.error is None else f" +- {item.error:.0e}"
    return f"{item.limit:.7g}{bar}" + ("" if item.settled else " ?")


def _reasons(told: SpectralTable, place: str) -> str:
    """Why limits are not taken as settled, each reason once."""
    reasons: dict[str, list[str]] = {}
    for item in told.sequences:
        if item.place == place and item.label != "checkerboard" and not item.settled:
            name = item.label if item.label == "sliding" else f"mode {item.number}"
            reasons.setdefault(item.reason, []).append(name)
    return "\n".join(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())
