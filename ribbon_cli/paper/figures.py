"""Every figure of chapter 3 of Koldaev (2022): the configs behind it, how it is drawn, and what is checked.

Panels of a figure are files of their own as well, `-a`, `-b`, ...: each is given as a key beside "", the
whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ribbon_cli.export.fields import inflections
from ribbon_cli.paper import claims
from ribbon_cli.paper.claims import Check
from ribbon_cli.paper.library import Library
from ribbon_cli.plot.curves import geometry_figure, multipliers_figure
from ribbon_cli.plot.levels import draw_spectra, spectrum_of
from ribbon_cli.plot.pictures import Panel, shapes_figure
from ribbon_cli.plot.style import STYLES
from ribbon_cli.study import multiplier_curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ribbon_cli.store import StateRecord

STYLE = STYLES["paper"]
PI, THREE, EVERTED, EVERSION, TABLE, SECOND, TWISTED = (
    "pi",
    "three-pi",
    "everted",
    "eversion",
    "table",
    "second-minimum",
    "three-pi-twisted",
)
SPECTRA = {
    "a": ("ring", 0.3, "cylinder, $b$ = 0.3, rule thesis"),
    "b": ("spectra-pi", 0.5, "π-twisted band, $b$ = 0.5, rule thesis"),
    "c": ("ring-value-average", 0.3, "cylinder, rule value-average"),
    "d": ("spectra-pi-value-average", 0.5, "π-twisted band, rule value-average"),
}
"""Panels of Figure 3.14, and the same under the rule without a null direction: config, b, title."""
COARSE = (20, 40, 80, 160)
TABLE_FILES = {"txt": "text", "tex": "latex", "csv": "csv"}
"""Files of a table by suffix."""


@dataclass(frozen=True)
class Made:
    """A figure's pictures by panel, the references of its states, its checks, and texts by suffix of file."""

    pictures: dict[str, Figure]
    sources: tuple[str, ...]
    checks: tuple[Check, ...] = ()
    texts: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Item:
    """A figure or table: what it shows, in our words, its configs, and the function that makes it."""

    caption: str
    configs: tuple[str, ...]
    make: Callable[[Library], Made]
    remarks: str = ""


def _panels(
    panels: Sequence[Panel], aligned: bool, view: tuple[float, float] | None = None
) -> dict[str, Figure]:
    """All shapes in one row, and each alone."""
    whole = shapes_figure(panels, STYLE, aligned=aligned, angles=view)
    letters = "abcdefgh"
    alone = {
        letters[k]: shapes_figure([panel], STYLE, aligned=False, angles=view)
        for k, panel in enumerate(panels)
    }
    return {"": whole} | alone


def _multipliers(states: Sequence[StateRecord]) -> Figure:
    """Multipliers over what their explicit formulas give on the same shapes."""
    return multipliers_figure(states, STYLE, [multiplier_curves(state) for state in states])


def _stages(library: Library, config: str, names: dict[str, str], marked: tuple[int, ...]) -> Made:
    """Auxiliary states of a construction in a row."""
    states = [library.stage(config, stage) for stage in names]
    panels = [Panel(state, title, marked) for state, title in zip(states, names.values(), strict=True)]
    return Made(_panels(panels, aligned=True), tuple(library.reference(config, s) for s in states))


def _figure_3_1(library: Library) -> Made:
    names = {"eversion 0/25": "$k$ = 0", "eversion 13/25": "$k$ = 13", "eversion 25/25": "$k$ = 25"}
    return _stages(library, EVERSION, names, (1, 11))


def _figure_3_2(library: Library) -> Made:
    names = {
        "cut along both rulings": "cut",
        "half turned 1/4": "turned by π/4",
        "half turned 2/4": "π/2",
        "half turned 3/4": "3π/4",
        "halves rejoined": "π, rejoined",
    }
    return _stages(library, EVERSION, names, (1, 11))


def _everted(library: Library) -> StateRecord:
    return library.state(EVERTED, 0.03, 160)


def _figure_3_3(library: Library) -> Made:
    state = _everted(library)
    checks = (
        claims.inflection_count(state, 2),
        claims.half_a_band_apart(state),
        claims.torsion_dips(state),
    )
    return Made({"": geometry_figure([state], STYLE)}, (library.reference(EVERTED, state),), checks)


def _figure_3_4(library: Library) -> Made:
    state = _everted(library)
    checks = claims.largest_at_inflections(state, ("lambda_2", "lambda_4", "lambda_5"))
    return Made({"": _multipliers([state])}, (library.reference(EVERTED, state),), tuple(checks))


def _figure_3_5(library: Library) -> Made:
    state = _everted(library)
    wider = [library.state(EVERTED, b, 160) for b in (0.035, 0.04)]
    found = "; ".join(
        f"b = {s.half_width:g}: {'certified minimum' if s.certified else s.status}, E = {s.energy:.6f}"
        for s in wider
    )
    none = not any(s.certified and inflections(s).size == 2 for s in wider)
    check = Check(
        "no wider partially everted cylinder was found at N = 160",
        found,
        none,
        "continued in small steps, with the two inflections kept, wider ones are there",
    )
    pictures = {"": shapes_figure([Panel(state, "", ())], STYLE, aligned=False)}
    references = tuple(library.reference(EVERTED, s) for s in (state, *wider))
    return Made(pictures, references, (claims.certified_minima([state]), check))


def _figure_3_6(library: Library) -> Made:
    names = {
        "twist 1/50": "turned by π/50",
        "twist 17/50": "17π/50",
        "twist 34/50": "34π/50",
        "twist 50/50": "π",
    }
    return _stages(library, PI, names, (1,))


def _pi(library: Library) -> list[StateRecord]:
    return [library.state(PI, b, 400) for b in (0.3, 1.5)]


def _three(library: Library) -> list[StateRecord]:
    return [library.state(THREE, b, 240) for b in (0.3, 0.65)]


def _references(library: Library, config: str, states: Sequence[StateRecord]) -> tuple[str, ...]:
    return tuple(library.reference(config, state) for state in states)


def _titled(states: Sequence[StateRecord]) -> list[Panel]:
    return [Panel(state, f"$b$ = {state.half_width:g}", ()) for state in states]


def _figure_3_7(library: Library) -> Made:
    states = _pi(library)
    checks = (
        claims.certified_minima(states),
        claims.contact_width(library.run(PI).states(all=True), "1.5"),
    )
    return Made(_panels(_titled(states), aligned=False), _references(library, PI, states), checks)


def _figure_3_8(library: Library) -> Made:
    states = _pi(library)
    note = "with one inflection it cannot hold: kappa_s vanishes at pi and would have to at 0"
    checks: list[Check] = []
    for state in states:
        checks += [
            claims.inflection_count(state, 1),
            claims.torsion_vanishes(state),
            claims.injectivity_nearly_active(state),
            claims.period(
                state, "tau", 2, 1, "tau is pi-periodic", "it is even about the inflection instead"
            ),
            claims.period(state, "kappa_s", 2, -1, "kappa_s is pi-antiperiodic", note),
            claims.half_turn_symmetry(state),
        ]
    return Made({"": geometry_figure(states, STYLE)}, _references(library, PI, states), tuple(checks))


def _figure_3_9(library: Library) -> Made:
    states = _pi(library)
    checks: list[Check] = []
    for state in states:
        checks += claims.extremum_at_inflections(state)
        checks += claims.largest_at_inflections(state, ("lambda_5",))
    return Made({"": _multipliers(states)}, _references(library, PI, states), tuple(checks))


def _figure_3_10(library: Library) -> Made:
    state = library.stage(THREE, "construction")
    check = Check(
        "the construction is a 3 pi-twisted developable band: Lk = 3/2, no facet inverted",
        f"Lk = {state.linking_number:.6f}, smallest facet {state.smallest_facet:.3g}, "
        f"constraint residual {state.constraint_residual:.1e}",
        abs(state.linking_number - 1.5) < 1e-6
        and state.inverted_facets == 0
        and state.constraint_residual < 1e-9,
    )
    pictures = {"": shapes_figure([Panel(state, "", ())], STYLE, aligned=False)}
    twisted = library.run(TWISTED)
    stages = twisted.states(all=True)
    reached = stages[-1]["stage"] if stages else "nothing"
    failed = "; ".join(library.failures[TWISTED])
    checks = (
        check,
        Check(
            "a strip whose ends are twisted by 3 pi passes through itself",
            f"last stage {reached}; {failed or 'reached'}",
            "passed through itself" in failed,
        ),
        Check(
            "and it ends as a -pi band",
            "not followed: the stages stop where the band passes through itself",
            None,
            "its linking number tells, which a -pi band and a 3 pi band do not share",
        ),
    )
    return Made(pictures, (library.reference(THREE, state), twisted.name), checks)


def _figure_3_11(library: Library) -> Made:
    states = _three(library)
    checks = (
        claims.certified_minima(states),
        claims.contact_width(library.run(THREE).states(all=True), "0.65"),
        claims.contact_at_the_centre(states[1]),
    )
    return Made(_panels(_titled(states), aligned=False), _references(library, THREE, states), checks)


def _figure_3_12(library: Library) -> Made:
    states = _three(library)
    checks: list[Check] = []
    for state in states:
        checks += [
            claims.inflection_count(state, 3),
            claims.period(state, "kappa_s", 3, -1, "kappa_s is 2 pi/3-antiperiodic"),
            claims.period(state, "tau", 3, 1, "tau is 2 pi/3-periodic"),
        ]
    return Made({"": geometry_figure(states, STYLE)}, _references(library, THREE, states), tuple(checks))


def _figure_3_13(library: Library) -> Made:
    states = _three(library)
    checks = [check for state in states for check in claims.extremum_at_inflections(state)]
    return Made({"": _multipliers(states)}, _references(library, THREE, states), tuple(checks))


def _figure_3_14(library: Library) -> Made:
    found = {
        letter: [library.state(config, b, n) for n in COARSE] for letter, (config, b, _) in SPECTRA.items()
    }
    pictures = {"": _spectra(found, "euclidean"), "physical": _spectra(found, "physical")}
    pictures |= {letter: _spectra({letter: states}, "euclidean") for letter, states in found.items()}
    checks: list[Check] = []
    lowest = {}
    for letter, what in (("a", "cylinder"), ("b", "pi band")):
        checks += claims.half_vanish(_euclidean(found[letter]), what)
    for letter in "ac":
        lowest[letter] = [
            float(values.min()) * n / state.length
            for state, (n, values) in zip(found[letter], _euclidean(found[letter]), strict=True)
        ]
    checks += claims.cured(lowest["a"], lowest["c"], 0.3 / 3)
    references = [
        reference
        for letter, (config, _, _) in SPECTRA.items()
        for reference in _references(library, config, found[letter])
    ]
    return Made(pictures, tuple(references), tuple(checks))


def _euclidean(states: Sequence[StateRecord]) -> list[tuple[int, np.ndarray]]:
    """N and all Euclidean eigenvalues of each state."""
    spectra = [(state.segments, spectrum_of(state, "euclidean")) for state in states]
    return [(n, claims.eigenvalues(found)) for n, found in spectra if found is not None]


def _spectra(found: dict[str, list[StateRecord]], metric: str) -> Figure:
    """Panels of Figure 3.14 by letter, in rows of two at one scale, in a metric."""
    from matplotlib.figure import Figure

    rows, columns = -(-len(found) // 2), min(2, len(found))
    size = (STYLE.width * (0.55 if columns == 1 else 1.0), 0.42 * rows * STYLE.width)
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, (letter, states) in zip(panels.ravel(), found.items(), strict=True):
        draw_spectra(axes, states, metric)
        axes.set_title(SPECTRA[letter][2])
        axes.legend(loc="upper left", handlelength=2.6)
        axes.label_outer()
    return figure


def _table_3_1(library: Library) -> Made:
    from ribbon_cli.report.convergence import Entry, compare_with_thesis, convergence_rows, thesis_table
    from ribbon_cli.report.tables import RENDERERS
    from ribbon_cli.study import table_entries

    run = library.run(TABLE)
    other = library.state(SECOND, 0.1, 50)
    second = Entry(other.half_width, other.segments, other.energy, other.certified, other.label)
    table = convergence_rows(table_entries(run))
    comparison = compare_with_thesis(table, thesis_table(), second)
    checks = tuple(
        Check(
            f"Delta_N = {row.thesis} at b = {row.half_width:g}, N = {row.segments}",
            "none" if row.delta is None else f"{row.delta:.9g}",
            row.agrees,
            row.footnote or ("" if row.agrees else "see docs/errata.md, Table 3.1"),
        )
        for row in comparison
    )
    texts = {suffix: RENDERERS[form](table, comparison) for suffix, form in TABLE_FILES.items()}
    return Made({}, (run.name, library.reference(SECOND, other)), checks, texts)


ITEMS: dict[str, Item] = {
    "figure-3.1": Item(
        "A cylinder on its way to the partially everted one, N = 20: two opposite rulings, green, are turned "
        "by a quarter-turn each in 25 steps; k counts them.",
        (EVERSION,),
        _figure_3_1,
    ),
    "figure-3.2": Item(
        "The band cut along both green rulings, one half turned over, and joined again: the guess for the "
        "partially everted cylinder.",
        (EVERSION,),
        _figure_3_2,
    ),
    "figure-3.3": Item(
        "Geometry of the partially everted cylinder, b = 0.03, N = 160.", (EVERTED,), _figure_3_3
    ),
    "figure-3.4": Item("Its Lagrange multipliers.", (EVERTED,), _figure_3_4),
    "figure-3.5": Item("Its shape.", (EVERTED,), _figure_3_5),
    "figure-3.6": Item(
        "From the cylinder to a guess for the pi-twisted band, N = 50, b = 0.1: the seam, green, is open and "
        "is turned by half a turn.",
        (PI,),
        _figure_3_6,
    ),
    "figure-3.7": Item("Pi-twisted bands, b = 0.3 and b = 1.5, N = 400.", (PI,), _figure_3_7),
    "figure-3.8": Item("Geometry of the two pi-twisted bands.", (PI,), _figure_3_8),
    "figure-3.9": Item("Their Lagrange multipliers.", (PI,), _figure_3_9),
    "figure-3.10": Item(
        "The construction of a 3 pi-twisted band from flat and cylindrical pieces, b = 0.3, N = 60.",
        (THREE, TWISTED),
        _figure_3_10,
    ),
    "figure-3.11": Item("3 pi-twisted bands, b = 0.3 and b = 0.65, N = 240.", (THREE,), _figure_3_11),
    "figure-3.12": Item("Geometry of the two 3 pi-twisted bands.", (THREE,), _figure_3_12),
    "figure-3.13": Item("Their Lagrange multipliers.", (THREE,), _figure_3_13),
    "figure-3.14": Item(
        "Sorted eigenvalues of the projected Hessian in the Euclidean metric, spread over [0, 1]: cylinders "
        "and pi-twisted bands; below, under the rule value-average, whose energy sees every move. "
        "figure-3.14-physical has the same states in the metric in which eigenvalues converge.",
        tuple(config for config, _, _ in SPECTRA.values()),
        _figure_3_14,
    ),
    "table-3.1": Item(
        "Energy differences of pi-twisted bands under refinement, beside the published numbers.",
        (TABLE, SECOND),
        _table_3_1,
    ),
}
"""Everything that `make paper` makes, in the thesis's order."""
